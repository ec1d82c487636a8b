# SPDX-License-Identifier: MIT
"""Standing: where the outlines of things end in a scan: at the border, at occluders, at what they touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.backs import separation_limits as limits
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled

BORDER, OCCLUDER, FREE, UNKNOWN, ROOM = 2, 1, 3, 4, 5
RANK = (0, 4, 5, 3, 2, 1)  # of the ends on the four sides of a pixel: the one with the highest is told


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The outlines of n things in one scan.

    Attributes
    ----------
    ends : (rows * columns,) uint8
        Of each pixel on the outline of a thing, whether it is cut by the border (2) or by an occluder (1), or
        ends before something farther (3) or where nothing came back (4), or goes
        on into what is no thing (5); 0 of others.
    above, below : (rows * columns,) uint8
        The same of pixels on the outline, by what is next to them upwards and downwards only.
    occluded : (n + 1, n + 1) int64
        How many pixels of each thing, from 1, end behind which other; 0 for what is no thing.
    touching : (n + 1, n + 1) int64
        How many end at the same depth as the next one beside.
    """

    ends: NDArray[np.uint8]
    above: NDArray[np.uint8]
    below: NDArray[np.uint8]
    occluded: IntArray
    touching: IntArray

    @classmethod
    def of(cls, seen: Observation, label: NDArray[np.int32], n_things: int, up: FloatArray) -> Outline:
        """Look at outlines by the thing, from 1, of each pixel (rows, columns), and what is `up` (3,)."""
        ranges, angle = seen.scan.ranges, seen.scan.projection.pixel_angle
        slack = limits.STEEP * angle * np.where(seen.valid, ranges, 0.0)
        slack += limits.N_SIGMA * np.sqrt(2.0) * seen.noise.deviation(ranges.ravel()).reshape(ranges.shape)
        rows, columns = (np.flatnonzero(seen.valid.any(axis=axis)) for axis in (1, 0))
        bounds = np.array(
            [rows.min(), rows.max(), columns.min(), columns.max()] if len(rows) else [0, 0, 0, 0]
        )
        ends = np.zeros((3, *label.shape), dtype=np.uint8)
        occluded, touching = (np.zeros((n_things + 1, n_things + 1), np.int64) for _ in range(2))
        _look(ranges, label, slack, bounds, limits.SIDE_PX, _way_up(seen, up), ends, occluded, touching)
        return cls(ends[0].ravel(), ends[1].ravel(), ends[2].ravel(), occluded, touching)

    def cut(self, pixels: IntArray) -> tuple[bool, bool]:
        """Tell whether a thing with flat pixels (n,) is cut by the border, and by an occluder."""
        ends = self.ends[pixels]
        least = max(limits.CUT_PIXELS, limits.CUT_SHARE * np.count_nonzero(ends))
        return (
            bool(np.count_nonzero(ends == BORDER) >= least),
            bool(np.count_nonzero(ends == OCCLUDER) >= least),
        )


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
    across: int,
    above: int,
    ends: NDArray[np.uint8],
    occluded: NDArray[np.int64],
    touching: NDArray[np.int64],
) -> None:
    """Tell of each labelled pixel by its four sides how the thing ends there."""
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
                    if r < bounds[0] or r > bounds[1] or c < bounds[2] or c > bounds[3]:
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
                if way == above:
                    ends[1, row, column] = here
                if way == above ^ 1:
                    ends[2, row, column] = here
                if RANK[here] > RANK[end]:
                    end = here
            ends[0, row, column] = end
