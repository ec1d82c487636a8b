# SPDX-License-Identifier: MIT
"""Profiles: what is swept along an axis or round a bend, with derivatives: tangent arcs, an edge, a pipe."""

from __future__ import annotations

import numpy as np

from completion.templates.junctions.model import Section
from scenes.checks import FloatArray


def tangent_arcs(local: FloatArray, shape: FloatArray) -> Section:
    """Return the distances of points (n, 3) to two arcs along z that touch in x = y = 0.

    d(x, y; k) = (2 x + k (x^2 + y^2)) / (1 + sqrt(1 + k (2 x + k (x^2 + y^2)))) with the curvatures (2,): the
    first where y > 0. Each is of either sign, or none: its circle's middle lies at x = -1 / k. The side is
    decided by the plane y = 0, not by the nearer surface, which noise would decide near the joint.
    """
    x, y = local[:, 0], local[:, 1]
    is_first = y > 0
    k = np.where(is_first, shape[0], shape[1])
    square = x * x + y * y
    s = 2 * x + k * square
    root = np.maximum(np.sqrt(np.maximum(1 + k * s, 0.0)), 1e-9)
    distance = s / (1 + root)
    slope = np.column_stack([(1 + k * x) / root, k * y / root, np.zeros(len(x))])
    by_k = (square - distance**2) / (2 * root)
    by_shape = np.column_stack([np.where(is_first, by_k, 0.0), np.where(is_first, 0.0, by_k)])
    return Section(distance, slope, by_shape, np.where(is_first, 1, 2))


def edge(local: FloatArray, shape: FloatArray) -> Section:
    """Return the distances of points (n, 3) to two planes that meet along z and lean by an angle (1,)."""
    cosine, sine = np.cos(shape[0]), np.sin(shape[0])
    x, y, side = local[:, 0], np.abs(local[:, 1]), np.where(local[:, 1] > 0, 1.0, -1.0)
    slope = np.column_stack([np.full(len(x), cosine), side * sine, np.zeros(len(x))])
    by_shape = (y * cosine - x * sine)[:, None]
    return Section(x * cosine + y * sine, slope, by_shape, np.where(side > 0, 1, 2))


def elbow(local: FloatArray, shape: FloatArray) -> Section:
    """Return the distances of points (n, 3) to a bend of a tube about z, and the straight tubes beyond.

    The shape (3,): half the angle of the bend, which lies about the x axis; its radius; the tube's. The
    tubes touch the bend where it ends. Faces: 1 the bend, 2 the tube at y > 0, 3 the other.
    """
    half, bend, tube = shape
    cosine, sine = np.cos(half), np.sin(half)
    x, y, z = local.T
    side = np.where(y > 0, 1.0, -1.0)
    beyond = np.abs(y) * cosine - x * sine
    is_tube = beyond > 0
    out = np.maximum(np.hypot(x, y), 1e-12)
    u = np.where(is_tube, x * cosine + np.abs(y) * sine, out) - bend
    w = np.maximum(np.hypot(u, z), 1e-12)
    by_x = np.where(is_tube, cosine, x / out)
    by_y = np.where(is_tube, side * sine, y / out)
    share = u / w
    slope = np.column_stack([share * by_x, share * by_y, z / w])
    by_shape = np.column_stack([np.where(is_tube, share * beyond, 0.0), -share, np.full(len(x), -1.0)])
    return Section(w - tube, slope, by_shape, np.where(is_tube, np.where(side > 0, 2, 3), 1))
