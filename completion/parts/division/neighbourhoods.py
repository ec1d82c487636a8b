# SPDX-License-Identifier: MIT
"""Neighbourhoods: noise, sampling distance and normals of points without any order.

Every point's neighbours are fitted by a paraboloid over their plane, at several sizes of the neighbourhood.
The noise is what the smoothest small neighbourhoods leave, edges and fillets do not count. A point's normal
is that of the largest neighbourhood that a paraboloid still explains at this noise, so that noisy points get
large ones and points near edges small ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree
from scipy.special import chdtri

from completion.parts.division.limits import CHANCE, RESOLUTION
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled, inlined

N_TERMS = 6  # 1, x, y, x^2, xy, y^2
_RIDGE = 1e-12  # of the number of neighbours: places that determine no paraboloid


@dataclass(frozen=True, slots=True, eq=False)
class Paraboloids:
    """One a point: normal (n, 3), rms residual (n,), and deviation (n,) of the normal per metre."""

    normals: FloatArray
    rms: FloatArray
    slope_factor: FloatArray


def paraboloids(points: FloatArray, nearest: IntArray) -> Paraboloids:
    """Fit paraboloids over the neighbours (n, k) of points (n, 3), each over the plane of its neighbours."""
    nearest, k = np.ascontiguousarray(nearest), nearest.shape[1]
    spread, scale = _spreads(points, nearest)
    _, axes = np.linalg.eigh(spread)  # columns: normal, second, first axis
    gram, right = _normal_equations(points, nearest, axes, scale)
    inverse = np.linalg.inv(gram + _RIDGE * k * np.eye(N_TERMS))
    solution = np.einsum("nij,nj->ni", inverse, right)
    rms = _residuals(points, nearest, axes, scale, solution)
    up = np.stack([np.ones(len(points)), -solution[:, 2], -solution[:, 1]], axis=-1)
    world = np.einsum("nij,nj->ni", axes, up)
    normals = world / np.linalg.norm(world, axis=1, keepdims=True)
    return Paraboloids(normals, rms, np.sqrt((inverse[:, 1, 1] + inverse[:, 2, 2]) / 2) / scale)


@compiled
def _spreads(points: FloatArray, nearest: IntArray) -> tuple[FloatArray, FloatArray]:
    """Scatter (n, 3, 3) of the neighbours about their mean, and their rms distance (n,) from the point."""
    n, k = nearest.shape
    spread, scale = np.empty((n, 3, 3)), np.empty(n)
    offset, mean = np.empty((k, 3)), np.empty(3)
    for i in range(n):
        mean[:] = 0.0
        square = 0.0
        for j in range(k):
            for a in range(3):
                away = points[nearest[i, j], a] - points[i, a]
                offset[j, a] = away
                mean[a] += away
                square += away * away
        mean /= k
        spread[i] = 0.0
        for j in range(k):
            for a in range(3):
                for b in range(a + 1):
                    spread[i, a, b] += (offset[j, a] - mean[a]) * (offset[j, b] - mean[b])
        for a in range(3):
            for b in range(a):
                spread[i, b, a] = spread[i, a, b]
        scale[i] = np.sqrt(square / k) if square > 0 else 1.0
    return spread, scale


@compiled
def _normal_equations(
    points: FloatArray, nearest: IntArray, axes: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Normal equations (n, 6, 6), (n, 6) of the paraboloids, in units of their scale."""
    n, k = nearest.shape
    gram, right = np.zeros((n, N_TERMS, N_TERMS)), np.zeros((n, N_TERMS))
    terms = np.empty(N_TERMS)
    for i in range(n):
        for j in range(k):
            z = _terms(points, nearest[i, j], i, axes, scale, terms)
            for a in range(N_TERMS):
                right[i, a] += terms[a] * z
                for b in range(a + 1):
                    gram[i, a, b] += terms[a] * terms[b]
        for a in range(N_TERMS):
            for b in range(a):
                gram[i, b, a] = gram[i, a, b]
    return gram, right


@compiled
def _residuals(
    points: FloatArray, nearest: IntArray, axes: FloatArray, scale: FloatArray, solution: FloatArray
) -> FloatArray:
    """Rms residual (n,) of the paraboloids, metres."""
    n, k = nearest.shape
    rms, terms = np.empty(n), np.empty(N_TERMS)
    for i in range(n):
        square = 0.0
        for j in range(k):
            residual = _terms(points, nearest[i, j], i, axes, scale, terms)
            for a in range(N_TERMS):
                residual -= terms[a] * solution[i, a]
            square += residual * residual
        rms[i] = scale[i] * np.sqrt(square / max(k - N_TERMS, 1))
    return rms


@inlined
def _terms(
    points: FloatArray, second: int, first: int, axes: FloatArray, scale: FloatArray, terms: FloatArray
) -> float:
    """Write the terms (6,) of a neighbour about a point; its height is returned."""
    x = y = z = 0.0
    for a in range(3):
        away = (points[second, a] - points[first, a]) / scale[first]
        z += away * axes[first, a, 0]
        y += away * axes[first, a, 1]
        x += away * axes[first, a, 2]
    terms[0], terms[1], terms[2] = 1.0, x, y
    terms[3], terms[4], terms[5] = x * x, x * y, y * y
    return z


N_LINKS = 10  # nearest neighbours that count as beside a point
SIZES = (12, 18, 27, 40, 60, 90, 135)  # neighbours of the paraboloids
_NOISE_SIZE = 18
_LEAST, _N_TURNS = 0.05, 20


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhoods:
    """Points with what lies about them.

    Attributes
    ----------
    points : (n, 3) float
        Metres.
    normals : (n, 3) float
        Unit vectors without a side.
    normal_sd : (n,) float
        Standard deviation of each normal, radians.
    is_smooth : (n,) bool
        Whether a paraboloid explains the smallest neighbourhood: not at an edge.
    reach : (n,) int
        How many neighbours the normal is from.
    links : (n, n) sparse
        Which points are beside one another; symmetric, ones.
    spacing_m : float
        Sampling distance: the median distance to the nearest neighbour.
    noise_m : float
        Standard deviation of the points along the normal, as estimated.
    tolerance_m : float
        The noise, or a hundredth of the sampling distance where that is more: what surfaces are held to.
    alike : float
        How many times the variance of independent errors the mean of neighbours' errors has; infinite before
        surfaces tell it.
    """

    points: FloatArray
    normals: FloatArray
    normal_sd: FloatArray
    is_smooth: BoolArray
    reach: IntArray
    links: csr_array
    spacing_m: float
    noise_m: float
    tolerance_m: float
    alike: float = np.inf


def look_around(
    points: FloatArray, normals: FloatArray | None = None, noise_m: float | None = None
) -> Neighbourhoods:
    """Return the neighbourhoods of points (n, 3), at least eight; given normals (n, 3) and noise are kept."""
    sizes = [size for size in SIZES if size <= len(points)] or [len(points)]
    distances, nearest = cKDTree(points).query(points, k=sizes[-1])
    nearest = nearest.astype(np.int64)
    spacing = _point_spacing(distances)
    shapes = [paraboloids(points, nearest[:, :size]) for size in sizes]
    plain = sizes.index(_NOISE_SIZE) if _NOISE_SIZE in sizes else 0
    noise = _noise(shapes[plain].rms, max(sizes[plain] - N_TERMS, 1)) if noise_m is None else noise_m
    tolerance = max(noise, RESOLUTION * spacing)
    n = len(points)
    chosen, smooth = np.zeros(n, dtype=np.int64), np.ones(n, dtype=np.bool_)
    explained = np.ones(n, dtype=np.bool_)
    for place, (size, shape) in enumerate(zip(sizes, shapes, strict=True)):
        freedom = max(size - N_TERMS, 1)
        explained &= shape.rms**2 * freedom <= tolerance**2 * float(chdtri(freedom, CHANCE))
        chosen[explained] = place
        if place == 0:
            smooth = explained.copy()
    values = np.stack([shape.normals for shape in shapes])[chosen, np.arange(n)]
    slopes = np.stack([shape.slope_factor for shape in shapes])[chosen, np.arange(n)]
    rms = np.stack([shape.rms for shape in shapes])[chosen, np.arange(n)]
    deviation = np.minimum(slopes * np.maximum(rms, tolerance), 0.5)
    return Neighbourhoods(
        points=points,
        normals=values if normals is None else normals,
        normal_sd=deviation,
        is_smooth=smooth,
        reach=np.asarray(sizes)[chosen],
        links=_links(nearest[:, : N_LINKS + 1], distances[:, : N_LINKS + 1]),
        spacing_m=spacing,
        noise_m=noise,
        tolerance_m=tolerance,
    )


def _point_spacing(distances: FloatArray) -> float:
    apart = distances[:, 1] if distances.shape[1] > 1 else distances[:, 0]
    return float(np.median(apart[apart > 0])) if (apart > 0).any() else 0.0


def _noise(rms: FloatArray, freedom: int) -> float:
    """The noise that the least residuals (n,) of neighbourhoods with so many degrees of freedom are of.

    Edges and fillets only make residuals larger. Of the smooth ones, a share p of all, r^2 / s^2 is chi
    squared; the twentieth part of all is their quantile .05 / p. s and p are found in turn.
    """
    least, noise, share = float(np.quantile(rms, _LEAST)), 0.0, 1.0
    for _ in range(_N_TURNS):
        quantile = float(chdtri(freedom, 1 - min(_LEAST / share, 0.5))) / freedom
        noise = least / np.sqrt(quantile)
        middle = float(chdtri(freedom, 0.5)) / freedom
        share = max(2 * float(np.mean(rms <= noise * np.sqrt(middle))), 2 * _LEAST)
        share = min(share, 1.0)
    return noise


def _links(nearest: IntArray, distances: FloatArray) -> csr_array:
    """The symmetric graph of neighbours; what is farther than thrice the usual is beside nothing."""
    n, k = nearest.shape
    rows = np.repeat(np.arange(n), k)
    columns, length = nearest.ravel(), distances.ravel()
    kept = (rows != columns) & (length <= 3 * np.median(distances[:, -1]))
    ones = np.ones(int(kept.sum()))
    graph = csr_array((ones, (rows[kept], columns[kept])), shape=(n, n))
    both = csr_array(graph + graph.T)
    both.data[:] = 1.0
    both.sort_indices()
    return both
