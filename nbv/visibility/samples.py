# SPDX-License-Identifier: MIT
"""Surface samples: points that stand for equal shares of a mesh's area."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError, frozen_copy
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.morton import morton_order

_GOLDEN = 1.32471795724474602596  # plastic number: x^3 = x + 1, base of the R2 sequence (Roberts 2018)
_R2 = np.array([1 / _GOLDEN, 1 / _GOLDEN**2])
_INWARD = 0.02  # of a face with one sample; n samples are drawn to the centroid by 1 / sqrt(n) of this share
_WISHED_SAMPLES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
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
    extent_m : float
        Longest side of their bounding box, metres.
    """

    points: FloatArray
    normals: FloatArray
    areas: FloatArray
    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    tolerance_m: float = 0.0
    extent_m: float = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.points)
        for name in ("points", "normals", "areas"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.float64))
        for name in ("face", "surface"):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int32))
        lengths = {len(self.normals), len(self.areas), len(self.face), len(self.surface)}
        if lengths != {n} or self.points.shape != (n, 3) or self.normals.shape != (n, 3):
            raise InputError(f"{n} samples, but normals, areas, faces and surfaces number {sorted(lengths)}")
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
    return min(float(np.sqrt(mesh.face_areas().sum() / _WISHED_SAMPLES)), extent / 20)


def sample_surface(
    mesh: LabelledMesh, spacing_m: float | None = None, *, every_face: bool = True
) -> SurfaceSamples:
    """Sample a mesh so that every sample stands for about `spacing_m` squared.

    Within a face the points follow a low-discrepancy sequence, strictly inside: rays aimed at edges leak.
    Samples are sorted along a Morton curve: rays to neighbours in the list go nearly the same way, which is
    faster.

    Parameters
    ----------
    mesh : LabelledMesh
        Faces without area get no sample.
    spacing_m : float, optional
        Metres between samples; `default_spacing` when not given.
    every_face : bool
        Whether faces smaller than `spacing_m` squared get a sample each (with their true, smaller area).
        Otherwise they are sampled systematically, about one sample a `spacing_m` squared in all.

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
    counts, share = _samples_a_face(areas, spacing, every_face)
    face = np.repeat(np.arange(len(areas), dtype=np.int32), counts)
    nth = np.arange(len(face)) - np.repeat(np.cumsum(counts) - counts, counts)
    points = np.einsum("nc,nck->nk", _inside_weights(nth, counts[face]), mesh.corners[face])
    order = morton_order(points)
    face, points = face[order], points[order]
    normals, surface = mesh.face_normals()[face], mesh.face_surface[face]
    return SurfaceSamples(points, normals, share[face], face, surface)


def _samples_a_face(
    areas: FloatArray, spacing: float, every_face: bool
) -> tuple[NDArray[np.int64], FloatArray]:
    """Return how many samples each face gets, and the area that each of them stands for."""
    wanted = areas / spacing**2
    if every_face:
        counts = np.ceil(wanted - 1e-6).astype(np.int64)  # a moved world must not change a count by rounding
        counts = np.maximum(counts, (areas > 0).astype(np.int64))
        return counts, np.divide(areas, counts, out=np.zeros_like(areas), where=counts > 0)
    reached = np.floor(np.cumsum(wanted) + 0.5 + 1e-6).astype(np.int64)
    counts = np.diff(reached, prepend=0)
    if not counts.any():
        counts[int(np.argmax(areas))] = 1
    return counts, np.full(len(areas), areas.sum() / counts.sum())


def _inside_weights(nth: NDArray[np.int64], count: NDArray[np.int64]) -> FloatArray:
    """Corner weights (n, 3) of the nth of `count` samples of a face; one alone is the centroid."""
    uv = (0.5 + np.multiply.outer(nth + 1, _R2)) % 1.0
    beyond = uv.sum(axis=1) > 1
    uv[beyond] = 1 - uv[beyond]
    weights = np.column_stack([1 - uv.sum(axis=1), uv])
    inward = np.where(count == 1, 1.0, _INWARD / np.sqrt(count))[:, None]
    inside: FloatArray = weights + inward * (1 / 3 - weights)
    return inside
