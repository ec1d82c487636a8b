# SPDX-License-Identifier: MIT
"""Samples: places of inferred area, evenly spread, each with its share of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.truth import SAME_WAY
from scenes.checks import FloatArray

_MOST_PIECES = 64  # along an edge of a triangle that is cut up


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Places of inferred area.

    Attributes
    ----------
    points, normals : (n, 3) float
        Metres; unit normals.
    areas : (n,) float
        Square metres that each stands for; what lies in several layers is divided among them.
    surface : (n,) int32
        Number of the inferred surface.
    sd, confidence : (n,) float
        As predicted.
    reason : (n,) int32
        Why it is inferred, as in the hypothesis.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    surface: NDArray[np.int32]
    sd: FloatArray
    confidence: FloatArray
    reason: NDArray[np.int32]


def sample(hypothesis: Hypothesis, cell_m: float) -> Samples:
    """Sample inferred area, about once in every `cell_m` x `cell_m`, always at the same places.

    Faces are cut into pieces that fit a cell; of the pieces of one surface in one voxel of that size the
    means are taken. Where several surfaces lie within a cell of each other, and parallel, their area is
    divided among them, so that overlapping layers count once.
    """
    corners = hypothesis.vertices[hypothesis.faces]
    pieces, face = _cut_up(corners, cell_m)
    spans = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    areas = np.linalg.norm(spans, axis=1) / 2
    kept = areas > 0
    pieces, face, areas, spans = pieces[kept], face[kept], areas[kept], spans[kept]
    centres = pieces.mean(axis=1)
    voxels = np.column_stack([hypothesis.surface[face], np.floor(centres / cell_m).astype(np.int64)])
    first, voxel = _same_rows(voxels)
    total = np.bincount(voxel, areas)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(voxel, values * areas) / total, dtype=np.float64)

    summed = np.stack([np.bincount(voxel, spans[:, i].copy()) for i in range(3)], axis=1).astype(np.float64)
    normals = summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-300)
    points = np.stack([mean(centres[:, i]) for i in range(3)], axis=1)
    surface = hypothesis.surface[face][first]
    layers = _layers(points, normals, surface, cell_m)
    confidence, sd = mean(hypothesis.confidence[face]), mean(hypothesis.sd[face])
    reason = hypothesis.face_reason[face][first]
    return Samples(
        points=points,
        normals=normals,
        areas=total / layers,
        surface=surface,
        sd=sd,
        confidence=confidence,
        reason=reason,
    )


def _same_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index of each different row of integers, and for each row the number of those like it."""
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    key = np.zeros(len(rows), np.int64)
    for column in rows.T:
        key = key * (int(np.ptp(column)) + 1) + (column - column.min())
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return first, number.reshape(-1)


def _cut_up(corners: FloatArray, cell_m: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut triangles (m, 3, 3) into similar ones with edges of at most a cell; and whose piece each is."""
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    n_pieces = np.clip(np.ceil(edges.max(axis=1, initial=0) / cell_m), 1, None).astype(np.int64)
    large = n_pieces > _MOST_PIECES
    if large.any():  # in two rounds, so that no lattice gets out of hand
        halves, of_half = _lattice(corners[large], _MOST_PIECES)
        pieces, of_piece = _cut_up(np.concatenate([corners[~large], halves]), cell_m)
        origin = np.concatenate([np.flatnonzero(~large), np.flatnonzero(large)[of_half]])
        return pieces, origin[of_piece]
    parts, owners = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for n in np.unique(n_pieces):
        chosen = np.flatnonzero(n_pieces == n)
        pieces, of_piece = _lattice(corners[chosen], int(n))
        parts.append(pieces)
        owners.append(chosen[of_piece])
    return np.concatenate(parts), np.concatenate(owners)


def _lattice(corners: FloatArray, n: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Cut each triangle into n^2 similar ones."""
    i, j = (index.ravel() for index in np.mgrid[:n, :n])
    up, down = i + j < n, i + j < n - 1
    weights = np.concatenate([
        np.stack([_weights(i[up] + a, j[up] + b, n) for a, b in ((0, 0), (1, 0), (0, 1))], axis=1),
        np.stack([_weights(i[down] + a, j[down] + b, n) for a, b in ((1, 1), (0, 1), (1, 0))], axis=1),
    ])  # fmt: skip
    pieces = np.einsum("pcw,mwx->mpcx", weights, corners).reshape(-1, 3, 3)
    return pieces, np.repeat(np.arange(len(corners)), n * n)


def _weights(i: NDArray[np.int64], j: NDArray[np.int64], n: int) -> FloatArray:
    return np.stack([n - i - j, i, j], axis=-1) / n


def _layers(points: FloatArray, normals: FloatArray, surface: NDArray[np.int32], cell_m: float) -> FloatArray:
    """How many surfaces lie parallel within a cell of each sample, its own counted."""
    layers = np.ones(len(points))
    members = [np.flatnonzero(surface == number) for number in np.unique(surface)]
    trees = [cKDTree(points[member]) for member in members]
    for one, mine in enumerate(members):
        for other, theirs in enumerate(members):
            if one == other or _cross(normals[mine], normals[theirs]):
                continue
            low, high = points[theirs].min(axis=0) - cell_m, points[theirs].max(axis=0) + cell_m
            asked = mine[((points[mine] >= low) & (points[mine] <= high)).all(axis=1)]
            near, index = trees[other].query(points[asked], distance_upper_bound=cell_m)
            met = np.flatnonzero(np.isfinite(near))
            cosine = np.einsum("ij,ij->i", normals[asked[met]], normals[theirs[index[met]]])
            layers[asked[met[np.abs(cosine) >= SAME_WAY]]] += 1
    return layers


def _cross(one: FloatArray, other: FloatArray) -> bool:
    """Tell whether both are flat and not parallel."""
    flat = all(bool((np.abs(normals @ normals[0]) > 1 - 1e-6).all()) for normals in (one, other))
    return flat and abs(float(one[0] @ other[0])) < SAME_WAY
