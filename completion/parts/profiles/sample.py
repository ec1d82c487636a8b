# SPDX-License-Identifier: MIT
"""Sample of a part: its points, or points spread over its triangles, and the surface of each."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray, IntArray

_MOST_SAMPLES = 400_000
_DENSER = 1.2  # samples in a square of the sampling distance


class SampledPart(Protocol):
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
    def faces(self) -> IntArray | None:
        """Triangles (m, 3) of a mesh."""

    @property
    def triangle_surface(self) -> IntArray | None:
        """Labels (m,) of these."""

    @property
    def spacing_m(self) -> float:
        """Their sampling distance, metres."""


class SweptPart(SampledPart, Protocol):
    """What profiles read of a part (`Part`)."""

    @property
    def measured(self) -> tuple[SurfaceFit, ...]:
        """Its surfaces as their own points say."""

    @property
    def fits(self) -> tuple[SurfaceFit, ...]:
        """Its surfaces where relations hold."""

    @property
    def groups(self) -> tuple[int, ...]:
        """Which of them are one."""

    @property
    def noise_m(self) -> float:
        """Deviation of the points, metres."""


def sample_of(part: SampledPart) -> tuple[FloatArray, IntArray]:
    """Return points (k, 3) of a part, metres, and the place (k,) of each one's surface, -1 for none."""
    points, label = part.points, part.surface
    if part.faces is not None and part.triangle_surface is not None and part.spacing_m > 0:
        points, members = _on_triangles(part.points, part.faces, part.spacing_m)
        label = part.triangle_surface[members]
    place = np.full(max((*part.labels, *label.tolist(), 0)) + 1, -1, dtype=np.int64)
    place[list(part.labels)] = np.arange(len(part.labels))
    return points, np.where(label > 0, place[np.maximum(label, 0)], -1)


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
