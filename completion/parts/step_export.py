# SPDX-License-Identifier: MIT
"""A part as STEP: its surfaces where relations hold, and points on what was measured of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from completion.export.step.pipeline import StepModel, step_of
from completion.export.step.regions import FittedRegion, PartRegions, RegionMesh, part_regions
from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray, IntArray
from scenes.mesh.merging import merge_vertices
from scenes.surfaces.catalogue import Surface

_MOST_SAMPLES = 400_000
_DENSER = 1.2  # samples in a square of the sampling distance
_ROUNDED = 1e-7  # of the size: what single precision does to a vertex
_EXACT = 2e-6  # of the size, that a vertex is off its surface
_MOST_LAYERS = 3  # of triangles on no surface that are given to those beside them
_LEAST_SAMPLES = 30  # of a surface; where there are fewer, its triangles' middles are added
_MOST_ASKED = 500  # points of a region whose deviation is predicted


class DividedPart(Protocol):
    """What is read of a part (`Part`)."""

    @property
    def points(self) -> FloatArray:
        """Points, or vertices (n, 3), metres."""

    @property
    def surface(self) -> IntArray:
        """Labels (n,)."""

    @property
    def labels(self) -> tuple[int, ...]:
        """The label of each surface."""

    @property
    def fits(self) -> tuple[SurfaceFit, ...]:
        """The surfaces."""

    @property
    def groups(self) -> tuple[int, ...]:
        """Which of them are one."""

    @property
    def faces(self) -> IntArray | None:
        """Triangles (m, 3) of a mesh."""

    @property
    def triangle_surface(self) -> IntArray | None:
        """Labels (m,) of these."""

    @property
    def is_model(self) -> bool:
        """Whether the mesh is a tessellated model."""

    @property
    def noise_m(self) -> float:
        """Deviation of the points, metres."""

    @property
    def spacing_m(self) -> float:
        """Their sampling distance, metres."""


def step_model(part: DividedPart, name: str = "part") -> StepModel:
    """Return a part as STEP; see `step_of`.

    Raises InputError: OCP is not installed, the part has no surface, or none can be trimmed.
    """
    return step_of(regions_of(part), name)


def regions_of(part: DividedPart) -> PartRegions:
    """Return the regions of a part: its points, or points on its triangles.

    Raises InputError: a part without surfaces.
    """
    points, label = part.points, part.surface
    if part.faces is not None and part.triangle_surface is not None and part.spacing_m > 0:
        points, members = _on_triangles(part.points, part.faces, part.spacing_m)
        label = part.triangle_surface[members]
        few = np.bincount(label, minlength=max(part.labels, default=0) + 1) < _LEAST_SAMPLES
        small = np.flatnonzero(few[part.triangle_surface])
        more = part.points[part.faces[small]].mean(axis=1)
        points, label = np.concatenate([points, more]), np.append(label, part.triangle_surface[small])
    place = np.full(max((*part.labels, *label.tolist(), 0)) + 1, -1, dtype=np.int64)
    place[list(part.labels)] = np.arange(len(part.labels))
    region = place[np.maximum(label, 0)]
    regions = [
        FittedRegion(number, fit.surface, _deviation(fit, points[region == k]), group)
        for k, (number, fit, group) in enumerate(zip(part.labels, part.fits, part.groups, strict=True))
    ]
    mesh = None
    if part.is_model and part.faces is not None and part.triangle_surface is not None:
        mesh = _region_mesh(
            part.points, part.faces, place[part.triangle_surface], [fit.surface for fit in part.fits]
        )
    return part_regions(regions, points, region, spacing_m=part.spacing_m, noise_m=part.noise_m, mesh=mesh)


def _region_mesh(
    points: FloatArray, faces: IntArray, region: IntArray, surfaces: Sequence[Surface]
) -> RegionMesh:
    """A model's triangles with vertices that neighbours share.

    Triangles of no region, as those without area, are of one beside them if they lie on its surface.
    """
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    vertices, number = merge_vertices(points, _ROUNDED * size)
    corners = number[faces]
    kept = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    corners, region = corners[kept], region[kept]
    for _ in range(_MOST_LAYERS):
        lost = np.flatnonzero(region < 0)
        if not len(lost):
            break
        beside: dict[frozenset[int], int] = {
            frozenset(pair): int(region[k])
            for k in np.flatnonzero(region >= 0).tolist()
            for pair in combinations(corners[k].tolist(), 2)
        }
        for k in lost.tolist():
            near = {beside.get(frozenset(pair), -1) for pair in combinations(corners[k].tolist(), 2)} - {-1}
            off = {one: float(np.abs(surfaces[one].distance(vertices[corners[k]])).max()) for one in near}
            best = min(sorted(off), key=lambda one: off[one], default=-1)
            region[k] = best if best >= 0 and off[best] <= _EXACT * size else -1
    return RegionMesh(vertices, corners, region)


def _deviation(fit: SurfaceFit, points: FloatArray) -> float:
    """The usual standard deviation of a surface along its normal at points (n, 3), metres."""
    if not len(points):
        return 0.0
    sample = points[:: max(1, len(points) // _MOST_ASKED)]
    return float(np.median(fit.standard_deviation(sample)))


def _on_triangles(vertices: FloatArray, faces: IntArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Points (k, 3) spread evenly over triangles (m, 3), and the triangle (k,) of each."""
    corners: FloatArray = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.cumsum(np.linalg.norm(across, axis=1) / 2)
    n = int(np.clip(_DENSER * total[-1] / spacing**2, 1, _MOST_SAMPLES))
    triangle = np.minimum(np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1]), len(faces) - 1)
    index, step = np.arange(1, n + 1)[:, None], 1.324717957244746  # plastic number (Roberts 2018)
    a, b = (0.5 + index / step) % 1.0, (0.5 + index / step**2) % 1.0
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    sample = corners[triangle]
    return sample[:, 0] + a * (sample[:, 1] - sample[:, 0]) + b * (sample[:, 2] - sample[:, 0]), triangle


def outcome_lines(model: StepModel) -> Sequence[str]:
    """What became of a part as STEP, for people."""
    n_faces = sum(not face.reason for face in model.faces)
    what = f"{_count(model.n_solids, 'solid')}, {1e6 * model.volume_m3:.4g} cm3" if model.is_solid else "open"
    lines = [f"step       {_count(n_faces, 'face')} of {_count(len(model.faces), 'surface')}, {what}"]
    left = [face for face in model.faces if face.reason] if model.is_solid else []
    sentences = [f"surface {outcome.number} ({outcome.kind}) is {outcome.reason}" for outcome in left]
    return [*lines, *(f"           {text}" for text in (sentences if model.is_solid else [model.reason]))]


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
