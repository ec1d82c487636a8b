# SPDX-License-Identifier: MIT
"""Grid of an E57 scan: points sorted into their pixels by chunks, and the projection they have."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, InputError
from scenes.formats.e57.e57_points import PointChunk
from scenes.formats.guard import check_size
from scenes.formats.header import described, not_finite_warnings, projection_from_dict
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, fit_grid, lie_on_rays, organised_scan
from scenes.pose import Pose
from scenes.run.mapping import allocate, release
from scenes.scan.pixels import ranges_of, row_blocks
from scenes.scan.range_image import RangeImage

if TYPE_CHECKING:
    from scenes.scan.ray_grid import RayGrid

_SENSOR_FROM_SCANNER = SCANNER_FROM_SENSOR.inverse()
_MOST_INDEX = 2**31
_SPARSE, _FEW = 1000, 1_000_000  # pixels for each point, and in all cases, beyond which no image is made
_CHUNKS_HELD = 10  # that memory holds pixels of: columns lie side by side in the same pages


@dataclass(frozen=True, slots=True)
class Survey:
    """What a first look at the points tells: their number, and the least and largest row and column."""

    n_kept: int
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    warnings: tuple[str, ...]


def survey(chunks: Iterable[PointChunk]) -> Survey:
    """Look through the points of a scan that has a grid."""
    n_kept = n_read = n_bad = 0
    low, high = np.full(2, _MOST_INDEX), np.zeros(2, np.int64)
    for chunk in chunks:
        n_kept, n_read, n_bad = n_kept + len(chunk.points), n_read + chunk.n_read, n_bad + chunk.n_bad
        low = np.minimum(low, chunk.pixels.min(axis=1, initial=_MOST_INDEX))
        high = np.maximum(high, chunk.pixels.max(axis=1, initial=0))
    return Survey(n_kept, low, high, not_finite_warnings(n_bad, n_read))


def gridded(
    chunks: Callable[[], Iterable[PointChunk]],
    seen: Survey,
    pose: Pose,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """Return the scan of points that were surveyed, which `chunks` gives anew, from a scanner at `pose`.

    Pixels are the file's own indices where a header says that it is of ours, less their minima where none
    does. Of several returns of a pixel the first is kept. Points on the rays of a known projection are held
    as ranges alone.

    Raises InputError: indices that are damaged, no projection that explains the points.
    """
    projection = None if ours is None else projection_from_dict(ours["projection"])
    first = seen.low if projection is None else np.zeros(2, np.int64)
    rows, columns = projection.shape if projection else (int(n) for n in seen.high - first + 1)
    check_size(rows, columns)
    if rows * columns > _SPARSE * seen.n_kept + _FEW:
        raise InputError(f"{seen.n_kept} points in a grid of {rows} x {columns}: are its indices damaged?")
    filled = np.zeros(rows * columns, np.bool_)
    image = partial(_images, filled=filled, shape=(rows, columns), first=first)
    found = {} if projection is None else image(chunks(), rays=projection.ray_grid())
    held = found or image(chunks())
    about: dict[str, Any] = {key: held.get(key) for key in ("colour", "intensity")} | {"name": name}
    about["world_from_sensor"] = pose @ SCANNER_FROM_SENSOR
    place = held["place"]
    if projection is not None and found:
        scan = RangeImage(place, projection, **about)
    else:
        scan = organised_scan(place, projection or fit_grid(place).projection, **about)
    n_more = seen.n_kept - int(np.count_nonzero(filled))
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    warnings = seen.warnings + several
    scan = described(scan, ours)
    return scan.restated(warnings=warnings) if warnings else scan


def _images(
    chunks: Iterable[PointChunk],
    filled: BoolArray,
    shape: tuple[int, int],
    first: NDArray[np.int64],
    rays: RayGrid | None = None,
) -> dict[str, NDArray[Any]]:
    """Sort points, and what else they have, into read-only images whose first pixel has indices `first`.

    "place" is the points of the sensor's frame, NaN for none; or with `rays` their ranges, inf for none, and
    nothing is returned when a point lies beside its ray. "colour", bytes, and "intensity" are black and 0
    for none. What flat pixels have a point is written to `filled`.
    """
    images = dict[str, Any]()
    filled[:] = False
    for number, chunk in enumerate(chunks, start=1):
        row, column = chunk.pixels - first[:, None]
        place: NDArray[Any] = _SENSOR_FROM_SCANNER.apply(chunk.points)
        if rays is not None:
            place, points = ranges_of(place), place
            if not (np.isfinite(place).all() and lie_on_rays(points, place, rays.at(row, column))):
                return {}
        found = {"place": place, "colour": chunk.colour, "intensity": chunk.intensity}
        known = {name: values for name, values in found.items() if values is not None}
        if not images:
            kinds = {"place": np.float64 if rays else chunk.points.dtype, "colour": np.uint8}
            images = {
                name: allocate((*shape, *one.shape[1:]), kinds.get(name, np.float32))
                for name, one in known.items()
            }
        pixel = row * shape[1] + column
        new = ~filled[pixel]
        filled[pixel] = True
        for name, values in known.items():  # backwards: the first of several is written last
            images[name].reshape(-1, *values.shape[1:])[pixel[new][::-1]] = values[new][::-1]
        if number % _CHUNKS_HELD == 0:
            release(*images.values())
    for rows in row_blocks(shape, *images.values()):
        images["place"][rows][~filled.reshape(shape)[rows]] = np.nan if rays is None else np.inf
    for image in images.values():
        image.setflags(write=False)
    return images
