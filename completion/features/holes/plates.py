# SPDX-License-Identifier: MIT
"""Plates: the flat parts of what was measured, each with a chart of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from completion.features.engine.template import Measured
from completion.fitting.robust import tukey_weights
from completion.fitting.starts import oriented
from scenes.checks import BoolArray, FloatArray

_MOST = 8  # plates of one input
_LEAST_POINTS, _LEAST_SHARE = 150, 0.02  # of a plate
_N_SAMPLE, _N_DRAWN = 4_000, 300  # points that vote for planes, planes tried
_SLAB = 4.0  # noises on either side of a plate
_EXACT = 1e-5  # of the diagonal: noise of points without any
_ROUGH = 0.03  # of the spacing: noise that makes no difference
_ALIGNED = np.cos(np.radians(25.0))
_N_ROUNDS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A plane with a chart, and all points in it.

    Attributes
    ----------
    origin : (3,) float
        Of the chart.
    frame : (3, 3) float
        Rows: the chart's two axes and the normal.
    uv : (n, 2) float
        Places of all points of the input in the chart.
    height : (n,) float
        Above the plane.
    is_on : (n,) bool
        Points of the plate.
    noise : float
        Standard deviation of them across it.
    """

    origin: FloatArray
    frame: FloatArray
    uv: FloatArray
    height: FloatArray
    is_on: BoolArray
    noise: float

    @property
    def slab(self) -> float:
        """Return the height within which a point is the plate's."""
        return _SLAB * self.noise

    def space(self, uv: FloatArray) -> FloatArray:
        """Return places (n, 2) of the chart in space (n, 3)."""
        return np.asarray(self.origin + uv @ self.frame[:2])

    def chart(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the places (n, 2) of points (n, 3) in the chart, and their heights (n,)."""
        local = (points - self.origin) @ self.frame.T
        return local[:, :2], local[:, 2]


def plates(measured: Measured, *, rng: np.random.Generator) -> Iterator[Plate]:
    """Yield planes with many points, the largest first.

    Consensus of oriented points (normals by local principal components), then Tukey's weights; the points of
    each are taken out before the next is sought.
    """
    points = measured.points
    if len(points) < _LEAST_POINTS:
        return
    noise = max(measured.noise, _EXACT * measured.diagonal, _ROUGH * measured.spacing)
    voters = rng.permutation(len(points))[:_N_SAMPLE]
    normals, _ = oriented(points[voters], points)
    least = max(_LEAST_POINTS, _LEAST_SHARE * len(points))
    free: BoolArray = np.ones(len(points), dtype=np.bool_)
    for _ in range(_MOST):
        left = free[voters]
        found = _consensus(points[voters[left]], normals[left], _SLAB * noise, rng=rng)
        if found is None:
            return
        plate = _refined(points, free, *found, noise)
        if plate is None or (plate.is_on & free).sum() < least:
            return
        free &= ~plate.is_on
        yield plate


def _consensus(
    points: FloatArray, normals: FloatArray, slab: float, *, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """A point and the normal of the plane that most of the oriented points (n, 3) agree with."""
    if len(points) < 3:
        return None
    drawn = rng.integers(len(points), size=_N_DRAWN)
    heights = points @ normals[drawn].T - np.einsum("ij,ij->i", points[drawn], normals[drawn])
    agrees = (np.abs(heights) < slab) & (np.abs(normals @ normals[drawn].T) > _ALIGNED)
    best = drawn[int(agrees.sum(axis=0).argmax())]
    return points[best], normals[best]


def _refined(
    points: FloatArray, free: BoolArray, place: FloatArray, normal: FloatArray, noise: float
) -> Plate | None:
    """The plate about a plane: Tukey's weights, its scale annealed to the noise."""
    near = points[free]
    for cut in np.geomspace(4.0, 1.0, _N_ROUNDS):
        weights = tukey_weights((near - place) @ normal, cut * 1.2 * _SLAB * noise)
        if np.count_nonzero(weights) < _LEAST_POINTS:
            return None
        place = weights @ near / weights.sum()
        offset = near - place
        normal = np.linalg.eigh((weights * offset.T) @ offset)[1][:, 0]
    frame = _frame((np.abs((near - place) @ normal) < _SLAB * noise), near - place, normal)
    local = (points - place) @ frame.T
    is_on = np.abs(local[:, 2]) < _SLAB * noise
    return Plate(origin=place, frame=frame, uv=local[:, :2], height=local[:, 2], is_on=is_on, noise=noise)


def _frame(is_on: BoolArray, offset: FloatArray, normal: FloatArray) -> FloatArray:
    """Rows: the longest direction of the plate's points, the one across, and the normal."""
    flat = offset[is_on]
    along = np.linalg.eigh(flat.T @ flat)[1][:, 2]
    along = along - (along @ normal) * normal
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])


def density(uv: FloatArray) -> float:
    """Points an area where places (n, 2) lie: the median of what eight neighbours tell."""
    tree = cKDTree(uv)
    sample = uv[:: max(1, len(uv) // 2_000)]
    far = tree.query(sample, k=min(9, len(uv)))[0][:, -1]
    return float((min(9, len(uv)) - 1.5) / (np.pi * np.median(far) ** 2))


_N_POINTS = 20_000


def scattered(measured: Measured, *, rng: np.random.Generator) -> Measured:
    """Return points all over the triangles, as many an area everywhere, instead of the mesh's corners."""
    faces = measured.faces
    if faces is None or not len(faces):
        return measured
    corners = measured.points[faces]
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    if not area.sum() > 0:
        return measured
    # even steps along the sum of areas, so that no triangle has more than its share
    steps = (np.arange(_N_POINTS) + rng.random(_N_POINTS)) / _N_POINTS * area.sum()
    face = np.minimum(np.searchsorted(area.cumsum(), steps), len(area) - 1)
    r, s = np.sqrt(rng.random(_N_POINTS)), rng.random(_N_POINTS)
    weights = np.column_stack([1 - r, r * (1 - s), r * s])
    points = np.einsum("ni,nij->nj", weights, corners[face])
    return replace(measured, points=points, spacing=0.5 * float(np.sqrt(area.sum() / _N_POINTS)), faces=None)


def rim_corners(measured: Measured, plate: Plate) -> FloatArray | None:
    """Return the places (k, 2) in the plate's chart of corners where its triangles end; None without any."""
    if measured.faces is None:
        return None
    uv, height = plate.chart(measured.points)
    faces = measured.faces[(np.abs(height) < plate.slab)[measured.faces].all(axis=1)]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    once, counts = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(uv[np.unique(once[counts == 1])])
