# SPDX-License-Identifier: MIT
"""Joints: where the surfaces end that a tangent junction or an elbow joins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.templates.engine.template import TemplateFit
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane

_ALONG = float(np.cos(np.radians(5.0)))  # between axes that are one
_OFF = 0.1  # of a radius, or of a joint's length, by which a surface may miss its joint
_ONE_SIDE = 0.8  # of a surface's measured points, that lie on its side of a joint
_MOST_POINTS = 5000


def ends_of(
    fit: TemplateFit, surfaces: Sequence[MergedSurface], observations: Sequence[Observation]
) -> list[tuple[int, Plane]]:
    """Return the surfaces, from 1, that a joint ends, each with the plane that it ends at.

    A tube of an elbow ends in the circle where the bend begins; two surfaces that touch end in the line along
    which they do. A surface lies on its plane's side. Those of which more than a fifth was measured beyond
    are not ended.

    Parameters
    ----------
    fit : TemplateFit
        The junction or the elbow, in the frame of the surfaces.
    surfaces : sequence of MergedSurface
        All n.
    observations : sequence of Observation
        The scans.
    """
    found = []
    for end in _tubes(fit) if fit.kind == "elbow" else _seams(fit, surfaces):
        index, plane = end
        if index is None:
            index = _tube_at(plane, fit, surfaces)
        if index is None:
            continue
        points = surfaces[index].points(observations, _MOST_POINTS)
        sides = plane.distance(points)
        if np.mean(sides > 0) >= _ONE_SIDE:
            found.append((index + 1, plane))
        elif fit.kind != "elbow" and np.mean(sides < 0) >= _ONE_SIDE:
            found.append((index + 1, plane.flipped()))
    return found


def _tubes(fit: TemplateFit) -> Iterator[tuple[int | None, Plane]]:
    """The circles at which the tubes of an elbow end, their normals away from the bend."""
    joint, axis = np.asarray(fit.geometry["joint"]), np.asarray(fit.geometry["axis"])
    centre = np.asarray(fit.geometry["centres"])[0]
    for place, other in zip(joint, joint[::-1], strict=True):
        away = np.cross(axis, place - centre)
        yield None, Plane(place, away if away @ (place - other) > 0 else -away)


def _tube_at(end: Plane, fit: TemplateFit, surfaces: Sequence[MergedSurface]) -> int | None:
    """The cylinder of a tube's radius whose axis passes an end's middle along its normal."""
    radius = float(np.asarray(fit.geometry["radii"])[1])
    best, least = None, _OFF * radius
    for number, one in enumerate(surfaces):
        tube = one.fit.surface
        if not isinstance(tube, Cylinder) or abs(tube.radius - radius) > _OFF * radius:
            continue
        if abs(float(tube.direction @ end.normal_direction)) < _ALONG:
            continue
        across = end.point - tube.point
        off = float(np.linalg.norm(across - (across @ tube.direction) * tube.direction))
        if off <= least:
            best, least = number, off
    return best


def _seams(fit: TemplateFit, surfaces: Sequence[MergedSurface]) -> Iterator[tuple[int | None, Plane]]:
    """Surfaces on which the line of a tangent junction lies, and the planes across them there."""
    joint, axis = np.asarray(fit.geometry["joint"]), np.asarray(fit.geometry["axis"])
    allowed = _OFF * float(np.linalg.norm(joint[1] - joint[0]))
    for number, one in enumerate(surfaces):
        shape = one.fit.surface
        if isinstance(shape, Cylinder):
            runs_along = abs(float(shape.direction @ axis)) >= _ALONG
            allowed_here = min(allowed, _OFF * shape.radius)
        elif isinstance(shape, Plane):
            runs_along = abs(float(shape.normal_direction @ axis)) <= np.sqrt(1 - _ALONG**2)
            allowed_here = allowed
        else:
            continue
        if runs_along and np.abs(shape.distance(joint)).max() <= allowed_here:
            normal: FloatArray = shape.normal(joint[:1])[0]
            yield number, Plane(joint.mean(axis=0), np.cross(axis, normal))
