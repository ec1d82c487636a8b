# SPDX-License-Identifier: MIT
"""Truth of folds: where the true surfaces of a scene meet, in view of a scan or anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from scenes.checks import BoolArray, FloatArray
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

NEAR_M = 0.015  # between a fold and its truth
_LEAST_DEG = 20.0  # of the angle at a fold
_SPACING_M = 0.008  # of places on the scene's surface
_FOOTPRINTS = 2.5  # between the places of two pixels and the fold between them
_SAME_DEG = 20.0  # between a normal and that of a true surface


@dataclass(frozen=True, slots=True, eq=False)
class TrueFolds:
    """Where true surfaces meet: places (n, 3) on folds in view; the places and normals (m, 3) of all."""

    in_view: FloatArray
    tree: cKDTree
    normals: FloatArray

    @classmethod
    def of(cls, scene: Scene, scans: Sequence[RangeImage], left_out: Sequence[str] = ()) -> TrueFolds:
        """Return those of a scene that its scans, which know their truth, look at.

        Folds in view of surfaces whose names hold one of the words `left_out` are not asked for.
        """
        seen = np.concatenate([scan.true_points().reshape(-1, 3) for scan in scans])
        places, normals = _surface_places(scene, np.nanmin(seen, axis=0) - 0.1, np.nanmax(seen, axis=0) + 0.1)
        asked = np.array([not any(word in name for word in left_out) for name in scene.surface_names])
        found = [
            np.concatenate(parts)
            for parts in zip(*(folds_in_view(scene, s, asked) for s in scans), strict=True)
        ]
        _, first = np.unique(np.floor(found[0] / 0.01).astype(np.int64), axis=0, return_index=True)
        at, one, other = (array[np.sort(first)] for array in found)
        all_of_them = cls(at, cKDTree(places), normals)
        there = np.isfinite(all_of_them.angles_near(at, one, other))  # planes meet in places without surface
        return cls(at[there], all_of_them.tree, normals)

    def angles_near(self, points: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
        """Angle (n,), degrees, between the true surfaces at places (n, 3) that have nearly two normals each.

        NaN where there are no such surfaces within 15 mm that meet at 20 degrees at least.
        """
        result = np.full(len(points), np.nan)
        for k, near in enumerate(self.tree.query_ball_point(points, NEAR_M)):
            normals = self.normals[near]
            if not len(normals):
                continue
            along = np.abs(normals @ np.stack([first[k], second[k]], axis=1))
            best = along.argmax(axis=0)
            if (along.max(axis=0) < np.cos(np.radians(_SAME_DEG))).any():
                continue
            one, other = normals[best]
            angle = np.degrees(np.arccos(np.clip(abs(one @ other), 0, 1)))
            if angle >= _LEAST_DEG:
                result[k] = angle
        return result


def folds_in_view(
    scene: Scene, scan: RangeImage, asked: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places (n, 3) where neighbouring pixels of a scan lie on planes that meet between them, their normals.

    Both are among those `asked` for, (surfaces,).

    The planes of the triangles that were hit are cut with one another; the cut lies within two and a half
    footprints of both pixels, and they meet at 20 degrees at least.
    """
    assert scan.truth is not None
    points, face = scan.true_points(), scan.truth.face
    corners = scene.mesh.vertices[scene.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    footprint = scan.truth.ranges * scan.projection.pixel_angle
    slant = np.maximum(np.cos(np.nan_to_num(scan.truth.incidence, nan=1.5)), 0.05)
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        one, other = face[a].ravel(), face[b].ravel()
        surface = scene.mesh.face_surface
        both = (one >= 0) & (other >= 0)
        both[both] = _is_other(scene, surface[one[both]], surface[other[both]])
        both[both] = asked[surface[one[both]]] & asked[surface[other[both]]]
        n, m = normals[one[both]], normals[other[both]]
        cosine = (n * m).sum(axis=1)
        square = 1 - cosine**2
        meets = square > np.sin(np.radians(_LEAST_DEG)) ** 2
        n, m, cosine, square = n[meets], m[meets], cosine[meets], square[meets]
        p, q = (points[side].reshape(-1, 3)[both][meets] for side in (a, b))
        limit = [_FOOTPRINTS * (footprint / slant)[side].ravel()[both][meets] for side in (a, b)]
        middle = (p + q) / 2
        e, f = ((p - middle) * n).sum(axis=1), ((q - middle) * m).sum(axis=1)
        place = middle + ((e - f * cosine) / square)[:, None] * n + ((f - e * cosine) / square)[:, None] * m
        near = (np.linalg.norm(place - p, axis=1) < limit[0]) & (np.linalg.norm(place - q, axis=1) < limit[1])
        found.append((place[near], n[near], m[near]))
    at, first, second = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return at, first, second


def _is_other(scene: Scene, one: NDArray[np.int32], other: NDArray[np.int32]) -> BoolArray:
    """Whether two faces are of different surfaces, or of one that has no form."""
    formless = np.array([surface is None for surface in scene.surfaces], np.bool_)
    return np.asarray((one != other) | formless[one], dtype=np.bool_)


def _surface_places(scene: Scene, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 3) about evenly on the faces of a scene in a box, and the normals (n, 3) there."""
    corners = scene.mesh.vertices[scene.mesh.faces]
    reaches = (corners.max(axis=1) >= low).all(axis=1) & (corners.min(axis=1) <= high).all(axis=1)
    corners = corners[reaches]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(a, b)
    area = np.linalg.norm(cross, axis=1) / 2
    rng = np.random.default_rng(0)
    count = rng.poisson(area / _SPACING_M**2) + 1
    owner = np.repeat(np.arange(len(area)), count)
    s, t = rng.random((2, len(owner)))
    turned = s + t > 1
    s[turned], t[turned] = 1 - s[turned], 1 - t[turned]
    places = corners[owner, 0] + s[:, None] * a[owner] + t[:, None] * b[owner]
    within = ((places >= low) & (places <= high)).all(axis=1)
    return places[within], (cross / np.maximum(2 * area, 1e-18)[:, None])[owner][within]
