# SPDX-License-Identifier: MIT
"""Support: tiles along each side of a recess, which confirm it or contradict it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.templates.engine.template import Side
from completion.templates.openings.walls.recess import SIDES, Recess
from completion.templates.openings.walls.sides import Estimate
from completion.templates.openings.walls.wall_beams import WallBeams
from scenes.checks import FloatArray

_TILE_M = 0.10
_DECIDED = 2.0  # nats by which a tile is wall or open
_BAND_M = 0.06  # width of the strips beside a side
_BEYOND_M = 0.24  # beside these strips, outside
_MOST_OF_A_BEAM = 4.6  # nats that one beam may say: one in a hundred strays


@dataclass(frozen=True, slots=True, eq=False)
class _Tiles:
    """Odds for no wall (n,) of n tiles along a side: just outside it, beyond that, and just inside."""

    outside: FloatArray
    beyond: FloatArray
    inside: FloatArray


def side_support(
    beams: WallBeams, recess: Recess, side: str, known: Estimate, *, floor: float | None = None
) -> Side:
    """Return a side with its tiles: confirmed where wall is just outside it and none just inside.

    Contradicted: no wall just outside, or wall just inside. A door's foot is confirmed where the opening
    reaches down to the `floor`.
    """
    tiles = _tiles(beams, recess, side, known)
    wall_outside, open_inside = tiles.outside < -_DECIDED, tiles.inside > _DECIDED
    open_outside, wall_inside = tiles.outside > _DECIDED, tiles.inside < -_DECIDED
    if side == "bottom" and floor is not None and abs(recess.bottom - floor) < _BAND_M:
        confirmed, contradicted = open_inside, wall_inside
    else:
        confirmed, contradicted = wall_outside & open_inside, open_outside | wall_inside
    n = len(confirmed)
    return Side(side, int(confirmed.sum()), int(contradicted.sum()), n, known.deviation)


def is_strip(
    beams: WallBeams, recess: Recess, side: str, known: Estimate, *, others: Sequence[Recess] = ()
) -> bool:
    """Whether what bounds a side is a strip, as of a frame or a board: most of its tiles are open beyond.

    Beyond are the 24 cm outside a tile's own strip. What nobody saw there, or is of `others` of the wall's
    openings, says nothing.
    """
    of_others = np.zeros(len(beams), dtype=np.bool_)
    for other in others:
        of_others |= other.holds(beams.uv) & (beams.nats > 0)
    beyond = _tiles(beams.chosen(~of_others), recess, side, known).beyond
    return int((beyond > _DECIDED).sum()) > int((beyond < -_DECIDED).sum())


def _tiles(beams: WallBeams, recess: Recess, side: str, known: Estimate) -> _Tiles:
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

    def sums(first: float, last: float) -> FloatArray:
        where = near & (outwards > first) & (outwards < last)
        return np.asarray(np.bincount(tile[where], odds[where], minlength=n), dtype=np.float64)

    end = margin + band
    return _Tiles(sums(margin, end), sums(end, end + _BEYOND_M), sums(-end, -margin))


def all_sides(
    beams: WallBeams, recess: Recess, known: dict[str, Estimate], floor: float | None
) -> tuple[Side, ...]:
    """Return the support of all four sides."""
    return tuple(side_support(beams, recess, side, known[side], floor=floor) for side in SIDES)
