# SPDX-License-Identifier: MIT
"""Free-form blends between planes and cylinders, as points; millimetres."""

import numpy as np

from completion.fitting.patches.joins import Boundary, JoinKind
from scenes.surfaces.catalogue import Cylinder, Plane

WALL, FLOOR, END = Plane((0, 0, 0), (1, 0, 0)), Plane((0, 0, 0), (0, 0, 1)), Plane((0, 0, 0), (0, 1, 0))
TUBE = Cylinder((0, 0, 0), (0, 0, 1), 50.0)
BLEND = {
    "u0": Boundary(WALL, JoinKind.TANGENT),
    "u1": Boundary(FLOOR, JoinKind.TANGENT),
    "v0": Boundary(END, JoinKind.ORTHOGONAL),
}
"""Tangent to a wall and a floor, at right angles to an end, free at the other."""

COLLAR = {
    "u0": Boundary(TUBE, JoinKind.TANGENT),
    "u1": Boundary(FLOOR, JoinKind.TANGENT),
    "v0": Boundary(END, JoinKind.ORTHOGONAL),
}
"""The same between a tube that stands on a floor, and that floor."""


def noisy(at, first, second, sigma, rng):
    """Points of a surface at parameters, off it along its normal."""
    step = 1e-5
    along = at(first + step, second) - at(first - step, second)
    across = np.cross(along, at(first, second + step) - at(first, second - step))
    unit = across / np.linalg.norm(across, axis=1, keepdims=True)
    return at(first, second) + sigma * rng.normal(size=(len(first), 1)) * unit


def blend(n, sigma, seed):
    """Points between wall and floor: a fillet of changing radius with a wave."""
    rng = np.random.default_rng(seed)

    def at(turn, y):
        radius, wave = 40 + 15 * (y / 100) ** 2, 3 * np.sin(2 * turn) ** 2 * np.cos(np.pi * y / 50)
        x, z = radius * (1 - np.cos(turn)), radius * (1 - np.sin(turn))
        return np.column_stack([x + wave * np.cos(turn), y, z + wave * np.sin(turn)])

    return noisy(at, rng.uniform(0, np.pi / 2, n), rng.uniform(0, 100, n), sigma, rng)


def collar(n, sigma, seed, span_deg=60.0):
    """Points between a tube and a floor, `span_deg` of the way round."""
    rng = np.random.default_rng(seed)

    def at(turn, about):
        radius, wave = 20 + 8 * np.sin(2 * about) ** 2, 1.5 * np.sin(2 * turn) ** 2 * np.cos(6 * about)
        reach = TUBE.radius + radius * (1 - np.cos(turn)) + wave * np.cos(turn)
        z = radius * (1 - np.sin(turn)) + wave * np.sin(turn)
        return np.column_stack([reach * np.cos(about), reach * np.sin(about), z])

    about = rng.uniform(0, np.radians(span_deg), n)
    return noisy(at, rng.uniform(0, np.pi / 2, n), about, sigma, rng)
