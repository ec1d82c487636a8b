# SPDX-License-Identifier: MIT
"""Sides: where each side of a recess is and how well that is known, by all beams near it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from completion.features.openings.recess import FACES, SIDES, Recess, expect, log_likelihoods, recesses
from completion.features.openings.walls import WallBeams
from scenes.checks import BoolArray, FloatArray

_TILE_M = 0.10  # of a side: what is alike within one errs together
_MOST_BEAMS = 6000  # near a side; every k-th of more
_COARSE, _FINE = 41, 41  # places that are tried
_FIVE_SD = 5.0
_NOTHING = 0.4  # of the reach: as wide as that is what says nothing
_LEAST_STEP_M = 1e-5
_ON_FACE = 3.0  # deviations of the range
_END_M = 0.05
_WALLS_M = 0.5  # walls are thinner: what is deeper is a room
_PLUMB = np.radians(1.0)
_DEPTHS_M = np.array([0.0, *np.geomspace(0.01, 1.2, 60)])


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its standard deviation."""

    value: float
    deviation: float


def near_side(beams: WallBeams, recess: Recess, side: str, reach: float) -> BoolArray:
    """Beams (n,) that cross the wall near a side, or within its recess where they may meet its reveal."""
    axis = 0 if side in ("left", "right") else 1
    low, high = ((recess.bottom, recess.top), (recess.left, recess.right))[axis]
    at, along = beams.uv[:, axis] - getattr(recess, side), beams.uv[:, 1 - axis]
    within = (along > low) & (along < high)
    outwards = at if side in ("right", "top") else -at
    slope = beams.slope[:, axis] * (1.0 if side in ("right", "top") else -1.0)
    meets = (outwards < 0) & (-outwards < reach + np.maximum(slope, 0.0) * recess.depth)
    return np.asarray(within & ((np.abs(outwards) < reach) | meets))


def fit_side(beams: WallBeams, recess: Recess, side: str, reach: float) -> Estimate:
    """Return where a side is: the mean and deviation of its posterior, all else as it is.

    The likelihood of all beams near it is evaluated at places closer and closer together. Beams next to each
    other err alike: the deviation is at least that of the jackknife over 10 cm of the side (Efron 1982).
    Where no beam says anything the side stays, with a deviation of inf.
    """
    chosen = np.flatnonzero(near_side(beams, recess, side, reach))
    some = beams.chosen(chosen[:: max(1, len(chosen) // _MOST_BEAMS)])
    here = getattr(recess, side)
    if not len(some):
        return Estimate(here, np.inf)
    axis = 0 if side in ("left", "right") else 1
    places = here + np.linspace(-reach, reach, _COARSE)
    for count in (_FINE, _FINE):
        mean, sd, _ = _posterior(_by_tiles(some, recess, side, places, axis), places)
        if sd > _NOTHING * reach:
            return Estimate(here, np.inf)
        half = max(_FIVE_SD * sd, 2 * (places[1] - places[0]), _LEAST_STEP_M)
        places = mean + np.linspace(-half, half, count)
    tiles = _by_tiles(some, recess, side, places, axis)
    mean, sd, _ = _posterior(tiles, places)
    return Estimate(mean, max(sd, _jackknife(tiles, places)))


def fit_turn(beams: WallBeams, recess: Recess, reach: float) -> tuple[Estimate, Recess]:
    """Return by what angle a recess is turned in its wall, from u towards v, and the recess in that frame.

    Walls stand upright and so do openings, to about a degree, which is the prior.
    """
    near = np.zeros(len(beams), dtype=np.bool_)
    for side in SIDES:
        near |= near_side(beams, recess, side, reach)
    chosen = np.flatnonzero(near)
    some = beams.chosen(chosen[:: max(1, len(chosen) // _MOST_BEAMS)])
    centre = np.array([recess.left + recess.right, recess.bottom + recess.top]) / 2
    best = sd = 0.0
    for half, count in ((np.radians(3.0), 25), (np.radians(0.3), 13), (np.radians(0.05), 13)):
        angles = best + np.linspace(-half, half, count)
        logs = np.array([_turned_likelihood(some, recess, centre, angle) for angle in angles])
        best, sd, _ = _posterior((logs - 0.5 * np.square(angles / _PLUMB))[None], angles)
    moved = _rotated(centre[None], best)[0] - centre
    u, v = (float(shift) for shift in moved)
    turned = replace(recess, left=recess.left + u, right=recess.right + u)
    return Estimate(best, sd), replace(turned, bottom=recess.bottom + v, top=recess.top + v)


def _rotated(uv: FloatArray, angle: float) -> FloatArray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(uv @ np.array([[cos, -sin], [sin, cos]]))


def _turned_likelihood(beams: WallBeams, recess: Recess, centre: FloatArray, angle: float) -> float:
    """Log likelihood of a recess whose frame is turned about its centre."""
    if not len(beams):
        return 0.0
    turned = beams.turned(angle)
    moved = replace(turned, uv=turned.uv - _rotated(centre[None], angle) + centre)
    sought = recesses(recess, "depth", np.array([recess.depth]))
    tile = np.zeros(len(beams), np.int64)
    return float(log_likelihoods(moved, sought, is_closed=recess.is_closed, tile=tile).sum())


def open_limits(beams: WallBeams, recess: Recess, side: str) -> tuple[float, float]:
    """Return how far in and out a side may be that nobody saw: to open beams, and to the next wall.

    Places along u or v; the outer one is not finite where no wall was measured beyond.
    """
    axis = 0 if side in ("left", "right") else 1
    sign = 1.0 if side in ("right", "top") else -1.0
    low, high = ((recess.bottom, recess.top), (recess.left, recess.right))[axis]
    within = (beams.uv[:, 1 - axis] > low) & (beams.uv[:, 1 - axis] < high)
    odds, at = beams.nats, sign * beams.uv[:, axis]
    near = at[within & (odds > 0) & recess.holds(beams.uv)]
    inner = float(np.quantile(near, 0.998)) if len(near) else sign * getattr(recess, side)
    walls = at[within & (odds < 0) & (at > inner)]
    outer = float(np.quantile(walls, 0.002)) if len(walls) else np.inf
    return sign * inner, sign * outer


def fit_depth(beams: WallBeams, recess: Recess, given: float | None = None) -> tuple[Recess, Estimate, float]:
    """Return the recess with its most probable depth, open or closed, the depth, and the odds for closed.

    The odds are log likelihood of the best niche less that of the best opening, nats. A deviation of inf says
    that no reveal was met: nothing tells the depth. What a floor that goes on behind a door says of depth is
    nothing, so beams that meet the bottom are left out of it. A `given` depth is held.
    """
    inside = np.flatnonzero(recess.holds(beams.uv) & np.isfinite(beams.ranges))
    some = beams.chosen(inside[:: max(1, len(inside) // _MOST_BEAMS)])
    factor = max(1.0, len(inside) / max(len(some), 1))
    best: dict[bool, tuple[float, Estimate]] = {}
    for is_closed in (False, True):
        depths = _DEPTHS_M if not is_closed else _DEPTHS_M[1:]
        if given is not None:
            top = float(_depth_tiles(some, recess, np.array([given]), is_closed).sum())
            best[is_closed] = (top, Estimate(given, 0.0))
            continue
        for _ in range(3):
            tiles = _depth_tiles(some, recess, depths, is_closed)
            mean, sd, top = _posterior(tiles, depths)
            step = float(np.max(np.diff(depths)[max(np.argmin(np.abs(depths - mean)) - 1, 0) :][:2]))
            half = max(_FIVE_SD * sd, 2 * step, 1e-4)
            tried, depths = depths, np.unique(np.clip(mean + np.linspace(-half, half, 41), 0.0, None))
        best[is_closed] = (top, Estimate(mean, max(sd, _jackknife(tiles, tried))))
    odds = factor * (best[True][0] - best[False][0])
    back = best[True][1]
    is_closed = odds > 0 and (given is not None or _has_back(beams, recess, back.value))
    reveals_end = odds > 0 and back.value <= _WALLS_M  # there, though no back does
    depth = back if is_closed or reveals_end else best[False][1]
    return replace(recess, depth=depth.value, is_closed=is_closed), depth, odds


def _has_back(beams: WallBeams, recess: Recess, depth: float) -> bool:
    """Whether most beams that a back should stop end there, no deeper than walls are thick.

    Where nothing comes back there is none, and the wall of a corridor behind a doorway is none either.
    """
    if depth > _WALLS_M:
        return False
    inside = beams.chosen(recess.holds(beams.uv) & (beams.ranges > beams.wall_range))
    held = {name: np.array([getattr(recess, name)]) for name in SIDES}
    left, right = held.pop("left"), held.pop("right")
    expected, _, face = expect(inside, left, right, **held, depth=np.array([depth]), is_closed=True)
    off, on_back = inside.ranges - expected[:, 0], face[:, 0] == len(FACES)
    at = inside.uv + depth * inside.slope  # close to a reveal it may be the reveal's end
    low, high = recess.corners()[[0, 2]]
    on_back &= ((at > low + _END_M) & (at < high - _END_M)).all(axis=1)
    ends = on_back & (np.abs(off) <= _ON_FACE * inside.deviation)
    return int(ends.sum()) > int((on_back & (off > 0) & ~ends).sum())


def _depth_tiles(beams: WallBeams, recess: Recess, depths: FloatArray, is_closed: bool) -> FloatArray:
    cells = np.floor(beams.uv / _TILE_M).astype(np.int64)
    tile = cells[:, 0] * 100_003 + cells[:, 1]
    return log_likelihoods(beams, recesses(recess, "depth", depths), is_closed=is_closed, tile=tile)


def _by_tiles(beams: WallBeams, recess: Recess, side: str, places: FloatArray, axis: int) -> FloatArray:
    """Log likelihood (tiles, k) of k places of a side, of each stretch along it."""
    tile = np.floor(beams.uv[:, 1 - axis] / _TILE_M).astype(np.int64)
    return log_likelihoods(beams, recesses(recess, side, places), is_closed=recess.is_closed, tile=tile)


def _posterior(tiles: FloatArray, places: FloatArray) -> tuple[float, float, float]:
    """Mean and deviation over places (k,) of the posterior of summed tiles (t, k), and the greatest sum."""
    total = tiles.sum(axis=0)
    weight = np.exp(total - total.max()) * np.gradient(places)
    weight = weight / weight.sum()
    mean = float(weight @ places)
    return mean, float(np.sqrt(weight @ np.square(places - mean))), float(total.max())


def _jackknife(tiles: FloatArray, places: FloatArray) -> float:
    """Deviation of the mean by leaving out one tile (t, k) after the other; 0 of a single one."""
    n = len(tiles)
    if n < 2:
        return 0.0
    others = tiles.sum(axis=0) - tiles
    weights = np.exp(others - others.max(axis=1, keepdims=True)) * np.gradient(places)
    means = (weights * places).sum(axis=1) / weights.sum(axis=1)
    return float(np.sqrt((n - 1) / n * np.square(means - means.mean()).sum()))
