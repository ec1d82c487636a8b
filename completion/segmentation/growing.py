# SPDX-License-Identifier: MIT
"""Growing: from seed tiles to all connected tiles that one plane or one cylinder explains."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.packed_surfaces import pack_plane, tangent_plane
from completion.observe.tiles import ImageTiles, solve_plane
from completion.segmentation.limits import MOST_MISFIT, SEED_CUT
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined

_N_ROUNDS = 12
CHI2_3 = 16.27  # 99.9 % quantile for three parameters


@dataclass(frozen=True, slots=True, eq=False)
class Cluster:
    """Connected tiles on one surface."""

    tiles: BoolArray  # (rows, columns) which
    model: FloatArray  # (9,) the surface as `pack` writes it, relative to the sensor
    n_pixels: int  # measured pixels in them


def tile_cut(options: SegmentationOptions) -> float:
    """How far a tile may deviate from a surface, root mean square, in standard deviations of a pixel."""
    return options.n_sigma / 3


def grow_plane(
    seed: tuple[int, int], free: BoolArray, tiles: ImageTiles, cut: float, max_angle: float
) -> Cluster | None:
    """Grow and refit in turn until the plane's tiles stand still.

    Parameters
    ----------
    seed : (int, int)
        Where to begin.
    free : (rows, columns) bool
        Tiles that may be taken.
    tiles : Tiles
        The image.
    cut : float
        How far a tile's own plane may deviate, root mean square, in standard deviations of a pixel.
    max_angle : float
        Largest angle between a tile's normal and the plane's, radians, beside its error.
    """
    window = (slice(max(seed[0] - 1, 0), seed[0] + 2), slice(max(seed[1] - 1, 0), seed[1] + 2))
    around, near = np.zeros_like(free), free[window]
    around[window] = near
    w = np.zeros(3)
    pooled = solve_plane(tiles.matrix[window][near].sum(axis=0), tiles.vector[window][near].sum(axis=0), w)
    if not pooled or not flood(pack_plane(w), seed, around, tiles, cut, max_angle=max_angle)[0][seed]:
        w = tiles.plane[seed].copy()  # the neighbours lie on other planes, or on a curved surface
    size = 0
    for _ in range(_N_ROUNDS):
        members, matrix, vector, now = flood(pack_plane(w), seed, free, tiles, cut, max_angle=max_angle)
        if now == 0 or not solve_plane(matrix, vector, w):
            return None
        if abs(now - size) <= 0.002 * now:
            break
        size = now
    return Cluster(members, pack_plane(w), int(tiles.count[members].sum()))


def flood(
    model: FloatArray,
    seed: tuple[int, int],
    free: BoolArray,
    tiles: ImageTiles,
    cut: float,
    *,
    max_angle: float,
) -> tuple[BoolArray, FloatArray, FloatArray, int]:
    """Return the free tiles (rows, columns) connected with `seed` that lie on the model; see `grow_plane`.

    With the sums of their moments, (6,) and (3,), and how many they are.
    """
    members = np.zeros(free.shape, np.bool_)
    matrix, vector = np.zeros(6), np.zeros(3)
    count = _flood(
        model, seed, free, tiles.count, tiles.matrix, tiles.vector, tiles.plane, tiles.misfit, tiles.centre,
        tiles.normal_sd, cut, max_angle, members, matrix, vector,
    )  # fmt: skip
    return members, matrix, vector, int(count)


def with_smooth_ring(members: BoolArray, free: BoolArray, tiles: ImageTiles, max_angle: float) -> BoolArray:
    """The members, and those of the free tiles (rows, columns) that go on from them with no crease or jump.

    The normals of neighbouring tiles differ by at most `max_angle`, radians, beside their error.
    """
    return np.asarray(_with_smooth_ring(members, free, tiles.plane, tiles.centre, tiles.normal_sd, max_angle))


@inlined
def _dot(a: FloatArray, b: FloatArray) -> float:
    """The inner product of two vectors of three; numpy's own would allocate in the innermost loop."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@inlined
def quadratic(a: FloatArray, x: float, y: float, z: float) -> float:
    """The quadratic form with packed symmetric matrix `a`, shape (6,), at x, y, z."""
    squares = a[0] * x * x + a[3] * y * y + a[5] * z * z
    return float(squares + 2.0 * (a[1] * x * y + a[2] * x * z + a[4] * y * z))


@compiled
def _flood(
    model: FloatArray,
    seed: tuple[int, int],
    free: BoolArray,
    count: FloatArray,
    matrix: FloatArray,
    vector: FloatArray,
    plane: FloatArray,
    misfit: FloatArray,
    centre: FloatArray,
    normal_sd: FloatArray,
    cut: float,
    max_angle: float,
    members: BoolArray,
    total_matrix: FloatArray,
    total_vector: FloatArray,
) -> int:
    """Grow `members` and its sums from the seed over tiles that agree with the model; return how many."""
    rows, columns = free.shape
    seen = np.zeros((rows, columns), np.bool_)
    stack = np.empty((rows * columns, 2), np.int64)
    w = np.zeros(3)
    top, n = 0, 0
    for i in range(max(seed[0] - 1, 0), min(seed[0] + 2, rows)):
        for j in range(max(seed[1] - 1, 0), min(seed[1] + 2, columns)):
            if free[i, j]:
                stack[top, 0], stack[top, 1] = i, j
                seen[i, j] = True
                top += 1
    while top > 0:
        top -= 1
        i, j = stack[top, 0], stack[top, 1]
        if not tangent_plane(model, centre[i, j], w):
            continue
        plane_number = plane[i, j]
        excess = quadratic(
            matrix[i, j], w[0] - plane_number[0], w[1] - plane_number[1], w[2] - plane_number[2]
        )
        worst = max(1.0, misfit[i, j])
        if excess > cut * cut * worst * count[i, j] + CHI2_3 * worst:
            continue
        cosine = min(1.0, _dot(w, plane_number) / np.sqrt(_dot(w, w) * _dot(plane_number, plane_number)))
        if np.arccos(cosine) > max_angle + 2.0 * normal_sd[i, j]:
            continue
        members[i, j] = True
        n += 1
        for t in range(6):
            total_matrix[t] += matrix[i, j, t]
        for t in range(3):
            total_vector[t] += vector[i, j, t]
        for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            k, m = i + di, j + dj
            if 0 <= k < rows and 0 <= m < columns and free[k, m] and not seen[k, m]:
                seen[k, m] = True
                stack[top, 0], stack[top, 1] = k, m
                top += 1
    return n


@compiled
def deviations(
    model: FloatArray, where: NDArray[np.int64], matrix: FloatArray, plane: FloatArray, centre: FloatArray
) -> FloatArray:
    """Weighted square deviation (n,) of the planes of tiles (n, 2) from the model; inf if it faces away."""
    result = np.full(len(where), np.inf)
    w = np.zeros(3)
    for index in range(len(where)):
        i, j = where[index]
        if tangent_plane(model, centre[i, j], w):
            members = plane[i, j]
            result[index] = quadratic(matrix[i, j], w[0] - members[0], w[1] - members[1], w[2] - members[2])
    return result


@compiled
def _with_smooth_ring(
    members: BoolArray,
    free: BoolArray,
    plane: FloatArray,
    centre: FloatArray,
    normal_sd: FloatArray,
    max_angle: float,
) -> BoolArray:
    """The members and those free neighbours that go on from them smoothly."""
    rows, columns = free.shape
    grown = members.copy()
    for i in range(rows):
        for j in range(columns):
            if not members[i, j]:
                continue
            w = plane[i, j]
            size = np.sqrt(_dot(w, w))
            for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                k, m = i + di, j + dj
                if not (0 <= k < rows and 0 <= m < columns) or grown[k, m] or not free[k, m]:
                    continue
                v = plane[k, m]
                cosine = _dot(w, v) / (size * np.sqrt(_dot(v, v)))
                allowed = max_angle + 2.0 * np.hypot(normal_sd[i, j], normal_sd[k, m])
                step = centre[k, m] - centre[i, j]
                gap = abs(_dot(w, centre[k, m]) - 1.0) / size
                if np.arccos(min(1.0, cosine)) <= allowed and gap <= np.sin(allowed) * np.sqrt(
                    _dot(step, step)
                ):
                    grown[k, m] = True
    return grown


_ACROSS, _ASLANT = 62_587, 89_738  # of a step, 1 / 65,536: Borgefors' best for steps to eight neighbours
_UNIT = 65_536


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Where growing may begin and go."""

    flat: BoolArray  # (rows, columns) tiles that no edge crosses
    coherent: BoolArray  # (rows, columns) those that lie on one plane with the tiles around


def find_seeds(tiles: ImageTiles) -> Seeds:
    """Tell which tiles lie inside one surface, alone and with their neighbours."""
    flat: BoolArray = tiles.misfit <= MOST_MISFIT * (1 + 3 * np.sqrt(2 / np.maximum(tiles.count - 3, 1)))
    return Seeds(flat, _coherent(flat, tiles.count, tiles.matrix, tiles.vector, tiles.plane, tiles.misfit))


def depths_within(area: BoolArray) -> NDArray[np.int64]:
    """Return how far from the outside each tile of an area (rows, columns) is at most, for `next_seed`.

    By steps to eight neighbours, after Borgefors (1986), Distance transformations in digital images.
    """
    depth = cv2.distanceTransform(np.pad(area, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    above = np.nextafter(depth, np.float32(np.inf)).astype(np.float64)  # it was rounded to single precision
    return np.where(area, np.ceil(_UNIT * above).astype(np.int64), 0)


def next_seed(candidates: BoolArray, depths: NDArray[np.int64]) -> tuple[int, int] | None:
    """Return row and column of the tile in the middle of the largest area of candidates (rows, columns).

    None when nothing is left. `depths` (rows, columns) are bounds from `depths_within` of an area that all
    candidates lie in. Candidates only ever leave: a bound is looked at again when it is the greatest, and
    lowered in place.
    """
    row, column = _deepest(candidates, depths)
    return (int(row), int(column)) if depths[row, column] > 0 else None


@compiled
def _deepest(candidates: BoolArray, depths: NDArray[np.int64]) -> tuple[int, int]:
    """The first of the tiles that are deepest within the candidates; the bounds are lowered on the way."""
    rows = depths.shape[0]
    where, most = np.zeros(rows, np.int64), np.zeros(rows, np.int64)
    for row in range(rows):
        for column in range(depths.shape[1]):
            if not candidates[row, column]:
                depths[row, column] = 0
        where[row] = np.argmax(depths[row])
        most[row] = depths[row, where[row]]
    while True:
        row = int(np.argmax(most))
        column, bound = where[row], most[row]
        if bound == 0:
            return row, column
        depth = _depth(candidates, row, column, bound)
        if depth == bound:
            return row, column
        depths[row, column] = depth
        where[row] = np.argmax(depths[row])
        most[row] = depths[row, where[row]]


@inlined
def _depth(candidates: BoolArray, row: int, column: int, bound: int) -> int:
    """How far a tile is from the nearest that is no candidate; no more than the bound."""
    rows, columns = candidates.shape
    nearest, ring = bound, 1
    while ring * _ACROSS < nearest:
        for i in range(row - ring, row + ring + 1):
            whole = abs(i - row) == ring
            for j in range(column - ring, column + ring + 1, 1 if whole else 2 * ring):
                if 0 <= i < rows and 0 <= j < columns and candidates[i, j]:
                    continue
                aslant = min(abs(i - row), abs(j - column))
                nearest = min(nearest, (ring - aslant) * _ACROSS + aslant * _ASLANT)
        ring += 1
    return nearest


@compiled
def _coherent(
    flat: BoolArray,
    count: FloatArray,
    matrix: FloatArray,
    vector: FloatArray,
    plane: FloatArray,
    misfit: FloatArray,
) -> BoolArray:
    """Which flat tiles agree with the plane of their flat neighbours."""
    rows, columns = flat.shape
    result = np.zeros((rows, columns), np.bool_)
    a, b, w = np.zeros(6), np.zeros(3), np.zeros(3)
    for i in range(rows):
        for j in range(columns):
            if not flat[i, j]:
                continue
            a[:], b[:] = 0.0, 0.0
            n, n_pixels = 0, 0.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        for t in range(6):
                            a[t] += matrix[k, m, t]
                        for t in range(3):
                            b[t] += vector[k, m, t]
                        n += 1
                        n_pixels += count[k, m]
            if n < 5 or not solve_plane(a, b, w):
                continue
            excess, worst = 0.0, 1.0
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if flat[k, m]:
                        members = plane[k, m]
                        excess += quadratic(
                            matrix[k, m], w[0] - members[0], w[1] - members[1], w[2] - members[2]
                        )
                        worst = max(worst, misfit[k, m])
            result[i, j] = excess <= (SEED_CUT * n_pixels + CHI2_3 * n) * worst
    return result
