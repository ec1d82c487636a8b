# SPDX-License-Identifier: MIT
"""What features that were fitted whole say of surfaces: openings, holes, joints, faces; nobody said it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.boundary.edges import Circle
from completion.evidence.chart_grid import ChartGrid
from completion.merging.merged_surface import MergedSurface
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_CORNERS = 48  # of a round hole's outline


@dataclass(frozen=True, slots=True, eq=False)
class FittedOpening:
    """An opening fitted as a whole and accepted by evidence; working frame, metres.

    Attributes
    ----------
    outline : (4, 3) float
        Corners from the lower left, anticlockwise as seen from the room; sides lead from each to the next.
    deviation : (4,) float
        Standard deviation of each side across itself.
    seen : (4,) float
        Share of each side that was seen; 0 of one that nobody saw.
    slack : (4, 2) float
        How far inwards and outwards a side may be off that nobody saw; 0 of others.
    number : int
        Which feature it is, from 1.
    """

    outline: FloatArray
    deviation: FloatArray
    seen: FloatArray
    slack: FloatArray
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class FittedHole:
    """A round hole of a row, a grid or a circle, which are all equal; working frame, metres.

    Attributes
    ----------
    centre : (3,) float
        Its middle.
    axis : (3,) float
        Across the plate.
    radius : float
        Of all holes of the pattern.
    deviation : float
        Standard deviation of its place, in the direction in which it is known worst.
    seen : float
        Share of its rim that was seen.
    number : int
        Which feature it is of, from 1.
    """

    centre: FloatArray
    axis: FloatArray
    radius: float
    deviation: float
    seen: float
    number: int

    @property
    def outline(self) -> FloatArray:
        """Corners (n, 3) along its rim, as if it had so many."""
        angle = np.linspace(0.0, 2 * np.pi, _CORNERS, endpoint=False)
        return Plane(self.centre, self.axis).from_uv(
            self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        )

    def rim(self, chart: Surface) -> Circle:
        """Its rim in the chart of the plane that it lies in."""
        return Circle(chart.to_uv(self.centre[None])[0], self.radius)

    def within(self, grid: ChartGrid) -> tuple[tuple[slice, slice], FloatArray]:
        """A box of a grid about it, and how far within its rim those cells (rows, columns) lie, metres."""
        rim, most = self.rim(grid.surface), np.array(grid.shape[::-1])
        reach = self.radius + grid.cell
        low, high = (
            np.clip(np.floor((rim.centre + sign * reach - grid.corner) / grid.cell), 0, most)
            for sign in (-1, 1)
        )
        columns, rows = (slice(int(low[axis]), int(high[axis]) + 1) for axis in (0, 1))
        u, v = grid.axes()
        return (rows, columns), rim.across(np.stack(np.meshgrid(u[columns], v[rows]), axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class FittedJoint:
    """Where a surface ends at another one that it was fitted together with; working frame.

    Attributes
    ----------
    plane : Plane
        The surface lies on its normal's side.
    number : int
        Which feature it is of, from 1.
    """

    plane: Plane
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class KnownFace:
    """A face whose place and outline are known from the feature that it is of; working frame.

    Attributes
    ----------
    surface : MergedSurface
        The plane, its normal to the side that is free, its chart along the outline with the origin in the
        middle; and what was measured of it, which may be nothing.
    size : (2,) float
        Along u and v, metres.
    feature : int
        Which feature it is of, from 1.
    """

    surface: MergedSurface
    size: FloatArray
    feature: int
