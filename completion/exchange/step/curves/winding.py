# SPDX-License-Identifier: MIT
"""Winding: how often curves go round an axis, or round the tube of a torus."""

from __future__ import annotations

import numpy as np

from completion.exchange.step.curves.kernel import plain_zero
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Torus
from scenes.surfaces.surface import cross


def axis_of(surface: Cylinder | Cone | Torus) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of the axis that a surface turns about, and its direction (3,)."""
    return (surface.centre if isinstance(surface, Torus) else surface.point), surface.direction


def winding(place: FloatArray, axis: FloatArray, points: FloatArray) -> int:
    """How often closed points (n, 3) go round an axis."""
    first = plain_zero(axis)
    return turns_of(np.arctan2((points - place) @ cross(axis, first), (points - place) @ first))


def tube_angles(torus: Torus, points: FloatArray) -> FloatArray:
    """Angles (n,) about the tube, 0 on the outer circle."""
    offset = points - torus.centre
    height = offset @ torus.direction
    out = np.linalg.norm(offset - np.outer(height, torus.direction), axis=1) - torus.radius
    return np.asarray(np.arctan2(height, out))


def turns_of(angle: FloatArray) -> int:
    """How often closed angles (n,) go round."""
    step = np.diff(np.append(angle, angle[0]))
    return round(float(((step + np.pi) % (2 * np.pi) - np.pi).sum()) / (2 * np.pi))
