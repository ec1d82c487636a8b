# SPDX-License-Identifier: MIT
"""Truth of a scene: its surfaces as charts, what scans see and miss of them, and the kinds of occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

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
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from scenes.surfaces.surface import Opening

FARTHEST_M = 0.05  # the largest distance that is told apart from none
_LEG_M = 0.03  # how far from a corner its sides are looked at
SAME_WAY = float(np.cos(np.radians(10.0)))  # |cosine| between normals that agree


@dataclass(frozen=True, slots=True, eq=False)
class TrueModel:
    """The true geometry as arrays.

    Raises InputError: not as many flags as surfaces.
    """

    mesh: LabelledMesh  # all geometry, world coordinates, metres
    surfaces: tuple[Surface | None, ...]  # the true surface of each id; those that are None are not scored
    scored: tuple[bool, ...]  # which surfaces are scored: what is seen through openings is not
    openings: tuple[Opening, ...] = ()  # true openings
    # (k, 2, 3) float: Boxes, low and high corners, in which the scene breaks the prior that hidden surface
    # goes on
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
    """One true surface in its chart."""

    surface: int  # its id
    grid: ChartGrid  # cells, with a margin around the surface
    present: BoolArray  # (rows, columns) bool: Where the surface really is
    in_opening: BoolArray  # (rows, columns) bool: Where it has a true opening
    # (rows, columns) float: Distance along the chart to where the surface is, metres; 0 there
    aside: FloatArray
    # (k, 3, 2) float: Chart coordinates of each corner of a plane's outline and of a place on either side of
    # it, up to 3 cm along the outline, metres
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


_MAX_TOLERANCE_M = 0.1


class Sight(IntEnum):
    """What the scans know of a place, weakest first; the strongest word of all scans counts."""

    OUT = 0  # in no scan's view
    HIDDEN = 1  # in the view of some and blocked in all of them
    VISIBLE = 2  # a ray ends there
    FREE = 3  # a ray goes through


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What the scans know of n places."""

    sight: NDArray[np.int8]  # (n,) int8: A `Sight` for each
    # (n,) int32: For hidden places the face of the true mesh that hides it from the first scan that has it in
    # view, -1 for others
    blocker: NDArray[np.int32]


def sight_of(
    points: FloatArray,
    scans: Sequence[RangeImage],
    caster: RayCaster,
    tolerance_m: float,
    normals: FloatArray,
) -> Sighting:
    """Look at places from all scans.

    A ray to the place that goes through makes it free only if the beam of the pixel that it falls into, as
    `truth` has it, goes through as well; else no beam has been there, and the place is hidden.
    `points` (n, 3) float: world coordinates, metres. `scans`: their poses and projections count. `caster`:
    the true mesh. `tolerance_m`: how far across the surface the true one may lie for the place to be seen;
    along the ray it is this over the cosine of the incidence angle, at most 10 cm. `normals` (n, 3) float:
    unit normals of the surface there.
    """
    sight, blocker = np.full(len(points), Sight.OUT, np.int8), np.full(len(points), -1, np.int32)
    for scan in scans:
        pixels = scan.pixels(points)
        inside = np.flatnonzero(np.isfinite(pixels).all(axis=1))
        if not len(inside):
            continue
        ray = points[inside] - scan.origin
        distance = np.linalg.norm(ray, axis=1)
        cosine = np.abs(np.einsum("ij,ij->i", ray, normals[inside])) / np.maximum(distance, 1e-12)
        tolerance = np.minimum(tolerance_m / np.maximum(cosine, 1e-3), _MAX_TOLERANCE_M)
        hits = caster.first_hit(scan.origin[None], ray)
        behind = distance - hits.ranges  # positive where something stands before the place
        row, column = np.rint(pixels[inside]).astype(np.int64).T
        beam_passes = noise_free_ranges(scan)[row, column] > distance + tolerance
        word = np.full(len(inside), Sight.VISIBLE, np.int8)
        word[behind > tolerance] = Sight.HIDDEN
        word[behind < -tolerance] = Sight.HIDDEN
        word[(behind < -tolerance) & beam_passes] = Sight.FREE
        first = (sight[inside] == Sight.OUT) & (word == Sight.HIDDEN)
        blocker[inside[first]] = hits.face[first]
        sight[inside] = np.maximum(sight[inside], word)
    blocker[sight != Sight.HIDDEN] = -1
    return Sighting(sight, blocker)


def noise_free_ranges(scan: RangeImage) -> FloatArray:
    """True ranges (rows, columns) of a simulated scan, inf where its rays met nothing.

    Raises InputError: a scan without truth.
    """
    if scan.truth is None:
        raise InputError(f"scan {scan.name!r} has no truth channels; evaluation needs simulated scans")
    return scan.truth.ranges


_EXACT_M = 1e-3  # facets stray from a true cylinder by less


@dataclass(frozen=True, slots=True, eq=False)
class TrueCells:
    """One true surface in its chart, as the scans see it."""

    chart: TrueChart  # where the surface is
    sight: NDArray[np.int8]  # (rows, columns) int8: A `Sight` for each cell, by noise-free rays to its centre
    occluder: NDArray[np.int32]  # (rows, columns) int32: Object that hides a cell, -1 where none does
    # (rows, columns) bool: Hidden part of the surface that is connected with a visible one
    reachable: BoolArray
    faces_away: BoolArray  # (rows, columns) bool: Where the surface shows its back to every scan

    @property
    def visible(self) -> BoolArray:
        """Where the surface is seen."""
        return np.asarray(self.chart.present & (self.sight == Sight.VISIBLE), dtype=np.bool_)

    @property
    def in_view(self) -> BoolArray:
        """Cells that are hidden or looked through, whether the surface is there or not."""
        return np.asarray((self.sight == Sight.HIDDEN) | (self.sight == Sight.FREE), dtype=np.bool_)

    @property
    def hidden(self) -> BoolArray:
        """Where it is in the view of some scan and blocked in all of them."""
        return np.asarray(self.chart.present & (self.sight == Sight.HIDDEN), dtype=np.bool_)


def look(
    model: TrueModel,
    charts: Sequence[TrueChart],
    scans: Sequence[RangeImage],
    *,
    min_pixels: int = 50,
    n_threads: int | None = None,
) -> tuple[TrueCells, ...]:
    """Return the cells of every charted surface, as the scans see it.

    `model`: the truth. `charts`: its charts. `scans`: simulated scans: poses, projections and truth channels
    count, not the measured ranges. `min_pixels`: a surface with fewer pixels in all scans is reachable
    nowhere. `n_threads`: threads that cast. Raises InputError: a scan without truth.
    """
    caster = RayCaster(model.mesh.vertices, model.mesh.faces, n_threads)
    objects = model.objects()
    pixels = np.zeros(len(model.surfaces), np.int64)
    for scan in scans:
        met = np.isfinite(noise_free_ranges(scan))
        if scan.truth is not None:
            pixels += np.bincount(scan.truth.surface[met], minlength=len(pixels))
    result = []
    for chart in charts:
        centres = chart.grid.centres()
        normals = chart.grid.surface.normal(centres)
        seen = sight_of(centres, scans, caster, _EXACT_M, normals)
        occluder = np.full(len(centres), -1, np.int32)
        hides = seen.blocker >= 0
        occluder[hides] = objects[model.mesh.face_surface[seen.blocker[hides]]]
        shape = chart.grid.shape
        enough = bool(pixels[chart.surface] >= min_pixels)
        away = np.ones(len(centres), dtype=np.bool_)
        for scan in scans:
            away &= np.einsum("ij,ij->i", scan.origin - centres, normals) <= 0
        cells = _cells_of(chart, seen.sight.reshape(shape), occluder.reshape(shape), enough, away)
        result.append(cells)
    return tuple(result)


def _cells_of(
    chart: TrueChart,
    sight: NDArray[np.int8],
    occluder: NDArray[np.int32],
    seen_enough: bool,
    away: BoolArray,
) -> TrueCells:
    visible, hidden = chart.present & (sight == Sight.VISIBLE), chart.present & (sight == Sight.HIDDEN)
    part = pieces(visible | hidden, chart.grid.wraps)
    reached = np.zeros(int(part.max(initial=0)) + 1, dtype=np.bool_)
    reached[np.unique(part[visible])] = seen_enough
    reached[0] = False
    reachable = np.asarray(hidden & reached[part], dtype=np.bool_)
    return TrueCells(chart, sight, occluder, reachable, away.reshape(chart.grid.shape))


def pieces(mask: BoolArray, wraps: bool) -> NDArray[np.int32]:
    """Number of the connected piece (8 neighbours) that each cell of `mask` is in; 0 outside."""
    part, n_parts = ndimage.label(mask, structure=np.ones((3, 3)))
    if not wraps or n_parts < 2:
        return np.asarray(part, dtype=np.int32)
    both = (part[:, 0] > 0) & (part[:, -1] > 0)
    graph = coo_array((np.ones(both.sum()), (part[both, 0], part[both, -1])), shape=(n_parts + 1,) * 2)
    joined = 1 + connected_components(graph, directed=False)[1]
    joined[0] = 0
    return np.asarray(joined[part], dtype=np.int32)


def grown(mask: BoolArray, wraps: bool) -> BoolArray:
    """The mask and its eight neighbours, across the seam where the chart wraps."""
    around = np.pad(mask, ((0, 0), (1, 1)), mode="wrap" if wraps else "constant")
    return np.asarray(ndimage.binary_dilation(around, np.ones((3, 3)))[:, 1:-1], dtype=np.bool_)


def nearest_index(mask: BoolArray, cell: FloatArray) -> NDArray[np.int64]:
    """Flat index of the cell of `mask` that is nearest to each cell; `mask` must hold one."""
    rows, columns = ndimage.distance_transform_edt(
        ~mask, sampling=cell[::-1], return_distances=False, return_indices=True
    )
    return np.asarray(rows * mask.shape[1] + columns, dtype=np.int64)


_MIN_PART_M2 = 0.0025  # smaller visible parts do not make a surface broken


class Stratum(IntEnum):
    """Why a part of a surface is hidden, after Dell'Acqua & Fisher 2002; 0 for area of no such part."""

    NONE = 0  # inferred on a surface of which nothing is hidden, or on no true surface
    INTERIOR = 1  # S1, surface-preserving: an occluder hides part of it, the rest stays one region
    BREAKING = 2  # S2, surface-breaking: the visible rest falls apart
    BOUNDARY = 3  # S3, boundary-breaking: part of the surface's own boundary is hidden too
    SELF = 4  # S4: the side of a cylinder that shows its back to all scans
    OPENING = 6  # S6: an opening's outline is partly hidden


def strata_of(cells: TrueCells) -> NDArray[np.int8]:
    """Return the stratum of every reachable hidden cell, -1 for all other cells.

    The back of a cylinder is S4. What one object hides of the rest of a surface, in one piece, is of one
    stratum: S6 where the piece borders on a hidden part of an opening; S2 where it borders on two visible
    parts; S3 where it borders on where the surface ends; else S1.
    """
    result = np.full(cells.chart.grid.shape, -1, np.int8)
    visible = _large_parts(cells)
    hidden_opening = cells.chart.in_opening & (cells.sight == Sight.HIDDEN)
    wraps = cells.chart.grid.wraps
    open_ = cells.reachable
    if isinstance(cells.chart.grid.surface, Cylinder):
        result[open_ & cells.faces_away] = Stratum.SELF
        open_ = open_ & ~cells.faces_away
    for occluder in np.unique(cells.occluder[open_]):
        shadows = pieces(open_ & (cells.occluder == occluder), wraps)
        for number in np.unique(shadows[shadows > 0]):
            shadow = shadows == number
            rim = grown(shadow, wraps) & ~shadow
            if (rim & hidden_opening).any():
                stratum = Stratum.OPENING
            elif len(np.unique(visible[rim & (visible > 0)])) > 1:
                stratum = Stratum.BREAKING
            elif (rim & ~cells.chart.present).any():
                stratum = Stratum.BOUNDARY
            else:
                stratum = Stratum.INTERIOR
            result[shadow] = stratum
    return result


def _large_parts(cells: TrueCells) -> NDArray[np.int32]:
    """Number of the visible part that each cell belongs to, 0 for small parts and cells of none."""
    part = pieces(cells.visible, cells.chart.grid.wraps)
    large = np.bincount(part.ravel()) * cells.chart.grid.cell_area >= _MIN_PART_M2
    large[0] = False
    return np.where(large[part], part, 0)
