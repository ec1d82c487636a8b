# SPDX-License-Identifier: MIT
"""Returns: the points of a scan of ours as files hold them, each with its pixel and number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError, IntArray
from scenes.io.formats.grid_fit import organised_scan
from scenes.io.formats.header import apply_header, not_finite_warnings, pose_from_header, projection_from_dict
from scenes.run.mapping import allocate, release
from scenes.scan.colour import colour_bytes
from scenes.scan.echoes import Echoes
from scenes.scan.pixels import ranges_of
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class ScanReturns:
    """The returns of a scan, row by row.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres.
    row, column : (n,) int64
        The pixel of each.
    colour : (n, 3) uint8, optional
        sRGB; of further returns that of their pixel.
    intensity : (n,) float32, optional
        On the instrument's scale.
    number, count : (n,) int64, optional
        Of each among the returns of its beam, from 1, and how many these are; None where all are first ones.
    """

    points: FloatArray
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    colour: ColourArray | None = None
    intensity: NDArray[np.float32] | None = None
    number: IntArray | None = None
    count: IntArray | None = None


def cloud_of(scan: RangeImage, *, all_returns: bool = False) -> ScanReturns:
    """Return the first returns of a scan, or all that it has, those of a beam one after the other.

    Raises InputError: there is none: a file of points cannot hold an empty grid.
    """
    if not scan.valid.any():
        raise InputError(f"scan {scan.name!r} has no return; a file of points would be empty, use .npz")
    pixel, points = np.flatnonzero(scan.valid), scan.points()[scan.valid]
    light = None if scan.intensity is None else scan.intensity[scan.valid]
    number = count = None
    more = scan.echoes if all_returns else None
    if more is not None:
        order = np.argsort(np.concatenate([pixel, more.pixel]), kind="stable")
        n_more = np.bincount(more.pixel, minlength=scan.valid.size)[pixel]
        pixel = np.concatenate([pixel, more.pixel])[order]
        points = np.concatenate([points, scan.echo_points()])[order]
        number = np.concatenate([np.ones(len(n_more), np.int64), more.number])[order]
        count = np.concatenate([n_more + 1, more.count])[order]
        if light is not None and more.intensity is not None:
            light = np.concatenate([light, more.intensity])[order]
        else:
            light = None
    row, column = np.divmod(pixel, scan.shape[1])
    colour = None if scan.colour is None else colour_bytes(scan.colour.reshape(-1, 3)[pixel])
    return ScanReturns(points, row, column, colour, light, number=number, count=count)


class FurtherReturns:
    """Further returns of a scan, gathered while its points are read."""

    def __init__(self) -> None:
        self._parts: list[tuple[Any, ...]] = []

    def gather(self, pixel: IntArray, points: FloatArray, number: IntArray, light: Any) -> None:
        """Keep the pixels (n,), ranges of sensor-frame points (n, 3), numbers from 1 and light of some."""
        zero = np.zeros(len(pixel), np.float32) if light is None else light
        self._parts.append((pixel, ranges_of(points), number, zero))

    def put_in(self, scan: RangeImage, *, has_light: bool) -> tuple[RangeImage, int]:
        """Return the scan with its further returns, and how many of them have no first one, and are left."""
        if not self._parts:
            return scan, 0
        pixel, ranges, number, light = (np.concatenate(column) for column in zip(*self._parts, strict=True))
        order = np.lexsort((number, pixel))
        taken = ranges == scan.ranges.reshape(-1)[pixel]  # in the image, where a file has no first return
        order = order[np.isfinite(ranges[order]) & ~taken[order]]
        echoes = Echoes(pixel[order], ranges[order], light[order] if has_light else None)
        held = echoes.within(scan.valid)
        return scan.with_facts(echoes=held), len(echoes) - len(held)


def scan_of(header: Mapping[str, Any], n_points: int, parts: Iterable[ScanReturns]) -> RangeImage:
    """Return the scan that a cloud of `n_points` with that header was made of, given part after part.

    Raises InputError: pixels outside the image that the header describes, or two first returns in one.
    """
    projection, pose = projection_from_dict(header["projection"]), pose_from_header(dict(header))
    rows, columns = projection.shape
    if rows * columns > 1000 * n_points + 1_000_000:
        raise InputError(f"{n_points} points in a grid of {rows} x {columns}: is its header damaged?")
    points, seen = allocate((rows, columns, 3), np.float64, np.nan), np.zeros((rows, columns), np.bool_)
    colour = light = None
    sensor_from_world, n_bad, further = pose.inverse(), 0, FurtherReturns()
    for part in parts:
        pixel = part.row * columns + part.column
        inside = (part.row >= 0) & (part.row < rows) & (part.column >= 0) & (part.column < columns)
        first = np.ones(len(pixel), np.bool_) if part.number is None else part.number <= 1
        at = part.row[first], part.column[first]
        if not inside.all() or seen[at].any() or len(np.unique(pixel[first])) < int(first.sum()):
            raise InputError(
                f"its points do not each have a pixel of their own in {rows} x {columns}: was the file "
                "edited? say where the scanner stood (--origin X,Y,Z)"
            )
        places = sensor_from_world.apply(part.points)
        seen[at], points[at] = True, places[first]
        n_bad += int((~np.isfinite(part.points).all(axis=1)).sum())
        if part.colour is not None:
            colour = allocate((rows, columns, 3), np.uint8) if colour is None else colour
            colour[at] = part.colour[first]
        if part.intensity is not None:
            light = allocate((rows, columns), np.float32) if light is None else light
            light[at] = part.intensity[first]
        if part.number is not None:
            later = None if part.intensity is None else part.intensity[~first]
            further.gather(pixel[~first], places[~first], part.number[~first], later)
        release(points, colour, light)
    for image in (points, colour, light):
        if image is not None:
            image.setflags(write=False)
    scan = organised_scan(
        points, projection, world_from_sensor=pose, colour=colour, name="scan", intensity=light
    )
    scan, n_left = further.put_in(scan, has_light=light is not None)
    told = (f"{n_left} further returns of pixels without a first one were left out",) if n_left else ()
    return apply_header(scan, dict(header)).add_warnings((*not_finite_warnings(n_bad, n_points), *told))
