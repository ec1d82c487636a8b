# SPDX-License-Identifier: MIT
"""Hypotheses: surfaces through oriented points in closed form, one of each kind.

Normals count as lines. A cylinder's axis is at right angles to all normals, a cone's apex lies in all tangent
planes, and the normals of a torus meet its axis; what is left are circles and directions, linear again.
"""

from __future__ import annotations

import numpy as np

from completion.fitting.chart import Chart, chart_of
from completion.fitting.euclidean import Cloud, normal_equations, polished
from completion.fitting.result import FitError
from completion.fitting.starts import rotation_axes, torus_about
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface

KINDS = ("plane", "sphere", "cylinder", "cone", "torus")
N_PARAMETERS = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6, "torus": 7}
_MOST_POINTS = 800  # that a surface is polished on
_N_STEPS = 3  # of Gauss and Newton; what calls this repeats it
_CUT = 4.685  # deviations, Tukey's
_FAR = 1e4  # radii beyond so many extents of the points are planes


def hypotheses(kind: str, points: FloatArray, normals: FloatArray) -> list[Surface]:
    """Return surfaces of a kind near points (n, 3) with normals (n, 3), none or few; metres."""
    centre = points.mean(axis=0)
    offset = points - centre
    scale = float(np.sqrt(np.einsum("ij,ij->", offset, offset) / len(offset)))
    if scale == 0:
        return []
    unit = offset / scale
    made = {"plane": _planes, "sphere": _spheres, "cylinder": _cylinders, "cone": _cones, "torus": _tori}
    try:
        found = made[kind](unit, normals)
        return [chart_of(surface, np.zeros(3), 1.0).surface(centre, scale, False) for surface in found]
    except (np.linalg.LinAlgError, InputError):
        return []


def adjusted(
    surface: Surface, points: FloatArray, tolerance: float, most: int = _MOST_POINTS
) -> tuple[Surface, FloatArray] | None:
    """Return the least-squares surface near another, and its covariance (k, k) at this tolerance.

    Points (n, 3), about so many of them at `most`, count with Tukey's weights at `tolerance`, metres, about
    the surface as it comes. None where they determine no such surface.
    """
    stride = max(1, len(points) // most)
    some = points[::stride]
    share = surface.distance(some) / (_CUT * tolerance)
    weights = np.maximum(1 - share * share, 0.0) ** 2
    if np.count_nonzero(weights) < N_PARAMETERS[surface.kind]:
        return None
    centre = some.mean(axis=0)
    scale = float(np.sqrt(np.mean(np.sum((some - centre) ** 2, axis=1)))) or 1.0
    cloud = Cloud(some, centre, scale, weights)
    try:
        chart: Chart = chart_of(surface, centre, scale)
        chart, normal, _ = polished(chart, cloud, surface.kind, _N_STEPS)
        chart = chart.growing() if hasattr(chart, "growing") else chart
        normal = normal_equations(chart, cloud)
        found = chart.surface(centre, scale, False)
        units = np.where(chart.lengths() > 0, 1.0, 1 / scale)
        covariance = tolerance**2 / stride * normal.inverse() * np.outer(units, units)
    except (FitError, InputError, np.linalg.LinAlgError):
        return None
    if not np.isfinite(covariance).all() or chart.size() > _FAR:
        return None
    return found, covariance


def _planes(points: FloatArray, _normals: FloatArray) -> list[Surface]:
    _, axes = np.linalg.eigh(points.T @ points)
    return [Plane(np.zeros(3), axes[:, 0])]


def _spheres(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """By the squared distances, and where the normals meet."""
    found: list[Surface] = []
    basis = np.column_stack([2 * points, np.ones(len(points))])
    *centre, rest = np.linalg.lstsq(basis, np.einsum("ij,ij->i", points, points), rcond=None)[0]
    radius2 = float(rest + np.dot(centre, centre))
    if radius2 > 0:
        found.append(Sphere(centre, np.sqrt(radius2)))
    across = np.eye(3) - np.einsum("ni,nj->nij", normals, normals)
    matrix, right = across.sum(axis=0), np.einsum("nij,nj->i", across, points)
    met = np.linalg.solve(matrix + 1e-12 * len(points) * np.eye(3), right)
    radius = float(np.median(np.linalg.norm(points - met, axis=1)))
    return [*found, Sphere(met, radius)] if radius > 0 else found


def _cylinders(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """About the direction that the normals are across: a circle by squares, and where the normals meet."""
    _, axes = np.linalg.eigh(normals.T @ normals)
    axis, frame = axes[:, 0], axes[:, 1:]
    flat, across = points @ frame, normals @ frame
    found: list[Surface] = []
    basis = np.column_stack([2 * flat, np.ones(len(flat))])
    *middle, rest = np.linalg.lstsq(basis, np.einsum("ij,ij->i", flat, flat), rcond=None)[0]
    radius2 = float(rest + np.dot(middle, middle))
    if radius2 > 0:
        found.append(Cylinder(frame @ np.asarray(middle), axis, np.sqrt(radius2)))
    turned = np.column_stack([-across[:, 1], across[:, 0]])
    met = np.linalg.lstsq(turned, np.einsum("ij,ij->i", turned, flat), rcond=None)[0]
    radius = float(np.median(np.linalg.norm(flat - met, axis=1)))
    return [*found, Cylinder(frame @ met, axis, radius)] if radius > 0 else found


def _cones(points: FloatArray, normals: FloatArray) -> list[Surface]:
    """By the apex in all tangent planes, and by the meridians about the axes that the normals meet."""
    found: list[Surface] = []
    apex = np.linalg.lstsq(normals, np.einsum("ij,ij->i", normals, points), rcond=1e-9)[0]
    ways = points - apex
    length = np.linalg.norm(ways, axis=1)
    if (length > 0).all():
        ways = ways / length[:, None]
        axis = np.linalg.lstsq(ways, np.ones(len(ways)), rcond=1e-9)[0]
        size = float(np.linalg.norm(axis))
        if 1 < size < np.inf:
            cosine = 1 / size
            found += _cone(apex, axis * cosine, float(np.arccos(cosine)), float(length.mean()))
    for point, axis in rotation_axes(points, normals, 3):
        found += cones_about(points, point, axis)
    return found


def cones_about(points: FloatArray, point: FloatArray, axis: FloatArray) -> list[Surface]:
    """The cone about an axis through `point` (3,) along a unit `axis` (3,), of points (n, 3)."""
    offset = points - point
    height = offset @ axis
    from_axis = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    about = np.column_stack([height - height.mean(), from_axis - from_axis.mean()])
    _, sides = np.linalg.eigh(about.T @ about)
    along = sides[:, 1]
    if abs(along[0]) < 1e-6 or abs(along[1]) < 1e-6:
        return []
    slope = float(along[1] / along[0])
    direction = axis if slope > 0 else -axis
    middle = point + height.mean() * axis
    return [Cone(middle, direction, float(from_axis.mean()), float(np.arctan(abs(slope))))]


def _cone(apex: FloatArray, axis: FloatArray, half_angle: float, length: float) -> list[Surface]:
    sine, cosine = np.sin(half_angle), np.cos(half_angle)
    if length * sine < 1e-9:
        return []
    return [Cone(apex + length * cosine * axis, axis, length * sine, half_angle)]


def _tori(points: FloatArray, normals: FloatArray) -> list[Surface]:
    charts = [chart for axis in rotation_axes(points, normals, 3) for chart in torus_about(points, *axis)]
    rings = [chart for chart in charts if chart.tube_radius < chart.radius]
    return [chart.surface(np.zeros(3), 1.0, False) for chart in rings]
