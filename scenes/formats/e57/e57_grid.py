# SPDX-License-Identifier: MIT
"""Grid of an E57 scan: points sorted into their pixels by chunks, and the projection they have."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.formats.e57.e57_points import PointChunk
from scenes.formats.guard import check_size
from scenes.formats.header import colour_from_bytes, described, not_finite_warnings, projection_from_dict
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, fit_grid, lie_on_rays, organised_scan
from scenes.pose import Pose
from scenes.scan.pixels import ranges_of
from scenes.scan.range_image import RangeImage

if TYPE_CHECKING:
    from scenes.scan.ray_grid import RayGrid

_SENSOR_FROM_SCANNER = SCANNER_FROM_SENSOR.inverse()
_MOST_INDEX = 2**31
_SPARSE, _FEW = 1000, 1_000_000  # pixels for each point, and in all cases, beyond which no image is made


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
    image = partial(_images, shape=(rows, columns), first=first)
    found = {} if projection is None else image(chunks(), rays=projection.ray_grid())
    held = found or image(chunks())
    about: dict[str, Any] = {key: held.get(key) for key in ("colour", "intensity")} | {"name": name}
    about["world_from_sensor"] = pose @ SCANNER_FROM_SENSOR
    place = held["place"]
    if projection is not None and found:
        scan = RangeImage(place, projection, **about)
    else:
        scan = organised_scan(place, projection or fit_grid(place).projection, **about)
    n_more = seen.n_kept - int(np.count_nonzero(np.isfinite(place if found else place[..., 0])))
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    warnings = seen.warnings + several
    scan = described(scan, ours)
    return replace(scan, warnings=warnings) if warnings else scan


def _images(
    chunks: Iterable[PointChunk],
    shape: tuple[int, int],
    first: NDArray[np.int64],
    rays: RayGrid | None = None,
) -> dict[str, NDArray[Any]]:
    """Sort points, and what else they have, into read-only images whose first pixel has indices `first`.

    "place" is the points of the sensor's frame, NaN for none; or with `rays` their ranges, inf for none, and
    nothing is returned when a point lies beside its ray. "colour" and "intensity" are black and 0 for none.
    """
    images, n_pixels = dict[str, Any](), shape[0] * shape[1]
    for chunk in chunks:
        row, column = chunk.pixels - first[:, None]
        place: NDArray[Any] = _SENSOR_FROM_SCANNER.apply(chunk.points)
        if rays is not None:
            place, points = ranges_of(place), place
            if not (np.isfinite(place).all() and lie_on_rays(points, place, rays.at(row, column))):
                return {}
        colour = None if chunk.colour is None else colour_from_bytes(chunk.colour)
        found = {"place": place, "colour": colour, "intensity": chunk.intensity}
        known = {name: values for name, values in found.items() if values is not None}
        if not images:
            images = {name: np.zeros((n_pixels, *one.shape[1:]), np.float32) for name, one in known.items()}
            kind, empty = (chunk.points.dtype, np.nan) if rays is None else (place.dtype, np.inf)
            images["place"] = np.full((n_pixels, *place.shape[1:]), empty, kind)
        pixel, held = row * shape[1] + column, images["place"]
        new = ~np.isfinite(held[pixel] if held.ndim == 1 else held[pixel, 0])
        for name, values in known.items():  # backwards: the first of several is written last
            images[name][pixel[new][::-1]] = values[new][::-1]
    images = {name: image.reshape(*shape, *image.shape[1:]) for name, image in images.items()}
    for image in images.values():
        image.base.setflags(write=False)
        image.setflags(write=False)
    return images
