# SPDX-License-Identifier: MIT
"""Key frames: of a sequence, whose frames mostly see the same again, those that show something new."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim

FEW = 64
"""Scans up to which each is a key frame."""

_ACROSS = 40  # pixels along the longer side of an image that are looked at, about
_CELLS_ACROSS = 16  # into which the view of the longer side is cut at the median range
_NEW = 0.2  # of what a frame measured: where more is new, it is a key frame
_FINER = 2.0  # times as fine as before: from so much nearer what was seen is new


def find_key_frames(observations: Sequence[Observation]) -> tuple[int, ...]:
    """Return the numbers, ascending, of the scans that show something new; all of them where they are few.

    Scans are taken in their order. One is a key frame if more than a fifth of what it measured is new: no key
    frame before it measured something in the same cell of space, from the same of six sides, and half as
    finely at least. Cells are as wide as a sixteenth of the view at the median range of all scans. With four
    fifths known, most of what is seen at all is in several key frames.
    """
    if len(observations) <= FEW:
        return tuple(range(len(observations)))
    pixels = [_some_pixels(seen) for seen in observations]
    far = np.concatenate([_ranges(seen, some) for seen, some in zip(observations, pixels, strict=True)])
    if not len(far):
        return tuple(range(len(observations)))
    angle = np.median([max(seen.scan.shape) * seen.scan.projection.pixel_angle for seen in observations])
    size, keys, finest = float(np.median(far) * angle / _CELLS_ACROSS), [], dict[tuple[int, ...], float]()
    for number, (seen, some) in enumerate(zip(observations, pixels, strict=True)):
        footprint = (_ranges(seen, some) * seen.scan.projection.pixel_angle).tolist()
        cells = list(map(tuple, _cells(seen, some, size).tolist()))
        known = [finest.get(cell, np.inf) for cell in cells]
        new = [width * _FINER < before for width, before in zip(footprint, known, strict=True)]
        if sum(new) > _NEW * len(new):
            keys.append(number)
            for cell, width in zip(cells, footprint, strict=True):
                finest[cell] = min(finest.get(cell, np.inf), width)
    return tuple(keys)


def _some_pixels(seen: Observation) -> IntArray:
    """Flat pixels (n,) that brought something back, evenly over the image."""
    trim()
    rows, columns = seen.scan.shape
    step = max(max(rows, columns) // _ACROSS, 1)
    flat = np.arange(step // 2, rows, step)[:, None] * columns + np.arange(step // 2, columns, step)
    return np.asarray(flat[np.isfinite(seen.scan.ranges.ravel()[flat])])


def _ranges(seen: Observation, some: IntArray) -> FloatArray:
    trim()
    return np.asarray(seen.scan.ranges.ravel()[some])


def _cells(seen: Observation, pixels: IntArray, size: float) -> NDArray[np.int64]:
    """The cell of each point (n, 4): where it is, and from which side it is seen."""
    rays = seen.rays_at(pixels)
    axis = np.argmax(np.abs(rays), axis=1)
    side = 2 * axis + (rays[np.arange(len(rays)), axis] > 0)
    place = np.floor(seen.points_at(pixels) / size)
    return np.concatenate([place, side[:, None]], axis=1).astype(np.int64)
