# SPDX-License-Identifier: MIT
"""Beyond: how probably a plane goes on past the rectangle of what was measured, by what is known of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.extension.extent import Extent
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane
from texture.engine.compiled import compiled

KNOWN = (
    "log of the distance past the rectangle, in units of its side",
    "log of that distance in metres",
    "share of its outline where beams passed",
    "encloses the room",
    "level, and does not enclose",
    "level, and encloses",
    "share of that side along which beams passed",
    "share of that side that is hidden",
    "encloses, and another plane closes that side",
    "stands on what closes that side",
    "improbability by its edges, where its outline was seen to end",
)
"""What the probability depends on, in the order of `WEIGHTS`."""

WEIGHTS: FloatArray = np.array([
    -1.51, -0.24, -0.29, -0.46, 0.68, -0.63, 0.25, -0.13, 0.64, 0.28, 0.68, -0.99,
])  # fmt: skip
"""Constant, and weight of each of `KNOWN`, in the logarithm of the odds (Cox 1958).

The most likely ones on the generated rooms with seeds 1000 to 1015, the furnished flats with seeds 0 to 19
and the frames of a walk through a furnished storey, rounded (examples/calibrate_confidence.py).
"""

_NEAREST = 0.02  # added to distances before their logarithm is taken: nearer is as near
_RAGGED = 0.15  # of the rectangle: how far from its side the outermost cell of a line may lie
_WELL_SEEN = 0.3  # of the outline: from here on the surface's own edges tell what they can
_HALVINGS = 40  # of an interval of 40 in the logarithm
_LEAST_SIZE = 1e-9  # of a measured rectangle, metres


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """What was seen along the four sides of a rectangle, each (2, 2): low and high (rows) along u and v."""

    passed: FloatArray  # share of the lines across it beyond whose outermost measured cell beams passed
    hidden: FloatArray  # share of those beyond whose outermost cell it was hidden
    passed_outline: float  # share of the whole outline where beams passed

    @classmethod
    def of(cls, grid: ChartGrid, evidence: Evidence, extent: Extent) -> Sides:
        """Look at the cells next to what was measured of a plane."""
        passed, hidden = np.zeros((2, 2)), np.zeros((2, 2))
        occluded = evidence.labels == Label.OCCLUDED
        for axis, centres in enumerate(grid.axes()):
            measured, open_, behind = (
                cells if axis == 0 else cells.T for cells in (evidence.observed, evidence.open, occluded)
            )
            lines = np.flatnonzero(measured.any(axis=1))
            slack = _RAGGED * (extent.own_high - extent.own_low)[axis] + 2 * float(grid.cell.max())
            last = measured.shape[1] - 1
            for row, side in enumerate((extent.own_low, extent.own_high)):
                if row == 0:
                    beside = measured[lines].argmax(axis=1) - 1
                else:
                    beside = last + 1 - measured[lines][:, ::-1].argmax(axis=1)
                at = np.clip(beside, 0, last)
                counts = (beside == at) & (np.abs(centres[at] - side[axis]) <= slack)
                n_lines = max(len(lines), 1)
                free = open_[lines, at]
                passed[row, axis] = np.count_nonzero(counts & free) / n_lines
                hidden[row, axis] = np.count_nonzero(counts & ~free & behind[lines, at]) / n_lines
        return cls(passed, hidden, share_seen_to_end(evidence))


def share_seen_to_end(evidence: Evidence) -> float:
    """Share of the cells around what was measured that beams passed: how much of the outline is known."""
    outline = ndimage.binary_dilation(evidence.observed, np.ones((3, 3))) & ~evidence.observed
    return float(np.count_nonzero(evidence.open & outline)) / max(int(np.count_nonzero(outline)), 1)


def known_beyond(
    uv: FloatArray, base: FloatArray, extent: Extent, sides: Sides
) -> tuple[FloatArray, NDArray[np.int8]]:
    """Return `KNOWN` (n, 11) for places (n, 2) in a plane's chart, and the side that each is past.

    Of several sides it is the one that it is farthest past, in units of the rectangle's; `base` (n,) is the
    probability by the surface's edges. The side (n,) is 0 and 1 for low and high u, 2 and 3 for v, -1 for
    places within the rectangle.
    """
    own = np.array([extent.own_low, extent.own_high])
    side, past, past_m = _farthest_past(uv, own)
    row, axis = side % 2, side // 2
    well_seen = min(sides.passed_outline / _WELL_SEEN, 1.0)
    closed = np.isfinite(extent.ends)[row, axis]
    n, encloses, level = len(uv), float(extent.encloses), float(extent.is_level)
    goes_on = extent.end_probability[row, axis]
    return np.column_stack([
        np.log(past + _NEAREST),
        np.log(past_m + _NEAREST),
        np.full(n, sides.passed_outline),
        np.full(n, encloses),
        np.full(n, level * (1 - encloses)),
        np.full(n, level * encloses),
        sides.passed[row, axis],
        sides.hidden[row, axis],
        encloses * closed,
        (1 - encloses) * goes_on,
        (1 - base) * well_seen,
    ]), side  # fmt: skip


def as_far_as_probable(extent: Extent, least: float, weights: FloatArray = WEIGHTS) -> Extent:
    """Return the extent of a plane that ends where its probability surely falls below `least`.

    The bound holds whatever will be seen: what is not known yet has its most favourable value. There is none
    where the odds do not fall with the distance. `weights` (12,) are those of `WEIGHTS`.
    """
    if not isinstance(extent.chart, Plane) or (weights[1:3] > 0).any() or not (weights[1:3] < 0).any():
        return extent
    size = np.maximum(extent.own_high - extent.own_low, _LEAST_SIZE)
    closed, encloses, level = np.isfinite(extent.ends), float(extent.encloses), float(extent.is_level)
    known = np.zeros((2, 2, len(KNOWN)))
    known[..., [2, 6, 7, 10]] = weights[1:][[2, 6, 7, 10]] > 0
    known[..., 3], known[..., 4], known[..., 5] = encloses, level * (1 - encloses), level * encloses
    known[..., 8], known[..., 9] = encloses * closed, (1 - encloses) * extent.end_probability
    odds = weights[0] + known @ weights[1:] - np.log(least / (1 - least))

    # A place that is farthest past one side, in units of the rectangle's, may be past the one beside it too.
    beside = _farthest(odds.max(axis=0)[::-1], size.max(), weights)
    past = size * np.maximum(_farthest(odds, size, weights), beside)
    return replace(extent, reach=np.stack([extent.own_low - past[0], extent.own_high + past[1]]))


def _farthest(odds: FloatArray, size: FloatArray, weights: FloatArray) -> FloatArray:
    """How far past its side, in units of `size`, a place may be until its log odds fall to 0."""
    low, high = np.full(odds.shape, -20.0), np.full(odds.shape, 20.0)  # logarithms of the distance
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        past = np.exp(middle)
        left = odds + np.log(np.stack([past, past * size], axis=-1) + _NEAREST) @ weights[1:3]
        low, high = np.where(left > 0, middle, low), np.where(left > 0, high, middle)
    return np.asarray(np.exp(high))


def probability_beyond(known: FloatArray, weights: FloatArray = WEIGHTS) -> FloatArray:
    """Probability (n,) that the surface is there, from `KNOWN` (n, 11)."""
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)


@compiled
def _farthest_past(uv: FloatArray, own: FloatArray) -> tuple[NDArray[np.int8], FloatArray, FloatArray]:
    """The side (n,) of the rectangle `own` (2, 2) that places (n, 2) are farthest past, and how far.

    Distances (n,) are in units of the rectangle's side, and in metres; of the latter the largest counts.
    """
    n = len(uv)
    side, past, past_m = np.full(n, -1, np.int8), np.zeros(n), np.zeros(n)
    for i in range(n):
        for axis in range(2):
            size = max(own[1, axis] - own[0, axis], _LEAST_SIZE)
            for row in range(2):
                away = own[0, axis] - uv[i, axis] if row == 0 else uv[i, axis] - own[1, axis]
                if away > 0.0:
                    past_m[i] = max(past_m[i], away)
                    if side[i] < 0 or away / size > past[i]:
                        side[i], past[i] = 2 * axis + row, away / size
    return side, past, past_m
