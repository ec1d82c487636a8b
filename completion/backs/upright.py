# SPDX-License-Identifier: MIT
"""Upright surfaces: fronts of cupboards that look like walls, and walls that have no role."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.backs import separation_limits as limits
from completion.backs.standing import BORDER, Outline
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch
from completion.room.planes import Beams
from completion.room.walls import Wall
from scenes.checks import FloatArray
from scenes.inclination import LEVEL_COSINE
from scenes.surfaces.catalogue import Cylinder, Plane


def is_front(wall: Wall, points: FloatArray, beams: Beams, others: Sequence[Wall]) -> bool:
    """Tell whether a wall is rather the front of something low, before another wall.

    Over most of its length beams pass above what was measured of it, and end at a wall soon behind.

    Parameters
    ----------
    wall : Wall
        The wall.
    points : (n, 3) float
        What was measured of it.
    beams : Beams
        Of all scans.
    others : sequence of Wall
        All walls.
    """
    before, after = wall.plane.distance(beams.origin), wall.plane.distance(beams.point)
    slack = limits.FLAT_M + limits.N_SIGMA * beams.sigma
    passes = (before > 0) & (after < -slack) & (after > -limits.DEEP_M)
    behind = [
        np.abs(other.plane.distance(beams.point)) < slack
        for other in others
        if other is not wall and other.plane.normal_direction @ wall.plane.normal_direction > LEVEL_COSINE
    ]
    passes &= np.any(behind, axis=0) if behind else False
    part = before[passes] / (before[passes] - after[passes])
    at = wall.places(beams.origin[passes] + part[:, None] * (beams.point - beams.origin)[passes])
    place = wall.places(points)
    low = float(place[:, 0].min(initial=0.0))
    n = int(np.floor((place[:, 0].max(initial=0.0) - low) / limits.COLUMN_M)) + 1
    top, passed = np.full(n, -np.inf), np.full(n, -np.inf)
    np.maximum.at(top, ((place[:, 0] - low) / limits.COLUMN_M).astype(np.int64), place[:, 1])
    column = np.floor((at[:, 0] - low) / limits.COLUMN_M).astype(np.int64)
    inside = (column >= 0) & (column < n)
    np.maximum.at(passed, column[inside], at[inside, 1])
    known = np.isfinite(top)
    return bool(known.any() and (passed > top + limits.GAP_M)[known].mean() > limits.MOSTLY)


def walls_without_role(
    patches: Sequence[Patch], scans: Scans, up: FloatArray, floor_m: float, ceiling_m: float
) -> list[int]:
    """Return the numbers, from 0, of upright surfaces that go up to a ceiling, or wide or high out of sight.

    Parameters
    ----------
    patches : sequence of Patch
        The completed surfaces.
    scans : Scans
        The scans.
    up : (3,) float
        Which way is up.
    floor_m, ceiling_m : float
        Heights of the room along it, metres; -inf and inf where they are not known.
    """
    asked = [
        k for k, patch in enumerate(patches) if not patch.limits.role and _is_upright(patch, up) and patch.source.n_pixels
    ]
    number = np.zeros(1 + len(patches), np.int32)
    number[np.array(asked, dtype=np.int64) + 1] = np.arange(1, len(asked) + 1)
    ends: list[list[FloatArray]] = [[] for _ in asked]
    hidden: list[list[FloatArray]] = [[] for _ in asked]
    for seen, owners in zip(scans.observations, scans.owners, strict=True):
        label = number[owners]
        outline = Outline.of(seen, label, len(asked), up)
        border = np.flatnonzero(outline.above)
        which = label.ravel()[border]
        height = seen.points_at(border) @ up
        out = outline.above[border] == BORDER
        for k in range(len(asked)):
            ends[k].append(height[which == k + 1])
            hidden[k].append(out[which == k + 1].astype(np.float64))
    found = []
    for k, index in enumerate(asked):
        points = patches[index].source.points(scans.observations, limits.N_POINTS)
        low, high = np.quantile(points @ up, (0.01, 0.99))
        level = np.concatenate(ends[k])
        top = level > high - limits.FOOT * (high - low)
        is_out = bool(top.any() and np.concatenate(hidden[k])[top].mean() >= limits.HIDDEN)
        plan = points - (points @ up)[:, None] * up
        width = float(np.linalg.norm(np.ptp(plan, axis=0)))
        rises = high - (floor_m if np.isfinite(floor_m) else low)
        if high > ceiling_m - limits.BUILT_IN_M or (
            is_out and (rises > limits.TALLEST_M or (rises > limits.SHAFT_M and width > limits.WIDE_M))
        ):
            found.append(index)
    return found


def _is_upright(patch: Patch, up: FloatArray) -> bool:
    """Whether a plane or a cylinder stands upright."""
    is_known = isinstance(patch.source.fit.surface, Plane | Cylinder)
    return bool(is_known and patch.source.fit.inclination(up).is_upright)
