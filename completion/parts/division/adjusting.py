# SPDX-License-Identifier: MIT
"""Adjusting: the steps of Gauss and Newton of `completion.fitting.euclidean`, compiled, for few points.

Division asks for thousands of small fits, which the interpreter makes ten times as dear as their sums. The
charts, parameters, bases and steps are those of `completion.fitting.chart`. A surface is a row (8,): its
point, its direction, and two numbers: radius and tube radius, or radius at the point and half angle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from completion.fitting.limits import MOST_CONDITION
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from texture.engine.compiled import compiled, inlined

KINDS = ("plane", "sphere", "cylinder", "cone", "torus")
N_PARAMETERS = {"plane": 3, "sphere": 4, "cylinder": 5, "cone": 6, "torus": 7}
_PLANE, _SPHERE, _CYLINDER, _CONE, _TORUS = range(5)
_LENGTHS = np.array(
    [[1, 0, 0, 0, 0, 0, 0], [1, 1, 1, 1, 0, 0, 0], [1, 1, 0, 0, 1, 0, 0], [1, 1, 0, 0, 1, 0, 0],
     [1, 1, 0, 0, 1, 1, 1]]
)  # fmt: skip
_RADIUS = np.array([-1, 3, 4, -1, 5])  # the parameter that grows about the place where the points are
_CUT = 4.685  # deviations, Tukey's


def row_of(surface: Surface) -> tuple[int, FloatArray]:
    """The number of a surface's kind, and its row (8,)."""
    kind, row = KINDS.index(surface.kind), np.zeros(8)
    if isinstance(surface, Plane):
        row[:3], row[3:6] = surface.point, surface.normal_direction
    elif isinstance(surface, Sphere):
        row[:3], row[5], row[6] = surface.centre, 1.0, surface.radius
    elif isinstance(surface, Torus):
        row[:3], row[3:6] = surface.centre, surface.direction
        row[6:] = surface.radius, surface.tube_radius
    elif isinstance(surface, Cylinder | Cone):
        row[:3], row[3:6], row[6] = surface.point, surface.direction, surface.radius
        row[7] = surface.half_angle if isinstance(surface, Cone) else 0.0
    return kind, row


@inlined
def _look(kind: int, row: FloatArray, place: FloatArray) -> Any:
    """Signed distance of a place (3,) from a surface."""
    x, y, z = place[0] - row[0], place[1] - row[1], place[2] - row[2]
    height = x * row[3] + y * row[4] + z * row[5]
    if kind == _PLANE:
        return height
    if kind == _SPHERE:
        return np.sqrt(x * x + y * y + z * z) - row[6]
    x, y, z = x - height * row[3], y - height * row[4], z - height * row[5]
    beyond = np.sqrt(x * x + y * y + z * z) - row[6]
    if kind == _CYLINDER:
        return beyond
    if kind == _TORUS:
        return np.hypot(beyond, height) - row[7]
    sine, cosine = np.sin(row[7]), np.cos(row[7])
    outward, below = cosine * beyond - sine * height, sine * beyond + cosine * height + row[6] / sine
    return np.hypot(outward, below) if below < 0 else outward


@compiled
def n_within(kind: int, row: FloatArray, points: FloatArray, most: float) -> int:
    """How many of the points (n, 3) are at most so far from a surface."""
    n = 0
    for i in range(len(points)):
        n += abs(_look(kind, row, points[i])) <= most
    return n


@inlined
def _frame(kind: int, row: FloatArray, frame: FloatArray) -> None:
    """Write the rows x, y, z (3, 3) of the chart's frame, as `axis_frame`; a sphere's is the world's."""
    x, y, z = row[3], row[4], row[5]
    if kind == _SPHERE:
        x, y, z = 0.0, 0.0, 1.0
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    frame[0, 0], frame[0, 1], frame[0, 2] = 1 + sign * x * x * a, sign * b, -sign * x
    frame[1, 0], frame[1, 1], frame[1, 2] = b, sign + y * y * a, -y
    frame[2, 0], frame[2, 1], frame[2, 2] = x, y, z


@inlined
def _rows(kind: int, row: FloatArray, x: float, y: float, z: float, gradient: FloatArray) -> Any:
    """Write the derivatives (k,) of the residual at a place of the chart; the residual is returned."""
    if kind == _PLANE:
        gradient[0], gradient[1], gradient[2] = 1.0, x, y
        return z
    if kind == _SPHERE:
        away = np.sqrt(x * x + y * y + z * z)
        safe = -max(away, 1e-300)
        gradient[0], gradient[1], gradient[2], gradient[3] = x / safe, y / safe, z / safe, -1.0
        return away - row[6]
    from_axis = np.sqrt(x * x + y * y)
    safe, beyond = max(from_axis, 1e-300), from_axis - row[6]
    if kind == _CYLINDER:
        gradient[0], gradient[1] = -x / safe, -y / safe
        gradient[2], gradient[3], gradient[4] = z * gradient[0], z * gradient[1], -1.0
        return beyond
    if kind == _CONE:
        sine, cosine = np.sin(row[7]), np.cos(row[7])
        gradient[0], gradient[1] = -cosine * x / safe, -cosine * y / safe
        gradient[2], gradient[3] = z * gradient[0] + sine * x, z * gradient[1] + sine * y
        gradient[4], gradient[5] = -cosine, cosine * z - sine * beyond
        return cosine * beyond + sine * z
    away = np.sqrt(beyond * beyond + z * z)
    level, rise = beyond / max(away, 1e-300), z / max(away, 1e-300)
    gradient[0], gradient[1] = -level * x / safe, -level * y / safe
    gradient[2], gradient[3] = z * gradient[0] + rise * x, z * gradient[1] + rise * y
    gradient[4], gradient[5], gradient[6] = -rise, -level, -1.0
    return away - row[7]


@compiled
def _sums(
    kind: int, row: FloatArray, points: FloatArray, weights: FloatArray, matrix: FloatArray, right: FloatArray
) -> tuple[FloatArray, float]:
    """Write J'WJ (k, k) and J'Wf (k,); the basis (k, k) that J is by, and f'Wf, are returned."""
    k = len(right)
    frame, basis, gradient, place = np.empty((3, 3)), np.eye(k), np.empty(7), np.empty(3)
    _frame(kind, row, frame)
    matrix[:], right[:], cost, grows = 0.0, 0.0, 0.0, _RADIUS[kind]
    n_shifts = 3 if kind == _SPHERE else 2
    if grows >= 0:
        touch = -(frame @ row[:3])[:n_shifts] / row[6]
        basis[:n_shifts, grows] = -touch / max(1.0, np.sqrt((touch * touch).sum()))
    for i in range(len(points)):
        if weights[i] == 0:
            continue
        for a in range(3):
            place[a] = 0.0
            for b in range(3):
                place[a] += frame[a, b] * (points[i, b] - row[b])
        residual = _rows(kind, row, place[0], place[1], place[2], gradient)
        if grows >= 0:
            for a in range(n_shifts):
                gradient[grows] += basis[a, grows] * gradient[a]
        cost += weights[i] * residual * residual
        for a in range(k):
            weighted = weights[i] * gradient[a]
            right[a] += weighted * residual
            for b in range(a + 1):
                matrix[a, b] += weighted * gradient[b]
    for a in range(k):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return basis, cost


@compiled
def _stepped(kind: int, row: FloatArray, change: FloatArray) -> tuple[bool, FloatArray]:
    """Whether a surface is left after a step (k,) of the chart, and its row (8,)."""
    new, frame = row.copy(), np.empty((3, 3))
    _frame(kind, row, frame)
    if kind == _SPHERE:
        new[:3] += change[:3]
        new[6] += change[3]
        return new[6] > 0, new
    if kind == _PLANE:
        new[3:6] = frame[0] * change[1] + frame[1] * change[2] + frame[2]
        new[3:6] /= np.sqrt((new[3:6] ** 2).sum())
        new[:3] -= change[0] * frame[2]
        return True, new
    new[3:6] = frame[0] * change[2] + frame[1] * change[3] + frame[2]
    new[3:6] /= np.sqrt((new[3:6] ** 2).sum())
    new[:3] += frame[0] * change[0] + frame[1] * change[1]
    if kind == _TORUS:
        new[:3] += frame[2] * change[4]
        new[6] += change[5]
        new[7] += change[6]
        return new[6] > 0 and new[7] > 0, new
    along = -(new[:3] * new[3:6]).sum()
    new[:3] += along * new[3:6]
    new[6] += change[4]
    if kind == _CYLINDER:
        return new[6] > 0, new
    new[7] += change[5]
    new[6] -= along * np.tan(new[7])
    return abs(new[7]) < 0.4999 * np.pi, new


@inlined
def _remaining_sum(change: FloatArray, last: FloatArray) -> float:
    """As in `completion.fitting.euclidean`."""
    length, now = np.sqrt((last * last).sum()), np.sqrt((change * change).sum())
    if length == 0 or now > 0.999 * length:
        return 1.0
    ratio = (change * last).sum() / length**2
    return 1 / (1 - ratio) if abs(ratio) * length > 0.99 * now and ratio > 0.2 else 1.0


@compiled
def _scaled(
    kind: int, start: FloatArray, points: FloatArray, cut: float, n_least: int
) -> tuple[bool, FloatArray, FloatArray, FloatArray, float]:
    """Whether enough points (n, 3) count; the chart's row, points, their weights, and the scale.

    The row and the points are in units of the scale about the points' mean, which is the last point.
    """
    n, row, scale, n_counted = len(points), start.copy(), 0.0, 0
    weights, unit, centre = np.empty(n), np.empty((n + 1, 3)), np.zeros(3)
    for i in range(n):
        share = _look(kind, start, points[i]) / cut
        weights[i] = max(1 - share * share, 0.0) ** 2
        n_counted += weights[i] != 0
        for a in range(3):
            centre[a] += points[i, a] / n
    for i in range(n):
        for a in range(3):
            unit[i, a] = points[i, a] - centre[a]
            scale += unit[i, a] ** 2 / n
    scale = np.sqrt(scale) if scale > 0 else 1.0
    unit /= scale
    unit[n] = centre
    row[:3] = (row[:3] - centre) / scale
    row[6] /= scale
    if kind == _TORUS:
        row[7] /= scale
    if kind in (_CYLINDER, _CONE):
        along = -(row[:3] * row[3:6]).sum()
        row[:3] += along * row[3:6]
        row[6] += along * np.tan(row[7])
        row[7] = -row[7]
    return n_counted >= n_least, row, unit, weights, scale


@compiled
def adjusted(
    kind: int, start: FloatArray, points: FloatArray, tolerance: float, limits: tuple[int, float, float]
) -> tuple[bool, FloatArray, FloatArray]:
    """Whether a surface is found near the row `start` (8,), its row, and covariance (k, k) at the tolerance.

    Points (n, 3) count with Tukey's weights about `start`. `limits` are the number of steps, the tolerances
    below which a step is the last, and the greatest radius, extents of the points. The steps are those of
    `completion.fitting.euclidean.polish_chart`.
    """
    k = 3 + kind
    n_steps, still, most_size = limits
    covariance, is_left = np.empty((k, k)), False
    enough, row, unit, weights, scale = _scaled(kind, start, points, _CUT * tolerance, k)
    unit, centre = unit[:-1], unit[-1]
    matrix, right, change = np.empty((k, k)), np.empty(k), np.zeros(k)
    trial_matrix, trial_right = np.empty((k, k)), np.empty(k)
    if not enough:
        return False, row, covariance
    basis, cost = _sums(kind, row, unit, weights, matrix, right)
    damping, last = 0.0, np.zeros(k)
    for _ in range(n_steps):
        norm = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        for a in range(k):
            for b in range(k):
                covariance[a, b] = matrix[a, b] / (norm[a] * norm[b])
        if not np.isfinite(covariance).all():
            return False, row, covariance
        values, vectors = np.linalg.eigh(covariance)
        if values[-1] > MOST_CONDITION * values[0]:
            return False, row, covariance
        change = -(basis @ ((vectors @ ((vectors.T @ (right / norm)) / (values + damping))) / norm))
        step = change * (_remaining_sum(change, last) if damping == 0 else 1.0)
        last = change
        size, moved = 1.0 if kind == _PLANE else max(1.0, row[6]), 0.0
        for a in range(k):
            moved = max(moved, abs(step[a]) / (size if _LENGTHS[kind, a] else 1.0))
        is_left, trial = _stepped(kind, row, step)
        rounding = 1e-15 * size * np.sqrt(len(points))
        slack = 1e-13 * cost + 2 * rounding * np.sqrt(cost) + rounding**2
        if is_left:
            trial_basis, trial_cost = _sums(kind, trial, unit, weights, trial_matrix, trial_right)
            is_left = trial_cost <= cost + slack
        if not is_left:
            if moved < 1e-9:
                break
            damping = max(10 * damping, 1e-3)
            continue
        row, basis, cost = trial, trial_basis, trial_cost
        matrix[:], right[:] = trial_matrix, trial_right
        damping = 0.0 if damping < 1e-2 else damping / 10
        if moved < still * tolerance / scale:
            break
    if kind == _CONE and row[7] > 0:
        row[3:6], row[7] = -row[3:6], -row[7]
        basis, cost = _sums(kind, row, unit, weights, matrix, right)
    norm = np.sqrt(np.diag(matrix))
    for a in range(k):
        for b in range(k):
            covariance[a, b] = matrix[a, b] / (norm[a] * norm[b])
    if not np.isfinite(covariance).all() or (kind != _PLANE and max(1.0, row[6]) > most_size):
        return False, row, covariance
    values, vectors = np.linalg.eigh(covariance)
    if (kind >= _CYLINDER and row[6] <= 0) or (kind == _CONE and row[7] == 0):
        return False, row, covariance
    if kind == _TORUS and row[7] >= row[6]:
        return False, row, covariance
    covariance[:] = basis @ ((vectors / values) @ vectors.T / np.outer(norm, norm)) @ basis.T
    for a in range(k):
        for b in range(k):
            covariance[a, b] *= tolerance**2
            covariance[a, b] /= (1.0 if _LENGTHS[kind, a] else scale) * (1.0 if _LENGTHS[kind, b] else scale)
    row[:3] = centre + scale * row[:3]
    row[6] *= scale
    row[7] *= scale if kind == _TORUS else -1.0
    return bool(np.isfinite(covariance).all()), row, covariance
