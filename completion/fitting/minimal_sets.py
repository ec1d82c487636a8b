# SPDX-License-Identifier: MIT
"""Minimal sets: the surface of a kind through a few oriented points, in closed form."""

from __future__ import annotations

import numpy as np

from completion.fitting.limits import LEAST_ANGLE
from completion.fitting.starts import torus_about
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus


def surface_through(shape: str, points: FloatArray, normals: FloatArray) -> Surface | None:
    """The surface through oriented points (k, 3) with normals (k, 3); None where they are degenerate."""
    try:
        if shape == "plane":
            return Plane(points[0], normals[0])
        if shape == "cone":
            return _spanned_cone(points, normals)
        if shape == "torus":
            return _spanned_torus(points, normals)
        if shape == "sphere":
            return _spanned_sphere(points, normals)
        return _spanned_cylinder(shape, points, normals)
    except (np.linalg.LinAlgError, InputError):
        return None


def _spanned_sphere(points: FloatArray, normals: FloatArray) -> Sphere | None:
    """The centre is nearest to both normals."""
    across = np.eye(3)[None] - normals[:, :, None] * normals[:, None, :]
    if abs(float(normals[0] @ normals[1])) > np.cos(LEAST_ANGLE):
        return None
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    radii = np.linalg.norm(points - centre, axis=1)
    return Sphere(centre, float(radii.mean())) if np.ptp(radii) < 0.3 * radii.mean() else None


def _spanned_cylinder(shape: str, points: FloatArray, normals: FloatArray) -> Surface | None:
    axis = np.cross(normals[0], normals[1])
    sine = float(np.linalg.norm(axis))
    if sine < np.sin(LEAST_ANGLE):
        return None
    axis = axis / sine
    frame = np.stack([normals[0], np.cross(axis, normals[0]), axis])
    if shape == "elliptic-cylinder":
        return _spanned_ellipse(points, frame)
    flat, direction = (points[:2] - points[0]) @ frame[:2].T, normals[:2] @ frame[:2].T
    along = np.linalg.solve(np.column_stack([direction[0], -direction[1]]), flat[1])
    radii = np.abs(along)
    if np.ptp(radii) > 0.3 * radii.mean():
        return None
    return Cylinder(points[0] + along[0] * normals[0], axis, float(radii.mean()))


def _spanned_ellipse(points: FloatArray, frame: FloatArray) -> EllipticCylinder | None:
    x, y = (points[2:] - points[2]) @ frame[0], (points[2:] - points[2]) @ frame[1]
    basis = np.column_stack([x * x - y * y, 2 * x * y, x, y, np.ones(5)])
    a, b, *linear, constant = np.linalg.solve(basis, x * x + y * y)
    form = np.array([[1 - a, -b], [-b, 1 + a]])
    values, vectors = np.linalg.eigh(form)
    if values[0] < 0.01 * values[1]:
        return None
    centre = np.linalg.solve(form, np.array(linear) / 2)
    level = float(constant + centre @ form @ centre)
    if level <= 0:
        return None
    radii = np.sqrt(level / values)
    place = points[2] + centre @ frame[:2]
    return EllipticCylinder(place, frame[2], (float(radii[0]), float(radii[1])), vectors[:, 0] @ frame[:2])


def _spanned_cone(points: FloatArray, normals: FloatArray) -> Cone | None:
    """The apex lies in all tangent planes; the rays from it to the points make one angle with the axis."""
    apex = np.linalg.solve(normals, np.einsum("ij,ij->i", normals, points))
    rays = points - apex
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    axis = np.linalg.solve(rays, np.ones(3))
    axis = axis / np.linalg.norm(axis)
    cosine = float(rays[0] @ axis)
    height = float(((points - apex) @ axis).mean())
    if not 0.01 < cosine < 0.99999 or height <= 0:
        return None
    half_angle = float(np.arccos(cosine))
    agrees = np.abs(normals @ axis) - np.sin(half_angle)
    if np.abs(agrees).max() > 0.2:
        return None
    return Cone(apex + height * axis, axis, height * float(np.tan(half_angle)), half_angle)


def _spanned_torus(points: FloatArray, normals: FloatArray) -> Torus | None:
    """The axis meets all four normals, which two lines do; about it the points lie on one circle."""
    centre = points.mean(axis=0)
    offset = points - centre
    lines = np.hstack([np.cross(offset, normals), normals])
    first, second = np.linalg.svd(lines)[2][4:]
    # (c + t c') . (m + t m') = 0: a line among the complexes
    a, b, c = second[:3] @ second[3:], first[:3] @ second[3:] + second[:3] @ first[3:], first[:3] @ first[3:]
    best: Torus | None = None
    least = 0.1  # of the tube's radius: how far the normals may be from the tube's middle
    for turn in np.roots([a, b, c]):
        line = first + float(turn.real) * second
        length = float(np.linalg.norm(line[:3]))
        if abs(turn.imag) > 1e-9 or length < 1e-9:
            continue
        axis, moment = line[:3] / length, line[3:] / length
        candidate = _torus_about(offset, normals, np.cross(axis, moment), axis)
        if candidate is not None and candidate[1] < least:
            torus, least = candidate
            best = Torus(torus.centre + centre, torus.direction, torus.radius, torus.tube_radius)
    return best


def _torus_about(
    points: FloatArray, normals: FloatArray, point: FloatArray, axis: FloatArray
) -> tuple[Torus, float] | None:
    """The torus about an axis through the points, and how far off they and their normals are (in radii)."""
    charts = torus_about(points, point, axis)
    if not charts:
        return None
    torus = charts[0].surface(np.zeros(3), 1.0, False)
    aligned = np.abs(np.einsum("ij,ij->i", torus.normal(points), normals))
    off = np.abs(torus.distance(points)) / torus.tube_radius
    return torus, float(max(off.max(), (1 - aligned).max()))
