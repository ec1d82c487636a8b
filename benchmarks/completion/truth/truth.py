# SPDX-License-Identifier: MIT
"""Truth: the true geometry as arrays, and every true surface in its own chart."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely.geometry.base import BaseGeometry

from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.surfaces.catalogue import Plane, Surface
from scenes.surfaces.surface import Opening

FARTHEST_M = 0.05  # the largest distance that is told apart from none
_LEG_M = 0.03  # how far from a corner its sides are looked at
SAME_WAY = float(np.cos(np.radians(10.0)))  # |cosine| between normals that agree


@dataclass(frozen=True, slots=True, eq=False)
class TrueModel:
    """The true geometry as arrays.

    Parameters
    ----------
    mesh : LabelledMesh
        All geometry, world coordinates, metres.
    surfaces : tuple of Surface or None
        The true surface of each id; those that are None are not scored.
    scored : tuple of bool
        Which surfaces are scored: what is seen through openings is not.
    openings : tuple of Opening
        True openings.
    breaks : (k, 2, 3) float
        Boxes, low and high corners, in which the scene breaks the prior that hidden surface goes on.

    Raises
    ------
    InputError
        Not as many flags as surfaces.
    """

    mesh: LabelledMesh
    surfaces: tuple[Surface | None, ...]
    scored: tuple[bool, ...]
    openings: tuple[Opening, ...] = ()
    breaks: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 3)))

    def __post_init__(self) -> None:
        if len(self.scored) != len(self.surfaces):
            raise InputError(f"{len(self.surfaces)} surfaces but {len(self.scored)} flags of what is scored")

    def objects(self) -> NDArray[np.int32]:
        """Number of the connected piece of mesh that each surface is part of, shape (n_surfaces,)."""
        faces = self.mesh.faces
        n = len(self.mesh.vertices)
        ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
        graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
        piece = connected_components(graph, directed=False)[1]
        result = np.full(len(self.surfaces), -1, np.int32)
        result[self.mesh.face_surface] = piece[faces[:, 0]]
        return result

    def in_breaks(self, points: FloatArray) -> BoolArray:
        """Tell which points (n, 3) lie where the scene breaks the prior."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for low, high in self.breaks:
            inside |= ((points >= low) & (points <= high)).all(axis=1)
        return inside


@dataclass(frozen=True, slots=True, eq=False)
class TrueChart:
    """One true surface in its chart.

    Attributes
    ----------
    surface : int
        Its id.
    grid : ChartGrid
        Cells, with a margin around the surface.
    present : (rows, columns) bool
        Where the surface really is.
    in_opening : (rows, columns) bool
        Where it has a true opening.
    aside : (rows, columns) float
        Distance along the chart to where the surface is, metres; 0 there.
    corners : (k, 3, 2) float
        Chart coordinates of each corner of a plane's outline and of a place on either side of it, up to 3 cm
        along the outline, metres.
    """

    surface: int
    grid: ChartGrid
    present: BoolArray
    in_opening: BoolArray
    aside: FloatArray
    corners: FloatArray

    def distances(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Distance (n,) in metres from `points` to the bounded surface, good to half a cell along it.

        inf beyond 5 cm, and where `normals` (n, 3) are more than 10 degrees off the surface's, whichever
        side they point to.
        """
        result = np.full(len(points), np.inf)
        across = np.abs(self.grid.surface.distance(points))
        near = np.flatnonzero(across <= FARTHEST_M)
        near = near[self._agrees(points[near], normals[near])]
        inside, cell = self.grid.cells_of(points[near])
        near = near[inside]
        distance = np.hypot(across[near], self.aside.ravel()[cell])
        result[near] = np.where(distance <= FARTHEST_M, distance, np.inf)
        return result

    def _agrees(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        cosine = np.einsum("ij,ij->i", self.grid.surface.normal(points), normals)
        return np.asarray(np.abs(cosine) >= SAME_WAY, dtype=np.bool_)


def true_charts(model: TrueModel, cell_m: float = 0.01) -> tuple[TrueChart, ...]:
    """Return the chart of every scored surface, with cells of `cell_m` metres."""
    return tuple(
        _chart_of(index, surface, model, cell_m)
        for index, surface in enumerate(model.surfaces)
        if surface is not None and model.scored[index] and (model.mesh.face_surface == index).any()
    )


def _chart_of(index: int, surface: Surface, model: TrueModel, cell_m: float) -> TrueChart:
    outlines = _facets(surface, model.mesh.corners[model.mesh.face_surface == index])
    low, high = outlines.min(axis=(0, 1)), outlines.max(axis=(0, 1))
    full_turn = bool(high[0] - low[0] > surface.period * (1 - 1e-6))
    margin = FARTHEST_M + cell_m
    grid = ChartGrid.over(surface, low - margin, high + margin, cell_m, full_turn=full_turn)
    region = _union(outlines)
    present = _covered(grid, region)
    in_opening = np.zeros(grid.shape, dtype=np.bool_)
    for opening in model.openings:
        if opening.surface == index:
            in_opening |= _covered(grid, _union(surface.to_uv(opening.outline)[None]))
    around = np.pad(present, ((0, 0), (grid.shape[1],) * 2), mode="wrap") if full_turn else present
    aside = ndimage.distance_transform_edt(~around, sampling=grid.cell[::-1])
    if full_turn:
        aside = aside[:, grid.shape[1] : 2 * grid.shape[1]]
    aside = np.maximum(aside - cell_m / 2, 0.0)
    corners = _corners(region) if isinstance(surface, Plane) else np.zeros((0, 3, 2))
    return TrueChart(
        surface=index,
        grid=grid,
        present=present,
        in_opening=in_opening & ~present,
        aside=aside,
        corners=corners,
    )


def _facets(surface: Surface, corners: FloatArray) -> FloatArray:
    """Corners (m, 3, 2) of the surface's faces in its chart, no face across the seam."""
    uv = surface.to_uv(corners.reshape(-1, 3)).reshape(-1, 3, 2)
    if np.isfinite(surface.period):
        middle = surface.to_uv(corners.mean(axis=1))[:, None, 0]
        uv[..., 0] -= surface.period * np.rint((uv[..., 0] - middle) / surface.period)
    return uv


def _union(outlines: FloatArray) -> BaseGeometry:
    """The region that polygons (m, n, 2) cover together."""
    return shapely.simplify(shapely.union_all(shapely.polygons(outlines), grid_size=1e-9), 1e-7)


def _covered(grid: ChartGrid, region: BaseGeometry) -> BoolArray:
    """Cells whose centre lies in the region."""
    shapely.prepare(region)
    uv = grid.centres_uv()
    return np.asarray(shapely.contains_xy(region, uv[..., 0], uv[..., 1]), dtype=np.bool_)


def _corners(region: BaseGeometry) -> FloatArray:
    """Where the region's outline turns by more than 20 degrees, and on it before and after: (k, 3, 2)."""
    found = [np.zeros((0, 3, 2))]
    for polygon in shapely.get_parts(region):
        for ring in shapely.get_rings(polygon):
            points = shapely.get_coordinates(ring)[:-1]
            into, out = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
            lengths = np.linalg.norm([into, out], axis=2)
            cosine = np.einsum("ij,ij->i", into, out) / lengths.prod(axis=0)
            before, after = np.minimum(_LEG_M / lengths, 0.5)[..., None] * [-into, out] + points
            places = np.stack([points, before, after], axis=1)
            found.append(places[cosine < np.cos(np.radians(20.0))])
    return np.concatenate(found)
