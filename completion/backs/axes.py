# SPDX-License-Identifier: MIT
"""Axes: vertical axes of revolution from normals, and turns of legs and bases about them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.backs.limits import (
    AXIS_NEAR,
    AXIS_ROUNDS,
    CORRELATED,
    FREE_WEIGHT,
    LEAST_LEVEL,
    N_PAIRS,
    N_SECTORS,
    OFF_PLANE,
    STEP,
    TURNS,
)
from completion.backs.seeing import see, see_limbs
from completion.backs.symmetry import Sample, Symmetry, turns
from completion.backs.views import Scale, Setting, Sight
from scenes.checks import BoolArray, FloatArray

_TRIED = np.radians(np.arange(30, 360, 30))
_FEWEST = 20  # normals that are level enough
_LEAST_SCORE = 0.0


def find_axes(
    sights: Sequence[Sight], sample: Sample, setting: Setting, scale: Scale, *, rng: np.random.Generator
) -> list[Symmetry]:
    """Return the vertical axis that most normals pass through, with covariance and evidence, or none.

    (a - p) x n = 0 in plan is linear in the axis a: pairs of points by chance, then least squares.
    """
    level = np.linalg.norm(sample.normals[:, :2], axis=1)
    usable = level > LEAST_LEVEL
    if usable.sum() < _FEWEST:
        return []
    across = sample.normals[usable][:, [1, 0]] * [1, -1] / level[usable, None]  # across a normal's line
    shift = np.einsum("ij,ij->i", across, sample.points[usable, :2] - scale.middle[:2])
    pair = rng.integers(len(across), size=(N_PAIRS, 2))
    matrix = across[pair]
    determinant = np.linalg.det(matrix)
    matrix, pair = matrix[np.abs(determinant) > 0.1], pair[np.abs(determinant) > 0.1]
    if not len(pair):
        return []
    places = np.linalg.solve(matrix, shift[pair][:, :, None])[:, :, 0]
    near = AXIS_NEAR * scale.size
    inside = np.abs(places @ across.T - shift) < near
    place = places[np.argmax(inside.sum(axis=1))]
    held = np.abs(across @ place - shift) < near
    information = np.eye(2) / (STEP * scale.size) ** 2
    for _ in range(AXIS_ROUNDS):
        a, b = across[held], shift[held]
        if held.sum() < _FEWEST or np.linalg.cond(a.T @ a) > 1e4:
            return []
        place = np.linalg.solve(a.T @ a, a.T @ b)
        variance = max(float(np.mean((a @ place - b) ** 2)), setting.sigma_m**2)
        information = a.T @ a / (CORRELATED * variance)
        held = np.abs(across @ place - shift) < near
    outward = sample.normals[usable][held]
    sector = np.floor(np.arctan2(outward[:, 1], outward[:, 0]) / (2 * np.pi) * N_SECTORS).astype(int)
    arc = len(np.unique(sector)) / N_SECTORS
    own = {"inliers": float(held.mean()), "arc": arc, "lateral": float(usable.mean())}
    covariance = np.asarray(np.linalg.inv(information + np.eye(2) / scale.size**2), dtype=np.float64)
    evidence = own | _evidence(place, _TRIED, sights, sample, scale)
    return [Symmetry("axis", place, scale.middle, covariance, evidence)]


def find_turns(
    axes: Sequence[Symmetry], found: Sequence[Symmetry], sights: Sequence[Sight], sample: Sample, scale: Scale
) -> list[Symmetry]:
    """Return the best turn by 360 / n degrees about an axis, or about the lines where mirrors meet.

    A stool's legs, the star below an office chair: no mirror of the seen half shows them, and about the axis
    of what is round in them they do not turn freely.
    """
    places = [(axis.place, axis.covariance, axis.evidence) for axis in axes]
    for k, one in enumerate(found):
        for other in found[:k]:
            matrix = np.stack([one.normal[:2], other.normal[:2]])
            if abs(np.linalg.det(matrix)) < 0.5:
                continue
            inverse = np.linalg.inv(matrix)
            meeting = inverse @ np.array([one.place[1], other.place[1]])
            spread = inverse @ np.diag([one.covariance[1, 1], other.covariance[1, 1]]) @ inverse.T
            places.append((meeting, spread, {"inliers": 0.0, "arc": 0.0, "lateral": 0.0}))
    best: Symmetry | None = None
    for place, covariance, own in places[:6]:
        for n in TURNS:
            angles = 2 * np.pi * np.arange(1, n) / n
            evidence = dict(own) | _evidence(place, angles, sights, sample, scale)
            if evidence["score"] > _LEAST_SCORE and (
                best is None or evidence["score"] > best.evidence["score"]
            ):
                best = Symmetry("turn", place, scale.middle, covariance, evidence, n_fold=n)
    return [] if best is None else [best]


def _evidence(
    place: FloatArray, angles: FloatArray, sights: Sequence[Sight], sample: Sample, scale: Scale
) -> dict[str, float]:
    """Shares of points turned by angles (k,), of those that are off the axis."""
    isometries = turns(place, scale.middle, angles)
    off: BoolArray = (
        np.linalg.norm(sample.points[:, :2] - scale.middle[:2] - place, axis=1) >= OFF_PLANE * scale.size
    )
    if not off.any():
        return {"matched": 0.0, "contradicted": 1.0, "hidden": 0.0, "limb": 0.0, "score": -FREE_WEIGHT}
    seen = see(sights, isometries, sample.points[off], sample.normals[off], scale.tolerance)
    matched, free = float((seen.matched * (1 - seen.free)).mean()), float(seen.free.mean())
    limbs = see_limbs(sights, isometries, sample.limbs, scale.size)
    return {
        "matched": matched,
        "contradicted": free,
        "hidden": float(seen.hidden.mean()),
        "limb": float(limbs.on_limb.max()),
        "cut": float(limbs.on_cut.max()),
        "score": matched - FREE_WEIGHT * free,
    }
