# SPDX-License-Identifier: MIT
"""Starts of elbows: from two tubes of consensus whose axes cross, and from a bend of consensus."""

from __future__ import annotations

from typing import cast

import numpy as np

from completion.fitting.held import holding
from completion.fitting.result import FitError
from completion.fitting.robust import consensus_surface
from completion.fitting.starts import oriented
from completion.templates.junctions.model import Model
from completion.templates.junctions.profiles import elbow
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Torus

_N_SAMPLE = 1_500
_BENDS = (1.0, 1.5, 2.2, 3.2, 4.8)  # radii of the tube, where nothing says more
_HALVES = tuple(np.radians([15.0, 22.5, 30.0, 45.0]))
_WITHIN = 4.0  # roughnesses, that a point may be from a tube
_MISS = 1.0  # radii by which axes may miss each other
_LEAST_ANGLE = np.radians(8.0)  # by which a pipe turns
_LEAST_LEFT = 30


def bend_starts(points: FloatArray, given: FloatArray) -> list[Model]:
    """Return models of elbows to begin with, at points (n, 3) at unit RMS.

    Parameters
    ----------
    points : (n, 3) float
        At unit RMS.
    given : (3,) float
        Half the angle, radius of the bend and of the tube; NaN where it is not given.
    """
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    normals, roughness = oriented(sample, points)
    tubes = _tubes(sample, normals, _WITHIN * roughness, given[2])
    starts = [model for pair in _pairs(tubes) for model in _between(*pair, given)]
    if starts:
        return starts
    try:
        bend = cast(Torus, consensus_surface(sample, normals, "torus", _WITHIN * roughness))
    except FitError:
        return []
    on = np.abs(bend.distance(sample)) < _WITHIN * roughness
    return _about(bend, sample[on], given)


def _tubes(
    sample: FloatArray, normals: FloatArray, tolerance: float, radius: float
) -> list[tuple[Cylinder, FloatArray]]:
    """Up to three cylinders, each of what those before leave, and the points (m, 3) on each."""
    held = holding("cylinder", float(radius), None) if np.isfinite(radius) else None
    found, left = [], np.ones(len(sample), dtype=np.bool_)
    for _ in range(3):
        if left.sum() < _LEAST_LEFT:
            break
        try:
            tube = cast(Cylinder, consensus_surface(sample[left], normals[left], "cylinder", tolerance, held))
        except FitError:
            break
        across = np.abs(np.einsum("ij,j->i", normals, tube.direction)) < 0.35
        on: BoolArray = left & (np.abs(tube.distance(sample)) < tolerance) & across
        if on.sum() < _LEAST_LEFT // 2:
            break
        found.append((tube, sample[on]))
        left &= ~on
    return found


_Tube = tuple[Cylinder, FloatArray]


def _pairs(tubes: list[_Tube]) -> list[tuple[_Tube, _Tube]]:
    """Pairs of tubes whose axes turn, and nearly cross."""
    pairs = []
    for i, (first, _) in enumerate(tubes):
        for j in range(i):
            second = tubes[j][0]
            normal = np.cross(first.direction, second.direction)
            sine = float(np.linalg.norm(normal))
            if sine < np.sin(_LEAST_ANGLE):
                continue
            miss = abs(float((first.point - second.point) @ normal)) / sine
            if miss < _MISS * max(first.radius, second.radius):
                pairs.append((tubes[i], tubes[j]))
    return pairs


def _between(first: _Tube, second: _Tube, given: FloatArray) -> list[Model]:
    """Elbows between two tubes, with bends of several radii."""
    a, b = first[0], second[0]
    gap = b.point - a.point
    along = float(a.direction @ b.direction)
    s, t = np.linalg.solve([[1.0, -along], [along, -1.0]], [gap @ a.direction, gap @ b.direction])
    corner = (a.point + s * a.direction + b.point + t * b.direction) / 2
    ways = [
        np.sign((tube[1].mean(axis=0) - corner) @ tube[0].direction) * tube[0].direction
        for tube in (first, second)
    ]
    inward = ways[0] + ways[1]
    if np.linalg.norm(inward) < 1e-6:
        return []
    x = -inward / np.linalg.norm(inward)
    y = ways[0] - (ways[0] @ x) * x
    y = y / np.linalg.norm(y)
    half = (np.pi - np.arccos(np.clip(ways[0] @ ways[1], -1, 1))) / 2
    tube = (a.radius + b.radius) / 2
    models = []
    for wide in _BENDS:
        shape = np.where(np.isfinite(given), given, [half, wide * tube, tube])
        origin = corner - x * shape[1] / np.cos(half)
        models.append(Model(elbow, np.stack([x, y, np.cross(x, y)]), origin, shape, _free(given)))
    return models


def _about(bend: Torus, on: FloatArray, given: FloatArray) -> list[Model]:
    """Elbows of a bend, of several angles, the middle where its points (m, 3) are."""
    flat = on - bend.centre
    flat = flat - np.outer(flat @ bend.direction, bend.direction)
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12)
    middle = flat.mean(axis=0)
    if np.linalg.norm(middle) < 0.1:
        return []
    x = middle / np.linalg.norm(middle)
    turn = np.stack([x, np.cross(bend.direction, x), bend.direction])
    models = []
    for half in _HALVES:
        shape = np.where(np.isfinite(given), given, [half, bend.radius, bend.tube_radius])
        models.append(Model(elbow, turn, bend.centre, shape, _free(given)))
    return models


def _free(given: FloatArray) -> BoolArray:
    return np.append(np.ones(6, dtype=np.bool_), ~np.isfinite(given))
