# SPDX-License-Identifier: MIT
"""Curves of the kernel through points: splines, and lines and circles where the points lie on one."""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.exchange.step.curves.kernel import kernel, kernel_errors, kernel_point
from scenes.checks import FloatArray


def chord_lengths(points: FloatArray, is_closed: bool) -> FloatArray:
    """Lengths (n,) along the chords of points (n, 3), with that of the way back where they close (n + 1,)."""
    whole = np.concatenate([points, points[:1]]) if is_closed else points
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(whole, axis=0), axis=1))])


def interpolated(points: FloatArray, *, is_closed: bool) -> Any | None:
    """The spline through points (n, 3); None where the kernel finds none."""
    array = kernel().collections.HArray1_gp_Pnt(1, len(points))
    for place, point in enumerate(points, start=1):
        array.SetValue(place, kernel_point(point))
    knots = chord_lengths(points, is_closed)
    held = kernel().collections.HArray1_double(1, len(knots))
    for place, knot in enumerate(knots, start=1):
        held.SetValue(place, float(knot))
    try:
        made = kernel().GeomAPI.GeomAPI_Interpolate(array, held, is_closed, 1e-9)
        made.Perform()
    except kernel_errors():  # points that coincide
        return None
    return made.Curve() if made.IsDone() else None


def line_through(points: FloatArray, exact: float) -> Any | None:
    """The line that points (n, 3) are on, to `exact`; None where they are not."""
    middle = points.mean(axis=0)
    way = np.linalg.svd(points - middle)[2][0]
    off = points - middle - np.outer((points - middle) @ way, way)
    if np.linalg.norm(off, axis=1).max() > exact:
        return None
    gp = kernel().gp
    return kernel().Geom.Geom_Line(kernel_point(middle), gp.gp_Dir(*(float(one) for one in way)))


def circle_through(points: FloatArray, exact: float) -> Any | None:
    """The circle that points (n, 3) are on, to `exact`; None where they are not."""
    middle = points.mean(axis=0)
    frame = np.linalg.svd(points - middle)[2]
    flat = (points - middle) @ frame.T
    if np.abs(flat[:, 2]).max() > exact:
        return None
    terms = np.column_stack([2 * flat[:, :2], np.ones(len(flat))])
    a, b, c = np.linalg.lstsq(terms, (flat[:, :2] ** 2).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(c + a * a + b * b, 0.0)))
    if np.abs(np.hypot(flat[:, 0] - a, flat[:, 1] - b) - radius).max() > exact:
        return None
    gp = kernel().gp
    centre = middle + a * frame[0] + b * frame[1]
    up, zero = (gp.gp_Dir(*(float(one) for one in row)) for row in (np.cross(frame[0], frame[1]), frame[0]))
    return kernel().Geom.Geom_Circle(gp.gp_Ax2(kernel_point(centre), up, zero), radius)
