# SPDX-License-Identifier: MIT
"""Support: tiles along each side of a recess, which confirm it or contradict it."""

from __future__ import annotations

import numpy as np

from completion.templates.engine.template import Side
from completion.templates.openings.walls.recess import SIDES, Recess
from completion.templates.openings.walls.sides import Estimate
from completion.templates.openings.walls.wall_beams import WallBeams
from scenes.checks import BoolArray, FloatArray, IntArray

_TILE_M = 0.10
_DECIDED = 2.0  # nats by which a tile is wall or open
_BAND_M = 0.06  # width of the strips beside a side
_MOST_OF_A_BEAM = 4.6  # nats that one beam may say: one in a hundred strays


def side_support(
    beams: WallBeams, recess: Recess, side: str, known: Estimate, *, floor: float | None = None
) -> Side:
    """Return a side with its tiles: confirmed where wall is just outside it and none just inside.

    Contradicted: no wall just outside, or wall just inside. A door's foot is confirmed where the opening
    reaches down to the `floor`.
    """
    axis = 0 if side in ("left", "right") else 1
    low, high = ((recess.bottom, recess.top), (recess.left, recess.right))[axis]
    n = max(round((high - low) / _TILE_M), 1)
    at = beams.uv[:, axis] - getattr(recess, side)
    outwards = at if side in ("right", "top") else -at
    tile = np.floor((beams.uv[:, 1 - axis] - low) / (high - low) * n).astype(np.int64)
    near = (tile >= 0) & (tile < n)
    margin = min(3 * known.deviation, _BAND_M / 2) if np.isfinite(known.deviation) else _BAND_M / 2
    beside = beams.gap[near & (np.abs(outwards) < _BAND_M)]
    gap = float(np.median(beside)) if len(beside) else _BAND_M
    band = max(_BAND_M, 2.0 * (gap if np.isfinite(gap) else _BAND_M))
    odds = np.clip(beams.nats, -_MOST_OF_A_BEAM, _MOST_OF_A_BEAM)
    outside = _sums(odds, tile, n, where=near & (outwards > margin) & (outwards < margin + band))
    inside = _sums(odds, tile, n, where=near & (outwards < -margin) & (outwards > -margin - band))
    wall_outside, open_inside = outside < -_DECIDED, inside > _DECIDED
    open_outside, wall_inside = outside > _DECIDED, inside < -_DECIDED
    if side == "bottom" and floor is not None and abs(recess.bottom - floor) < _BAND_M:
        confirmed, contradicted = open_inside, wall_inside
    else:
        confirmed, contradicted = wall_outside & open_inside, open_outside | wall_inside
    return Side(side, int(confirmed.sum()), int(contradicted.sum()), n, known.deviation)


def all_sides(
    beams: WallBeams, recess: Recess, known: dict[str, Estimate], floor: float | None
) -> tuple[Side, ...]:
    """Return the support of all four sides."""
    return tuple(side_support(beams, recess, side, known[side], floor=floor) for side in SIDES)


def _sums(odds: FloatArray, tile: IntArray, n: int, *, where: BoolArray) -> FloatArray:
    return np.asarray(np.bincount(tile[where], odds[where], minlength=n), dtype=np.float64)
