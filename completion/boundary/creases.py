# SPDX-License-Identifier: MIT
"""Creases: lines in a surface's chart along which it meets other surfaces, from their fits."""

from __future__ import annotations

import numpy as np

from completion.boundary.curves import Line
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_LEAST_SINE = 0.1  # of the angle between surfaces: flatter ones meet anywhere
_SQUARE = float(np.cos(np.radians(3.0)))  # between a plane's normal and an axis


def meeting_line(chart: Surface, other: Surface) -> Line | None:
    """Return the line in `chart` along which the two surfaces meet, None where it is no line.

    Plane and plane meet in a line; so do a cylinder and a plane at right angles to its axis, or along it.

    Parameters
    ----------
    chart : Surface
        Whose chart the line is wanted in.
    other : Surface
        The other surface, same frame.
    """
    if isinstance(chart, Plane) and isinstance(other, Plane):
        return _of_planes(chart, other)
    if isinstance(chart, Cylinder) and isinstance(other, Plane):
        return _across_axis(chart, other)
    return None


def _of_planes(chart: Plane, other: Plane) -> Line | None:
    """Where other.normal . (point + u a + v b - other.point) vanishes."""
    gradient = np.array([
        chart.u_direction @ other.normal_direction,
        chart.v_direction @ other.normal_direction,
    ])  # fmt: skip
    sine = float(np.linalg.norm(gradient))
    if sine < _LEAST_SINE:
        return None
    height = float(other.distance(chart.point[None])[0])
    normal = gradient / sine
    return Line(-height / sine * normal, np.array([normal[1], -normal[0]]))


def _across_axis(chart: Cylinder, other: Plane) -> Line | None:
    """The height at which a plane at right angles to the axis cuts the cylinder."""
    cosine = float(chart.direction @ other.normal_direction)
    if abs(cosine) < _SQUARE:
        return None
    height = -float(other.distance(chart.point[None])[0]) / cosine
    return Line(np.array([0.0, height]), np.array([1.0, 0.0]))
