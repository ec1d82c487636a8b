# SPDX-License-Identifier: MIT
"""The chart of a torus: its centre, the tilts of its axis, and both radii."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from completion.fitting.charts.chart import axis_frame
from scenes.checks import FloatArray
from scenes.surfaces.torus import Torus


@dataclass(frozen=True, slots=True, eq=False)
class TorusChart:
    """Shifts across the axis, its tilts, the shift along it, radius and tube radius.

    f = sqrt((rho - R)^2 + z^2) - r with rho = sqrt(x^2 + y^2): regular wherever the points are off the axis
    and off the tube's middle.
    """

    origin: FloatArray
    frame: FloatArray
    radius: float
    tube_radius: float

    n_parameters: ClassVar[int] = 7

    def linearise(self, local: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and gradient (7, n), rows x, y, tilts, z, R, r, at points (3, n) of the chart."""
        x, y, z = local
        from_axis = np.sqrt(x * x + y * y)
        beyond = from_axis - self.radius
        away = np.sqrt(beyond * beyond + z * z)
        safe = np.maximum(away, 1e-300)
        level, rise = beyond / safe, z / safe
        across = level / np.maximum(from_axis, 1e-300)
        gradient = np.empty((7, local.shape[1]))
        np.multiply(x, -across, out=gradient[0])
        np.multiply(y, -across, out=gradient[1])
        gradient[2] = z * gradient[0] + rise * x
        gradient[3] = z * gradient[1] + rise * y
        gradient[4] = -rise
        gradient[5] = -level
        gradient[6] = -1.0
        return away - self.tube_radius, gradient

    def basis(self) -> FloatArray:
        """Changes (7, 7) in which the radius grows about where the points are, as a cylinder's does."""
        basis = np.eye(7)
        touch = self.frame[:2] @ -self.origin / self.radius
        basis[:2, 5] = -touch / max(1.0, float(np.linalg.norm(touch)))
        return basis

    def moved(self, change: FloatArray) -> TorusChart | None:
        """The chart after a step (7,); None where a radius is none."""
        radius, tube_radius = self.radius + float(change[5]), self.tube_radius + float(change[6])
        if radius <= 0 or tube_radius <= 0:
            return None
        axis = self.frame.T @ np.array([change[2], change[3], 1.0])
        origin = self.origin + self.frame.T @ np.array([change[0], change[1], change[4]])
        return TorusChart(origin, axis_frame(axis / np.linalg.norm(axis)), radius, tube_radius)

    def lengths(self) -> FloatArray:
        """1 for shifts and radii, 0 for the tilts, (7,)."""
        return np.array([1.0, 1, 0, 0, 1, 1, 1])

    def surface(self, centre: FloatArray, scale: float, concave: bool) -> Torus:
        """The torus, scaled and moved by `centre` (3,); a spindle is refused by Torus."""
        return Torus(
            centre=centre + scale * self.origin,
            direction=self.frame[2],
            radius=scale * self.radius,
            tube_radius=scale * self.tube_radius,
            concave=concave,
        )

    def size(self) -> float:
        """The radius."""
        return max(1.0, self.radius)
