# SPDX-License-Identifier: MIT
"""A part: its points divided among surfaces, and what these are to each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Protocol

import numpy as np

from completion.export.step.pipeline import StepModel, step_of
from completion.export.step.regions import FittedRegion, PartRegions, part_regions
from completion.fitting.result import SurfaceFit
from completion.relations.engine.relation import Status
from completion.relations.graph import RelationGraph
from scenes.checks import FloatArray, InputError, IntArray, frozen_copy
from scenes.run.atomic import write_bytes


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part, divided into surfaces.

    Attributes
    ----------
    points : (n, 3) float
        As they were given, metres; of a mesh its vertices.
    surface : (n,) int
        Label of the surface of each point; 0 for none.
    labels : tuple of int
        Label of each of the k surfaces, ascending.
    measured : tuple of SurfaceFit
        The surfaces (k) as their own points say, with covariances that allow for neighbours that err alike.
    fits : tuple of SurfaceFit
        The surfaces (k) where their relations hold, with their covariances given these.
    groups : tuple of int
        One a surface: those with equal numbers lie on one and the same, as far as the points tell.
    noise_m, spacing_m : float
        Estimated deviation of the points along the normal, and their sampling distance; metres.
    relations : RelationGraph, optional
        What the surfaces of `related` are to each other; None where nobody asked.
    related : tuple of int
        Places, from 0, of the surfaces that relations were inferred of: those that are known well enough.
    faces : (m, 3) int, optional
        Corners of the triangles of a mesh.
    triangle_surface : (m,) int, optional
        Label of the surface of each triangle.
    warnings : tuple of str
        What is doubtful, a sentence each.
    """

    points: FloatArray
    surface: IntArray
    labels: tuple[int, ...]
    measured: tuple[SurfaceFit, ...]
    fits: tuple[SurfaceFit, ...]
    groups: tuple[int, ...]
    noise_m: float
    spacing_m: float
    relations: RelationGraph | None = None
    related: tuple[int, ...] = ()
    faces: IntArray | None = None
    triangle_surface: IntArray | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_copy(self.points, np.float64))
        for name in ("surface", "faces", "triangle_surface"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int32))

    def members(self, label: int) -> IntArray:
        """Places (m,) of the points of the surface with a label."""
        return np.flatnonzero(self.surface == label)

    def numbered(self, status: Status) -> int:
        """How many relations came to a status."""
        return 0 if self.relations is None else self.relations.numbered(status)

    def export(self, path: str | PathLike[str]) -> list[Path]:
        """Write the part to one file by suffix, `.step` or `.stp`; return all files that were written.

        STEP (AP214, millimetres) has analytic faces trimmed where surfaces meet, a solid where they close;
        what is to be known of it, `completion.parts.part.step_model` says.

        Raises
        ------
        InputError
            Another suffix, a folder that does not exist, a part without surfaces, or without any that can be
            trimmed; or OCP is not installed (`pip install "unseen[step]"`).
        """
        target = Path(path)
        if target.suffix.lower() not in (".step", ".stp"):
            wrong = target.suffix or "a name without suffix"
            raise InputError(f"{target}: cannot export a part to {wrong}; known: .step, .stp")

        write_bytes(target, step_model(self, target.stem).data)
        return [target]

    def __repr__(self) -> str:
        holding = 0 if self.relations is None else sum(one.holds for one in self.relations.relations)
        share = float(np.mean(self.surface > 0)) if len(self.surface) else 0.0
        return (
            f"Part({kinds_text(self.fits)}; {share:.1%} of {len(self.surface)} points; {holding} relations)"
        )


def kinds_text(fits: Sequence[SurfaceFit]) -> str:
    """How many surfaces of which kind, in words: "3 planes, 1 torus"."""
    kinds = Counter(fit.surface.kind for fit in fits)
    plural = {"torus": "tori"}
    named = [f"{n} {kind if n == 1 else plural.get(kind, kind + 's')}" for kind, n in sorted(kinds.items())]
    return ", ".join(named) or "no surface"


_MOST_SAMPLES = 400_000
_DENSER = 1.2  # samples in a square of the sampling distance
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
        points, own = _on_triangles(part.points, part.faces, part.spacing_m)
        label = part.triangle_surface[own]
    place = np.full(max((*part.labels, *label.tolist(), 0)) + 1, -1, dtype=np.int64)
    place[list(part.labels)] = np.arange(len(part.labels))
    region = np.where(label > 0, place[np.maximum(label, 0)], -1)
    regions = [
        FittedRegion(number, fit.surface, _deviation(fit, points[region == k]), group)
        for k, (number, fit, group) in enumerate(zip(part.labels, part.fits, part.groups, strict=True))
    ]
    return part_regions(regions, points, region, spacing_m=part.spacing_m, noise_m=part.noise_m)


def _deviation(fit: SurfaceFit, points: FloatArray) -> float:
    """The usual standard deviation of a surface along its normal at points (n, 3), metres."""
    if not len(points):
        return 0.0
    some = points[:: max(1, len(points) // _MOST_ASKED)]
    return float(np.median(fit.standard_deviation(some)))


def _on_triangles(vertices: FloatArray, faces: IntArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Points (k, 3) spread evenly over triangles (m, 3), and the triangle (k,) of each."""
    corners: FloatArray = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.cumsum(np.linalg.norm(across, axis=1) / 2)
    n = int(np.clip(_DENSER * total[-1] / spacing**2, 1, _MOST_SAMPLES))
    own = np.minimum(np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1]), len(faces) - 1)
    index, step = np.arange(1, n + 1)[:, None], 1.324717957244746  # plastic number (Roberts 2018)
    a, b = (0.5 + index / step) % 1.0, (0.5 + index / step**2) % 1.0
    over = a + b > 1
    a, b = np.where(over, 1 - a, a), np.where(over, 1 - b, b)
    some = corners[own]
    return some[:, 0] + a * (some[:, 1] - some[:, 0]) + b * (some[:, 2] - some[:, 0]), own


def outcome_lines(model: StepModel) -> Sequence[str]:
    """What became of a part as STEP, for people."""
    n_faces = sum(not one.reason for one in model.faces)
    what = f"{_count(model.n_solids, 'solid')}, {1e6 * model.volume_m3:.4g} cm3" if model.is_solid else "open"
    lines = [f"step       {_count(n_faces, 'face')} of {_count(len(model.faces), 'surface')}, {what}"]
    left = [one for one in model.faces if one.reason] if model.is_solid else []
    told = [f"surface {one.number} ({one.kind}) is {one.reason}" for one in left]
    return [*lines, *(f"           {text}" for text in (told if model.is_solid else [model.reason]))]


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
