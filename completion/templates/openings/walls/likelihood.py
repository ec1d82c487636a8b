# SPDX-License-Identifier: MIT
"""Likelihood of recesses: log densities of all beams, summed over stretches of wall that err together."""

from __future__ import annotations

import numpy as np

from completion.templates.openings.walls.recess import SIDES, Recess
from completion.templates.openings.walls.wall_beams import BLOCKED, MEETS, STRAY, WallBeams
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled


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
