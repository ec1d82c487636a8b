# SPDX-License-Identifier: MIT
"""Form: planes and cylinders with their charts as compiled loops read them, place by place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.observe.rays import Triple, dot, minus, plus, triple
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import inlined

_LEAST_APPROACH = 1e-12  # cosine below which a ray runs along a plane
_LEAST_SQUARE = 1e-18  # of the sine between a ray and an axis


class Form(NamedTuple):
    """A plane or a cylinder; see its chart there."""

    is_curved: bool
    point: Triple  # of the surface, or on its axis
    axis: Triple  # a plane's normal, a cylinder's axis
    first: Triple  # u direction; where a cylinder's arc length is 0
    second: Triple  # v direction; a quarter turn on around a cylinder
    radius: float  # metres; 1 of a plane
    outward: float  # -1 where a cylinder is concave


def form_of(surface: Surface) -> Form:
    """Return a plane or a cylinder as the loops read it."""
    if isinstance(surface, Plane):
        return Form(
            is_curved=False,
            point=triple(surface.point),
            axis=triple(surface.normal_direction),
            first=triple(surface.u_direction),
            second=triple(surface.v_direction),
            radius=1.0,
            outward=1.0,
        )
    if not isinstance(surface, Cylinder):
        raise TypeError(f"no scan can be held against a {type(surface).__name__}")
    return Form(
        is_curved=True,
        point=triple(surface.point),
        axis=triple(surface.direction),
        first=triple(surface.zero_direction),
        second=triple(np.cross(surface.direction, surface.zero_direction)),
        radius=surface.radius,
        outward=-1.0 if surface.concave else 1.0,
    )


@inlined
def place_of(form: Form, u: float, v: float) -> Triple:
    """The place of chart coordinates, metres."""
    if not form.is_curved:
        return plus(plus(form.point, u, form.first), v, form.second)
    angle = u / form.radius
    across = plus(form.point, form.radius * np.cos(angle), form.first)
    return plus(plus(across, form.radius * np.sin(angle), form.second), v, form.axis)


@inlined
def chart_of(form: Form, place: Triple) -> tuple[float, float]:
    """Chart coordinates of the foot of a place, metres."""
    offset = minus(place, form.point)
    if not form.is_curved:
        return dot(offset, form.first), dot(offset, form.second)
    return form.radius * np.arctan2(dot(offset, form.second), dot(offset, form.first)), dot(offset, form.axis)


@inlined
def slope_at(form: Form, place: Triple, ray: Triple) -> float:
    """Inner product of a direction and the surface's unit normal at a place."""
    if not form.is_curved:
        return dot(ray, form.axis)
    offset = minus(place, form.point)
    radial = plus(offset, -dot(offset, form.axis), form.axis)
    length = np.sqrt(dot(radial, radial))
    if length > 0.0:
        return form.outward * dot(ray, radial) / float(length)
    return form.outward * dot(ray, form.first)


@inlined
def reach_of(form: Form, origin: Triple, ray: Triple, from_within: bool) -> float:
    """Range along a unit ray to the outer side of a surface, or from within to its inner side; else inf.

    A plane's outer side is the one that its normal points to.
    """
    offset = minus(origin, form.point)
    if not form.is_curved:
        height, approach = dot(offset, form.axis), -dot(ray, form.axis)
        if from_within:
            height, approach = -height, -approach
        return height / approach if approach > _LEAST_APPROACH and height >= 0.0 else np.inf
    offset = plus(offset, -dot(offset, form.axis), form.axis)
    across = plus(ray, -dot(ray, form.axis), form.axis)
    square = dot(across, across)
    if square <= _LEAST_SQUARE:
        return np.inf
    middle = -dot(across, offset) / square  # where the ray is nearest the axis
    nearest = plus(offset, middle, across)
    depth = form.radius * form.radius - dot(nearest, nearest)
    if depth < 0.0:
        return np.inf
    half = np.sqrt(depth / square)
    reach = middle + half if from_within else middle - half
    return reach if reach >= 0.0 else np.inf
