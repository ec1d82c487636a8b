# SPDX-License-Identifier: MIT
"""Beams: where those of the scans went through the space between two faces, which is then no body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.free_space import free_cells
from completion.evidence.reach import Reach, reach_of
from completion.evidence.sight import Sight, sight_of
from completion.exchange.building.areas import buffered, common, joined, wide
from completion.exchange.building.faces import Frame
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane

_CELL_M, _MOST_CELLS = 0.03, 200_000  # side of a cell; how many there are at most
_LEAST_WIDE_M = 0.1  # of what counts as gone through: outlines of openings are off by a cell or two


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """The beams of scans.

    Attributes
    ----------
    sights, reaches : sequences
        Of each scan, working frame.
    world : Pose
        From the working frame to the world.
    """

    sights: Sequence[Sight]
    reaches: Sequence[Reach]
    world: Pose

    @classmethod
    def of(cls, observations: Sequence[Observation], world: Pose, tolerance: Tolerance) -> Beams:
        """Return the beams of scans that brought something back."""
        seen = [one for one in observations if one.scan.valid.any()]
        return cls([sight_of(one, tolerance) for one in seen], [reach_of(one) for one in seen], world)

    def free(self, area: Any, frame: Frame, depth_m: float) -> Any:
        """Return where beams went through an area of a frame, at a depth behind its plane, metres.

        By the same rule as the veto of a surface (`free_cells`), in cells of 3 cm that are joined over gaps
        of two; of it what is at least 10 cm wide.
        """
        if not self.sights or area.is_empty:
            return shapely.Polygon()
        inverse = self.world.inverse()
        local = inverse.apply(frame.place(shapely.get_coordinates(area), -depth_m))
        plane = Plane(local[0], inverse.rotate(frame.normal[None])[0])
        uv = plane.to_uv(local)
        low, high = uv.min(axis=0), uv.max(axis=0)
        cell = max(_CELL_M, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
        grid = ChartGrid.over(plane, low, high, cell, full_turn=False)
        is_free = free_cells(grid, np.zeros(grid.shape[0] * grid.shape[1]), self.sights, self.reaches)
        found = joined(self._cells(grid, np.flatnonzero(is_free), frame))
        found = buffered(buffered(found, cell), -cell)
        return wide(common(area, found), max(_LEAST_WIDE_M, 3 * cell))

    def _cells(self, grid: ChartGrid, chosen: NDArray[np.int64], frame: Frame) -> list[Any]:
        """Squares of some cells in the coordinates of a frame."""
        row, column = np.divmod(chosen, grid.shape[1])
        around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
        uv = grid.uv_of(row[:, None] + around[:, 1], column[:, None] + around[:, 0])
        places = self.world.apply(grid.surface.from_uv(uv.reshape(-1, 2)))
        return list(shapely.polygons(frame.flat(places).reshape(-1, 4, 2)))
