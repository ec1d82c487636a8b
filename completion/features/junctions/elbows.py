# SPDX-License-Identifier: MIT
"""Elbows: a bend of a tube between two straight ones of the same radius, tangent by construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from completion.features.engine.limits import LEAST_EVIDENCE
from completion.features.engine.template import FeatureSide, FeatureStatus, Measurements, TemplateFit
from completion.features.junctions import limits
from completion.features.junctions.alternatives import (
    Alternative,
    WeighedFit,
    judge,
    parameter_covariance,
    sides_of,
    weigh,
)
from completion.features.junctions.models import (
    Descent,
    Mixture,
    Model,
    Unit,
    at_unit,
    descend_from,
    elbow,
    thickness,
)
from completion.fitting.given_geometry import given_of_shape
from completion.fitting.result import FitError
from completion.fitting.robust import consensus_surface, fit_robust
from completion.fitting.starts import orient_normals
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Torus

_N_SAMPLE = 1_500
_BENDS = (1.0, 1.5, 2.2, 3.2, 4.8)  # radii of the tube, where nothing says more
_HALVES = tuple(np.radians([15.0, 22.5, 30.0, 45.0]))


def bend_starts(points: FloatArray, given: FloatArray) -> list[Model]:
    """Return models of elbows to begin with, at points (n, 3) at unit RMS.

    Parameters
    ----------
    points : (n, 3) float
        At unit RMS.
    given : (3,) float
        Half the angle, radius of the bend and of the tube; NaN where it is not given.
    """
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    normals, roughness = orient_normals(sample, points)
    tubes = _tubes(sample, normals, limits.WITHIN_SD * roughness, given[2])
    starts = [model for pair in _pairs(tubes) for model in _elbows_between(*pair, given)]
    if starts:
        return starts
    try:
        bend = cast(Torus, consensus_surface(sample, normals, "torus", limits.WITHIN_SD * roughness))
    except FitError:
        return []
    on = np.abs(bend.distance(sample)) < limits.WITHIN_SD * roughness
    return _about(bend, sample[on], given)


def _tubes(
    sample: FloatArray, normals: FloatArray, tolerance: float, radius: float
) -> list[tuple[Cylinder, FloatArray]]:
    """Up to three cylinders, each of what those before leave, and the points (m, 3) on each."""
    held = given_of_shape("cylinder", float(radius), None) if np.isfinite(radius) else None
    tubes, left = [], np.ones(len(sample), dtype=np.bool_)
    for _ in range(3):
        if left.sum() < limits.SIDE_POINTS:
            break
        try:
            tube = cast(Cylinder, consensus_surface(sample[left], normals[left], "cylinder", tolerance, held))
        except FitError:
            break
        across = np.abs(np.einsum("ij,j->i", normals, tube.direction)) < 0.35
        on: BoolArray = left & (np.abs(tube.distance(sample)) < tolerance) & across
        if on.sum() < limits.SIDE_POINTS // 2:
            break
        tubes.append((tube, sample[on]))
        left &= ~on
    return tubes


_Tube = tuple[Cylinder, FloatArray]


def _pairs(tubes: list[_Tube]) -> list[tuple[_Tube, _Tube]]:
    """Pairs of tubes whose axes turn, and nearly cross."""
    pairs = []
    for i, (first, _) in enumerate(tubes):
        for j in range(i):
            second = tubes[j][0]
            normal = np.cross(first.direction, second.direction)
            sine = float(np.linalg.norm(normal))
            if sine < limits.LEAST_TURN:
                continue
            miss = abs(float((first.point - second.point) @ normal)) / sine
            if miss < limits.MISS_START * max(first.radius, second.radius):
                pairs.append((tubes[i], tubes[j]))
    return pairs


def _elbows_between(first: _Tube, second: _Tube, given: FloatArray) -> list[Model]:
    """Elbows between two tubes, with bends of several radii."""
    a, b = first[0], second[0]
    gap = b.point - a.point
    along = float(a.direction @ b.direction)
    s, t = np.linalg.solve([[1.0, -along], [along, -1.0]], [gap @ a.direction, gap @ b.direction])
    corner = (a.point + s * a.direction + b.point + t * b.direction) / 2
    ways = [
        np.sign((tube[1].mean(axis=0) - corner) @ tube[0].direction) * tube[0].direction
        for tube in (first, second)
    ]
    inward = ways[0] + ways[1]
    if np.linalg.norm(inward) < 1e-6:
        return []
    x = -inward / np.linalg.norm(inward)
    y = ways[0] - (ways[0] @ x) * x
    y = y / np.linalg.norm(y)
    half = (np.pi - np.arccos(np.clip(ways[0] @ ways[1], -1, 1))) / 2
    tube = (a.radius + b.radius) / 2
    models = []
    for wide in _BENDS:
        shape = np.where(np.isfinite(given), given, [half, wide * tube, tube])
        origin = corner - x * shape[1] / np.cos(half)
        models.append(Model(elbow, np.stack([x, y, np.cross(x, y)]), origin, shape, _free(given)))
    return models


def _about(bend: Torus, on: FloatArray, given: FloatArray) -> list[Model]:
    """Elbows of a bend, of several angles, the middle where its points (m, 3) are."""
    flat = on - bend.centre
    flat = flat - np.outer(flat @ bend.direction, bend.direction)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    middle = flat.mean(axis=0)
    if np.linalg.norm(middle) < 0.1:
        return []
    x = middle / np.linalg.norm(middle)
    turn = np.stack([x, np.cross(bend.direction, x), bend.direction])
    models = []
    for half in _HALVES:
        shape = np.where(np.isfinite(given), given, [half, bend.radius, bend.tube_radius])
        models.append(Model(elbow, turn, bend.centre, shape, _free(given)))
    return models


def _free(given: FloatArray) -> BoolArray:
    return np.append(np.ones(6, dtype=np.bool_), ~np.isfinite(given))


SHAPE = ("angle", "bend_radius", "tube_radius")
NAMES = (*SHAPE, "corner_x", "corner_y", "corner_z", "axis_x", "axis_y", "axis_z")
FACES = ("bend", "tube 1", "tube 2")
_PLAIN = {"plane": 3, "sphere": 4, "cylinder": 5, "torus": 7}
_ARTICLE = {"plane": "a plane", "sphere": "a sphere", "cylinder": "one cylinder"}


def fit_elbow(measured: Measurements, given: Mapping[str, float]) -> TemplateFit:
    """Fit an elbow to points, all of which, but for outliers, lie on it; one side of it may be enough.

    Nine parameters: the frame of the bend, half its angle, its radius and the tube's. Starts are two
    cylinders of consensus whose axes cross, or a torus of consensus.

    Parameters
    ----------
    measured : Measurements
        Points (n, 3).
    given : mapping
        "angle" (radians, by which the pipe turns), "bend_radius" (of the bend's middle line), "tube_radius":
        held exactly.
    """
    n = len(measured.points)
    if n < limits.JOINT_POINTS:
        return TemplateFit.absent(
            "elbow", NAMES, n, f"{n} points are too few for an elbow ({limits.JOINT_POINTS})"
        )
    unit = at_unit(measured)
    held = {name: value for name, value in given.items() if name in SHAPE}
    elbow = _fit_elbow(unit, held)
    if isinstance(elbow, str):
        return TemplateFit.absent("elbow", NAMES, n, elbow)
    return _describe_elbow(elbow, unit, tuple(held))


def _fit_elbow(unit: Unit, given: Mapping[str, float]) -> WeighedFit | str:
    """The most likely elbow and the plain alternatives, or why there is none."""
    points, reach = unit.points, thickness(unit.points)
    units = {"angle": 0.5, "bend_radius": unit.factor, "tube_radius": unit.factor}
    shape = np.array([given[name] * units[name] if name in given else np.nan for name in SHAPE])
    starts = bend_starts(points, shape)
    if not starts:
        return "neither two tubes whose axes cross nor a bend was found to begin with"
    pairs = [descent for descent in descend_from(starts, points, reach) if _is_bend(descent.model)]
    if not pairs:
        return "no bend is wider than the tube"
    best = pairs[0]
    return weigh(
        best,
        _alternatives(points, best),
        unit,
        rival=lambda excess: _rival(pairs, unit.factor, excess),
        evaluations=best.evaluations,
    )


def _is_bend(model: Model) -> bool:
    """Whether the shape is one: a bend that is no tighter than its tube, and less than half a turn."""
    half, bend, tube = model.shape
    return bool(0.02 < half < 1.55 and tube > 0 and bend > limits.TIGHTEST * tube)


def _alternatives(points: FloatArray, best: Descent) -> list[Alternative]:
    """What else the points (n, 3) may be."""
    model, mixture = best.model, best.mixture
    radius, tube = (float(value) for value in model.shape[1:])
    bend = Torus(model.origin, model.turn[2], radius, tube) if radius > tube else None
    alternatives = [Alternative("outliers alone", -len(points) * float(np.log(mixture.reach)), 0)]
    for kind, n in _PLAIN.items():
        try:
            start = bend if kind == "torus" else None
            distances = fit_robust(points, kind, start).surface.distance(points)
        except FitError:
            continue
        members = Mixture.of(distances, mixture.reach, mixture.sigma, limits.LEAST_SIGMA)
        name = _ARTICLE.get(kind, "a bend without tubes")
        alternatives.append(Alternative(name, float(members.log_densities(distances).sum()), n))
    return alternatives


def _rival(pairs: Sequence[Descent], factor: float, excess: float) -> str:
    """Another solution that is nearly as likely and has another shape."""
    first = pairs[0].model.shape
    for descent in pairs[1:]:
        behind = (pairs[0].log_likelihood - descent.log_likelihood) / excess
        if (
            behind < LEAST_EVIDENCE
            and (np.abs(descent.model.shape - first) > limits.OTHER_RADIUS * first).any()
        ):
            bend, tube = descent.model.shape[1:] / factor
            return (
                f"a bend of {bend:.4g} of a tube of {tube:.4g} is nearly as likely ({behind:.1f} nats less)"
            )
    return ""


def _describe_elbow(elbow: WeighedFit, unit: Unit, held: tuple[str, ...]) -> TemplateFit:
    """Return an elbow, in the unit of the points."""
    descent, known = elbow.descent, elbow.known

    def parameters(model: Model) -> FloatArray:
        half, bend, tube = model.shape
        corner = unit.outside(model.origin + bend / np.cos(half) * model.turn[0])
        return np.concatenate([[2 * half, bend / unit.factor, tube / unit.factor], corner, model.turn[2]])

    x, covariance = parameters(descent.model), parameter_covariance(parameters, descent.model, known)
    sides = sides_of(FACES, descent, known, unit)
    status, reason = _judge_elbow(elbow, x, covariance, sides)
    half, bend, _ = descent.model.shape
    ends = bend * np.array([[np.cos(half), -np.sin(half), 0.0], [np.cos(half), np.sin(half), 0.0]])
    return TemplateFit(
        kind="elbow",
        status=status,
        names=NAMES,
        x=x,
        covariance=covariance,
        sides=sides,
        evidence=elbow.evidence,
        faces=FACES,
        assignment=known.faces,
        evaluations=elbow.evaluations,
        reason=reason,
        geometry={
            "radii": x[1:3],
            "joint": unit.outside(descent.model.origin + ends @ descent.model.turn),
            "axis": descent.model.turn[2],
            "centres": unit.outside(descent.model.origin)[None],
        },
        held=held,
    )


def _judge_elbow(
    elbow: WeighedFit, x: FloatArray, covariance: FloatArray, sides: tuple[FeatureSide, ...]
) -> tuple[FeatureStatus, str]:
    """The status and why."""
    unseen = [side.name for side in sides if not side.is_seen]
    refused = unseen if "bend" in unseen or len(unseen) > 1 else []
    refusal = judge(
        elbow, refused, f"{unseen[0]} was not seen: where the bend ends is open" if unseen else ""
    )
    if refusal:
        return refusal
    deviations = np.sqrt(np.diag(covariance)[:3])
    vague = [name for name, value, sd in zip(SHAPE, x, deviations, strict=False) if sd > limits.LOOSE * value]
    if vague:
        return FeatureStatus.AMBIGUOUS, f"the points hardly tell {' and '.join(vague)}"
    return FeatureStatus.FOUND, ""
