# SPDX-License-Identifier: MIT
"""Straightening: a surface's cells as polygons, laid on the edges that the surface is known to have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.boundary.edges import Line, meeting_line
from completion.boundary.meshing import ChartMesh
from completion.evidence.evidence import Label
from completion.extension.patch import Patch
from completion.panels.sheet import polygons_of_cells
from scenes.checks import BoolArray, FloatArray

_REACH = 4.0  # cells between an outline and the edge that it follows
_MEETING = 10.0  # the same where it meets another surface
_BEYOND = 2.0  # cells by which an outline may follow an edge past where it was seen
_ROUGH = 1.0  # cells that an outline may be off its polygon
_STRAIGHT = 1e-6  # cells that a place between two corners is off their line
_LEAST_CELLS = 9  # of a part or a hole
_LEAST_RING = 3  # places of a closed ring; flatter ones are no polygon
_PARALLEL = float(np.sin(np.radians(10.0)))


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """A line of the chart that an outline is laid on."""

    line: Line  # where it is
    runs: FloatArray  # (k, 2) first and last arc length of the stretches along which it counts, metres
    reach_m: float  # how far off it an outline may be


def surface_polygon(patch: Patch, mesh: ChartMesh) -> Any:
    """Measured and inferred area of a plane as polygons of its chart (shapely geometry), `straightened`.

    `mesh` has its inferred cells, each by itself. Parts and holes of fewer than nine cells are left out.
    """
    grid = patch.grid
    corners = grid.uv_of(mesh.cells[:, 0], mesh.cells[:, 1])[mesh.faces]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]) / 2
    covered = np.bincount(mesh.face_cell, areas, patch.observed.size).reshape(grid.shape)
    whole = patch.observed | (covered > (1 - 1e-6) * grid.cell_area)
    cut = mesh.cells[mesh.faces[~whole.ravel()[mesh.face_cell]]]
    area = shapely.transform(polygons_of_cells(whole, cut), lambda xy: grid.uv_of(xy[:, 1], xy[:, 0]))
    size, least = float(grid.cell.max()), _LEAST_CELLS * grid.cell_area
    guides, straight = guides_of(patch), []
    declined = (patch.evidence.labels == Label.OCCLUDED) & patch.is_within & ~whole & ~patch.hypothesised
    low, high = patch.limits.window()

    def is_declined(uv: FloatArray) -> BoolArray:
        inside, cells = grid.cells_at(uv)
        # it goes on to there too improbably
        result = np.asarray(((uv < low - size) | (uv > high + size)).any(axis=1))
        result[inside] = declined.ravel()[cells]
        return result

    for part in _without_small(area, least):
        straight += _without_small(straightened(part, guides, size, is_declined), least)
    return shapely.union_all(straight)


def _without_small(area: Any, least_m2: float) -> list[Any]:
    """The polygons of a geometry without parts and holes of less than an area."""
    kept = [part for part in polygon_parts(area) if part.area >= least_m2]
    holes = [[hole for hole in part.interiors if shapely.Polygon(hole).area >= least_m2] for part in kept]
    return [shapely.Polygon(part.exterior, large) for part, large in zip(kept, holes, strict=True)]


def polygon_parts(area: Any) -> list[Any]:
    """The polygons of a geometry, largest first."""
    parts = shapely.get_parts(shapely.get_parts(area))
    proper = [part for part in parts if part.geom_type == "Polygon" and part.area > 0]
    return sorted(proper, key=lambda part: -part.area)


def guides_of(patch: Patch) -> list[Guide]:
    """Return a surface's own straight edges, and where it meets what encloses the room.

    Cells that are seen obliquely make a saw of an edge. An edge that was fitted to the pixels holds within
    four cells; where two surfaces meet is known better than where the pixels between them ended, so that
    it holds within ten.
    """
    cell = float(patch.grid.cell.max())
    always = np.array([[-np.inf, np.inf]])
    meetings = [meeting_line(patch.grid.surface, cut) for cut in patch.limits.cuts]
    guides = [Guide(line, always, _MEETING * cell) for line in meetings if line is not None]
    for edge in patch.edges:
        if isinstance(edge.curve, Line):
            slack = _BEYOND * cell * np.array([-1.0, 1.0])
            guides.append(Guide(edge.curve, edge.runs + slack, _REACH * cell))
    return guides


def straightened(
    polygon: Any,
    guides: Sequence[Guide],
    cell_m: float,
    is_declined: Callable[[FloatArray], BoolArray] | None = None,
) -> Any:
    """Return a shapely polygon of the chart, its sides laid on the guides where these run beside it.

    A place stays where it is if the way to its guide leads through what was not inferred, though hidden, or
    was too improbable to be looked at: `is_declined` tells it of places (n, 2), as (n,).
    What follows none is straightened to within a cell of `cell_m` metres. Places along a straight side are
    dropped before what was folded is put right: there they would become slivers.
    """
    dense = shapely.segmentize(polygon, cell_m)

    def lay(uv: FloatArray) -> FloatArray:
        moved = _on_guides(uv, guides)
        if is_declined is not None:
            stays = is_declined((uv + moved) / 2) & (np.linalg.norm(moved - uv, axis=1) > _REACH * cell_m)
            moved[stays] = uv[stays]
        return moved

    laid = shapely.transform(dense, lay) if guides else dense
    corners = _from_corners(laid, _STRAIGHT * cell_m)
    return _from_corners(_put_right(corners)).simplify(_ROUGH * cell_m)


def _put_right(polygons: Any) -> Any:
    """Polygons whose rings cross themselves or each other as valid ones, ring by ring.

    A ring that became a bow tie keeps both its parts, and a hole that was laid on the outline stays open.
    """
    parts = shapely.get_parts(polygons)
    rings = [[part.exterior for part in parts], [hole for part in parts for hole in part.interiors]]
    shells, holes = (
        shapely.union_all(shapely.make_valid([shapely.Polygon(r) for r in some])) for some in rings
    )
    return shapely.difference(shells, holes)


def _from_corners(area: Any, straight_m: float = 0.0) -> Any:
    """The same polygons, each ring from its place farthest from the middle on.

    Simplifying keeps the place that a ring begins at (Douglas & Peucker 1973), which rounding would choose.
    Places that are off a straight side by no more than `straight_m` are dropped, ring by ring: of a ring that
    crosses itself the polygon's own way of it would lose a part.
    """

    def begun(ring: Any) -> FloatArray:
        places = shapely.get_coordinates(ring)[:-1]
        away = np.square(places - places.mean(axis=0)).sum(axis=1)
        begun_anew = np.asarray(np.roll(places, -int(np.argmax(away)), axis=0), dtype=np.float64)
        if not straight_m:
            return begun_anew
        closed = shapely.linestrings(np.concatenate([begun_anew, begun_anew[:1]]))
        kept = shapely.get_coordinates(shapely.simplify(closed, straight_m, preserve_topology=False))
        return np.asarray(kept if len(kept) > _LEAST_RING else begun_anew, dtype=np.float64)

    parts = shapely.get_parts(shapely.get_parts(area))  # what was folded can become a collection of several
    polygons = [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]
    return shapely.MultiPolygon(
        [shapely.Polygon(begun(part.exterior), [begun(hole) for hole in part.interiors]) for part in polygons]
    )


def _on_guides(uv: FloatArray, guides: Sequence[Guide]) -> FloatArray:
    """Places moved to the nearest guide that they follow, or to where the two nearest meet."""
    across = np.stack([np.where(_follows(uv, guide), guide.line.across(uv), np.inf) for guide in guides])
    order = np.argsort(np.abs(across), axis=0, kind="stable")[:2]
    moved = uv.copy()
    for k, guide in enumerate(guides):
        near = (order[0] == k) & np.isfinite(across[k])
        moved[near] -= across[k, near, None] * guide.line.normal
    if len(guides) > 1:
        for place in np.flatnonzero(np.isfinite(np.take_along_axis(across, order[1:2], axis=0)[0])):
            one, other = (guides[k] for k in order[:, place])
            corner = crossing(one.line, other.line)
            reach = 1.5 * max(one.reach_m, other.reach_m)
            if corner is not None and np.linalg.norm(corner - uv[place]) <= reach:
                moved[place] = corner
    return moved


def _follows(uv: FloatArray, guide: Guide) -> Any:
    """Which places lie beside a stretch of a guide."""
    along = guide.line.along(uv)[:, None]
    beside = ((along >= guide.runs[:, 0]) & (along <= guide.runs[:, 1])).any(axis=1)
    return beside & (np.abs(guide.line.across(uv)) <= guide.reach_m)


def crossing(one: Line, other: Line) -> FloatArray | None:
    """Return where two lines of a chart cross (2,); None where the angle between them is below 10 degrees."""
    across = float(other.normal @ one.direction)
    if abs(across) < _PARALLEL:
        return None
    along = float(other.normal @ (other.point - one.point)) / across
    return np.asarray(one.at(np.array(along)), dtype=np.float64)
