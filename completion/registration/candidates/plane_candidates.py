# SPDX-License-Identifier: MIT
"""Plane candidates: poses under which planes of two scans face alike and lie in each other.

After the two equations of a plane under a motion: R n_b = n_a, and n_a . t = d_a - d_b.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from completion.registration.candidates.station_view import Directions
from scenes.checks import FloatArray

_SAME_ANGLE = np.radians(4.0)  # by which angles between directions may differ
_LEAST_SINE = 0.3  # of the angle between two directions that tell a rotation
_N_ROTATIONS = 40
_ALIKE = np.cos(np.radians(6.0))  # directions that a rotation brings together
_N_VOTES = 9  # of offsets along a direction
_N_FEW = 4  # of them, where all places along a third direction are tried
_SAME_M = 0.05  # offsets that are one vote
_STEP_M = 0.2  # along a direction that no plane tells
_INDEPENDENT = 0.3  # triple product of three directions that tell a place


def plane_candidates(a: Directions, b: Directions, reach_m: float) -> FloatArray:
    """Return motions (n, 3, 4) of scan b into the frame of scan a that bring planes together.

    Rotations come from pairs of directions with the same angle between them, those that bring most area
    together first. Offsets come from the differences of planes' distances, the seven that most area votes for
    along each direction; where only two directions are shared, all places along the third within `reach_m`.
    """
    motions = [np.zeros((0, 3, 4))]
    for rotation in _rotations(a, b):
        places = places_of(a, b, rotation, reach_m)
        turned = np.repeat(rotation[None], len(places), axis=0)
        motions.append(np.concatenate([turned, places[:, :, None]], axis=2))
    return np.concatenate(motions)


def _rotations(a: Directions, b: Directions) -> list[FloatArray]:
    """Rotations (3, 3) under which directions agree, most area first."""
    found: list[tuple[float, FloatArray]] = []
    weight_a, weight_b = (np.array([float(one.sum()) for one in some.areas]) for some in (a, b))
    for i, j in combinations(range(len(a.normals)), 2):
        cross = np.cross(a.normals[i], a.normals[j])
        if np.linalg.norm(cross) < _LEAST_SINE:
            continue
        angle = np.arctan2(np.linalg.norm(cross), a.normals[i] @ a.normals[j])
        for k, m in product(range(len(b.normals)), repeat=2):
            if k == m:
                continue
            cross_b = np.cross(b.normals[k], b.normals[m])
            size = np.linalg.norm(cross_b)
            if size < _LEAST_SINE or abs(np.arctan2(size, b.normals[k] @ b.normals[m]) - angle) > _SAME_ANGLE:
                continue
            rotation = _frame(a.normals[i], a.normals[j]) @ _frame(b.normals[k], b.normals[m]).T
            cosine = a.normals @ rotation @ b.normals.T
            together = np.minimum(weight_a[:, None], weight_b[None])[cosine > _ALIKE].sum()
            found.append((float(together), rotation))
    found.sort(key=lambda one: -one[0])
    kept: list[FloatArray] = []
    for _, rotation in found:
        if all(np.trace(rotation.T @ other) < 1 + 2 * _ALIKE for other in kept):
            kept.append(rotation)
        if len(kept) == _N_ROTATIONS:
            break
    return kept


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    """The frame (3, 3) of two directions, alike in both: its columns are their half, difference and cross."""
    half, across = first + second, first - second
    x, y = half / np.linalg.norm(half), across / np.linalg.norm(across)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def places_of(a: Directions, b: Directions, rotation: FloatArray, reach_m: float) -> FloatArray:
    """Return shifts (n, 3) under which planes of directions that agree lie in each other, metres."""
    cosine = a.normals @ rotation @ b.normals.T
    pairs = [(i, int(cosine[i].argmax())) for i in range(len(a.normals)) if cosine[i].max() > _ALIKE]
    told = [(a.normals[i], *votes(a, b, i, k)) for i, k in pairs]
    told.sort(key=lambda one: -float(one[2].sum()))
    places = [np.zeros((0, 3))]
    for three in combinations(told, 3):
        matrix = np.array([one[0] for one in three])
        if abs(np.linalg.det(matrix)) > _INDEPENDENT:
            offsets = np.array(list(product(*(one[1] for one in three))))
            places.append(np.linalg.solve(matrix, offsets.T).T)
            break
    steps = np.arange(-reach_m, reach_m, _STEP_M)
    for first, second in list(combinations(told, 2))[:3]:
        along = np.cross(first[0], second[0])
        if np.linalg.norm(along) < _LEAST_SINE:
            continue
        offsets = np.array(list(product(first[1][:_N_FEW], second[1][:_N_FEW], steps)))
        matrix = np.array([first[0], second[0], along / np.linalg.norm(along)])
        places.append(np.linalg.solve(matrix, offsets.T).T)
    return np.concatenate(places)


def votes(a: Directions, b: Directions, i: int, k: int) -> tuple[FloatArray, FloatArray]:
    """The best offsets (m,) along direction i of a, metres, and the area that votes for each (m,)."""
    offsets = (a.heights[i][:, None] - b.heights[k][None]).ravel()
    weight = np.minimum(a.areas[i][:, None], b.areas[k][None]).ravel()
    kept: list[float] = []
    said: list[float] = []
    left = np.argsort(-weight, kind="stable")
    while len(left) and len(kept) < _N_VOTES:
        near = np.abs(offsets[left] - offsets[left[0]]) < _SAME_M
        own = left[near]
        kept.append(float((offsets[own] * weight[own]).sum() / weight[own].sum()))
        said.append(float(weight[own].sum()))
        left = left[~near]
    return np.array(kept), np.array(said)
