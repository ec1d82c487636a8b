# SPDX-License-Identifier: MIT
"""Fit of a template on one page: search, least squares, evidence against a plain surface, and its status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.features.engine import limits
from completion.features.engine.least_squares import (
    PRIOR_VARIANCE,
    Refinement,
    box_covariance,
    inflation,
    neighbour_cells,
    refine,
)
from completion.features.engine.search import Gate, SoughtParameters, breach, equations, explore
from completion.features.engine.template import (
    FeatureSide,
    FeatureStatus,
    Given,
    Measurements,
    Template,
    TemplateFit,
)
from completion.fitting.euclidean import fit_euclidean
from completion.fitting.limits import TUKEY
from completion.fitting.result import FitError
from completion.fitting.robust import fit_robust
from scenes.checks import BoolArray, FloatArray, InputError, IntArray

MOST_POINTS = 3_000
_PARAMETERS = {"plane": 3, "cylinder": 5}


def log_likelihood(distances: FloatArray, sigma: float, reach: float) -> float:
    """Sum of the logarithms of densities of distances (n,): normal, and uniform up to `reach` for outliers.

    The share of outliers is that beyond 4.685 sigma, and never none or all.
    """
    size = np.abs(distances)
    share = float(np.clip(np.mean(size > TUKEY * sigma), 1 / (len(size) + 2), 1 - 1 / (len(size) + 2)))
    normal = np.exp(-0.5 * (size / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
    return float(np.log((1 - share) * normal + share / reach).sum())


def plain_likelihood(points: FloatArray, least_sigma: float, reach: float) -> tuple[float, str]:
    """Return the greatest log likelihood of a plain explanation, less what its parameters cost; and its name.

    A plane, a cylinder, robust or through all, each with the noise that suits it, or scattered points; a
    parameter costs log(n) / 2 (Schwarz 1978).

    Parameters
    ----------
    points : (n, 3) float
        At most some thousands.
    least_sigma : float
        Noise of points, at least.
    reach : float
        Of outliers: the diagonal of all.
    """
    best, name = -len(points) * float(np.log(reach)), "scattered points"
    for kind, k in _PARAMETERS.items():
        for robust in (True, False):
            try:
                fit = fit_robust(points, kind) if robust else fit_euclidean(points, kind)
            except (FitError, InputError):
                continue
            distances = fit.surface.distance(points)
            sigma = max(fit.rms, least_sigma)
            value = log_likelihood(distances, sigma, reach) - k / 2 * float(np.log(len(points)))
            if value > best:
                best, name = value, f"a {kind}"
    return best, name


Nearest = Callable[[FloatArray], tuple[FloatArray, IntArray]]
"""From points (n, 3) to distance and number (n,) of the nearest face, from 1."""

_N_BEAMS, _N_STEPS, _N_SAMPLE = 2_000, 80, 2_000


def face_sides(
    names: Sequence[str],
    measured: Measurements,
    faces: IntArray,
    deviations: FloatArray,
    *,
    nearest: Nearest,
    tolerance: float,
) -> tuple[FeatureSide, ...]:
    """Return the support of each face.

    Tiles are cubes of six typical distances between the points of a face. One is confirmed by four of them,
    and contradicted by beams that went through the face there and on, unless it is confirmed.

    Parameters
    ----------
    names : sequence of str
        Of the faces.
    measured : Measurements
        What was measured.
    faces : (n,) int
        Face of each point, from 1; 0 for none.
    deviations : (f,) float
        Of the place of each face across itself.
    nearest : callable
        Distances to the template, for beams.
    tolerance : float
        Within which a point agrees with a face.
    """
    through, through_faces = _passages(measured, measured.points[faces > 0], nearest, tolerance)
    sides = []
    for number, name in enumerate(names, start=1):
        points = measured.points[faces == number]
        side = max(
            limits.TILE_SPACINGS * max(measured.spacing, _typical_spacing(points)), 4 * tolerance, 1e-12
        )
        confirmed = _tiles(points, side, limits.TILE_POINTS)
        crossed = _tiles(through[through_faces == number], side, 1) - confirmed
        n = len(confirmed) + len(crossed)
        deviation = float(deviations[number - 1])
        sides.append(FeatureSide(name, len(confirmed), len(crossed), n, deviation=deviation))
    return tuple(sides)


def _typical_spacing(points: FloatArray) -> float:
    """Typical distance between the points (n, 3) of a face: where beams graze it they lie farther apart."""
    if len(points) < limits.TILE_POINTS:
        return 0.0
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    away, _ = cKDTree(points).query(sample, k=limits.TILE_POINTS)
    return float(np.median(away[:, -1]) / np.sqrt(limits.TILE_POINTS - 1))


def _tiles(points: FloatArray, side: float, least: int) -> set[tuple[int, ...]]:
    """Numbers of the cubes with so many of the points (n, 3) at least."""
    cells, count = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_counts=True)
    return {tuple(cell) for cell in cells[count >= least].tolist()}


def _passages(
    measured: Measurements, explained: FloatArray, nearest: Nearest, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """Where beams (m, 3) went through a face and on, and its number (m,); by steps of the distance.

    Of beams that pass the ball round the points (n, 3) that the template explains.
    """
    beams = measured.beams
    if beams is None or len(beams.ranges) == 0 or len(explained) == 0:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    middle = (explained.min(axis=0) + explained.max(axis=0)) / 2
    reach = float(np.linalg.norm(explained - middle, axis=1).max())
    away = middle - beams.origins
    along = np.einsum("ij,ij->i", away, beams.directions)
    passes = np.einsum("ij,ij->i", away, away) - np.square(along) <= reach**2
    near = np.isfinite(beams.ranges) & passes & (along > -reach) & (beams.ranges > along - reach)
    chosen = np.flatnonzero(near)[:: max(1, int(near.sum()) // _N_BEAMS)]
    origins, directions = beams.origins[chosen], beams.directions[chosen]
    end = beams.ranges[chosen] - 4 * tolerance - measured.spacing
    gone, hit = np.zeros(len(chosen)), np.zeros(len(chosen), dtype=np.int64)
    for _ in range(_N_STEPS):
        going: BoolArray = (hit == 0) & (gone < end)
        if not going.any():
            break
        places = origins[going] + gone[going, None] * directions[going]
        distance, face = nearest(places)
        size = np.abs(distance)
        # one that passes within the tolerance beside a face has not gone through it
        hit[going] = np.where(size < 0.05 * tolerance, face, 0)
        gone[going] += size
    met = (hit > 0) & (gone < end)
    return origins[met] + gone[met, None] * directions[met], hit[met]


class LocalFit(NamedTuple):
    """What least squares says of a place."""

    covariance: FloatArray  # (k, k); infinite where nothing is known
    unknown: tuple[str, ...]  # parameters that the points leave open
    faces: IntArray  # (n,) face of each point, 0 for none
    sides: tuple[FeatureSide, ...]
    cost: float  # nats: of the parameters
    excess: float  # inflation of variances


def knowledge(
    template: Template, measured: Measurements, sought: SoughtParameters, refined: Refinement
) -> LocalFit:
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
    open_ = np.flatnonzero(np.diag(box) > limits.OPEN_VARIANCE * PRIOR_VARIANCE)
    lost = (sought.spread[:, open_] != 0).any(axis=1)
    covariance[lost], covariance[:, lost] = 0.0, 0.0
    covariance[lost, lost] = np.inf
    names = tuple(name for name, gone in zip(template.names, lost, strict=True) if gone)
    sign, size = np.linalg.slogdet(box / PRIOR_VARIANCE)
    cost = -0.5 * float(size) if sign > 0 else 0.0
    return LocalFit(covariance, names, faces, sides, cost=cost, excess=excess)


def _gradient(template: Template, points: FloatArray, x: FloatArray, step: float) -> FloatArray:
    """Differences (n, 3) of the distances of points (n, 3) as they move: along the normal, of no length."""
    moved = [step * direction for direction in np.eye(3)]
    return np.column_stack(
        [template.distance(points + d, x)[0] - template.distance(points - d, x)[0] for d in moved]
    )


def evidence(measured: Measurements, refined: Refinement, known: LocalFit) -> tuple[float, str]:
    """Return the log odds against the best plain surface, in nats, and which that is."""
    step = max(1, len(measured.points) // MOST_POINTS)
    floor, reach = max(1e-9 * measured.diagonal, 1e-300), max(measured.diagonal, 1e-300)
    sigma = max(refined.sigma, floor)
    fitted = log_likelihood(refined.distances[::step], sigma, reach)
    plain, name = plain_likelihood(measured.points[::step], floor, reach)
    return (fitted - plain) * step / known.excess - known.cost, name


def misfit(measured: Measurements, refined: Refinement) -> str:
    """Return what is wrong where points scatter about the faces by more than noise and form explain.

    A template that follows the bulk of a scene beats any plain surface, and is still not there.
    """
    size = float(np.linalg.norm(np.ptp(measured.points[refined.inliers], axis=0)))
    if refined.sigma <= max(limits.SCATTER_SD * measured.noise, limits.FORM_ERROR * size):
        return ""
    times = f", {refined.sigma / measured.noise:.0f} times their noise" if measured.noise > 0 else ""
    return f"points scatter by {refined.sigma:.3g} about its faces{times}"


def judge_fit(
    template: Template, known: LocalFit, evidence: float, *, plain: str, wrong: str, breach: float
) -> tuple[FeatureStatus, str]:
    """Return the status, and why it is not simply found; `wrong` is a misfit."""
    if breach > 0:
        return (
            FeatureStatus.NONE,
            f"no place obeys the constraints: the best breaks them by {breach:.3g} tolerances",
        )
    if wrong:
        return FeatureStatus.NONE, wrong
    if evidence <= 0:
        return FeatureStatus.NONE, f"{plain} explains the points as well ({-evidence:.0f} nats better)"
    against = [side for side in known.sides if side.contradicted > side.confirmed]
    seen = [side for side in known.sides if side.is_seen]
    if not seen:
        return FeatureStatus.NONE, "no face has points on two tiles"
    if len(against) > len(seen):
        return FeatureStatus.NONE, f"beams went through {', '.join(side.name for side in against)}"
    if evidence < limits.LEAST_EVIDENCE:
        return FeatureStatus.AMBIGUOUS, f"{plain} explains the points nearly as well ({evidence:.1f} nats)"
    if len(seen) == 1 < len(template.faces):
        return FeatureStatus.AMBIGUOUS, f"only {seen[0].name} was seen: it may be a part of anything"
    if known.unknown:
        return FeatureStatus.FOUND, f"the points leave open: {', '.join(known.unknown)}"
    return FeatureStatus.FOUND, ""


NOTHING: Given = {}
_FOR_SQUARES = 0.3  # of the budget


def fit_template(
    template: Template,
    measured: Measurements,
    given: Given = NOTHING,
    *,
    rng: np.random.Generator,
    budget: int = 20_000,
    starts: FloatArray | None = None,
    equal: Sequence[tuple[str, ...]] = (),
    gates: Sequence[Gate] = (),
) -> TemplateFit:
    """Fit a template to points, and weigh it against a plain surface.

    Parameters
    ----------
    template : Template
        What is fitted.
    measured : Measurements
        Points, and beams where there are.
    given : mapping
        Parameters that are known: held exactly.
    rng : Generator
        Of the search.
    budget : int
        Evaluations at most, of distances to all points that a stage looks at.
    starts : (s, k) float, optional
        Parameters to begin with, among others.
    equal : sequence of tuple of str
        Parameters that are one.
    gates : sequence of Gate
        Constraints that hold within a tolerance; what obeys them beats what does not.

    Returns
    -------
    TemplateFit
        Its evidence is the log likelihood against the best plain surface, both with outliers, less what the
        parameters cost: the share of their bounds that is left to them (Laplace), and divided by what
        neighbouring residuals have in common. It is not complete where the budget, or an interrupt, ended the
        search before the best value stood still, or least squares before the same points kept their weights.
        Parameters that the points leave open have an infinite variance.

    Raises
    ------
    InputError
        Fewer than eight points; a given or equal parameter that there is not; bounds that are not finite.
    """
    points = measured.points
    if len(points) < limits.FEWEST_POINTS:
        raise InputError(f"a template needs {limits.FEWEST_POINTS} points, got {len(points)}")
    bounds = template.bounds(measured)
    sought = equations(template.names, bounds, given, equal)

    # 1. Search: truncated distances of some points, from anywhere.
    begun = [] if starts is None else [sought.sought(start) for start in np.atleast_2d(starts)]
    find = explore(
        template,
        measured,
        sought,
        rng=rng,
        budget=max(1, round((1 - _FOR_SQUARES) * budget)),
        begun=begun,
        gates=gates,
    )

    # 2. Least squares: all points, robust.
    def distance(z: FloatArray) -> FloatArray:
        return template.distance(points, sought.full(z))[0]

    least = 1e-9 * measured.diagonal
    size = np.abs(distance(find.place))
    near = size[size < limits.REACH * measured.diagonal]
    sigma = max(1.4826 * float(np.median(near)) if len(near) else 0.0, least)
    refined = refine(distance, find.place, sigma, least_sigma=least, most=budget - find.evaluations)
    if breach(gates, sought.full(refined.place)) > find.violation:  # least squares knows of no gates
        refined = refine(distance, find.place, sigma, least_sigma=least, most=0)

    # 3. What is known: covariance, faces, evidence.
    known = knowledge(template, measured, sought, refined)
    nats, plain = evidence(measured, refined, known)
    wrong = misfit(measured, refined)
    status, reason = judge_fit(template, known, nats, plain=plain, wrong=wrong, breach=find.violation)
    return TemplateFit(
        kind=template.kind,
        status=status,
        names=template.names,
        x=sought.full(refined.place),
        covariance=known.covariance,
        sides=known.sides,
        evidence=nats,
        faces=template.faces,
        assignment=known.faces,
        evaluations=find.evaluations + refined.evaluations,
        is_complete=find.is_settled and refined.is_settled,
        reason=reason,
        held=sought.held,
    )
