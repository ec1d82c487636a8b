# SPDX-License-Identifier: MIT
"""Elbows: a bend of a tube between two straight ones of the same radius, tangent by construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from completion.fitting.result import FitError
from completion.fitting.robust import fit_robust
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Side, Status, TemplateFit
from completion.templates.junctions.alternatives import Alternative
from completion.templates.junctions.bend_starts import bend_starts
from completion.templates.junctions.certainty import sides_of, told_covariance
from completion.templates.junctions.descent import LEAST_SIGMA, Descended, descend_from
from completion.templates.junctions.mixture import Mixture, thickness
from completion.templates.junctions.model import Model
from completion.templates.junctions.starts import Unit, at_unit
from completion.templates.junctions.weighing import LEAST_EVIDENCE, Weighed, weigh
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Torus

SHAPE = ("angle", "bend_radius", "tube_radius")
NAMES = (*SHAPE, "corner_x", "corner_y", "corner_z", "axis_x", "axis_y", "axis_z")
FACES = ("bend", "tube 1", "tube 2")
_PLAIN = {"plane": 3, "sphere": 4, "cylinder": 5, "torus": 7}
_ARTICLE = {"plane": "a plane", "sphere": "a sphere", "cylinder": "one cylinder"}
_VAGUE = 0.3  # of a value, that its standard deviation may be
_OTHER = 0.15  # of a radius, by which another solution differs
_TIGHTEST = 0.8  # of the tube's radius, that a bend has
_LEAST_POINTS = 60


def fit_elbow(measured: Measured, given: Mapping[str, float]) -> TemplateFit:
    """Fit an elbow to points, all of which, but for outliers, lie on it; one side of it may be enough.

    Nine parameters: the frame of the bend, half its angle, its radius and the tube's. Starts are two
    cylinders of consensus whose axes cross, or a torus of consensus.

    Parameters
    ----------
    measured : Measured
        Points (n, 3).
    given : mapping
        "angle" (radians, by which the pipe turns), "bend_radius" (of the bend's middle line), "tube_radius":
        held exactly.
    """
    n = len(measured.points)
    if n < _LEAST_POINTS:
        return TemplateFit.absent("elbow", NAMES, n, f"{n} points are too few for an elbow ({_LEAST_POINTS})")
    unit = at_unit(measured)
    held = {name: value for name, value in given.items() if name in SHAPE}
    elbow = _fitted(unit, held)
    if isinstance(elbow, str):
        return TemplateFit.absent("elbow", NAMES, n, elbow)
    return _told(elbow, unit, tuple(held))


def _fitted(unit: Unit, given: Mapping[str, float]) -> Weighed | str:
    """The most likely elbow and the plain alternatives, or why there is none."""
    points, reach = unit.points, thickness(unit.points)
    units = {"angle": 0.5, "bend_radius": unit.factor, "tube_radius": unit.factor}
    shape = np.array([given[name] * units[name] if name in given else np.nan for name in SHAPE])
    starts = bend_starts(points, shape)
    if not starts:
        return "neither two tubes whose axes cross nor a bend was found to begin with"
    found = [one for one in descend_from(starts, points, reach) if _is_bend(one.model)]
    if not found:
        return "no bend is wider than the tube"
    best = found[0]
    return weigh(
        best,
        _alternatives(points, best),
        unit,
        rival=lambda excess: _rival(found, unit.factor, excess),
        evaluations=best.evaluations,
    )


def _is_bend(model: Model) -> bool:
    """Whether the shape is one: a bend that is no tighter than its tube, and less than half a turn."""
    half, bend, tube = model.shape
    return bool(0.02 < half < 1.55 and tube > 0 and bend > _TIGHTEST * tube)


def _alternatives(points: FloatArray, best: Descended) -> list[Alternative]:
    """What else the points (n, 3) may be."""
    model, mixture = best.model, best.mixture
    radius, tube = (float(one) for one in model.shape[1:])
    bend = Torus(model.origin, model.turn[2], radius, tube) if radius > tube else None
    found = [Alternative("outliers alone", -len(points) * float(np.log(mixture.reach)), 0)]
    for kind, n in _PLAIN.items():
        try:
            start = bend if kind == "torus" else None
            distances = fit_robust(points, kind, start).surface.distance(points)
        except FitError:
            continue
        own = Mixture.of(distances, mixture.reach, mixture.sigma, LEAST_SIGMA)
        name = _ARTICLE.get(kind, "a bend without tubes")
        found.append(Alternative(name, float(own.log_densities(distances).sum()), n))
    return found


def _rival(found: Sequence[Descended], factor: float, excess: float) -> str:
    """Another solution that is nearly as likely and has another shape."""
    first = found[0].model.shape
    for one in found[1:]:
        behind = (found[0].log_likelihood - one.log_likelihood) / excess
        if behind < LEAST_EVIDENCE and (np.abs(one.model.shape - first) > _OTHER * first).any():
            bend, tube = one.model.shape[1:] / factor
            return (
                f"a bend of {bend:.4g} of a tube of {tube:.4g} is nearly as likely ({behind:.1f} nats less)"
            )
    return ""


def _told(elbow: Weighed, unit: Unit, held: tuple[str, ...]) -> TemplateFit:
    """What is told of an elbow, in the unit of the points."""
    found, known = elbow.found, elbow.known

    def told(one: Model) -> FloatArray:
        half, bend, tube = one.shape
        corner = unit.outside(one.origin + bend / np.cos(half) * one.turn[0])
        return np.concatenate([[2 * half, bend / unit.factor, tube / unit.factor], corner, one.turn[2]])

    x, covariance = told(found.model), told_covariance(told, found.model, known)
    sides = sides_of(FACES, found, known, unit)
    status, reason = _judged(elbow, x, covariance, sides)
    half, bend, _ = found.model.shape
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
            "joint": unit.outside(found.model.origin + ends @ found.model.turn),
            "axis": found.model.turn[2],
            "centres": unit.outside(found.model.origin)[None],
        },
        held=held,
    )


def _judged(
    elbow: Weighed, x: FloatArray, covariance: FloatArray, sides: tuple[Side, ...]
) -> tuple[Status, str]:
    """The status and why."""
    if elbow.evidence <= 0:
        return Status.NONE, f"{elbow.plain} explains the points as well ({-elbow.evidence:.1f} nats better)"
    if elbow.misfit:
        return Status.NONE, elbow.misfit
    unseen = [side.name for side in sides if not side.is_seen]
    if "bend" in unseen or len(unseen) > 1:
        return Status.NONE, f"not seen: {', '.join(unseen)}"
    if elbow.evidence < LEAST_EVIDENCE:
        return (
            Status.AMBIGUOUS,
            f"{elbow.plain} explains the points nearly as well ({elbow.evidence:.1f} nats)",
        )
    if unseen:
        return Status.AMBIGUOUS, f"{unseen[0]} was not seen: where the bend ends is open"
    if elbow.rival:
        return Status.AMBIGUOUS, elbow.rival
    deviations = np.sqrt(np.diag(covariance)[:3])
    vague = [name for name, value, sd in zip(SHAPE, x, deviations, strict=False) if sd > _VAGUE * value]
    if vague:
        return Status.AMBIGUOUS, f"the points hardly tell {' and '.join(vague)}"
    return Status.FOUND, ""
