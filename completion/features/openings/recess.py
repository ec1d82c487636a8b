# SPDX-License-Identifier: MIT
"""Recess: a rectangle in a wall with four reveals and, of a niche, a back; its sides by beams near them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from completion.features.openings.limits import (
    AROUND_BEST_SD,
    BLOCKED,
    END_M,
    MEETS,
    MOST_DEPTH_M,
    ON_FACE_SD,
    PLUMB,
    STRAY,
    TILE_M,
    UNTOLD_SHARE,
)
from completion.features.openings.walls import WallBeams
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled

SIDES = ("left", "right", "bottom", "top")
FACES = ("left", "right", "bottom", "top", "back")
_HAS_NONE = np.inf


@dataclass(frozen=True, slots=True)
class Recess:
    """A hole in a wall, in the wall's frame, metres.

    Attributes
    ----------
    left, right, bottom, top : float
        Where its sides are along u and v.
    depth : float
        How deep its reveals are; 0 of a thin wall.
    is_closed : bool
        Whether a back closes it at that depth, as that of a niche does.
    """

    left: float
    right: float
    bottom: float
    top: float
    depth: float = 0.0
    is_closed: bool = False

    @property
    def size(self) -> tuple[float, float]:
        """Width and height."""
        return self.right - self.left, self.top - self.bottom

    def move_side(self, side: str, to: float) -> Recess:
        """Return it with one side elsewhere."""
        at = [to if name == side else float(getattr(self, name)) for name in SIDES]
        return Recess(at[0], at[1], at[2], at[3], depth=self.depth, is_closed=self.is_closed)

    def corners(self) -> FloatArray:
        """Corners (4, 2) from the lower left, anticlockwise as seen from the room."""
        return np.array(
            [
                [self.left, self.bottom],
                [self.right, self.bottom],
                [self.right, self.top],
                [self.left, self.top],
            ]
        )

    def holds(self, uv: FloatArray) -> BoolArray:
        """Whether places (n, 2) lie within."""
        return np.asarray(
            (uv[:, 0] > self.left)
            & (uv[:, 0] < self.right)
            & (uv[:, 1] > self.bottom)
            & (uv[:, 1] < self.top)
        )


def expect(
    beams: WallBeams,
    left: FloatArray,
    right: FloatArray,
    *,
    bottom: FloatArray,
    top: FloatArray,
    depth: FloatArray,
    is_closed: bool,
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Ranges (n, k) that beams expect, inf where they go on, from where on then; and faces, 0 for the wall.

    Faces are numbered as in `FACES`, from 1; -1 where a beam goes on.
    """
    u, v = beams.uv[:, :1], beams.uv[:, 1:]
    inside = (u > left) & (u < right) & (v > bottom) & (v < top)
    slope_u, slope_v = beams.slope[:, :1], beams.slope[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.where(slope_u > 0, (right - u) / slope_u, (left - u) / slope_u)
        along = np.where(slope_v > 0, (top - v) / slope_v, (bottom - v) / slope_v)
    across, along = np.where(slope_u == 0, _HAS_NONE, across), np.where(slope_v == 0, _HAS_NONE, along)
    into = np.minimum(across, along)
    reveals = inside & (into < depth)
    wall, stretch = beams.wall_range[:, None], beams.stretch[:, None]
    end = wall + stretch * np.minimum(into, depth)
    stops = reveals | is_closed
    expected = np.where(inside, np.where(stops, end, np.inf), wall)
    by_u = np.where(slope_u > 0, 2, 1)
    by_v = np.where(slope_v > 0, 4, 3)
    face = np.where(reveals, np.where(across <= along, by_u, by_v), 5 if is_closed else -1)
    return expected, wall + stretch * depth, np.where(inside, face, 0)


def recesses(recess: Recess, name: str, values: FloatArray) -> FloatArray:
    """Return recesses (k, 5), sides and depth, of which one number takes k values and all else is held."""
    held = np.array([*(getattr(recess, side) for side in SIDES), recess.depth])
    out = np.tile(held, (len(values), 1))
    out[:, [*SIDES, "depth"].index(name)] = values
    return out


def log_likelihoods(beams: WallBeams, sought: FloatArray, *, is_closed: bool, tile: IntArray) -> FloatArray:
    """Log likelihood (t, k) of k recesses by the beams of each of t tiles.

    A beam outside the rectangle ends at the wall. Inside it ends at the nearest reveal that it reaches before
    the depth, else at the back, or goes on anywhere beyond. Before what is expected something else may stop
    it, and a few are strays. Where nothing came back a beam says nothing.

    Parameters
    ----------
    beams : WallBeams
        All n.
    sought : (k, 5) float
        Left, right, bottom, top and depth of each, metres.
    is_closed : bool
        Whether they have a back.
    tile : (n,) int
        Of each beam; any numbers.
    """
    _, which = np.unique(tile, return_inverse=True)
    out = np.zeros((int(which.max(initial=0)) + 1, len(sought)))
    numbers = np.column_stack(
        [beams.uv, beams.slope, beams.stretch, beams.wall_range, beams.ranges, beams.deviation]
    )
    back = np.isfinite(beams.ranges)
    _add(numbers[back], np.ascontiguousarray(sought), is_closed, beams.farthest, which[back], out)
    return out


@compiled
def _add(
    beams: FloatArray,
    sought: FloatArray,
    is_closed: bool,
    farthest: float,
    which: IntArray,
    out: FloatArray,
) -> None:
    for n in range(len(beams)):
        u, v, slope_u, slope_v = beams[n, 0], beams[n, 1], beams[n, 2], beams[n, 3]
        stretch, wall, r, sd = beams[n, 4], beams[n, 5], beams[n, 6], beams[n, 7]
        for k in range(len(sought)):
            left, right, bottom, top, depth = sought[k]
            expected, goes_on = wall, False
            if left < u < right and bottom < v < top:
                into = np.inf
                if slope_u > 0:
                    into = (right - u) / slope_u
                elif slope_u < 0:
                    into = (left - u) / slope_u
                if slope_v > 0:
                    into = min(into, (top - v) / slope_v)
                elif slope_v < 0:
                    into = min(into, (bottom - v) / slope_v)
                goes_on = not is_closed and into >= depth
                expected = wall + stretch * min(into, depth)
            density = STRAY / farthest
            if r < expected:
                density += BLOCKED / max(expected, 1e-9)
            if not goes_on:
                z = (r - expected) / sd
                if abs(z) < 38.0:
                    density += MEETS * np.exp(-0.5 * z * z) / (sd * 2.5066282746310002)
            elif r >= expected:
                density += MEETS / max(farthest - expected, sd)
            out[which[n], k] += np.log(density)


_MOST_BEAMS = 6000  # near a side; every k-th of more
_COARSE, _FINE = 41, 41  # places that are tried
_LEAST_STEP_M = 1e-5
_DEPTHS_M = np.array([0.0, *np.geomspace(0.01, 1.2, 60)])


@dataclass(frozen=True, slots=True)
class SideEstimate:
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


def fit_side(beams: WallBeams, recess: Recess, side: str, reach: float) -> SideEstimate:
    """Return where a side is: the mean and deviation of its posterior, all else as it is.

    The likelihood of all beams near it is evaluated at places closer and closer together. Beams next to each
    other err alike: the deviation is at least that of the jackknife over 10 cm of the side (Efron 1982).
    Where no beam says anything the side stays, with a deviation of inf.
    """
    chosen = np.flatnonzero(near_side(beams, recess, side, reach))
    wall_beams = beams.select(chosen[:: max(1, len(chosen) // _MOST_BEAMS)])
    here = getattr(recess, side)
    if not len(wall_beams):
        return SideEstimate(here, np.inf)
    axis = 0 if side in ("left", "right") else 1
    places = here + np.linspace(-reach, reach, _COARSE)
    for count in (_FINE, _FINE):
        mean, sd, _ = _posterior(_by_tiles(wall_beams, recess, side, places, axis), places)
        if sd > UNTOLD_SHARE * reach:
            return SideEstimate(here, np.inf)
        half = max(AROUND_BEST_SD * sd, 2 * (places[1] - places[0]), _LEAST_STEP_M)
        places = mean + np.linspace(-half, half, count)
    tiles = _by_tiles(wall_beams, recess, side, places, axis)
    mean, sd, _ = _posterior(tiles, places)
    return SideEstimate(mean, max(sd, _jackknife(tiles, places)))


def fit_turn(beams: WallBeams, recess: Recess, reach: float) -> tuple[SideEstimate, Recess]:
    """Return by what angle a recess is turned in its wall, from u towards v, and the recess in that frame.

    Walls stand upright and so do openings, to about a degree, which is the prior.
    """
    near = np.zeros(len(beams), dtype=np.bool_)
    for side in SIDES:
        near |= near_side(beams, recess, side, reach)
    chosen = np.flatnonzero(near)
    wall_beams = beams.select(chosen[:: max(1, len(chosen) // _MOST_BEAMS)])
    centre = np.array([recess.left + recess.right, recess.bottom + recess.top]) / 2
    best = sd = 0.0
    for half, count in ((np.radians(3.0), 25), (np.radians(0.3), 13), (np.radians(0.05), 13)):
        angles = best + np.linspace(-half, half, count)
        logs = np.array([_turned_likelihood(wall_beams, recess, centre, angle) for angle in angles])
        best, sd, _ = _posterior((logs - 0.5 * np.square(angles / PLUMB))[None], angles)
    moved = _rotate(centre[None], best)[0] - centre
    u, v = (float(shift) for shift in moved)
    turned = replace(recess, left=recess.left + u, right=recess.right + u)
    return SideEstimate(best, sd), replace(turned, bottom=recess.bottom + v, top=recess.top + v)


def _rotate(uv: FloatArray, angle: float) -> FloatArray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(uv @ np.array([[cos, -sin], [sin, cos]]))


def _turned_likelihood(beams: WallBeams, recess: Recess, centre: FloatArray, angle: float) -> float:
    """Log likelihood of a recess whose frame is turned about its centre."""
    if not len(beams):
        return 0.0
    turned = beams.turn(angle)
    moved = replace(turned, uv=turned.uv - _rotate(centre[None], angle) + centre)
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


def fit_depth(
    beams: WallBeams, recess: Recess, given: float | None = None
) -> tuple[Recess, SideEstimate, float]:
    """Return the recess with its most probable depth, open or closed, the depth, and the odds for closed.

    The odds are log likelihood of the best niche less that of the best opening, nats. A deviation of inf says
    that no reveal was met: nothing tells the depth. What a floor that goes on behind a door says of depth is
    nothing, so beams that meet the bottom are left out of it. A `given` depth is held.
    """
    inside = np.flatnonzero(recess.holds(beams.uv) & np.isfinite(beams.ranges))
    wall_beams = beams.select(inside[:: max(1, len(inside) // _MOST_BEAMS)])
    factor = max(1.0, len(inside) / max(len(wall_beams), 1))
    best: dict[bool, tuple[float, SideEstimate]] = {}
    for is_closed in (False, True):
        depths = _DEPTHS_M if not is_closed else _DEPTHS_M[1:]
        if given is not None:
            top = float(_depth_tiles(wall_beams, recess, np.array([given]), is_closed).sum())
            best[is_closed] = (top, SideEstimate(given, 0.0))
            continue
        for _ in range(3):
            tiles = _depth_tiles(wall_beams, recess, depths, is_closed)
            mean, sd, top = _posterior(tiles, depths)
            step = float(np.max(np.diff(depths)[max(np.argmin(np.abs(depths - mean)) - 1, 0) :][:2]))
            half = max(AROUND_BEST_SD * sd, 2 * step, 1e-4)
            tried, depths = depths, np.unique(np.clip(mean + np.linspace(-half, half, 41), 0.0, None))
        best[is_closed] = (top, SideEstimate(mean, max(sd, _jackknife(tiles, tried))))
    odds = factor * (best[True][0] - best[False][0])
    back = best[True][1]
    is_closed = odds > 0 and (given is not None or _has_back(beams, recess, back.value))
    reveals_end = odds > 0 and back.value <= MOST_DEPTH_M  # there, though no back does
    depth = back if is_closed or reveals_end else best[False][1]
    return replace(recess, depth=depth.value, is_closed=is_closed), depth, odds


def _has_back(beams: WallBeams, recess: Recess, depth: float) -> bool:
    """Whether most beams that a back should stop end there, no deeper than walls are thick.

    Where nothing comes back there is none, and the wall of a corridor behind a doorway is none either.
    """
    if depth > MOST_DEPTH_M:
        return False
    inside = beams.select(recess.holds(beams.uv) & (beams.ranges > beams.wall_range))
    held = {name: np.array([getattr(recess, name)]) for name in SIDES}
    left, right = held.pop("left"), held.pop("right")
    expected, _, face = expect(inside, left, right, **held, depth=np.array([depth]), is_closed=True)
    off, on_back = inside.ranges - expected[:, 0], face[:, 0] == len(FACES)
    at = inside.uv + depth * inside.slope  # close to a reveal it may be the reveal's end
    low, high = recess.corners()[[0, 2]]
    on_back &= ((at > low + END_M) & (at < high - END_M)).all(axis=1)
    ends = on_back & (np.abs(off) <= ON_FACE_SD * inside.deviation)
    return int(ends.sum()) > int((on_back & (off > 0) & ~ends).sum())


def _depth_tiles(beams: WallBeams, recess: Recess, depths: FloatArray, is_closed: bool) -> FloatArray:
    cells = np.floor(beams.uv / TILE_M).astype(np.int64)
    tile = cells[:, 0] * 100_003 + cells[:, 1]
    return log_likelihoods(beams, recesses(recess, "depth", depths), is_closed=is_closed, tile=tile)


def _by_tiles(beams: WallBeams, recess: Recess, side: str, places: FloatArray, axis: int) -> FloatArray:
    """Log likelihood (tiles, k) of k places of a side, of each stretch along it."""
    tile = np.floor(beams.uv[:, 1 - axis] / TILE_M).astype(np.int64)
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
