# SPDX-License-Identifier: MIT
"""Judgement: what least squares knows of a template, its evidence against a plain surface, and its status."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.templates.engine.equations import Equations
from completion.templates.engine.measured import Measured
from completion.templates.engine.plain import MOST_POINTS, log_likelihood, plain_likelihood
from completion.templates.engine.refinement import (
    PRIOR_VARIANCE,
    Refined,
    box_covariance,
    inflation,
    neighbour_cells,
)
from completion.templates.engine.support import face_sides
from completion.templates.engine.template import Side, Status, Template
from scenes.checks import FloatArray, IntArray

LEAST_EVIDENCE = float(np.log(100.0))  # nats: one in a hundred
_SCATTER, _FORM = 5.0, 0.01  # of the noise, and of the size of what is explained: points about true faces
_UNKNOWN = 0.5  # of the variance between the bounds: who knows no more knows nothing


class Known(NamedTuple):
    """What least squares says of a place."""

    covariance: FloatArray  # (k, k); infinite where nothing is known
    unknown: tuple[str, ...]  # parameters that the points leave open
    faces: IntArray  # (n,) face of each point, 0 for none
    sides: tuple[Side, ...]
    cost: float  # nats: of the parameters
    excess: float  # inflation of variances


def knowledge(template: Template, measured: Measured, sought: Equations, refined: Refined) -> Known:
    """Return the covariance of all parameters, the faces of all points and their support."""
    x = sought.full(refined.place)
    _, nearest = template.distance(measured.points, x)
    faces = np.where(refined.inliers, nearest, 0)
    kept = refined.inliers
    points, residuals = measured.points[kept], refined.distances[kept]
    normals = _gradient(template, points, x, 0.01 * refined.sigma)
    cells = neighbour_cells(points, residuals, normals, faces[kept], measured.spacing)
    excess = inflation(residuals, normals, cells)
    box = box_covariance(refined, excess)
    deviations = np.full(len(template.faces), np.inf)
    across = np.sqrt(np.einsum("ni,ij,nj->n", refined.jacobian, box, refined.jacobian))
    for number in range(1, len(template.faces) + 1):
        if (faces == number).any():
            deviations[number - 1] = float(np.sqrt(np.mean(across[faces == number] ** 2)))
    sides = face_sides(
        template.faces,
        measured,
        faces,
        deviations,
        nearest=lambda places: template.distance(places, x),
        tolerance=max(3 * refined.sigma, measured.noise),
    )
    covariance = sought.spread @ box @ sought.spread.T
    open_ = np.flatnonzero(np.diag(box) > _UNKNOWN * PRIOR_VARIANCE)
    lost = (sought.spread[:, open_] != 0).any(axis=1)
    covariance[lost], covariance[:, lost] = 0.0, 0.0
    covariance[lost, lost] = np.inf
    names = tuple(name for name, gone in zip(template.names, lost, strict=True) if gone)
    sign, size = np.linalg.slogdet(box / PRIOR_VARIANCE)
    cost = -0.5 * float(size) if sign > 0 else 0.0
    return Known(covariance, names, faces, sides, cost=cost, excess=excess)


def _gradient(template: Template, points: FloatArray, x: FloatArray, step: float) -> FloatArray:
    """Differences (n, 3) of the distances of points (n, 3) as they move: along the normal, of no length."""
    moved = [step * direction for direction in np.eye(3)]
    return np.column_stack(
        [template.distance(points + d, x)[0] - template.distance(points - d, x)[0] for d in moved]
    )


def evidence(measured: Measured, refined: Refined, known: Known) -> tuple[float, str]:
    """Return the log odds against the best plain surface, in nats, and which that is."""
    step = max(1, len(measured.points) // MOST_POINTS)
    floor, reach = max(1e-9 * measured.diagonal, 1e-300), max(measured.diagonal, 1e-300)
    sigma = max(refined.sigma, floor)
    fitted = log_likelihood(refined.distances[::step], sigma, reach)
    plain, name = plain_likelihood(measured.points[::step], floor, reach)
    return (fitted - plain) * step / known.excess - known.cost, name


def misfit(measured: Measured, refined: Refined) -> str:
    """Return what is wrong where points scatter about the faces by more than noise and form explain.

    A template that follows the bulk of a scene beats any plain surface, and is still not there.
    """
    size = float(np.linalg.norm(np.ptp(measured.points[refined.inliers], axis=0)))
    if refined.sigma <= max(_SCATTER * measured.noise, _FORM * size):
        return ""
    times = f", {refined.sigma / measured.noise:.0f} times their noise" if measured.noise > 0 else ""
    return f"points scatter by {refined.sigma:.3g} about its faces{times}"


def judged(
    template: Template, known: Known, evidence: float, *, plain: str, wrong: str, breach: float
) -> tuple[Status, str]:
    """Return the status, and why it is not simply found; `wrong` is a misfit."""
    if breach > 0:
        return Status.NONE, f"no place obeys the constraints: the best breaks them by {breach:.3g} tolerances"
    if wrong:
        return Status.NONE, wrong
    if evidence <= 0:
        return Status.NONE, f"{plain} explains the points as well ({-evidence:.0f} nats better)"
    against = [side for side in known.sides if side.contradicted > side.confirmed]
    seen = [side for side in known.sides if side.is_seen]
    if not seen:
        return Status.NONE, "no face has points on two tiles"
    if len(against) > len(seen):
        return Status.NONE, f"beams went through {', '.join(side.name for side in against)}"
    if evidence < LEAST_EVIDENCE:
        return Status.AMBIGUOUS, f"{plain} explains the points nearly as well ({evidence:.1f} nats)"
    if len(seen) == 1 < len(template.faces):
        return Status.AMBIGUOUS, f"only {seen[0].name} was seen: it may be a part of anything"
    if known.unknown:
        return Status.FOUND, f"the points leave open: {', '.join(known.unknown)}"
    return Status.FOUND, ""
