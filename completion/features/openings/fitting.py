# SPDX-License-Identifier: MIT
"""Fitting: a recess at its most probable place in its wall, and how well each of its parameters is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.features.engine.template import Given, Side
from completion.features.openings.decision import DOOR_M, refuted
from completion.features.openings.proposals import CELL_M
from completion.features.openings.recess import SIDES, Recess
from completion.features.openings.sides import Estimate, fit_depth, fit_side, fit_turn, near_side, open_limits
from completion.features.openings.walls import Wall, WallBeams, WallFrame
from completion.fitting.result import SurfaceFit
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


_ROUNDS = 2
_GAPS, _ABOUT_M = 2.5, 0.3  # distances between beams that a side is sought over, and about it that tell them
_TRIES, _FAR = 3, 0.7  # to find a side, and the share of the reach within which it counts as found
_INFLATION = 1.9  # by which deviations of sides were too small, in the median of simulated walls 104 to 109
FLOOR_M = 0.15  # between an opening's foot and the floor that it stands on
_OPPOSITE = {"left": "right", "right": "left", "bottom": "top", "top": "bottom"}
_SIZE = {"left": "width", "right": "width", "bottom": "height", "top": "height"}
_UNKNOWN = Estimate(0.0, np.inf)


def fit_recess(
    beams: WallBeams, rough: Recess, given: Given, levels: Sequence[Estimate]
) -> tuple[Recess, dict[str, Estimate], float]:
    """Return the recess at its most probable, how well its parameters are known, and its turn in the wall.

    Of what the sides refute at once neither depth nor turn is sought.
    """
    floor = floor_of(rough, levels)
    recess = rough if floor is None else rough.moved("bottom", floor.value)
    known = {"bottom": floor or Estimate(rough.bottom, np.inf)}
    sides = [side for side in SIDES if side != "bottom" or floor is None]
    reach = {side: _reach(beams, recess, side) for side in SIDES}
    for side in sides:
        for _ in range(_TRIES):
            known[side] = fit_side(beams, recess, side, reach[side])
            shift = abs(known[side].value - getattr(recess, side))
            recess = recess.moved(side, known[side].value)
            if shift < _FAR * reach[side]:  # else it may lie farther on
                break
    first = all_sides(beams, recess, known, None if floor is None else floor.value)
    if refuted(first, has_floor=floor is not None):
        return recess, known | {"depth": _UNKNOWN, "turn": Estimate(0.0, 0.0)}, 0.0
    total = 0.0
    for _ in range(_ROUNDS):
        recess, known["depth"], _ = fit_depth(beams, recess, given.get("depth"))
        known["turn"], recess = fit_turn(beams, recess, CELL_M)
        beams, total = beams.turned(known["turn"].value), total + known["turn"].value
        for side in sides:
            closer = CELL_M if reach[side] <= 2 * CELL_M else reach[side]
            known[side] = fit_side(beams, recess, side, closer)
            recess = recess.moved(side, known[side].value)
    return recess, known, total


def _reach(beams: WallBeams, recess: Recess, side: str) -> float:
    """How far to both ways a side is sought, metres: farther where beams are wider apart than cells."""
    gaps = beams.gap[near_side(beams, recess, side, _ABOUT_M)]
    return max(2 * CELL_M, _GAPS * float(np.quantile(gaps, 0.9))) if len(gaps) else 2 * CELL_M


def with_unseen(
    beams: WallBeams, recess: Recess, sides: tuple[Side, ...], given: Given, *, farther: WallBeams
) -> tuple[Recess, tuple[Side, ...], dict[str, tuple[float, float]]]:
    """Return the recess with sides that nobody saw where beams still went through, as uncertain as that is.

    Of a width or height that is given, a side that was seen says where the other one is. How far inwards and
    outwards each side may be off comes with it. Of walls that `beams` do not reach `farther` ones tell.
    """
    seen, slack = {side.name: side for side in sides}, {side.name: (0.0, 0.0) for side in sides}
    for side in sides:
        if side.is_seen:
            continue
        opposite, size = _OPPOSITE[side.name], given.get(_SIZE[side.name])
        if size is not None and seen[opposite].is_seen:
            sign = 1.0 if side.name in ("right", "top") else -1.0
            recess = recess.moved(side.name, getattr(recess, opposite) + sign * size)
            seen[side.name] = replace(side, deviation=seen[opposite].deviation)
            continue
        inner, outer = open_limits(beams, recess, side.name)
        if not np.isfinite(outer):
            outer = open_limits(farther, recess, side.name)[1]
        recess, slack[side.name] = recess.moved(side.name, inner), (0.0, abs(outer - inner))
        seen[side.name] = replace(side, deviation=float(abs(outer - inner) / np.sqrt(3.0)))
    return recess, tuple(seen.values()), slack


def with_wall(
    beams: WallBeams, recess: Recess, known: dict[str, Estimate], wall: Wall, frame: WallFrame
) -> dict[str, Estimate]:
    """Return what is known of the sides, with what errors of the wall's plane and of the turn add to it."""
    out, centre = dict(known), recess.corners().mean(axis=0)
    for side in SIDES:
        axis = 0 if side in ("left", "right") else 1
        near = near_side(beams, recess, side, CELL_M)
        if not near.any() or not np.isfinite(known[side].deviation):
            continue
        place = np.where(np.arange(2) == axis, getattr(recess, side), centre)
        off = wall.fit.standard_deviation(frame.points(place[None]))[0]
        by_wall = float(off * np.median(np.abs(beams.slope[near, axis])))
        by_turn = known["turn"].deviation * recess.size[1 - axis] / np.sqrt(12)
        sd = _INFLATION * float(np.sqrt(known[side].deviation ** 2 + by_wall**2 + by_turn**2))
        out[side] = Estimate(known[side].value, sd)
    return out


def height_of(frame: WallFrame, fit: SurfaceFit) -> Estimate:
    """Return the height in the wall's frame at which a level plane meets the wall."""
    floor = fit.surface
    normal = frame.axes @ floor.normal(frame.origin[None])[0]
    if abs(normal[2]) < 0.5:
        return Estimate(np.inf, np.inf)
    off = float(floor.distance(frame.origin[None])[0])
    sd = float(fit.standard_deviation(frame.origin[None])[0])
    return Estimate(-off / normal[2], sd)


def floor_of(recess: Recess, levels: Sequence[Estimate]) -> Estimate | None:
    """Return the level that an opening stands on, None for none: what is lower than people stands on none."""
    if recess.size[1] < DOOR_M:
        return None
    near = [level for level in levels if abs(level.value - recess.bottom) <= FLOOR_M]
    return min(near, key=lambda level: abs(level.value - recess.bottom), default=None)
