# SPDX-License-Identifier: MIT
"""Saturation: ranges that only say that an instrument's number was full, taken as no return."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from scenes.checks import BoolArray, FloatArray
from scenes.scan.pixels import mended, row_blocks
from scenes.scan.range_image import RangeImage

_CLOSE = 1e-3  # relative: codes for "no return" lie so close to the fullest number
_SAME = 1e-5  # relative: what files round away
_MOST_CODES, _LEAST_TIMES = 8, 20  # different ones, and how often each must be there
_GAP = 1.2  # from the farthest real range to the codes
_STRAYS = 0.05  # of as many numbers as codes may lie in between
_SPREAD = 5  # rows and columns: a true distance that comes again and again does so in one place


def saturation_start(ranges: FloatArray) -> float:
    """Return the least of the saturated among the finite numbers of an image (rows, columns), or of (n,).

    It is inf where there is none. They are the largest, at most eight different ones within 0.1 % of the
    largest, each there 20 times or more; most ranges are nearer than them by a sixth, with a twentieth as
    many strays in between.
    """
    n_known, most = 0, 0.0
    for known in _finite(ranges):
        n_known, most = n_known + len(known), max(most, float(known.max(initial=0.0)))
    if n_known < _LEAST_TIMES:
        return np.inf
    n_far, tops = 0, []
    for known in _finite(ranges):
        far = known[known >= most / _GAP]
        n_far += len(far)
        tops.append(far[far >= (1 - _CLOSE) * most])
    top = np.sort(np.concatenate(tops))
    if not _LEAST_TIMES <= len(top) < n_known / 2 or n_far - len(top) > _STRAYS * len(top):
        return np.inf
    group = np.concatenate([[0], np.cumsum(np.diff(top) > _SAME * most)])
    times = np.bincount(group)
    if len(times) > _MOST_CODES or times.min() < _LEAST_TIMES:
        return np.inf
    return float(top[0])


def _finite(ranges: FloatArray) -> Iterator[FloatArray]:
    """The finite ranges, some at a time."""
    column = ranges.reshape(-1, 1)
    for rows in row_blocks(column.shape, column):
        yield column[rows][np.isfinite(column[rows])]


def saturation_warning(n_saturated: int, start: float, n_ranges: int) -> str:
    """Say how many ranges were left out as saturated; `start` is the least of them, in the file's unit."""
    return (
        f"{n_saturated} of {n_ranges} ranges are {start:.7g} or hardly more, over and over and far beyond "
        "all others: numbers for no return, and left out"
    )


def without_saturated(scan: RangeImage) -> RangeImage:
    """Return the scan with saturated ranges as no return, counted in its warnings."""
    start = saturation_start(scan.ranges)
    if start == np.inf:
        return scan
    full = scan.valid & (scan.ranges >= start)
    if min(np.count_nonzero(full.any(axis=k)) for k in (0, 1)) < _SPREAD:
        return scan
    told = saturation_warning(int(full.sum()), start, int(scan.valid.sum()))
    points = scan.sensor_points

    def is_full(rows: slice, _held: FloatArray) -> BoolArray:
        return full[rows]

    return replace(
        scan,
        ranges=mended(scan.ranges, scan.ranges.dtype, is_full, np.inf),
        sensor_points=None if points is None else mended(points, points.dtype, is_full, np.nan),
        warnings=(*scan.warnings, told),
    )
