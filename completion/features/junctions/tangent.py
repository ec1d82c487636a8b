# SPDX-License-Identifier: MIT
"""Tangent junctions: two cylinders, or a cylinder and a plane, that touch along a line; fitted as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from completion.features.engine.template import FeatureSide, FeatureStatus, Measurements, TemplateFit
from completion.features.junctions import limits
from completion.features.junctions.alternatives import (
    Certainty,
    WeighedFit,
    alternatives,
    judge,
    one_arc,
    parameter_covariance,
    sides_of,
    weigh,
)
from completion.features.junctions.models import (
    Descent,
    Model,
    Unit,
    at_unit,
    descend_from,
    descend_to_rest,
    flat_starts,
    split_starts,
    tangent_arcs,
    thickness,
)
from scenes.checks import BoolArray, FloatArray

NAMES = ("radius_1", "radius_2", "joint_x", "joint_y", "joint_z", "axis_x", "axis_y", "axis_z")
FACES = ("surface 1", "surface 2")
_FREE = np.array([True, True, True, True, True, False, True, True])
_SIGNS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_BINS = 12  # along a joint


def fit_junction(measured: Measurements, given: Mapping[str, float]) -> TemplateFit:
    """Fit a tangent junction to points, all of which, but for outliers, lie on it.

    Curvatures have a sign, so that S-shaped, same-sided and plane junctions are one family (the formula
    stands in `profiles.tangent_arcs`). Starts need no guess: twelve directions in the principal frame, and
    the one best cylinder bent at eight places. Points are noise or outliers, each as likely as its
    distance says.

    Parameters
    ----------
    measured : Measurements
        Points (n, 3).
    given : mapping
        "radius_1", "radius_2": held exactly; inf for a plane. Without them the smaller is the first.
    """
    n = len(measured.points)
    if n < limits.SIDE_POINTS:
        return TemplateFit.absent(
            "junction", NAMES, n, f"{n} points are too few for a junction ({limits.SIDE_POINTS})"
        )
    unit = at_unit(measured)
    held = {name: value for name, value in given.items() if name in NAMES[:2]}
    return _describe_junction(_fit_junction(unit, held), unit, tuple(held))


def _fit_junction(unit: Unit, given: Mapping[str, float]) -> WeighedFit:
    """The most likely junction, and the plain alternatives."""
    points, reach = unit.points, thickness(unit.points)
    single = one_arc(points, reach)
    curvatures = np.array(
        [1 / (given[name] * unit.factor) if name in given else np.nan for name in NAMES[:2]]
    )
    is_held = np.isfinite(curvatures)
    is_free = _FREE & np.append(np.ones(6, dtype=np.bool_), ~is_held)
    shapes = np.unique(np.where(is_held, curvatures, 0.0) * _SIGNS, axis=0)
    starts = flat_starts(points, tangent_arcs, shapes, is_free)
    if is_held.any():
        starts += [turned_round(start) for start in starts]
    near = [replace(start, shape=np.where(is_held, shape, start.shape))
            for start in split_starts(single.model, points, single.mixture.sigma, is_free)
            for shape in (shapes if is_held.any() else shapes[:1])]  # fmt: skip
    descend = descend_from(starts, points, reach, near)
    best = _try_plane(descend[0], points, is_held)
    return weigh(
        best,
        alternatives(points, reach, single),
        unit,
        rival=lambda excess: _rival(descend, unit.factor, len(points), excess),
        evaluations=descend[0].evaluations,
    )


def turned_round(model: Model) -> Model:
    """Return the model turned by 180 degrees about x: the first side is where the second was."""
    return replace(model, turn=model.turn * np.array([[1.0], [-1.0], [-1.0]]))


def _try_plane(descent: Descent, points: FloatArray, is_held: BoolArray) -> Descent:
    """The fit with a plane instead of the flatter surface, where that is as likely for a parameter less."""
    flatter = int(np.argmin(np.abs(descent.model.shape)))
    if is_held[flatter]:
        return descent
    shape, is_free = descent.model.shape.copy(), descent.model.is_free.copy()
    shape[flatter], is_free[6 + flatter] = 0.0, False
    flat = descend_to_rest(
        descent._replace(model=replace(descent.model, shape=shape, is_free=is_free)), points
    )
    worth = 0.5 * float(np.log(len(points)))
    return flat if flat.log_likelihood > descent.log_likelihood - worth else descent


def _rival(pairs: Sequence[Descent], factor: float, n: int, excess: float) -> str:
    """Another solution for n points that is nearly as likely and has other radii."""
    first = np.sort(np.abs(pairs[0].model.shape))
    ahead = limits.AHEAD_NATS + limits.OUTLIER_NATS * pairs[0].mixture.share * n
    for descent in pairs[1:]:
        second = np.sort(np.abs(descent.model.shape))
        behind = (pairs[0].log_likelihood - descent.log_likelihood) / excess
        if behind < ahead and (np.abs(second - first) > limits.OTHER_RADIUS * first.max()).any():
            radii = " and ".join(f"{1 / max(k * factor, 1e-12):.4g}" for k in second[::-1])
            return f"radii {radii} are nearly as likely ({behind:.1f} nats less)"
    return ""


def _describe_junction(junction: WeighedFit, unit: Unit, held: tuple[str, ...]) -> TemplateFit:
    """Return a junction, in the unit of the points."""
    descent, known = junction.descent, junction.known
    model = descent.model
    first = 0 if held or abs(model.shape[0]) >= abs(model.shape[1]) else 1
    order = [first, 1 - first]
    local = model.local(unit.points[known.near])
    ends = np.quantile(local[:, 2], (0.005, 0.995)) if len(local) else np.zeros(2)

    def parameters(tube: Model) -> FloatArray:
        with np.errstate(divide="ignore"):
            radii = 1 / np.abs(tube.shape[order]) / unit.factor
        return np.concatenate([radii, unit.outside(tube.origin + ends.mean() * tube.turn[2]), tube.turn[2]])

    x = parameters(model)
    covariance = parameter_covariance(parameters, model, known)
    faces = np.where(known.faces > 0, np.where(known.faces == first + 1, 1, 2), 0)
    known = known._replace(faces=faces)
    if first:
        descent = descent._replace(model=turned_round(model))
        local = local * [1.0, -1.0, -1.0]
    joint = _joint(local, ends, unit, _across(model, known) / unit.factor)
    sides = (*sides_of(FACES, descent, known, unit), joint)
    status, reason = _judge_junction(junction, x, covariance, sides, local=local / unit.factor)
    bends = descent.model.shape
    return TemplateFit(
        kind="junction",
        status=status,
        names=NAMES,
        x=x,
        covariance=covariance,
        sides=sides,
        evidence=junction.evidence,
        faces=FACES,
        assignment=faces,
        evaluations=junction.evaluations,
        reason=reason,
        geometry={
            "radii": x[:2],
            "joint": unit.outside(model.origin + ends[:, None] * model.turn[2]),
            "axis": model.turn[2],
            "is_s_shaped": bool(bends[0] * bends[1] < 0),
        },
        held=held,
    )


def _across(model: Model, known: Certainty) -> float:
    """Standard deviation of the joint along the surfaces, across itself."""
    row = model.basis[4]  # the shift along y
    return float(np.sqrt(max(row @ known.covariance @ row, 0.0)))


def _joint(local: FloatArray, ends: FloatArray, unit: Unit, deviation: float) -> FeatureSide:
    """The support of the joint: pieces along it with points close by on both sides."""
    spacing = unit.measured.spacing
    length = max(float(np.ptp(ends)) / _BINS, 4 * spacing, 1e-12)
    pieces = np.floor((local[:, 2] - ends[0]) / length).astype(np.int64)
    beside = np.abs(local[:, 1]) < 0.5 * length
    sides = [set(pieces[beside & (sign * local[:, 1] > 0)].tolist()) for sign in (1.0, -1.0)]
    return FeatureSide(
        "joint", len(sides[0] & sides[1]), 0, max(1, len(set(pieces.tolist()))), deviation=deviation
    )


def _judge_junction(
    junction: WeighedFit,
    x: FloatArray,
    covariance: FloatArray,
    sides: tuple[FeatureSide, ...],
    *,
    local: FloatArray,
) -> tuple[FeatureStatus, str]:
    """The status and why."""
    refusal = judge(junction, [side.name for side in sides if not side.is_seen])
    if refusal:
        return refusal
    deviations = np.sqrt(np.diag(covariance)[:2])
    vague = [
        name
        for name, r, sd in zip(NAMES, x, deviations, strict=False)
        if np.isfinite(r) and sd > limits.VAGUE * r
    ]
    if vague:
        return FeatureStatus.AMBIGUOUS, f"the points hardly tell {' and '.join(vague)}"
    shorter = min(float(np.quantile(local[:, 1], 0.99)), -float(np.quantile(local[:, 1], 0.01)))
    if sides[2].deviation > limits.LOOSE * shorter:
        return FeatureStatus.AMBIGUOUS, "the points hardly tell where the joint lies"
    model, mixture = junction.descent.model, junction.descent.mixture
    factor = 1 / (float(x[0]) * float(np.abs(model.shape).max()))
    apart = abs(float(model.shape[0] - model.shape[1])) * (factor * shorter) ** 2 / 2
    if mixture.share > limits.MANY_OUTLIERS and apart < limits.WITHIN_SD * mixture.sigma:
        return (
            FeatureStatus.AMBIGUOUS,
            f"{mixture.share:.0%} outliers, and both sides bend too much alike for that",
        )
    return FeatureStatus.FOUND, ""
