# SPDX-License-Identifier: MIT
"""Kinds of surfaces that can be fitted: the one registry, and each kind through a few oriented points.

A new kind is a module with its surface, its chart and its `Kind`; an entry here; and its name in `Shape`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from completion.fitting.chart import Chart, standard_chart
from completion.fitting.limits import LEAST_ANGLE
from completion.fitting.shape import Kind, KindGeometry
from completion.fitting.starts import starts, torus_about
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus


def surface_through(shape: str, points: FloatArray, normals: FloatArray) -> Surface | None:
    """The surface through oriented points (k, 3) with normals (k, 3); None where they are degenerate."""
    try:
        if shape == "plane":
            return Plane(points[0], normals[0])
        if shape == "cone":
            return _cone_through(points, normals)
        if shape == "torus":
            return _torus_through(points, normals)
        if shape == "sphere":
            return _sphere_through(points, normals)
        return _cylinder_through(shape, points, normals)
    except (np.linalg.LinAlgError, InputError):
        return None


def _sphere_through(points: FloatArray, normals: FloatArray) -> Sphere | None:
    """The centre is nearest to both normals."""
    across = np.eye(3)[None] - normals[:, :, None] * normals[:, None, :]
    if abs(float(normals[0] @ normals[1])) > np.cos(LEAST_ANGLE):
        return None
    centre = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, points))
    radii = np.linalg.norm(points - centre, axis=1)
    return Sphere(centre, float(radii.mean())) if np.ptp(radii) < 0.3 * radii.mean() else None


def _cylinder_through(shape: str, points: FloatArray, normals: FloatArray) -> Surface | None:
    axis = np.cross(normals[0], normals[1])
    sine = float(np.linalg.norm(axis))
    if sine < np.sin(LEAST_ANGLE):
        return None
    axis = axis / sine
    frame = np.stack([normals[0], np.cross(axis, normals[0]), axis])
    if shape == "elliptic-cylinder":
        return _ellipse_through(points, frame)
    flat, direction = (points[:2] - points[0]) @ frame[:2].T, normals[:2] @ frame[:2].T
    along = np.linalg.solve(np.column_stack([direction[0], -direction[1]]), flat[1])
    radii = np.abs(along)
    if np.ptp(radii) > 0.3 * radii.mean():
        return None
    return Cylinder(points[0] + along[0] * normals[0], axis, float(radii.mean()))


def _ellipse_through(points: FloatArray, frame: FloatArray) -> EllipticCylinder | None:
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


def _cone_through(points: FloatArray, normals: FloatArray) -> Cone | None:
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


def _torus_through(points: FloatArray, normals: FloatArray) -> Torus | None:
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


_Standard = Plane | Sphere | Cylinder | Cone | EllipticCylinder | Torus


def _parameters(surface: _Standard) -> dict[str, object]:
    """The parameters of a surface by name, in the order that files use."""
    if isinstance(surface, Plane):
        return {"point": surface.point.tolist(), "normal": surface.normal_direction.tolist()}
    if isinstance(surface, Sphere):
        return {"centre": surface.centre.tolist(), "radius": surface.radius, "concave": surface.concave}
    if isinstance(surface, Torus):
        place = {"centre": surface.centre.tolist(), "direction": surface.direction.tolist()}
        radii = {"radius": surface.radius, "tube_radius": surface.tube_radius}
        return place | radii | {"concave": surface.concave}
    axis = {"point": surface.point.tolist(), "direction": surface.direction.tolist()}
    if isinstance(surface, Cylinder):
        return axis | {"radius": surface.radius, "concave": surface.concave}
    if isinstance(surface, Cone):
        half_angle = {"half_angle_deg": float(np.degrees(surface.half_angle)), "apex": surface.apex.tolist()}
        return axis | {"radius": surface.radius} | half_angle | {"concave": surface.concave}
    radii = {"greater_radius": surface.radii[0], "smaller_radius": surface.radii[1]}
    return axis | radii | {"zero_direction": surface.zero_direction.tolist(), "concave": surface.concave}


def _natural_jacobians(surface: _Standard) -> dict[str, FloatArray]:
    """Derivatives of the natural parameters by those of the chart, each (3, k) or (1, k)."""
    if isinstance(surface, Plane):
        across = np.stack([surface.u_direction, surface.v_direction])
        zero = np.zeros((3, 1))
        point = np.column_stack([surface.normal_direction, np.zeros((3, 2))])
        return {"point": point, "normal": np.column_stack([zero, -across.T])}
    if isinstance(surface, Sphere):
        return {"centre": np.eye(4)[:3], "radius": np.eye(4)[3:]}
    if isinstance(surface, Torus):
        unit, frame = np.eye(7), standard_chart(surface, surface.centre, 1.0).frame
        place = {"centre": frame.T @ unit[[0, 1, 4]], "direction": frame[:2].T @ unit[2:4]}
        return place | {"radius": unit[5:6], "tube_radius": unit[6:]}
    k = {Cylinder: 5, Cone: 6, EllipticCylinder: 7}[type(surface)]
    frame = standard_chart(surface, surface.point, 1.0).frame
    unit = np.eye(k)
    natural = {"point": frame[:2].T @ unit[:2], "direction": frame[:2].T @ unit[2:4]}
    if isinstance(surface, Cylinder):
        return natural | {"radius": unit[4:]}
    if isinstance(surface, EllipticCylinder):
        return natural | {"greater_radius": unit[4:5] + unit[5:6], "smaller_radius": unit[4:5] - unit[5:6]}
    tangent = np.tan(max(surface.half_angle, 1e-100))  # a cylinder's apex is far away, not nowhere
    height = -surface.radius / tangent
    # phi = -half angle; height = radius / tan(phi).
    by_height = -unit[4:5] / tangent - surface.radius * (1 + 1 / tangent**2) * unit[5:6]
    apex = natural["point"] + height * natural["direction"] + np.outer(frame[2], by_height[0])
    return natural | {"radius": unit[4:5], "half_angle": unit[5:], "apex": apex}


def _standard(shape: str, radii: Callable[[Any], tuple[float, ...]]) -> KindGeometry:
    """The geometry of a kind of the catalogue."""
    return KindGeometry(
        chart=standard_chart,
        starts=partial(starts, shape),
        through=partial(surface_through, shape),
        parameters=_parameters,
        jacobians=_natural_jacobians,
        radii=radii,
    )


def _no_radii(surface: Plane) -> tuple[float, ...]:  # noqa: ARG001 - planes have none
    return ()


def _one_radius(surface: Sphere | Cylinder | Cone) -> tuple[float, ...]:
    return (surface.radius,)


def _smaller_radius(surface: EllipticCylinder) -> tuple[float, ...]:
    return (surface.radii[1],)


def _torus_radii(surface: Torus) -> tuple[float, ...]:
    return surface.radius, surface.tube_radius


KINDS: Mapping[str, Kind] = {
    "plane": Kind(
        title="a plane",
        least_points=3,
        n_parameters=3,
        minimal=(1, 200),
        axis=(1, 2),
        geometry=_standard("plane", _no_radii),
    ),
    "sphere": Kind(
        title="a sphere",
        least_points=4,
        n_parameters=4,
        minimal=(2, 400),
        radius=3,
        geometry=_standard("sphere", _one_radius),
    ),
    "cylinder": Kind(
        title="a cylinder",
        least_points=6,
        n_parameters=5,
        minimal=(2, 600),
        radius=4,
        axis=(2, 3),
        geometry=_standard("cylinder", _one_radius),
    ),
    "cone": Kind(
        title="a cone",
        least_points=6,
        n_parameters=6,
        minimal=(3, 1500),
        axis=(2, 3),
        geometry=_standard("cone", _one_radius),
    ),
    "elliptic-cylinder": Kind(
        title="an elliptic cylinder",
        least_points=7,
        n_parameters=7,
        minimal=(7, 1500),
        axis=(2, 3),
        geometry=_standard("elliptic-cylinder", _smaller_radius),
    ),
    "torus": Kind(
        title="a torus",
        least_points=7,
        n_parameters=7,
        minimal=(4, 1500),
        radius=5,
        axis=(2, 3),
        is_quadric=False,
        geometry=_standard("torus", _torus_radii),
    ),
}
"""By name, in the order in which a fit of unknown shape tries them."""


def kind_of(surface: Surface) -> Kind:
    """The kind of a surface; raises TypeError for one that is not in the registry."""
    kind = KINDS.get(getattr(surface, "kind", ""))
    if kind is None:
        raise TypeError(f"no parameters are known for a {type(surface).__name__}")
    return kind


def chart_of(surface: Surface, centre: FloatArray, scale: float) -> Chart:
    """The chart at a surface, in coordinates relative to `centre` (3,) in units of `scale`."""
    return kind_of(surface).geometry.chart(surface, centre, scale)


def chart_origin(surface: Surface) -> FloatArray:
    """The surface's own point (3,): its centre, else the point on its plane or axis."""
    origin = getattr(surface, "centre", None)
    return np.asarray(surface.point if origin is None else origin)  # type: ignore[attr-defined]  # one or the other is there
