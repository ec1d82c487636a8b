# SPDX-License-Identifier: MIT
"""Kinds of surfaces that can be fitted: the one registry.

A new kind is a module with its surface, its chart and its `Kind`; an entry here; and its name in `Shape`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from completion.fitting.chart import Chart, standard_chart
from completion.fitting.minimal_sets import surface_through
from completion.fitting.shape import Kind, KindGeometry
from completion.fitting.starts import starts
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Surface, Torus

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
        spanned=partial(surface_through, shape),
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
    return np.asarray(surface.point if origin is None else origin)  # type: ignore[attr-defined]
