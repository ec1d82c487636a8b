# SPDX-License-Identifier: MIT
"""Revolution: axes that all normals meet, and tori to begin with.

The normals of a surface of revolution meet its axis. With Pluecker coordinates (n, p x n) of the normal at p
and (c, m) of the axis, p x n . c + n . m = 0: linear in the axis, so that it is an eigenvector (Pottmann and
Randrup 1998, Rotational and helical surface approximation for reverse engineering). About the axis the
surface is its meridian, and a torus' meridian a circle.
"""

from __future__ import annotations

import numpy as np

from completion.fitting.charts.chart import axis_frame
from completion.fitting.charts.paraboloid import LEAST_CURVATURE, Paraboloid
from completion.fitting.charts.torus_chart import TorusChart
from completion.fitting.oriented import oriented
from scenes.checks import FloatArray

_N_ORIENTED = 1_000
_TUBE_ANGLES_DEG = (0.0, 20.0, 45.0, 70.0, 85.0, 95.0, 110.0, 135.0, 160.0, 180.0)
_LEAST_NEIGHBOURS = 12  # points from which normals by their neighbours mean something


def rotation_axes(points: FloatArray, normals: FloatArray, n_best: int = 3) -> list[tuple[FloatArray, ...]]:
    """Axes that the normals (n, 3) at points (n, 3) nearly meet: each a point (3,) and a unit vector (3,).

    The points are near the unit ball. Of a plane, a sphere or a cylinder any line does in some family; the
    best of the linear complexes come first.
    """
    lines = np.hstack([np.cross(points, normals), normals])
    _, vectors = np.linalg.eigh(lines.T @ lines)
    found: list[tuple[FloatArray, ...]] = []
    for vector in vectors.T[:n_best]:
        along, moment = vector[:3], vector[3:]
        length = float(np.linalg.norm(along))
        if length > 1e-6:
            axis = along / length
            found.append((np.cross(axis, moment / length), axis))
    return found


def torus_starts(unit: FloatArray) -> list[TorusChart]:
    """Tori to polish from, about axes and by curvature, for points (n, 3) near the unit ball."""
    found = _osculating(unit)
    if len(unit) >= _LEAST_NEIGHBOURS:
        places = np.unique(np.linspace(0, len(unit) - 1, _N_ORIENTED).astype(np.int64))
        normals, _ = oriented(unit[places], unit)
        for point, axis in rotation_axes(unit[places], normals, 4):
            found = [*torus_about(unit[places], point, axis), *found]
    _, principal = np.linalg.eigh(unit.T @ unit)
    for axis in principal.T:
        found += torus_about(unit, np.zeros(3), axis)
    return found


def torus_about(points: FloatArray, point: FloatArray, axis: FloatArray) -> list[TorusChart]:
    """The torus about an axis through `point` (3,) along a unit `axis` (3,) with the meridian's circle."""
    offset = points - point
    height = offset @ axis
    from_axis = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    basis = np.column_stack([2 * from_axis, 2 * height, np.ones(len(points))])
    radius, level, rest = np.linalg.lstsq(basis, from_axis**2 + height**2, rcond=None)[0]
    tube2 = float(rest + radius**2 + level**2)
    if radius <= 1e-6 or tube2 <= 1e-12:
        return []
    return [TorusChart(point + level * axis, axis_frame(axis), float(radius), float(np.sqrt(tube2)))]


def _osculating(unit: FloatArray) -> list[TorusChart]:
    """Tori that touch the points' paraboloid and curve there as it does, one for each place on the tube.

    At an angle a from the outermost circle the curvatures are 1 / r and cos(a) / (R + r cos(a)).
    """
    touching = Paraboloid.of(unit)
    foot, normal, curvatures = touching.foot, touching.normal, touching.curvatures
    found: list[TorusChart] = []
    for tube in (0, 1):
        bent, other = float(curvatures[tube]), float(curvatures[1 - tube])
        if abs(bent) < LEAST_CURVATURE:
            continue
        outward = -np.sign(bent) * normal  # away from the tube's middle
        radius, ratio = 1 / abs(bent), other / bent
        along = touching.directions[:, tube]
        along = along - outward * (along @ outward)
        along = along / np.linalg.norm(along)
        for angle in np.radians(_TUBE_ANGLES_DEG):
            cosine, sine = float(np.cos(angle)), float(np.sin(angle))
            ring = radius * cosine * (1 / ratio - 1) if abs(ratio) > 1e-3 else 1e3 * radius
            if ring <= 0.2 * radius:
                continue
            for side in (along, -along):
                axis, level_out = sine * outward + cosine * side, cosine * outward - sine * side
                centre = foot - radius * outward - ring * level_out
                found.append(TorusChart(centre, axis_frame(axis), min(ring, 1e3), radius))
    return found
