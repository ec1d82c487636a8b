# SPDX-License-Identifier: MIT
"""Past the end: how probably a cylinder goes on along its axis beyond what was measured of it.

A pipe or a column vanishes behind something that stands clear before it. A limb, an arm of a chair or a stem
stops where it meets the next part: there the neighbouring beams went past it, or lie on it still.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.extension.extent import Extent
from scenes.checks import FloatArray

KNOWN_PAST_END = (
    "log of the distance past the end, in units of the measured length",
    "log of the sine between its axis and the nearest normal of a plane that closes it",
    "log of the radius' standard deviation, in units of the radius",
    "share of that end's boundary where the cylinder was seen to end",
)
"""What the probability depends on, in the order of `PAST_END`."""

PAST_END: FloatArray = np.array([-0.07, -0.31, -0.25, -0.29, -3.10])
"""Constant, and weight of each of `KNOWN_PAST_END`, in the logarithm of the odds (Cox 1958).

The most likely ones on the same rooms, flats and frames as `beyond.WEIGHTS`, rounded.
"""

_NEAREST = 0.02  # of the length: nearer is as near
_UPRIGHT = 0.02  # sine: axes nearer to a normal are as upright
_EXACT = 1e-3  # of the radius: radii that are known better are as well known
_LEAST_SIZE = 1e-9  # of a measured length, metres


@dataclass(frozen=True, slots=True, eq=False)
class PastEnds:
    """What n places on a cylinder have to do with its ends."""

    side: NDArray[np.int8]  # (n,) 0 past the low end, 1 past the high one, -1 between them
    known: FloatArray  # (n, 4) `KNOWN_PAST_END`

    @classmethod
    def of(cls, along: FloatArray, extent: Extent) -> PastEnds:
        """Look at places by their chart coordinate `along` (n,) the axis, metres."""
        low, high = extent.own_low[1], extent.own_high[1]
        side = np.where(along < low, 0, np.where(along > high, 1, -1)).astype(np.int8)
        past = np.maximum(np.maximum(low - along, along - high), 0.0) / max(high - low, _LEAST_SIZE)
        n = len(along)
        known = np.column_stack([
            np.log(past + _NEAREST),
            np.full(n, np.log(min(extent.tilt, 1.0) + _UPRIGHT)),
            np.full(n, np.log(extent.radius_sd + _EXACT)),
            extent.seen_ends[np.maximum(side, 0)],
        ])  # fmt: skip
        return cls(side, known)


def probability_past_end(known: FloatArray, weights: FloatArray = PAST_END) -> FloatArray:
    """Probability (n,) that the cylinder goes on to there, from `KNOWN_PAST_END` (n, 4)."""
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)
