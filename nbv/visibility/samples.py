# SPDX-License-Identifier: MIT
"""Surface samples: points that stand for equal shares of a mesh's area.

Strata: a surface cut into pieces of nearly equal area, and one point drawn in each.
A face that is large enough is cut into triangles of equal area, always across its longest edge. Faces that
are too small for a point each are put in a row, neighbours beside one another, and the row is cut into pieces
of equal area. The point of a piece comes from a low-discrepancy sequence (R2; M. Roberts, "The unreasonable
effectiveness of quasirandom sequences", 2018) that is shifted by a hash of the face's own number, so that
congruent faces do not share their error (Cranley and Patterson, SIAM J. Numer. Anal. 13, 1976).

Pieces come in pairs of neighbours: how often the two points of a pair differ tells the error of a share.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, Value, frozen_copy
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import LabelledMesh
from texture.engine.compiled import compiled

_DEPTH = 128  # of cuts within one another; each leaves at most three quarters


@compiled
def cut_triangles(
    corners: FloatArray, counts: NDArray[np.int64], rounding: float, pieces: FloatArray, of: NDArray[np.int64]
) -> None:
    """Cut triangle k of `corners` (m, 3, 3) into `counts[k]` pieces of equal area, and write them in a row.

    `pieces` (n, 3, 3) and `of` (n,), the triangle each comes from, hold as many as are counted. Of two pieces
    that are cut from one triangle the first holds an even number of pieces, so that neighbours in the row are
    halves of one triangle. The first edge counts as the longest that is shorter by `rounding` of it at most.
    """
    waiting, numbers = np.empty((_DEPTH, 3, 3)), np.empty(_DEPTH, np.int64)
    lengths, done = np.empty(3), 0
    for k in range(len(counts)):
        if counts[k] < 1:
            continue
        numbers[0], top = counts[k], 0
        for corner in range(3):
            for axis in range(3):
                waiting[0, corner, axis] = corners[k, corner, axis]
        while top >= 0:
            n = numbers[top]
            if n == 1:
                for corner in range(3):
                    for axis in range(3):
                        pieces[done, corner, axis] = waiting[top, corner, axis]
                of[done] = k
                done, top = done + 1, top - 1
                continue
            for side in range(3):
                x = waiting[top, (side + 1) % 3, 0] - waiting[top, side, 0]
                y = waiting[top, (side + 1) % 3, 1] - waiting[top, side, 1]
                z = waiting[top, (side + 1) % 3, 2] - waiting[top, side, 2]
                lengths[side] = np.sqrt(x * x + y * y + z * z)
            longest, least = 0, (1 - rounding) * max(lengths[0], lengths[1], lengths[2])
            while lengths[longest] < least:
                longest += 1
            left = 2 * max(int(np.rint(n / 4)), 1) if n > 2 else 1
            numbers[top], numbers[top + 1] = n - left, left
            for axis in range(3):
                a, b = waiting[top, longest, axis], waiting[top, (longest + 1) % 3, axis]
                apex, middle = waiting[top, (longest + 2) % 3, axis], a + (b - a) * (left / n)
                waiting[top, 0, axis], waiting[top, 1, axis], waiting[top, 2, axis] = middle, b, apex
                here = top + 1
                waiting[here, 0, axis], waiting[here, 1, axis], waiting[here, 2, axis] = a, middle, apex
            top += 1


_GOLDEN = 1.32471795724474602596  # plastic number: x^3 = x + 1, base of the R2 sequence
_R2 = np.array([1 / _GOLDEN, 1 / _GOLDEN**2])
_INWARD = 0.02  # by which points are drawn towards the middle of their piece: rays aimed at edges leak
_ROUNDING = 1e-6  # a moved world must not change a count, or which edge is the longest, by rounding


@dataclass(frozen=True, slots=True, eq=False)
class Strata:
    """Pieces of a surface and their points.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres.
    areas : (n,) float
        Area of each piece, square metres.
    face : (n,) int32
        Face on which the point lies.
    pair : (n,) int32
        Pieces of one number are neighbours: two of them, or three.
    """

    points: FloatArray
    areas: FloatArray
    face: NDArray[np.int32]
    pair: NDArray[np.int32]


def cut_strata(mesh: LabelledMesh, areas: FloatArray, piece_m2: float) -> Strata:
    """Cut a mesh into pieces of about `piece_m2` square metres, and draw a point in each.

    Where faces are fewer than such pieces, each gets a point of its own, however small it is; otherwise those
    below `piece_m2` share points with their neighbours on the same surface. There are never more than three
    times as many points as the area asks for. `areas` (m,) are those of the faces, not all of them 0.
    """
    wanted = areas / piece_m2
    small = wanted < 1 - _ROUNDING
    if np.count_nonzero(areas) <= max(wanted.sum(), 1.0):
        small = areas <= 0
    counts = np.where(small, 0, np.ceil(wanted - _ROUNDING)).astype(np.int64)
    whole, of_whole = _cut_faces(mesh.corners, counts)
    shared, of_shared, shared_m2, n_shared = _cut_rows(mesh, np.where(small, areas, 0.0), piece_m2)
    face = np.concatenate([of_whole, of_shared])
    area = np.concatenate([areas[of_whole] / np.maximum(counts[of_whole], 1), shared_m2])
    points = np.concatenate([whole, shared])
    runs = np.concatenate([counts[counts > 0], n_shared])
    return Strata(points, area, face.astype(np.int32), _pairs(mesh, runs, face=face, points=points))


def _cut_faces(corners: FloatArray, counts: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Points (n, 3) in pieces of equal area of each face (m, 3, 3), and their faces (n,)."""
    pieces, face = np.empty((int(counts.sum()), 3, 3)), np.empty(int(counts.sum()), np.int64)
    cut_triangles(np.ascontiguousarray(corners, dtype=np.float64), counts, _ROUNDING, pieces, face)
    nth = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.einsum("nc,nck->nk", _weights(nth, face), pieces), face


def _cut_rows(
    mesh: LabelledMesh, areas: FloatArray, piece_m2: float
) -> tuple[FloatArray, NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Points (n, 3) that small faces share, their faces and areas (n,), and how many each row holds.

    `areas` (m,) are those of the small faces, 0 for others. A row is what is small of one surface; all of it
    where surfaces are as many as pieces.
    """
    small = np.flatnonzero(areas > 0)
    if not len(small):
        return np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)
    surface = mesh.face_surface[small]
    if len(np.unique(surface)) > areas.sum() / piece_m2:
        surface = np.zeros(len(small), np.int32)
    curve = np.empty(len(small), np.int64)
    curve[morton_order(mesh.corners[small].mean(axis=1))] = np.arange(len(small))
    order = np.lexsort((curve, _side(mesh.face_normals()[small]), surface))
    small, row = small[order], np.unique(surface[order], return_inverse=True)[1]
    row_m2 = np.bincount(row, areas[small])
    n_points = np.maximum(np.ceil(row_m2 / piece_m2 - _ROUNDING), 1).astype(np.int64)
    of = np.repeat(np.arange(len(n_points)), n_points)
    nth = np.arange(len(of)) - np.repeat(np.cumsum(n_points) - n_points, n_points)
    ends = np.cumsum(areas[small])
    starts = np.cumsum(row_m2) - row_m2
    along = starts[of] + row_m2[of] * (nth + _shift(np.arange(len(of)), 2)) / n_points[of]
    last = np.searchsorted(row, of, side="right") - 1
    chosen = np.minimum(np.searchsorted(ends, along, side="right"), last)
    face = small[np.maximum(chosen, np.searchsorted(row, of))]
    points = np.einsum("nc,nck->nk", _weights(nth, face), mesh.corners[face])
    return points, face, (row_m2 / n_points)[of], n_points


def _side(normals: FloatArray) -> NDArray[np.int64]:
    """Which of six ways a normal (n, 3) points."""
    axis = np.abs(normals).argmax(axis=1)
    way: NDArray[np.int64] = 2 * axis + (normals[np.arange(len(normals)), axis] > 0)
    return way


def _pairs(
    mesh: LabelledMesh, runs: NDArray[np.int64], *, face: NDArray[np.int64], points: FloatArray
) -> NDArray[np.int32]:
    """Number of the pair (n,) of each point; `runs` are how many follow one another on a face or row.

    Points that are alone on their face are paired along a space-filling curve, like normals together.
    """
    n_in = np.repeat(runs, runs)
    nth = np.arange(len(face)) - np.repeat(np.cumsum(runs) - runs, runs)
    first = np.repeat(np.cumsum(runs // 2) - runs // 2, runs)
    pair = first + np.minimum(nth // 2, np.maximum(n_in // 2 - 1, 0))
    alone = np.flatnonzero(n_in == 1)
    if len(alone):
        curve = np.empty(len(alone), np.int64)
        curve[morton_order(points[alone])] = np.arange(len(alone))
        order = np.lexsort((curve, _side(mesh.face_normals()[face[alone]]), mesh.face_surface[face[alone]]))
        pair[alone[order]] = int((runs // 2).sum()) + pair_up(len(alone))
    return pair.astype(np.int32)


def pair_up(n: int) -> NDArray[np.int32]:
    """Return the number of the pair (n,) of each of n things in a row; three at the end of an odd number."""
    return np.minimum(np.arange(n) // 2, max(n // 2 - 1, 0)).astype(np.int32)


def _weights(nth: NDArray[np.int64], face: NDArray[np.int64]) -> FloatArray:
    """Corner weights (n, 3) of the nth point of each face within its piece, off the piece's edges."""
    uv = np.column_stack([_shift(face, 0), _shift(face, 1)])
    uv = (uv + np.multiply.outer(nth + 1, _R2)) % 1.0
    beyond = uv.sum(axis=1) > 1
    uv[beyond] = 1 - uv[beyond]
    weights = np.column_stack([1 - uv.sum(axis=1), uv])
    inside: FloatArray = weights + _INWARD * (1 / 3 - weights)
    return inside


def _shift(number: NDArray[np.int64], stream: int) -> FloatArray:
    """Hash numbers (n,) to [0, 1) (splitmix64: Steele, Lea and Flood, OOPSLA 2014)."""
    with np.errstate(over="ignore"):
        z = (3 * number + stream + 1).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(11)).astype(np.float64) / 2.0**53


WISHED_SAMPLES = 20_000


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SurfaceSamples(Value):
    """Samples of a surface.

    Attributes
    ----------
    points, normals : (n, 3) float
        World coordinates in metres, unit normals of the faces.
    areas : (n,) float
        Area in square metres that each sample stands for.
    face, surface : (n,) int32
        Face and surface it lies on.
    tolerance_m : float
        A line of sight may end this far before the point, metres: for given patches that lie on rims.
    pair : (n,) int32, optional
        Samples of one number stand for neighbouring pieces of surface, from which the error of a share is
        told (`nbv.coverage.coverage`); those that follow one another when not given.
    extent_m : float
        Longest side of their bounding box, metres.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    tolerance_m: float = 0.0
    pair: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    extent_m: float = field(init=False)

    def __repr__(self) -> str:
        return f"SurfaceSamples({len(self)} samples of {self.total_m2:.4g} m2)"

    def __post_init__(self) -> None:
        n = len(self.points)
        for name in ("points", "normals", "areas"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.float64))
        if not len(self.pair):
            object.__setattr__(self, "pair", pair_up(n))
        for name in ("face", "surface", "pair"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int32))
        lengths = {len(self.normals), len(self.areas), len(self.face), len(self.surface), len(self.pair)}
        if lengths != {n} or self.points.shape != (n, 3) or self.normals.shape != (n, 3):
            raise InputError(
                f"{n} samples, but normals, areas, faces, surfaces and pairs number {sorted(lengths)}"
            )
        object.__setattr__(self, "extent_m", float(np.ptp(self.points, axis=0).max()) if n else 0.0)

    def some(self, chosen: BoolArray | slice) -> SurfaceSamples:
        """Return the chosen (n,) samples."""
        return replace(
            self,
            points=self.points[chosen],
            normals=self.normals[chosen],
            areas=self.areas[chosen],
            face=self.face[chosen],
            surface=self.surface[chosen],
            pair=self.pair[chosen],
        )

    def __len__(self) -> int:
        return len(self.points)

    @property
    def total_m2(self) -> float:
        """Area of all samples."""
        return float(self.areas.sum())


def default_spacing(mesh: LabelledMesh) -> float:
    """Return the spacing in metres that gives about 20,000 samples, never above 1/20 of the mesh's extent."""
    extent = float(np.ptp(mesh.bounds(), axis=0).max())
    return min(float(np.sqrt(mesh.face_areas().sum() / WISHED_SAMPLES)), extent / 20)


def sample_surface(mesh: LabelledMesh, spacing_m: float | None = None) -> SurfaceSamples:
    """Sample a mesh so that every sample stands for about `spacing_m` squared.

    Every sample is drawn in a piece of the surface of its own (`nbv.visibility.samples`), strictly inside its
    face: rays aimed at edges leak. There are at most three times as many samples as the area asks for,
    whatever the mesh: where faces are fewer than samples, each has one. Samples are sorted along a Morton
    curve: rays to neighbours in the list go nearly the same way, which is faster.

    Parameters
    ----------
    mesh : LabelledMesh
        Faces without area get no sample.
    spacing_m : float, optional
        Metres between samples; `default_spacing` when not given.

    Raises
    ------
    InputError
        No face with area, a spacing that is not positive.
    """
    areas = mesh.face_areas()
    if not areas.sum() > 0:
        raise InputError(f"the mesh has no surface: {len(areas)} faces, all without area")
    spacing = default_spacing(mesh) if spacing_m is None else spacing_m
    if not spacing > 0:
        raise InputError(f"spacing_m must be positive, got {spacing}")
    strata = cut_strata(mesh, areas, spacing**2)
    order = morton_order(strata.points)
    face = strata.face[order]
    return SurfaceSamples(
        strata.points[order], mesh.face_normals()[face], strata.areas[order], face, mesh.face_surface[face],
        pair=strata.pair[order],
    )  # fmt: skip
