# SPDX-License-Identifier: MIT
"""Standing: where the outlines of things end in a scan: at the border, at occluders, at what they touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.backs import separation_limits as limits
from completion.backs.separation import wraps
from completion.evidence.evidence import Scans
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled

BORDER, OCCLUDER, FREE, UNKNOWN, ROOM = 2, 1, 3, 4, 5
RANK = (0, 4, 5, 3, 2, 1)  # of the ends on the four sides of a pixel: the one with the highest is told


@dataclass(frozen=True, slots=True, eq=False)
class ScanOutline:
    """The pixels on the outlines of things in one scan, and how the things end there.

    Attributes
    ----------
    pixels : (m,) int64
        Flat pixels, ascending.
    ends : (3, m) uint8
        How they end on any side, upwards, and downwards: at the border (2), behind an occluder (1), before
        something farther (3), where nothing came back (4), in what is no thing (5), or not at all (0).
    """

    pixels: IntArray
    ends: NDArray[np.uint8]

    def at(self, pixels: IntArray) -> IntArray:
        """Which of the outline are among flat pixels (n,), ascending."""
        return np.flatnonzero(np.isin(self.pixels, pixels, assume_unique=True))

    def cut(self, pixels: IntArray) -> tuple[bool, bool]:
        """Tell whether a thing with flat pixels (n,) is cut by the border, and by an occluder."""
        ends = self.ends[0, self.at(pixels)]
        least = max(limits.CUT_PIXELS, limits.CUT_SHARE * np.count_nonzero(ends))
        border, occluder = (bool(np.count_nonzero(ends == end) >= least) for end in (BORDER, OCCLUDER))
        return border, occluder


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """The outlines of n things in all scans.

    Attributes
    ----------
    each : tuple of ScanOutline
        In each scan.
    occluded : (n + 1, n + 1) int64
        How many pixels of each thing, from 1, end behind which other; 0 for what is no thing.
    touching : (n + 1, n + 1) int64
        How many end at the same depth as the next one beside.
    """

    each: tuple[ScanOutline, ...]
    occluded: IntArray
    touching: IntArray

    @classmethod
    def of(cls, things: Sequence[Sequence[IntArray]], scans: Scans, up: FloatArray) -> Outlines:
        """Look at things by the flat pixels of each in each scan; `up` (3,) in the working frame."""
        occluded, touching = (np.zeros((len(things) + 1,) * 2, np.int64) for _ in range(2))
        each = []
        for number, seen in enumerate(scans.observations):
            label = np.zeros(seen.scan.shape, np.int32)
            for k, pixels in enumerate(things, start=1):
                label.ravel()[pixels[number]] = k
            ranges = seen.scan.ranges
            slack = limits.STEEP * seen.scan.projection.pixel_angle * np.where(seen.valid, ranges, 0.0)
            slack += limits.N_SIGMA * np.sqrt(2) * seen.noise.deviation(ranges.ravel()).reshape(ranges.shape)
            rows, columns = (np.append(np.flatnonzero(seen.valid.any(axis=k)), 0) for k in (1, 0))
            bounds = np.array([rows.min(), rows.max(), columns.min(), columns.max()])
            ends = np.zeros((3, *label.shape), dtype=np.uint8)
            ways = np.array([limits.SIDE_PX, _way_up(seen, up), wraps(seen)])
            _look(ranges, label, slack, bounds, ways, ends, occluded, touching)
            border = np.flatnonzero(ends.any(axis=0))
            each.append(ScanOutline(border, ends.reshape(3, -1)[:, border]))
        return cls(tuple(each), occluded, touching)


def _way_up(seen: Observation, up: FloatArray) -> int:
    """Which of the four neighbours of pixels is above them, as `_look` counts: below, above, right, left."""
    right, down, _ = up @ seen.scan.world_from_sensor.rotation
    if seen.scan.projection.kind == "spherical" or abs(down) >= abs(right):
        return 1 if down <= 0 or seen.scan.projection.kind == "spherical" else 0
    return 2 if right > 0 else 3


@compiled
def _look(
    ranges: FloatArray,
    label: NDArray[np.int32],
    slack: FloatArray,
    bounds: NDArray[np.int64],
    ways: NDArray[np.int64],
    ends: NDArray[np.uint8],
    occluded: NDArray[np.int64],
    touching: NDArray[np.int64],
) -> None:
    """Tell of each labelled pixel by its four sides how the thing ends there.

    `ways`: pixels up to which is looked, which side is above, whether columns wrap around.
    """
    across, above, columns = ways[0], ways[1], label.shape[1]
    for row in range(label.shape[0]):
        for column in range(label.shape[1]):
            own = label[row, column]
            if own == 0:
                continue
            end = 0
            for way in range(4):
                step_row = 1 if way == 0 else (-1 if way == 1 else 0)
                step_column = 1 if way == 2 else (-1 if way == 3 else 0)
                here = 4
                for step in range(1, across + 1):
                    r, c = row + step * step_row, column + step * step_column
                    if ways[2]:
                        c = c % columns
                    elif c < bounds[2] or c > bounds[3]:
                        here = 2
                        break
                    if r < bounds[0] or r > bounds[1]:
                        here = 2
                        break
                    if not np.isfinite(ranges[r, c]):
                        continue
                    other = label[r, c]
                    most = max(slack[row, column], slack[r, c])
                    nearer = ranges[row, column] - ranges[r, c]
                    if other == own:
                        here = 0
                    elif nearer > most:
                        here = 1
                        occluded[own, other] += 1
                    elif nearer > -most:
                        here = 5 if other == 0 else 0
                        touching[own, other] += 1
                    else:
                        here = 3
                    break
                if here == 4:  # nothing came back from there on, up to the border
                    r, c = row + 4 * across * step_row, column + 4 * across * step_column
                    is_aside = ways[2] == 0 and (c < bounds[2] or c > bounds[3])
                    here = 2 if is_aside or r < bounds[0] or r > bounds[1] else 4
                if way == above:
                    ends[1, row, column] = here
                if way == above ^ 1:
                    ends[2, row, column] = here
                if RANK[here] > RANK[end]:
                    end = here
            ends[0, row, column] = end
