# SPDX-License-Identifier: MIT
"""Beyond: how probably a plane goes on past the rectangle of what was measured, by what is known of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from completion.extension.extent import Extent
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane
from texture.engine.compiled import compiled


class Role(IntEnum):
    """What a plane is to the room, and which of its sides a place is past."""

    FLOOR = 0  # past any side
    CEILING = 1
    DOWN = 2  # walls, past the lower side
    ASIDE = 3
    UP = 4
    THING_LEVEL = 5  # planes that do not enclose the room: seats and table tops, past any side
    THING_DOWN = 6
    THING_ASIDE = 7  # or up


KNOWN = (
    "log of the distance past the rectangle, in units of its side",
    "log of that distance in metres",
    "log of how far past another side as well, over none, in units of that side",
    "improbability by its edges",
    "share of its outline where beams passed",
    "share of that side along which beams passed",
    "share of that side that is hidden",
    "whether a plane that encloses the room closes that side",
    "how probably it stands on what closes that side",
)
"""What the probability depends on, in the order of `WEIGHTS`. It never grows with the first six."""

N_FALLING = 6

WEIGHTS: FloatArray = np.array([
    [-0.14, -0.36, -0.55, -0.49, -3.31, -5.17,  0.00,  2.31,  0.49, 0.00],
    [ 0.56,  0.00, -0.40, -0.90, -7.28, -2.33, -1.48, -2.66, -1.76, 0.00],
    [-2.27,  0.00, -0.69, -0.37, -1.82, -4.74, -2.46,  2.64,  2.21, 0.00],
    [ 0.77,  0.00, -0.16, -0.54, -2.14, -2.12,  0.00, -1.19,  0.24, 0.00],
    [-3.35,  0.00, -1.16,  0.00,  0.00, -2.32, -1.24,  0.64,  0.55, 0.00],
    [-2.05,  0.00, -0.48, -0.20, -0.80,  0.00,  0.00,  2.03, -0.43, 0.15],
    [-0.40, -0.19,  0.00, -0.34, -0.51, -0.34, -0.37,  0.51, -0.54, 1.06],
    [-1.33, -0.25, -0.18, -0.10, -0.87, -0.30,  0.00,  0.73, -0.57, 1.85],
])  # fmt: skip
"""Constant (n_roles, 0) and weight of each of `KNOWN`, in the logarithm of the odds (Cox 1958), by `Role`.

The most likely ones on the generated rooms with seeds 1000 to 1015, the furnished flats with seeds 0 to 19
and the frames of a walk through a furnished storey, rounded (examples/calibrate_confidence.py).
"""

_NEAREST = 0.02  # added to distances before their logarithm is taken: nearer is as near
_RAGGED = 0.15  # of the rectangle: how far from its side the outermost cell of a line may lie
_WELL_SEEN = 0.3  # of the outline: from here on the surface's own edges tell what they can
_STEEPEST = float(np.sqrt(0.5))  # of the rise: within 45 degrees of the steepest way
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


@dataclass(frozen=True, slots=True, eq=False)
class PastSides:
    """What n places on a plane have to do with the sides of its measured rectangle."""

    side: NDArray[np.int8]  # (n,) 0 and 1 past the low and high side along u, 2 and 3 v; -1 past none
    role: NDArray[np.int8]  # (n,) a `Role`; of no use past none
    known: FloatArray  # (n, 9) `KNOWN`; of no use past none


def past_sides(uv: FloatArray, base: FloatArray, extent: Extent, sides: Sides) -> PastSides:
    """Look at places (n, 2) in a plane's chart.

    Of several sides that a place is past, the one counts that it is farthest past, in units of the
    rectangle's. `base` (n,) is the probability by the surface's edges.
    """
    own = np.array([extent.own_low, extent.own_high])
    side, past, past_m, other = _farthest_past(uv, own)
    row, axis = side % 2, side // 2
    known = np.empty((len(uv), len(KNOWN)))
    known[:, 0] = np.log(past + _NEAREST)
    known[:, 1] = np.log(past_m + _NEAREST)
    known[:, 2] = np.log(1 + other / _NEAREST)
    known[:, 3] = 1 - base
    known[:, 4] = sides.passed_outline
    known[:, 5:7] = np.stack([sides.passed, sides.hidden], axis=-1)[row, axis]
    known[:, 7:] = _ends(extent)[row, axis]
    return PastSides(side, roles(extent)[row, axis], known)


def nowhere(n: int) -> PastSides:
    """Return that n places have nothing to do with the sides of a plane."""
    return PastSides(np.full(n, -1, np.int8), np.zeros(n, np.int8), np.zeros((n, len(KNOWN))))


def roles(extent: Extent) -> NDArray[np.int8]:
    """The `Role` (2, 2) of places past the low and the high sides along u and v."""
    steep = float(np.sqrt(max(1 - extent.faces_up**2, 0.0)))
    falls, climbs = (sign * extent.rises > _STEEPEST * steep for sign in (-1, 1))
    if extent.is_level:
        enclosing = Role.FLOOR if extent.faces_up > 0 else Role.CEILING
        return np.full((2, 2), enclosing if extent.encloses else Role.THING_LEVEL, np.int8)
    if extent.encloses:
        return np.where(falls, Role.DOWN, np.where(climbs, Role.UP, Role.ASIDE)).astype(np.int8)
    return np.where(falls, Role.THING_DOWN, Role.THING_ASIDE).astype(np.int8)


def _ends(extent: Extent) -> FloatArray:
    """The last of `KNOWN` (2, 2, 2) for the low and the high sides along u and v."""
    stands = np.where(extent.encloses, 0.0, extent.end_probability)
    return np.stack([np.isfinite(extent.ends), stands], axis=-1).astype(np.float64)


def as_far_as_probable(extent: Extent, least: float, weights: FloatArray = WEIGHTS) -> Extent:
    """Return the extent of a plane that ends where its probability surely falls below `least`.

    The bound holds whatever will be seen: what is not known yet has its most favourable value. There is none
    where the odds do not fall with the distance. `weights` (n_roles, 10) are those of `WEIGHTS`.
    """
    if not isinstance(extent.chart, Plane):
        return extent
    size = np.maximum(extent.own_high - extent.own_low, _LEAST_SIZE)
    of_sides = weights[roles(extent)]
    known = np.zeros((2, 2, len(KNOWN)))
    known[..., N_FALLING:-2] = of_sides[..., 1 + N_FALLING : -2] > 0
    known[..., -2:] = _ends(extent)
    odds = of_sides[..., 0] + (known * of_sides[..., 1:]).sum(axis=-1) - np.log(least / (1 - least))

    # A place that is farthest past one side, in units of the rectangle's, may be past the one beside it too.
    beside = _farthest(odds, np.full(2, size.max()), of_sides).max(axis=0)[::-1]
    past = size * np.maximum(_farthest(odds, size, of_sides), beside)
    return replace(extent, reach=np.stack([extent.own_low - past[0], extent.own_high + past[1]]))


def _farthest(odds: FloatArray, size: FloatArray, weights: FloatArray) -> FloatArray:
    """How far past its side, in units of `size`, a place may be until its log odds fall to 0; inf for never.

    `odds` are those without the distance, and `weights` (2, 2, 10) those of the four sides.
    """
    low, high = np.full(odds.shape, -20.0), np.full(odds.shape, 20.0)  # logarithms of the distance
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        past = np.exp(middle)
        logs = np.log(np.stack([past, past * size], axis=-1) + _NEAREST)
        left = odds + (logs * weights[..., 1:3]).sum(axis=-1)
        low, high = np.where(left > 0, middle, low), np.where(left > 0, high, middle)
    bounded = (weights[..., 1 : 1 + N_FALLING] <= 0).all(axis=-1) & (weights[..., 1:3] < 0).any(axis=-1)
    return np.where(bounded, np.exp(high), np.inf)


def probability_beyond(
    known: FloatArray, role: NDArray[np.int8], weights: FloatArray = WEIGHTS
) -> FloatArray:
    """Probability (n,) that the surface is there, from `KNOWN` (n, 9) and each `Role` (n,)."""
    odds = np.empty(len(role))
    for one in np.unique(role):
        odds[role == one] = weights[one, 0] + known[role == one] @ weights[one, 1:]
    return np.asarray(1 / (1 + np.exp(-odds)), dtype=np.float64)


@compiled
def _farthest_past(
    uv: FloatArray, own: FloatArray
) -> tuple[NDArray[np.int8], FloatArray, FloatArray, FloatArray]:
    """The side (n,) of the rectangle `own` (2, 2) that places (n, 2) are farthest past, and how far.

    Distances (n,) are in units of the rectangle's side, and in metres; of the latter the largest counts. The
    last is how far they are past a side of the other two as well, in units of that side.
    """
    n = len(uv)
    side, past, past_m, other = np.full(n, -1, np.int8), np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        for axis in range(2):
            size = max(own[1, axis] - own[0, axis], _LEAST_SIZE)
            for row in range(2):
                away = own[0, axis] - uv[i, axis] if row == 0 else uv[i, axis] - own[1, axis]
                if away > 0.0:
                    past_m[i] = max(past_m[i], away)
                    if side[i] < 0 or away / size > past[i]:
                        other[i] = past[i]
                        side[i], past[i] = 2 * axis + row, away / size
                    else:
                        other[i] = away / size
    return side, past, past_m, other
