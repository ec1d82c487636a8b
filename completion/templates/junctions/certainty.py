# SPDX-License-Identifier: MIT
"""Certainty: how well points know a model, and whether what they leave over is noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from completion.fitting.starts import oriented
from completion.templates.engine.refinement import inflation, neighbour_cells
from completion.templates.engine.support import face_sides
from completion.templates.engine.template import Side
from completion.templates.junctions.descent import LEAST_SIGMA, Descended
from completion.templates.junctions.model import Model
from completion.templates.junctions.starts import Unit
from scenes.checks import BoolArray, FloatArray, IntArray

_STEP = 1e-6
_N_ROUGH, _ROUGHER = 800, 3.0
_NOISE = 0.5  # how likely a point is noise, that counts as on the surface


class Certainty(NamedTuple):
    """What is known of a model at unit RMS."""

    covariance: FloatArray  # (m, m) of the steps of what moves
    excess: float  # inflation of variances that it holds
    faces: IntArray  # (n,) face of each point, 0 for none
    near: BoolArray  # (n,) which points are on it
    across: FloatArray  # (n,) standard deviation of the surface at each


def certainty(found: Descended, points: FloatArray, spacing: float) -> Certainty:
    """Return the covariance of a model that points (n, 3) at unit RMS were fitted by, and the faces of these.

    A^-1 B A^-1 of the likelihood's derivatives (Huber 1967), times what residuals of neighbours at distances
    of the spacing have in common.
    """
    model, mixture = found.model, found.mixture
    distances, slopes = model.linearised(points)
    weight = mixture.weights(distances)
    size2 = (distances / mixture.sigma) ** 2
    curving = slopes.T @ ((weight * (1 - (1 - weight) * size2))[:, None] * slopes)
    spread = slopes.T @ ((weight**2 * size2)[:, None] * slopes)
    inverse = np.linalg.pinv(curving, rcond=1e-14, hermitian=True) * mixture.sigma
    section = model.section(points)
    near = weight > _NOISE
    faces = np.where(near, section.face, 0)
    normals, residuals = section.slope[near] @ model.turn, distances[near]
    cells = neighbour_cells(points[near], residuals, normals, faces[near], spacing)
    excess = inflation(residuals, normals, cells)
    small = inverse @ spread @ inverse * excess
    across = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, small, slopes), 0.0))
    return Certainty(small, excess, faces, near, across)


def misfit(found: Descended, unit: Unit) -> str:
    """Return why residuals are no noise, "" where they may be: more than the points are rough.

    Roughness is that of small neighbourhoods about their own planes: it holds the noise, and some of what
    the surface bends and of outliers. Where residuals exceed it threefold, the surface is another.
    """
    points = unit.points
    _, roughness = oriented(points[:: max(1, len(points) // _N_ROUGH)], points)
    sigma, rough = found.mixture.sigma, max(roughness, unit.measured.noise, LEAST_SIGMA)
    if sigma <= _ROUGHER * rough:
        return ""
    return f"residuals of {sigma / unit.factor:.3g} are no noise: points are {rough / unit.factor:.3g} rough"


Told = Callable[[Model], FloatArray]
"""From a model to the parameters (k,) that are told of it."""


def told_covariance(told: Told, model: Model, known: Certainty) -> FloatArray:
    """Return the covariance (k, k) of what is told of a model, by differences; zero where it is infinite."""
    columns = []
    for step in np.eye(len(known.covariance)) * _STEP:
        ahead, back = told(model.moved(step)), told(model.moved(-step))
        finite = np.isfinite(ahead) & np.isfinite(back)
        columns.append((np.where(finite, ahead, 0.0) - np.where(finite, back, 0.0)) / (2 * _STEP))
    slopes = np.column_stack(columns) if columns else np.zeros((len(told(model)), 0))
    return slopes @ known.covariance @ slopes.T


def sides_of(names: tuple[str, ...], found: Descended, known: Certainty, unit: Unit) -> tuple[Side, ...]:
    """Return the support of each face at unit RMS; deviations in the old unit."""
    deviations = np.full(len(names), np.inf)
    for number in range(1, len(names) + 1):
        on = known.faces == number
        if on.any():
            deviations[number - 1] = float(np.sqrt(np.mean(known.across[on] ** 2))) / unit.factor
    model = found.model

    def nearest(places: FloatArray) -> tuple[FloatArray, IntArray]:
        section = model.section(places)
        return section.distance, section.face

    tolerance = 3 * found.mixture.sigma
    return face_sides(names, unit.measured, known.faces, deviations, nearest=nearest, tolerance=tolerance)
