# SPDX-License-Identifier: MIT
"""Surface samples: points that stand for equal shares of a mesh's area."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nbv.visibility.strata import cut_strata, pair_up
from scenes.checks import BoolArray, FloatArray, InputError, frozen_copy
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import LabelledMesh

WISHED_SAMPLES = 20_000


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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
    pair : (n,) int32, optional
        Samples of one number stand for neighbouring pieces of surface, from which the error of a share is
        told (`nbv.coverage.share_error`); those that follow one another when not given.
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

    Every sample is drawn in a piece of the surface of its own (`nbv.visibility.strata`), strictly inside its
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
