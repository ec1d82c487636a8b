# SPDX-License-Identifier: MIT
"""Starts without a guess: closed-form circular errors over all axis directions, from one pass of moments.

For a direction W the algebraic circular fit is linear least squares in the moments, so that its error G(W)
costs the same for any number of points (Eberly, Fitting 3D data with a cylinder). The hemisphere is searched
at about 600 Fibonacci directions and the best are refined. A cone adds height and its square to the
regressors of the squared radius or, where it is blunt, has the squared height for dependent variable; an
elliptic cylinder adds the section's two other quadratic forms.

Tori begin from axes that all normals meet. With Pluecker coordinates (n, p x n) of the normal at p and (c, m)
of the axis, p x n . c + n . m = 0: linear in the axis, so that it is an eigenvector (Pottmann and Randrup
1998, Rotational and helical surface approximation for reverse engineering). About the axis the surface is its
meridian, and a torus' meridian a circle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from completion.fitting.chart import (
    Chart,
    ConeChart,
    CylinderChart,
    EllipticChart,
    SphereChart,
    TorusChart,
    axis_frame,
    turned_frame,
)
from completion.fitting.limits import LEAST_CURVATURE
from completion.fitting.moments import moments
from scenes.checks import FloatArray

_N_TREE = 50_000
N_NEIGHBOURS = 24


def orient_normals(sample: FloatArray, points: FloatArray) -> tuple[FloatArray, float]:
    """Normals (m, 3), without a side, of sample points by their neighbours, and the typical roughness."""
    thinned = points[:: max(1, len(points) // _N_TREE)]
    _, nearest = cKDTree(thinned).query(sample, k=min(N_NEIGHBOURS, len(thinned)))
    around = thinned[nearest]
    around = around - around.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", around, around) / (around.shape[1] - 3))
    extent = float(np.sqrt(np.einsum("ij,ij->", sample - sample.mean(axis=0), sample - sample.mean(axis=0))))
    roughness = float(np.median(np.sqrt(np.maximum(values[:, 0], 0.0))))
    return vectors[:, :, 0], max(roughness, 1e-9 * extent / np.sqrt(len(sample)))


@dataclass(frozen=True, slots=True, eq=False)
class Paraboloid:
    """The paraboloid over the plane of points, least squares in their heights.

    Attributes
    ----------
    foot : (3,) float
        Where it stands over the points' middle, which is the origin.
    normal : (3,) float
        Unit vector at the foot.
    curvatures : (2,) float
        Principal ones, the smaller first; positive where it bends towards the normal.
    directions : (3, 2) float
        Unit vectors in the plane, in which it curves so.
    """

    foot: FloatArray
    normal: FloatArray
    curvatures: FloatArray
    directions: FloatArray

    @classmethod
    def of(cls, unit: FloatArray) -> Paraboloid:
        """Fit it to points (n, 3) whose middle is the origin."""
        _, vectors = np.linalg.eigh(unit.T @ unit)
        x, y, z = vectors[:, 2] @ unit.T, vectors[:, 1] @ unit.T, vectors[:, 0] @ unit.T
        basis = np.column_stack([np.ones(len(x)), x, y, x * x / 2, x * y, y * y / 2])
        level, slope_x, slope_y, xx, xy, yy = np.linalg.lstsq(basis, z, rcond=None)[0]
        curvatures, turns = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
        normal = vectors @ np.array([1.0, -slope_y, -slope_x])
        across = np.stack([vectors[:, [2, 1]] @ turns[:, k] for k in range(2)], axis=1)
        return cls(level * vectors[:, 0], normal / np.linalg.norm(normal), curvatures, across)


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
    axes: list[tuple[FloatArray, ...]] = []
    for vector in vectors.T[:n_best]:
        along, moment = vector[:3], vector[3:]
        length = float(np.linalg.norm(along))
        if length > 1e-6:
            axis = along / length
            axes.append((np.cross(axis, moment / length), axis))
    return axes


def torus_starts(unit: FloatArray) -> list[TorusChart]:
    """Tori to polish from, about axes and by curvature, for points (n, 3) near the unit ball."""
    charts = _osculating_tori(unit)
    if len(unit) >= _LEAST_NEIGHBOURS:
        places = np.unique(np.linspace(0, len(unit) - 1, _N_ORIENTED).astype(np.int64))
        normals, _ = orient_normals(unit[places], unit)
        for point, axis in rotation_axes(unit[places], normals, 4):
            charts = [*torus_about(unit[places], point, axis), *charts]
    _, principal = np.linalg.eigh(unit.T @ unit)
    for axis in principal.T:
        charts += torus_about(unit, np.zeros(3), axis)
    return charts


def torus_about(points: FloatArray, point: FloatArray, axis: FloatArray) -> list[TorusChart]:
    """The torus about an axis through `point` (3,) along a unit `axis` (3,) with the meridian's circle."""
    offset = points - point
    height = offset @ axis
    from_axis = np.linalg.norm(offset - height[:, None] * axis, axis=1)
    basis = np.column_stack([2 * from_axis, 2 * height, np.ones(len(points))])
    radius, level, constant = np.linalg.lstsq(basis, from_axis**2 + height**2, rcond=None)[0]
    tube2 = float(constant + radius**2 + level**2)
    if radius <= 1e-6 or tube2 <= 1e-12:
        return []
    return [TorusChart(point + level * axis, axis_frame(axis), float(radius), float(np.sqrt(tube2)))]


def _osculating_tori(unit: FloatArray) -> list[TorusChart]:
    """Tori that touch the points' paraboloid and curve there as it does, one for each place on the tube.

    At an angle a from the outermost circle the curvatures are 1 / r and cos(a) / (R + r cos(a)).
    """
    touching = Paraboloid.of(unit)
    foot, normal, curvatures = touching.foot, touching.normal, touching.curvatures
    charts: list[TorusChart] = []
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
                charts.append(TorusChart(centre, axis_frame(axis), min(ring, 1e3), radius))
    return charts


_N_DIRECTIONS = 600
_N_ZOOMS = 6
_HALF_ANGLES_DEG = (0.0, 5.0, 20.0, 40.0, 60.0, 72.0, 80.0, 85.0)
_RIDGE = 1e-13  # of the diagonal: directions across which nothing is spread stay finite


def starts(shape: str, unit: FloatArray, n_best: int) -> list[Chart]:
    """Charts to polish from, best first, for points (n, 3) near the unit ball."""
    if shape == "torus":
        return [*torus_starts(unit)]
    gram = moments(unit, np.zeros(3)).gram() / len(unit)
    if shape == "sphere":
        return [*_spheres(gram), *_shallow(unit, shape)]
    searched = "cylinder" if shape == "elliptic-cylinder" else shape
    axes = _best_axes(gram, searched, n_best)
    charts: list[Chart] = [] if shape == "cone" else _shallow(unit, "cylinder")
    if shape == "elliptic-cylinder":
        charts = [_nearly_round(chart) for chart in charts if isinstance(chart, CylinderChart)]
    for axis in axes:
        frame = axis_frame(axis)
        if shape == "cone":
            charts.extend(_cones(gram, frame))
        elif shape == "cylinder":
            charts.extend(_cylinders(gram, frame))
        else:
            charts.extend(_ellipses(gram, frame))
    if shape == "elliptic-cylinder":
        for axis in _best_axes(gram, "ellipse", n_best):
            charts.extend(_ellipses(gram, axis_frame(axis)))
    if shape == "cone":
        for axis in _best_axes(gram, "blunt", n_best):
            charts.extend(_blunt_cones(gram, axis_frame(axis)))
    return charts


def starts_along(shape: str, unit: FloatArray, axis: FloatArray) -> list[Chart]:
    """Charts to polish from about a unit axis (3,) of a given direction."""
    gram = moments(unit, np.zeros(3)).gram() / len(unit)
    frame = axis_frame(axis)
    round_ones: list[Chart] = [*_cylinders(gram, frame)]
    if shape == "torus":
        places = [chart.origin for chart in round_ones] or [np.zeros(3)]
        return [chart for place in places for chart in torus_about(unit, place, axis)]
    if shape == "cone":
        return [*_cones(gram, frame), *_blunt_cones(gram, frame)]
    return _ellipses(gram, frame) if shape == "elliptic-cylinder" else round_ones


def _spheres(gram: FloatArray) -> list[Chart]:
    basis = np.eye(10)[6:]
    q = np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0, 0])
    solution = _regress(gram, q[None], basis[None])[0][0]
    centre = solution[:3] / 2
    radius2 = float(solution[3] + centre @ centre)
    return [SphereChart(centre, float(np.sqrt(radius2)))] if radius2 > 0 else []


def _shallow(unit: FloatArray, shape: str) -> list[Chart]:
    """The sphere or cylinder that osculates a paraboloid over the points' plane.

    Over a small arc the squared radius says little and noise biases it; heights over the plane do not care.
    """
    touching = Paraboloid.of(unit)
    foot, normal, curvatures = touching.foot, touching.normal, touching.curvatures
    if shape == "sphere":
        radius = 1 / max(abs(float(curvatures.mean())), LEAST_CURVATURE)
        return [SphereChart(foot + np.copysign(radius, curvatures.mean()) * normal, radius)]
    bent = int(np.argmax(np.abs(curvatures)))
    radius = 1 / max(abs(float(curvatures[bent])), LEAST_CURVATURE)
    axis = touching.directions[:, 1 - bent]
    axis = axis - normal * (normal @ axis)
    axis = axis / np.linalg.norm(axis)
    centre = foot + np.copysign(radius, curvatures[bent]) * normal
    return [CylinderChart(centre - axis * (centre @ axis), axis_frame(axis), radius)]


def _cylinders(gram: FloatArray, frame: FloatArray) -> list[CylinderChart]:
    q, basis = _section(frame[None], "cylinder")
    solution = _regress(gram, q, basis)[0][0]
    centre = solution[:2] / 2
    radius2 = float(solution[2] + centre @ centre)
    return [CylinderChart(centre @ frame[:2], frame, float(np.sqrt(radius2)))] if radius2 > 0 else []


def _cones(gram: FloatArray, frame: FloatArray) -> list[Chart]:
    """Squared radius A + B z + C z^2: the slope from B, and from C where that has the right sign."""
    q, basis = _section(frame[None], "cone")
    solution = _regress(gram, q, basis)[0][0]
    centre = solution[:2] / 2
    radius2 = float(solution[2] + centre @ centre)
    slopes = []
    if radius2 > 1e-12:
        slopes.append(float(solution[3]) / (2 * np.sqrt(radius2)))
    if solution[4] > 0:
        slopes.append(float(np.copysign(np.sqrt(solution[4]), solution[3])))
    radius = float(np.sqrt(max(radius2, 1e-6)))
    charts: list[Chart] = [
        ConeChart(centre @ frame[:2], frame, radius, float(-np.arctan(slope))) for slope in slopes
    ]
    if solution[4] > 0 and abs(solution[3]) > 1e-12:  # the apex condition: B = 2 s k
        slope = float(np.sqrt(solution[4]))
        radius = abs(float(solution[3])) / (2 * slope)
        phi = -float(np.arctan(np.copysign(slope, solution[3])))
        charts.append(ConeChart(centre @ frame[:2], frame, radius, phi))
    return charts


def cones_along(chart: CylinderChart) -> list[Chart]:
    """Cones that touch a cylinder along the generator through the points and curve there as it does.

    A cone of half angle alpha with radius r there has the normal curvature cos(alpha) / r.
    """
    away = -chart.origin / max(float(np.linalg.norm(chart.origin)), 1e-300)
    touch = chart.origin + chart.radius * away
    charts: list[Chart] = []
    for alpha in np.radians(_HALF_ANGLES_DEG):
        radius = chart.radius * np.cos(alpha)
        for generator in (chart.frame[2], -chart.frame[2]):
            axis = np.cos(alpha) * generator - np.sin(alpha) * away
            level = np.cos(alpha) * away + np.sin(alpha) * generator
            point = touch - radius * level
            along = -float(point @ axis)
            grown = float(radius + along * np.tan(alpha))
            charts.append(ConeChart(point + along * axis, axis_frame(axis), grown, -float(alpha)))
    return charts


def _blunt_cones(gram: FloatArray, frame: FloatArray) -> list[Chart]:
    """(z - z0)^2 = t^2 ((x - cx)^2 + (y - cy)^2): the form for cones so blunt that z is the dependent one."""
    q, basis = _section(frame[None], "blunt")
    solution = _regress(gram, q, basis)[0][0]
    apex, steepness2 = float(solution[3]) / 2, float(solution[4])
    if not steepness2 > 1e-12:
        return []
    centre, steepness = -solution[:2] / (2 * steepness2), float(np.sqrt(steepness2))
    phi = float(np.copysign(np.arctan(1 / steepness), apex))
    return [ConeChart(centre @ frame[:2], frame, abs(apex) / steepness, phi)]


def _ellipses(gram: FloatArray, frame: FloatArray) -> list[Chart]:
    q, basis = _section(frame[None], "ellipse")
    a, b, *linear, constant = _regress(gram, q, basis)[0][0][[3, 4, 0, 1, 2]]
    form = np.array([[1 - a, -b], [-b, 1 + a]])
    charts: list[Chart] = []
    values, vectors = np.linalg.eigh(form)
    if values[0] > 1e-6:
        centre = np.linalg.solve(form, np.array(linear) / 2)
        level = float(constant + centre @ form @ centre)
        if level > 0:
            greater, smaller = np.sqrt(level / values)
            turned = turned_frame(frame[2], vectors[:, 0] @ frame[:2])
            charts.append(EllipticChart(centre @ frame[:2], turned, float(greater), float(smaller)))
    return [*charts, *(_nearly_round(chart) for chart in _cylinders(gram, frame))]


def _nearly_round(chart: CylinderChart) -> EllipticChart:
    """An ellipse of which the section is nearly a circle: exactly round ones have no axes to turn."""
    return EllipticChart(chart.origin, chart.frame, 1.0001 * chart.radius, chart.radius)


def _best_axes(gram: FloatArray, shape: str, n_best: int) -> FloatArray:
    """Refined directions (k, 3) of least error, at least 12 degrees apart before refinement."""
    directions = _hemisphere()
    order = np.argsort(_errors(gram, directions, shape), kind="stable")
    chosen: list[int] = []
    for candidate in order:
        if all(abs(float(directions[candidate] @ directions[c])) < np.cos(np.radians(12.0)) for c in chosen):
            chosen.append(int(candidate))
        if len(chosen) == n_best:
            break
    axes = directions[chosen]
    spread, steps = np.radians(4.0), np.linspace(-1, 1, 5)
    grid = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    for _ in range(_N_ZOOMS):
        frames = np.stack([axis_frame(axis) for axis in axes])
        around = axes[:, None] + spread * np.einsum("gi,kij->kgj", grid, frames[:, :2])
        around /= np.linalg.norm(around, axis=2, keepdims=True)
        error = _errors(gram, around.reshape(-1, 3), shape).reshape(around.shape[:2])
        axes = around[np.arange(len(axes)), np.argmin(error, axis=1)]
        spread *= 0.4
    error = _errors(gram, axes, shape)
    return np.asarray(axes[np.argsort(error, kind="stable")], dtype=np.float64)


def _errors(gram: FloatArray, directions: FloatArray, shape: str) -> FloatArray:
    """Mean squared algebraic error (m,) over that of its gradient, for each axis direction."""
    first = _perpendiculars(directions)
    frames = np.stack([first, np.cross(directions, first), directions], axis=1)
    q, basis = _section(frames, shape)
    solution, error = _regress(gram, q, basis)
    shift = solution[:, 3:4] if shape == "blunt" else solution[:, :2]
    mean_q = np.einsum("mi,i->m", q, gram[9])
    radius2 = mean_q + np.einsum("mi,mi->m", shift, shift) / 4  # the centroid is the origin
    return np.asarray(np.maximum(error, 0.0) / radius2, dtype=np.float64)


def _section(frames: FloatArray, shape: str) -> tuple[FloatArray, FloatArray]:
    """Coefficients over the ten monomials of the squared radius (m, 10) and its regressors (m, p, 10)."""
    u, v, w = frames[:, 0], frames[:, 1], frames[:, 2]
    q = _form(u, u) + _form(v, v)
    zero = np.zeros((len(frames), 6))
    linear = [np.column_stack([zero, row, zero[:, :1]]) for row in (u, v)]
    rows = [*linear, np.broadcast_to(np.eye(10)[9], q.shape)]
    if shape == "cone":
        rows += [np.column_stack([zero, w, zero[:, :1]]), _form(w, w)]
    if shape == "blunt":
        rows += [np.column_stack([zero, w, zero[:, :1]]), q]
        q = _form(w, w)
    if shape == "ellipse":
        rows += [_form(u, u) - _form(v, v), 2 * _form(u, v)]
    return q, np.stack(rows, axis=1)


def _form(u: FloatArray, v: FloatArray) -> FloatArray:
    """Coefficients (m, 10) of (u . x) (v . x)."""
    square = u * v
    mixed = [u[:, i] * v[:, j] + u[:, j] * v[:, i] for i, j in ((0, 1), (0, 2), (1, 2))]
    return np.column_stack([square, *mixed, np.zeros((len(u), 4))])


def _regress(gram: FloatArray, q: FloatArray, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares of q by the basis under the moments: coefficients (m, p) and mean squared error (m,)."""
    weighted = basis @ gram
    matrix = weighted @ basis.transpose(0, 2, 1)
    right = np.einsum("mpi,mi->mp", weighted, q)
    diagonal = np.einsum("mpp->mp", matrix)
    matrix = matrix + _RIDGE * np.eye(matrix.shape[1]) * np.maximum(diagonal, 1e-12)[:, None, :]
    solution = np.linalg.solve(matrix, right[..., None])[..., 0]
    error = np.einsum("mi,ij,mj->m", q, gram, q) - np.einsum("mp,mp->m", right, solution)
    return solution, error


def _perpendiculars(directions: FloatArray) -> FloatArray:
    smallest = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    across = np.cross(directions, smallest)
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True), dtype=np.float64)


@cache
def _hemisphere() -> FloatArray:
    """Fibonacci directions (600, 3) with z > 0."""
    index = np.arange(_N_DIRECTIONS) + 0.5
    z = index / _N_DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5.0)) * index
    level = np.sqrt(1 - z * z)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
