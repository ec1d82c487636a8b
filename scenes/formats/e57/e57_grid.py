# SPDX-License-Identifier: MIT
"""Grid of an E57 scan: points sorted into their pixels by chunks, and the projection they have."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.formats.e57.e57_points import PointChunk
from scenes.formats.guard import check_size
from scenes.formats.header import described, not_finite_warnings, projection_from_dict
from scenes.formats.scans.grid_fit import SCANNER_FROM_SENSOR, fit_grid, lie_on_rays, organised_scan
from scenes.pose import Pose
from scenes.run.mapping import allocate, release
from scenes.scan.pixels import copied, ranges_of, row_blocks
from scenes.scan.range_image import RangeImage

if TYPE_CHECKING:
    from scenes.scan.projection import Projection
    from scenes.scan.ray_grid import RayGrid

_SENSOR_FROM_SCANNER = SCANNER_FROM_SENSOR.inverse()
_MOST_INDEX = 2**31
_SPARSE, _FEW = 1000, 1_000_000  # pixels for each point, and in all cases, beyond which no image is made
_CHUNKS_HELD = 10  # that memory holds pixels of: columns lie side by side in the same pages


@dataclass(slots=True)
class Survey:
    """What is seen of points that pass: their number, and the least and largest row and column."""

    n_kept: int = 0
    n_read: int = 0
    n_bad: int = 0
    low: NDArray[np.int64] = field(default_factory=lambda: np.full(2, _MOST_INDEX))
    high: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2, np.int64))

    def see(self, chunk: PointChunk) -> None:
        """Count the points of a chunk that has pixels."""
        self.n_kept, self.n_read = self.n_kept + len(chunk.points), self.n_read + chunk.n_read
        self.n_bad += chunk.n_bad
        self.low = np.minimum(self.low, chunk.pixels.min(axis=1, initial=_MOST_INDEX))
        self.high = np.maximum(self.high, chunk.pixels.max(axis=1, initial=0))


class _BeyondError(Exception):
    """A point has a pixel beyond what was announced."""


def gridded(
    chunks: Callable[..., Iterable[PointChunk]],
    announced: Survey,
    pose: Pose,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """Return the scan of the points that `chunks` gives, anew each time, from a scanner at `pose`.

    Pixels are the file's own indices where a header says that it is of ours, less their minima where none
    does. Of several returns of a pixel the first is kept. Points on the rays of a known projection are held
    as ranges alone. The bounds that are `announced` save a look at the points; where they are none, or are
    wrong, that look is taken.

    Raises InputError: no valid point, indices that are damaged, no projection that explains the points.
    """
    projection = None if ours is None else projection_from_dict(ours["projection"])
    if projection is not None:
        announced.low, announced.high = np.zeros(2, np.int64), np.array(projection.shape) - 1
    size = [int(n) for n in announced.high - announced.low + 1]
    if min(size) > 0 and size[0] * size[1] <= _SPARSE * announced.n_kept + _FEW:
        try:
            return _gridded(chunks, announced, projection, pose, name=name, ours=ours)
        except _BeyondError:
            pass
    seen = Survey()
    for chunk in chunks(places_alone=True):
        seen.see(chunk)
    if not seen.n_kept:
        raise InputError(f"{name}: has no valid point")
    if projection is not None and (seen.high >= projection.shape).any():
        raise InputError(
            f"its rows and columns reach {seen.high.tolist()}, its header says {projection.shape}"
        )
    bounds = seen if projection is None else announced
    rows, columns = (int(n) for n in bounds.high - bounds.low + 1)
    check_size(rows, columns)
    if rows * columns > _SPARSE * seen.n_kept + _FEW:
        raise InputError(f"{seen.n_kept} points in a grid of {rows} x {columns}: are its indices damaged?")
    return _gridded(chunks, bounds, projection, pose, name=name, ours=ours)


def _gridded(
    chunks: Callable[..., Iterable[PointChunk]],
    bounds: Survey,
    projection: Projection | None,
    pose: Pose,
    name: str,
    ours: dict[str, Any] | None,
) -> RangeImage:
    """The scan of points whose pixels are within bounds, which are those of a projection that is known."""
    rays = None if projection is None else projection.ray_grid()
    held = _images(chunks(), bounds, rays) if rays is not None else None
    is_on_rays = held is not None
    if held is None:
        held = _images(chunks(), bounds, None)
    if held is None or not held.images:
        raise InputError(f"{name}: has no valid point")
    images, seen = held.images, held.seen
    if projection is None:
        images = {key: _cropped(image, bounds, seen) for key, image in images.items()}
    about: dict[str, Any] = {key: images.get(key) for key in ("colour", "intensity")} | {"name": name}
    about["world_from_sensor"] = pose @ SCANNER_FROM_SENSOR
    place = images["place"]
    if projection is not None and is_on_rays:
        scan = RangeImage(place, projection, **about)
    else:
        scan = organised_scan(place, projection or fit_grid(place).projection, **about)
    n_more = seen.n_kept - held.n_filled
    several = (f"{n_more} further returns of pixels with several were left out",) if n_more else ()
    warnings = not_finite_warnings(seen.n_bad, seen.n_read) + several
    scan = described(scan, ours)
    return scan.restated(warnings=warnings) if warnings else scan


def _cropped(image: NDArray[Any], bounds: Survey, seen: Survey) -> NDArray[Any]:
    """The part of an image, whose pixels are within bounds, that has points."""
    first, last = seen.low - bounds.low, seen.high - bounds.low + 1
    rows, columns = slice(first[0], last[0]), slice(first[1], last[1])
    part: NDArray[Any] = image[rows, columns]
    if part.flags.c_contiguous:
        return part
    copy: NDArray[Any] = copied(part)
    copy.setflags(write=False)
    return copy


class _Held(NamedTuple):
    """Read-only images by name, what was seen of the points in them, and how many pixels have one."""

    images: dict[str, NDArray[Any]]
    seen: Survey
    n_filled: int


def _images(chunks: Iterable[PointChunk], bounds: Survey, rays: RayGrid | None) -> _Held | None:
    """Sort points, and what else they have, into images of the pixels within bounds.

    "place" is the points of the sensor's frame, NaN for none; or with `rays` their ranges, inf for none, and
    nothing is returned when a point lies beside its ray. "colour", bytes, and "intensity" are black and 0
    for none. Raises _BeyondError: a pixel is not within bounds.
    """
    images, seen, shape = dict[str, Any](), Survey(), tuple(int(n) for n in bounds.high - bounds.low + 1)
    check_size(*shape)
    filled = np.zeros(shape[0] * shape[1], np.bool_)
    for number, chunk in enumerate(chunks, start=1):
        seen.see(chunk)
        if seen.n_kept and ((seen.low < bounds.low).any() or (seen.high > bounds.high).any()):
            raise _BeyondError
        row, column = chunk.pixels - bounds.low[:, None]
        place: NDArray[Any] = _SENSOR_FROM_SCANNER.apply(chunk.points)
        if rays is not None:
            place, points = ranges_of(place), place
            if not (np.isfinite(place).all() and lie_on_rays(points, place, rays.at(row, column))):
                return None
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
    if not seen.n_kept:
        return _Held({}, seen, 0)
    for rows in row_blocks(shape, *images.values()):
        images["place"][rows][~filled.reshape(shape)[rows]] = np.nan if rays is None else np.inf
    for image in images.values():
        image.setflags(write=False)
    return _Held(images, seen, int(np.count_nonzero(filled)))
