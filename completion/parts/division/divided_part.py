# SPDX-License-Identifier: MIT
"""A divided part as exporters, dimensions and profiles read it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations.graph import RelationGraph
from scenes.checks import FloatArray, IntArray
from scenes.mesh.labelled_mesh import spread_points, triangle_areas

_MOST_SAMPLES = 400_000
_DENSER = 1.2  # samples in a square of the sampling distance


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


class RelatedPart(DividedPart, Protocol):
    """The same with its relations."""

    @property
    def measured(self) -> tuple[SurfaceFit, ...]:
        """The surfaces as their own points say."""

    @property
    def relations(self) -> RelationGraph | None:
        """What the surfaces of `related` are to each other."""

    @property
    def related(self) -> tuple[int, ...]:
        """Places of these surfaces."""


def surface_points(part: DividedPart) -> tuple[FloatArray, IntArray]:
    """Return points (k, 3) of a part, of a mesh spread evenly over its triangles, and their labels (k,)."""
    if part.faces is None or part.triangle_surface is None or part.spacing_m <= 0:
        return part.points, part.surface
    corners: FloatArray = part.points[part.faces]
    n = int(min(_DENSER * triangle_areas(corners).sum() / part.spacing_m**2, _MOST_SAMPLES))
    points, members = spread_points(corners, max(n, 1))
    return points, np.asarray(part.triangle_surface[members])
