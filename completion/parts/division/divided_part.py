# SPDX-License-Identifier: MIT
"""A divided part as others read it, and points on the triangles of its mesh."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from completion.fitting.result import SurfaceFit
from scenes.checks import FloatArray, IntArray

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
    def noise_m(self) -> float:
        """Deviation of the points, metres."""

    @property
    def spacing_m(self) -> float:
        """Their sampling distance, metres."""


def points_on_triangles(vertices: FloatArray, faces: IntArray, spacing: float) -> tuple[FloatArray, IntArray]:
    """Return points (k, 3) spread evenly over triangles (m, 3), and the triangle (k,) of each."""
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
