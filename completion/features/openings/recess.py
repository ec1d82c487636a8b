# SPDX-License-Identifier: MIT
"""Recess: a rectangle in a wall with four reveals and, of a niche, a back; the ranges that beams expect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.features.openings.walls import BLOCKED, MEETS, STRAY, WallBeams
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

    def moved(self, side: str, to: float) -> Recess:
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
