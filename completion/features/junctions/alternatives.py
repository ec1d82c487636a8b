# SPDX-License-Identifier: MIT
"""Alternatives: plainer surfaces and other solutions that a fit is weighed against, and how certain it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from completion.features.engine.least_squares import inflation, neighbour_cells
from completion.features.engine.limits import LEAST_EVIDENCE
from completion.features.engine.template import FeatureSide, FeatureStatus
from completion.features.engine.template_fit import face_sides
from completion.features.junctions.limits import HALF, LEAST_SIGMA, ROUGHER, SHARPEST
from completion.features.junctions.models import (
    N_DIRECTIONS,
    Descent,
    Mixture,
    Model,
    Unit,
    descend_from,
    edge,
    flat_starts,
    tangent_arcs,
)
from completion.fitting.result import FitError
from completion.fitting.robust import fit_robust
from completion.fitting.starts import orient_normals
from scenes.checks import BoolArray, FloatArray, IntArray

_ONE_ARC = np.array([True, True, True, True, False, False, True, True])
_TIED = np.column_stack([np.eye(8)[:, :4], np.array([0, 0, 0, 0, 0, 0, 1.0, 1.0])])  # of equal curvatures
_STRAIGHT = np.array([False, True, True, True, False, False, False, False])  # of no curvature
_EDGE = np.array([True, True, True, True, True, False, True])
_LEANS = np.array([[0.35], [-0.35]])


class Alternative(NamedTuple):
    """Something plainer."""

    name: str
    log_likelihood: float
    n_parameters: int

    def value(self, n: int) -> float:
        """Return the log likelihood of n points less what the parameters cost (Schwarz 1978)."""
        return self.log_likelihood - 0.5 * self.n_parameters * float(np.log(n))


def one_arc(points: FloatArray, reach: float, n_directions: int = N_DIRECTIONS) -> Descent:
    """Return the one cylinder, or plane, that points (n, 3) at unit RMS are most likely on."""
    shapes = np.zeros((1, 2))
    starts = flat_starts(points, tangent_arcs, shapes, _ONE_ARC, ties=_TIED, n_directions=n_directions)
    return descend_from(starts, points, reach)[0]


def alternatives(points: FloatArray, reach: float, single: Descent) -> list[Alternative]:
    """Return what else points (n, 3) at unit RMS may be, beside the one cylinder that was fitted before."""
    flat = descend_from(flat_starts(points, tangent_arcs, np.zeros((1, 2)), _STRAIGHT)[:1], points, reach)[0]
    sharp = descend_from(flat_starts(points, edge, _LEANS, _EDGE), points, reach)
    pairs = [
        Alternative("a plane", flat.log_likelihood, 3),
        Alternative("one cylinder", single.log_likelihood, 5),
    ]
    open_ones = [descent for descent in sharp if abs(descent.model.shape[0]) < SHARPEST]
    pairs += [Alternative("a sharp edge", descent.log_likelihood, 6) for descent in open_ones[:1]]
    for kind, name, n in (("sphere", "a sphere", 4), ("cone", "a cone", 6)):
        try:
            distances = fit_robust(points, kind).surface.distance(points)
        except FitError:
            continue
        mixture = Mixture.of(distances, reach, single.mixture.sigma, LEAST_SIGMA)
        pairs.append(Alternative(name, float(mixture.log_densities(distances).sum()), n))
    return pairs


_STEP = 1e-6
_N_ROUGH = 800


class Certainty(NamedTuple):
    """What is known of a model at unit RMS."""

    covariance: FloatArray  # (m, m) of the steps of what moves
    excess: float  # inflation of variances that it holds
    faces: IntArray  # (n,) face of each point, 0 for none
    near: BoolArray  # (n,) which points are on it
    across: FloatArray  # (n,) standard deviation of the surface at each


def certainty(descent: Descent, points: FloatArray, spacing: float) -> Certainty:
    """Return the covariance of a model that points (n, 3) at unit RMS were fitted by, and the faces of these.

    A^-1 B A^-1 of the likelihood's derivatives (Huber 1967), times what residuals of neighbours at distances
    of the spacing have in common.
    """
    model, mixture = descent.model, descent.mixture
    distances, slopes = model.linearise(points)
    weight = mixture.weights(distances)
    size2 = (distances / mixture.sigma) ** 2
    curving = slopes.T @ ((weight * (1 - (1 - weight) * size2))[:, None] * slopes)
    spread = slopes.T @ ((weight**2 * size2)[:, None] * slopes)
    inverse = np.linalg.pinv(curving, rcond=1e-14, hermitian=True) * mixture.sigma
    section = model.section(points)
    near = weight > HALF
    faces = np.where(near, section.face, 0)
    normals, residuals = section.slope[near] @ model.turn, distances[near]
    cells = neighbour_cells(points[near], residuals, normals, faces[near], spacing)
    excess = inflation(residuals, normals, cells)
    small = inverse @ spread @ inverse * excess
    across = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, small, slopes), 0.0))
    return Certainty(small, excess, faces, near, across)


def misfit(descent: Descent, unit: Unit) -> str:
    """Return why residuals are no noise, "" where they may be: more than the points are rough.

    Roughness is that of small neighbourhoods about their own planes: it holds the noise, and some of what
    the surface bends and of outliers. Where residuals exceed it threefold, the surface is another.
    """
    points = unit.points
    _, roughness = orient_normals(points[:: max(1, len(points) // _N_ROUGH)], points)
    sigma, rough = descent.mixture.sigma, max(roughness, unit.measured.noise, LEAST_SIGMA)
    if sigma <= ROUGHER * rough:
        return ""
    return f"residuals of {sigma / unit.factor:.3g} are no noise: points are {rough / unit.factor:.3g} rough"


Told = Callable[[Model], FloatArray]
"""From a model to the parameters (k,) that are told of it."""


def parameter_covariance(sentence: Told, model: Model, known: Certainty) -> FloatArray:
    """Return the covariance (k, k) of what is told of a model, by differences; zero where it is infinite."""
    columns = []
    for step in np.eye(len(known.covariance)) * _STEP:
        ahead, back = sentence(model.move(step)), sentence(model.move(-step))
        finite = np.isfinite(ahead) & np.isfinite(back)
        columns.append((np.where(finite, ahead, 0.0) - np.where(finite, back, 0.0)) / (2 * _STEP))
    slopes = np.column_stack(columns) if columns else np.zeros((len(sentence(model)), 0))
    return slopes @ known.covariance @ slopes.T


def sides_of(names: tuple[str, ...], sides: Descent, known: Certainty, unit: Unit) -> tuple[FeatureSide, ...]:
    """Return the support of each face at unit RMS; deviations in the old unit."""
    deviations = np.full(len(names), np.inf)
    for number in range(1, len(names) + 1):
        on = known.faces == number
        if on.any():
            deviations[number - 1] = float(np.sqrt(np.mean(known.across[on] ** 2))) / unit.factor
    model = sides.model

    def nearest(places: FloatArray) -> tuple[FloatArray, IntArray]:
        section = model.section(places)
        return section.distance, section.face

    tolerance = 3 * sides.mixture.sigma
    return face_sides(names, unit.measured, known.faces, deviations, nearest=nearest, tolerance=tolerance)


class WeighedFit(NamedTuple):
    """A fit at unit RMS and what it was weighed against."""

    descent: Descent
    known: Certainty
    evidence: float
    plain: str  # the best that is plainer
    misfit: str  # why residuals are no noise, "" where they may be
    rival: str  # another solution that is nearly as likely, "" for none
    evaluations: int


def weigh(
    descent: Descent,
    others: Sequence[Alternative],
    unit: Unit,
    *,
    rival: Callable[[float], str],
    evaluations: int,
) -> WeighedFit:
    """Return a fit with its evidence against the best of the `others`, each less what its parameters cost.

    `rival` tells of another solution, by how much residuals of neighbours have in common.
    """
    n = len(unit.points)
    known = certainty(descent, unit.points, unit.measured.spacing)
    plain = max(others, key=lambda alternative: alternative.value(n))
    cost = 0.5 * descent.model.basis.shape[1] * float(np.log(n))
    evidence = (descent.log_likelihood - cost - plain.value(n)) / known.excess
    return WeighedFit(
        descent,
        known,
        evidence,
        plain.name,
        misfit=misfit(descent, unit),
        rival=rival(known.excess),
        evaluations=evaluations,
    )


def judge(fit: WeighedFit, unseen: Sequence[str], is_open: str = "") -> tuple[FeatureStatus, str] | None:
    """Return the status of a fit that its evidence refuses or leaves open, and why; None where it is for it.

    Sides that are `unseen` refuse it; `is_open` tells what a side that may be so leaves open, "" for nothing.
    """
    if fit.evidence <= 0:
        return (
            FeatureStatus.NONE,
            f"{fit.plain} explains the points as well ({-fit.evidence:.1f} nats better)",
        )
    if fit.misfit or unseen:
        return FeatureStatus.NONE, fit.misfit or f"not seen: {', '.join(unseen)}"
    if fit.evidence < LEAST_EVIDENCE:
        reason = f"{fit.plain} explains the points nearly as well ({fit.evidence:.1f} nats)"
        return FeatureStatus.AMBIGUOUS, reason
    return (FeatureStatus.AMBIGUOUS, is_open or fit.rival) if is_open or fit.rival else None
