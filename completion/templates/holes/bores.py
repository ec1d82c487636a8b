# SPDX-License-Identifier: MIT
"""Bores: where points on the walls of holes, or a mesh's corners on their rims, tell circles exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.robust import TUKEY, scale_within, tukey_weights
from completion.templates.holes.measuring.openings import Openings
from completion.templates.holes.measuring.plates import Plate
from completion.templates.holes.measuring.survey import Survey
from completion.templates.holes.patterns import Pattern
from completion.templates.holes.refinement import Refined
from scenes.checks import BoolArray, FloatArray, IntArray

_DEEP = 2.0  # radii below the plate
_LEAST_POINTS, _LEAST_SHARE = 6, 0.6  # on a wall, and of the holes that have one
_N_ROUNDS = 12
_EXACT = 1e-9  # of the radius: residuals of points without noise
_ROUND = 0.1  # spacings: residuals of what is no wall are as great


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Points (m, 2) of the chart that should lie on rims, and the holes whose they are (m,)."""

    places: FloatArray
    owner: IntArray


def assigned(pattern: Pattern, plate: Plate, opened: Openings, points: FloatArray) -> IntArray:
    """Number the faces that points (n, 3) are on: 1 the plate, from 2 the walls of its holes, 0 none."""
    faces = _owners(pattern, plate, opened, points) + 2
    faces[faces == 1] = 0
    faces[np.abs(plate.chart(points)[1]) < plate.slab] = 1
    return faces


def _owners(pattern: Pattern, plate: Plate, opened: Openings, points: FloatArray) -> IntArray:
    """The hole (n,) on whose wall each of points (n, 3) is, -1 for none."""
    places, height = plate.chart(points)
    deep = (np.abs(height) > 1.5 * plate.slab) & (np.abs(height) < _DEEP * pattern.radius)
    if opened.outward:
        deep &= height * opened.outward < 0
    return _nearest_rim(pattern, places, deep, opened.reach)


def walls(pattern: Pattern, plate: Plate, opened: Openings, points: FloatArray) -> Walls:
    """Gather those of points (n, 3) that are on walls; or places (n, 2) near rims: a mesh's corners."""
    if points.shape[1] == 2:
        places, owner = points, _nearest_rim(pattern, points, np.ones(len(points), np.bool_), opened.reach)
    else:
        places, owner = plate.chart(points)[0], _owners(pattern, plate, opened, points)
    return Walls(places[owner >= 0], owner[owner >= 0])


def _nearest_rim(pattern: Pattern, places: FloatArray, chosen: BoolArray, reach: float) -> IntArray:
    """The hole (n,) on whose rim places (n, 2) are, of those that are chosen (n,); else -1."""
    owner = np.full(len(places), -1)
    for k, centre in enumerate(pattern.centres):
        gap = np.abs(np.hypot(*(places - centre).T) - pattern.radius)
        owner[chosen & (gap < reach)] = k
    return owner


def sharpened(
    coarse: Refined, found: Walls, seen: BoolArray, survey: Survey, held: BoolArray
) -> Refined | None:
    """Fit a pattern to points on its holes' walls by robust Gauss-Newton.

    Residuals are distances from the circles, weighed by Tukey's function; `held` (p + 1,) stay as they are.
    None where less than six tenths of the holes that were `seen` (count,) have a wall, or what is
    near the rims is no straight wall: a countersink.
    """
    pattern, spacing = coarse.pattern, survey.spacing
    per_hole = np.bincount(found.owner, minlength=pattern.count)
    if (per_hole[seen] >= _LEAST_POINTS).mean() < _LEAST_SHARE if seen.any() else True:
        return None
    free, x = ~held, np.array([*pattern.x, pattern.radius])
    sigma, radii = 0.5 * spacing, pattern.radius
    for _ in range(_N_ROUNDS):
        residual, slopes = _residual(replace(pattern, x=x[:-1], radius=float(x[-1])), found)
        sigma = max(scale_within(np.abs(residual[np.abs(residual) < TUKEY * sigma]), sigma), _EXACT * radii)
        weights = tukey_weights(residual, TUKEY * sigma)
        root = np.sqrt(weights)
        step = np.linalg.lstsq(root[:, None] * slopes[:, free], -root * residual, rcond=None)[0]
        x[free] += np.clip(step, -spacing, spacing)
    if sigma > max(_ROUND * spacing, 2 * survey.plate.noise):
        return None
    normal = slopes[:, free].T @ (weights[:, None] * slopes[:, free])
    covariance = np.zeros((len(x),) * 2)
    covariance[np.ix_(free, free)] = sigma**2 * np.linalg.pinv(normal)
    moved = replace(pattern, x=x[:-1], radius=float(x[-1]))
    if np.hypot(*(moved.centres - pattern.centres).T).max() > spacing:
        return None
    return Refined(moved, covariance, coarse.evaluations + _N_ROUNDS)


def _residual(pattern: Pattern, found: Walls) -> tuple[FloatArray, FloatArray]:
    """Distances (m,) of the points outside their circles, and their derivatives (m, p + 1)."""
    offset = found.places - pattern.centres[found.owner]
    far = np.maximum(np.hypot(*offset.T), 1e-300)
    out = offset / far[:, None]
    slopes = -np.einsum("mi,mip->mp", out, pattern.slopes[found.owner])
    return far - pattern.radius, np.column_stack([slopes, -np.ones(len(far))])
