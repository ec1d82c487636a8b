# SPDX-License-Identifier: MIT
"""Measured: points, and the beams that met them or met nothing, as templates are fitted to."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scenes.checks import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Beams of n pixels.

    Attributes
    ----------
    origins : (n, 3) float
        Where each began.
    directions : (n, 3) float
        Unit directions.
    ranges : (n,) float
        How far each went; inf where nothing came back.
    """

    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray

    def chosen(self, which: BoolArray | IntArray) -> Beams:
        """Return some of them, by truth (n,) or by number (m,)."""
        return Beams(self.origins[which], self.directions[which], self.ranges[which])


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What was measured, in one frame and one unit.

    Attributes
    ----------
    points : (n, 3) float
        All points of the input in their order, finite.
    noise : float
        Standard deviation of a point across its surface; 0 where there is none.
    spacing : float
        Typical distance between neighbouring points.
    beams : Beams, optional
        The beams of a scan, those without a return too; None of points alone.
    beam_of_point : (n,) int, optional
        Number of the beam that measured each point.
    faces : (m, 3) int, optional
        Triangles of a mesh, by number of point.
    """

    points: FloatArray
    noise: float
    spacing: float
    beams: Beams | None = None
    beam_of_point: IntArray | None = None
    faces: IntArray | None = None

    @property
    def diagonal(self) -> float:
        """Of the box round all points; 0 of none."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    def scaled(self, factor: float) -> Measured:
        """Return the same in another unit."""
        beams = self.beams and Beams(
            self.beams.origins * factor, self.beams.directions, self.beams.ranges * factor
        )
        return replace(
            self,
            points=self.points * factor,
            noise=self.noise * factor,
            spacing=self.spacing * factor,
            beams=beams,
        )
