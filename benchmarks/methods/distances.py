# SPDX-License-Identifier: MIT
"""Peers of a check: distances between clouds and a design (C2M, M3C2), judged by element at a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from scenes.checks import BoolArray, FloatArray
from scenes.mesh.design import ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_NEAR_M, _LEAST_POINTS = 0.1, 10  # of points that belong to an element
_PIECE_M, _NEAREST = 0.3, 8  # triangles are cut so small; these pieces are tried
_ROUNDS, _FITTED = 6, 8_000  # of least squares, and points of each
_MOST_POINTS = 300_000
_STEP_M, _RADIUS_M, _HALF_M, _REGISTRATION_M = 0.2, 0.05, 0.15, 0.002  # of M3C2


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """Of points (n,): the design's nearest triangle, and the signed distance along its normal, metres."""

    face: NDArray[np.int64]
    distance: FloatArray
    foot: FloatArray


class DesignTree:
    """Triangles of a design, cut into small pieces, for the nearest of them."""

    def __init__(self, mesh: LabelledMesh) -> None:
        vertices, faces, self._of = trimesh.remesh.subdivide_to_size(
            mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), _PIECE_M, 20, True
        )
        self._pieces, self._normals = vertices[faces], mesh.face_normals()
        self._tree = cKDTree(self._pieces.mean(axis=1))

    def nearest(self, points: FloatArray) -> Nearest:
        """Return the nearest triangles of points (n, 3)."""
        best, piece, foot = np.full(len(points), np.inf), np.zeros(len(points), np.int64), points.copy()
        tried = self._tree.query(points, k=_NEAREST)[1]
        for column in tried.T:
            there = trimesh.triangles.closest_point(self._pieces[column], points)
            away = np.linalg.norm(points - there, axis=1)
            better = away < best
            best[better], piece[better], foot[better] = away[better], column[better], there[better]
        face = self._of[piece]
        side = np.sign(np.einsum("ij,ij->i", points - foot, self._normals[face]))
        return Nearest(face, best * np.where(side == 0, 1.0, side), foot)


def aligned_points(scans: Sequence[RangeImage], design: ElementMesh, tree: DesignTree) -> FloatArray:
    """Return points (n, 3) of scans, moved together by least squares of distances to the design's planes."""
    points = np.concatenate([scan.points()[scan.valid] for scan in scans])
    normals, some = design.mesh.face_normals(), slice(None, None, max(len(points) // _FITTED, 1))
    for _ in range(_ROUNDS):
        moved = points[some]
        near = tree.nearest(moved)
        normal = normals[near.face]
        gap = np.einsum("ij,ij->i", moved - near.foot, normal)
        used = np.abs(near.distance) < _NEAR_M
        middle = moved[used].mean(axis=0)
        lever = np.hstack([normal, np.cross(moved - middle, normal)])[used]
        shift = np.linalg.lstsq(lever, -gap[used], rcond=None)[0]
        points = (points - middle) @ Rotation.from_rotvec(shift[3:]).as_matrix().T + middle + shift[:3]
    return points


def judged(deviation: FloatArray, tolerance_m: float) -> list[str]:
    """Return "within", "deviates" or, where the deviation (n,) is NaN, "no data"."""
    return ["no data" if d != d else "deviates" if abs(d) > tolerance_m else "within" for d in deviation]


def cloud_to_mesh(points: FloatArray, design: ElementMesh, tree: DesignTree) -> FloatArray:
    """Return the median distance (n,) of the points nearest to each element within 0.1 m; NaN below 10."""
    near = tree.nearest(points[:: max(len(points) // _MOST_POINTS, 1)])
    close = np.abs(near.distance) <= _NEAR_M
    return _medians(
        design.mesh.face_surface[near.face[close]], near.distance[close], len(design.elements), _LEAST_POINTS
    )


def multiscale(points: FloatArray, design: ElementMesh, origins: FloatArray) -> FloatArray:
    """Return the median distance (n,) of each element by M3C2, NaN without data.

    Lague, Brodu and Leroux 2013, section 3: the mean along the normal of the points in a cylinder about each
    core point; what is not significant, within 1.96 (sd / sqrt n + registration error), counts as 0. Core
    points lie about every 0.2 m where the design, which is exact, faces one of the `origins`
    (s, 3) with nothing between.
    """
    mesh = design.mesh
    count = int(mesh.face_areas().sum() / _STEP_M**2)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    cores, face = trimesh.sample.sample_surface(solid, count, seed=0)
    faced = _faced(mesh, np.asarray(cores), mesh.face_normals()[face], origins)
    cores, face = np.asarray(cores)[faced], face[faced]
    normals = mesh.face_normals()[face]
    tree = cKDTree(points)
    around = tree.query_ball_point(cores, np.hypot(_RADIUS_M, _HALF_M), return_sorted=True)
    core = np.repeat(np.arange(len(cores)), [len(one) for one in around])
    away = points[np.concatenate([np.asarray(one, np.int64) for one in around])] - cores[core]
    along = np.einsum("ij,ij->i", away, normals[core])
    across = np.linalg.norm(away - along[:, None] * normals[core], axis=1)
    held = (np.abs(along) <= _HALF_M) & (across <= _RADIUS_M)
    n = np.bincount(core[held], minlength=len(cores))
    mean = np.bincount(core[held], along[held], len(cores)) / np.maximum(n, 1)
    spread = np.bincount(core[held], (along[held] - mean[core[held]]) ** 2, len(cores))
    least = 1.96 * (np.sqrt(spread / np.maximum(n - 1, 1) / np.maximum(n, 1)) + _REGISTRATION_M)
    told = np.where(np.abs(mean) > least, mean, 0.0)
    return _medians(mesh.face_surface[face[n >= 4]], told[n >= 4], len(design.elements), 1)


def _faced(mesh: LabelledMesh, cores: FloatArray, normals: FloatArray, origins: FloatArray) -> BoolArray:
    """Tell which places (n, 3) of a mesh face one of the origins (s, 3) with nothing between."""
    caster, before = RayCaster(mesh.vertices, mesh.faces), cores + 1e-3 * normals
    found = np.zeros(len(cores), np.bool_)
    for origin in origins:
        front = np.flatnonzero(~found & (np.einsum("ij,ij->i", origin - cores, normals) > 0))
        found[front] = ~caster.are_blocked(before[front], np.tile(origin, (len(front), 1)))
    return found


def _medians(element: NDArray[np.int32], values: FloatArray, n: int, least: int) -> FloatArray:
    found = np.full(n, np.nan)
    order = np.argsort(element, kind="stable")
    starts = np.searchsorted(element[order], np.arange(n + 1))
    for k in range(n):
        if starts[k + 1] - starts[k] >= least:
            found[k] = np.median(values[order[starts[k] : starts[k + 1]]])
    return found
