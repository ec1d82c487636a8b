# SPDX-License-Identifier: MIT
"""Patch: one completed surface in its chart, with the reason why each of its cells is in the model."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from shapely import LineString, contains_xy

from completion.boundary.continuation import ContinuedEdge
from completion.boundary.edges import BoundaryEdge
from completion.boundary.hidden_regions import HiddenRegions, Labelling
from completion.boundary.meshing import Trim
from completion.edits.edit import SurfaceEdits
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence
from completion.extension.extent import Extent
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from scenes.checks import ArrayValue, BoolArray, FloatArray


class Provenance(IntEnum):
    """How a place came to be in the model."""

    MEASURED = 0
    INTERIOR = 1  # a hole in the measured part: the surface goes on behind the occluder
    BETWEEN = 2  # between parts that an occluder had cut apart
    EDGES = 3  # inside the measured part's own straight edges, continued until they meet
    ARCHITECTURAL = 4  # on to the plane that encloses the room there
    FULL_TURN = 5  # around the back of a cylinder
    USER = 6  # because a person says so
    NO_RETURN = 7  # nothing came back: in the projector's shadow, or with the surface all around
    FEATURE = 8  # a face of a feature that was fitted whole: the reveal of a window


@dataclass(frozen=True, slots=True, eq=False)
class Patch(ArrayValue):
    """One completed surface in its chart.

    Attributes
    ----------
    source : MergedSurface
        The fit and the pixels behind it.
    stated : SurfaceFit
        The fit with the covariance that is told: the sensor's systematic errors are part of it.
    limits : Extent
        What bounded the continuation.
    grid : ChartGrid
        The cells.
    evidence : Evidence
        What the scans say of them.
    hypothesised : (rows, columns) bool
        Cells that the surface is inferred to cover.
    provenance : (rows, columns) int8
        A `Provenance` for each observed or hypothesised cell, -1 elsewhere.
    confidence : (rows, columns) float
        Probability that the surface is there; 1 where it was measured, 0 where it cannot be.
    spread : (rows, columns) float
        Predicted standard deviation along the normal, metres.
    is_within : (rows, columns) bool
        Cells that are not beyond what the surface ends at, seen or not.
    edges : tuple of Edge
        Its creases and own edges.
    stretches : tuple of ContinuedEdge
        Its edges, continued where they are hidden.
    shadows : HiddenRegions
        The hidden cells in the regions that those edges divide them into.
    labelling : Labelling
        Which regions are surface.
    trims : tuple of Trim
        Where the mesh of hypothesised cells is cut along continued edges and declared openings.
    verdict : SurfaceEdits
        What a person says of it.
    feature : int
        Which feature, from 1, it is a face of; 0 for none.
    """

    source: MergedSurface
    stated: SurfaceFit
    limits: Extent
    grid: ChartGrid
    evidence: Evidence
    hypothesised: BoolArray
    provenance: NDArray[np.int8]
    confidence: FloatArray
    spread: FloatArray
    is_within: BoolArray
    edges: tuple[BoundaryEdge, ...]
    stretches: tuple[ContinuedEdge, ...]
    shadows: HiddenRegions
    labelling: Labelling
    trims: tuple[Trim, ...]
    verdict: SurfaceEdits
    feature: int = 0

    @property
    def observed(self) -> BoolArray:
        """Cells (rows, columns) where the surface was measured."""
        return self.evidence.observed

    @property
    def observed_m2(self) -> float:
        """Measured area in square metres."""
        return float(self.observed.sum()) * self.grid.cell_area

    @property
    def hypothesised_m2(self) -> float:
        """Inferred area in square metres, cells at a cut counted whole."""
        return float(self.hypothesised.sum()) * self.grid.cell_area

    def _facts(self) -> list[tuple[str, str]]:
        """The kind of surface, how much of it is measured and inferred."""
        return [
            ("kind", self.grid.surface.kind),
            ("measured", f"{self.observed_m2:.2f} m\u00b2"),
            ("inferred", f"{self.hypothesised_m2:.2f} m\u00b2"),
            ("cells", f"{' x '.join(map(str, self.grid.shape))} of {1000 * self.grid.cell[0]:.3g} mm"),
        ]


def in_hull(cells: BoolArray, among: BoolArray) -> BoolArray:
    """Cells among some (rows, columns) whose centre lies in the convex hull of `cells`, to half a cell."""
    rows, columns = np.nonzero(cells)
    if len(rows) < 3:
        return cells & among
    outline = LineString(np.column_stack([columns, rows]).astype(np.float64)[_extremes(rows)]).convex_hull
    result = np.zeros(cells.shape, dtype=np.bool_)
    place = np.nonzero(among)
    result[place] = contains_xy(outline.buffer(0.5), place[1], place[0])
    return result


def in_hulls(cells: BoolArray, among: BoolArray) -> BoolArray:
    """Cells among some (rows, columns) in the convex hull of any connected part of `cells`."""
    part, _ = ndimage.label(cells, structure=np.ones((3, 3)))
    inside = np.zeros(cells.shape, dtype=np.bool_)
    for number, box in enumerate(ndimage.find_objects(part), start=1):
        inside[box] |= in_hull(part[box] == number, among[box])
    return inside


def _extremes(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of the first and last cell in each row; `rows` ascends, and columns ascend in each."""
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    return np.unique(np.concatenate([first, np.append(first[1:] - 1, len(rows) - 1)]))


def provenance_of(
    grid: ChartGrid, extent: Extent, observed: BoolArray, hypothesised: BoolArray
) -> NDArray[np.int8]:
    """Give each observed or hypothesised cell (rows, columns) its `Provenance`, -1 to the others."""
    result = np.full(grid.shape, -1, np.int8)
    across, up = (
        (centre < extent.own_low[axis]) | (centre > extent.own_high[axis])
        for axis, centre in enumerate(grid.axes())
    )
    beyond = up[:, None] | (across & (not extent.full_turn))
    if extent.full_turn:
        result[hypothesised & across] = Provenance.FULL_TURN
    result[hypothesised & beyond] = Provenance.ARCHITECTURAL
    within = hypothesised & (result < 0)
    result[within] = Provenance.EDGES
    part, n_parts = ndimage.label(observed, structure=np.ones((3, 3)))
    sizes = np.bincount(part.ravel(), minlength=n_parts + 1)[1:]
    if len(sizes):
        largest = part == int(np.argmax(sizes)) + 1
        result[in_hull(observed, within)] = Provenance.BETWEEN
        result[in_hull(largest, within)] = Provenance.INTERIOR
    result[observed] = Provenance.MEASURED
    return result
