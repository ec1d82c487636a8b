# SPDX-License-Identifier: MIT
"""Packed surfaces: planes and cylinders as nine numbers for compiled loops."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import inlined


def pack_plane(w: FloatArray) -> FloatArray:
    """Return a plane w . x = 1, w of shape (3,), as the numbers (9,) that the compiled loops read.

    Kind 0, unit normal away from the sensor, three unused, distance from the sensor.
    """
    size = np.sqrt(w @ w)
    model = np.zeros(9)
    model[1:4], model[7] = w / size, 1.0 / size
    return model


def pack(surface: Surface, origin: FloatArray) -> FloatArray:
    """Return a plane or cylinder as numbers (9,) relative to the sensor at `origin` (3,), metres.

    A cylinder is kind 1, axis point, axis, radius, and -1 where it is concave; see `pack_plane`.
    """
    if isinstance(surface, Plane):
        return pack_plane(surface.normal_direction / ((surface.point - origin) @ surface.normal_direction))
    if not isinstance(surface, Cylinder):
        raise TypeError(f"cannot pack a {type(surface).__name__}")
    sign = -1.0 if surface.concave else 1.0
    return np.concatenate([[1.0], surface.point - origin, surface.direction, [surface.radius, sign]])


def unpack(model: FloatArray, centre: FloatArray, origin: FloatArray) -> Surface:
    """Return the surface that a packed model (9,) stands for; it faces the sensor.

    Its own point is the one next to `centre` (3,); the sensor stands at `origin` (3,). Metres.
    """
    if model[0] == 0.0:
        normal = -model[1:4]
        height = float((centre - origin) @ normal) + float(model[7])
        return Plane(centre - height * normal, normal)
    point, direction = model[1:4] + origin, model[4:7]
    point = point + float((centre - point) @ direction) * direction
    return Cylinder(point, direction, float(model[7]), None, bool(model[8] < 0))


@inlined
def tangent_plane(model: FloatArray, c: FloatArray, w: FloatArray) -> bool:
    """Write the tangent plane w (3,) of a model (9,) nearest to c (3,): w . x = 1; False if it faces away."""
    if model[0] == 0.0:
        w[0], w[1], w[2] = model[1] / model[7], model[2] / model[7], model[3] / model[7]
        return True
    ox, oy, oz = c[0] - model[1], c[1] - model[2], c[2] - model[3]
    along = ox * model[4] + oy * model[5] + oz * model[6]
    ox -= along * model[4]
    oy -= along * model[5]
    oz -= along * model[6]
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    if length < 1e-12:
        return False
    nx, ny, nz = ox / length, oy / length, oz / length
    gap = length - model[7]
    offset = nx * c[0] + ny * c[1] + nz * c[2] - gap
    if offset * model[8] >= 0.0:  # the sensor must be on the side that the surface shows
        return False
    w[0], w[1], w[2] = nx / offset, ny / offset, nz / offset
    return True


@inlined
def gap_to(
    models: FloatArray, k: int, x: float, y: float, z: float, r: float, normal: FloatArray
) -> tuple[float, float]:
    """Distance of the point r (x, y, z) from the k-th model of (m, 9), and the cosine of its incidence.

    The unit normal (3,) away from the sensor is written to `normal`; where the surface faces away, the cosine
    is not positive. Loops over pixels index the table in place: a view of a row costs more than the distance.
    """
    if models[k, 0] == 0.0:
        normal[0], normal[1], normal[2] = models[k, 1], models[k, 2], models[k, 3]
        cosine = models[k, 1] * x + models[k, 2] * y + models[k, 3] * z
        return r * cosine - models[k, 7], cosine
    ax, ay, az = models[k, 4], models[k, 5], models[k, 6]
    ox, oy, oz = r * x - models[k, 1], r * y - models[k, 2], r * z - models[k, 3]
    along = ox * ax + oy * ay + oz * az
    ox -= along * ax
    oy -= along * ay
    oz -= along * az
    length = max(np.sqrt(ox * ox + oy * oy + oz * oz), 1e-12)
    side = -models[k, 8] / length
    normal[0], normal[1], normal[2] = ox * side, oy * side, oz * side
    return length - models[k, 7], normal[0] * x + normal[1] * y + normal[2] * z
