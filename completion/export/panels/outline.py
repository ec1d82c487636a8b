# SPDX-License-Identifier: MIT
"""Outline: where a completed surface ends, each part with its kind, provenance and confidence.

As polygons, a surface's cells are laid on the edges that the surface is known to have, and straightened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.boundary.continuation import Cue
from completion.boundary.edges import ChartLine, meeting_line
from completion.boundary.meshing import ChartMesh
from completion.edits.edit import SurfaceEdits
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label
from completion.export.panels import limits
from completion.export.panels.sheet import polygons_of_cells
from completion.extension.patch import Patch
from scenes.checks import BoolArray, FloatArray, Value
from scenes.surfaces.catalogue import Surface

_STEPS = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])  # to the four cells beside one


@dataclass(frozen=True, slots=True, eq=False)
class BoundarySegment(Value):
    """A stretch of outline.

    Attributes
    ----------
    kind : str
        What lies beyond it: "edge" (beams went through), "crease" (another surface), "occluded",
        "frame" (the edge of the field of view) or "no-return".
    provenance : str
        "measured", or why the inferred part ends there: a `Cue` of a continued edge, "architectural" (at the
        plane that encloses the room), "shadow-limit" (the hidden zone ends, or it is no longer probable), or
        "user" (a person says so).
    confidence : float
        Probability that the surface ends there: that it is just inside and not just outside.
    points : (n, 3) float
        Polyline, metres, working frame.
    """

    kind: str
    provenance: str
    confidence: float
    points: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class OutlineCells(Value):
    """What is said of the measured and inferred cells that others touch, n of them, row by row."""

    inside: BoolArray  # (rows, columns) all measured and inferred cells
    cells: NDArray[np.int64]  # (n, 2) row and column
    kinds: NDArray[np.str_]  # (n,) as of `BoundarySegment`
    provenances: NDArray[np.str_]  # (n,) as of `BoundarySegment`
    confidence: FloatArray  # (n,) probability that the surface ends there

    def numbers(self, chain: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which of the n the cells (k, 2) of a chain are."""
        flat = (np.ravel_multi_index((*cells.T,), self.inside.shape) for cells in (self.cells, chain))
        return np.asarray(np.searchsorted(*flat), dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class NearOutline:
    """What is known of a surface's cells beside its outline, and which is nearest to a place of the chart."""

    known: OutlineCells
    tree: cKDTree

    @classmethod
    def of(cls, grid: ChartGrid, known: OutlineCells) -> NearOutline:
        """Return it for the cells of an outline on their grid."""
        row, column = (known.cells + 0.5).T
        return cls(known, cKDTree(grid.uv_of(row, column)))

    def kinds(self, uv: FloatArray) -> NDArray[np.str_]:
        """What lies beyond the outline nearest to places (n, 2) of the chart, (n,)."""
        return np.asarray(self.known.kinds[self.tree.query(uv)[1]], dtype=np.str_)


def outline_cells(patch: Patch) -> OutlineCells:
    """Return what is said of the cells of a surface's outline."""
    inside = patch.observed | patch.hypothesised
    cells = np.argwhere(inside & ~ndimage.binary_erosion(inside, np.ones((3, 3))))
    label, still = _greatest_outside(patch, inside, cells)
    row, column = cells.T
    uv = patch.grid.uv_of(*(cells.T.astype(np.float64) + 0.5))
    at_cuts = _near(patch, uv, [cut for cut in patch.limits.cuts if cut not in patch.verdict.ends])
    kinds = np.where(at_cuts, "crease", _kinds(label))
    provenances = _provenances(patch, cells, uv, at_cuts)
    drop = np.maximum(patch.confidence[row, column] - np.maximum(still, 0.0), 0.0)
    return OutlineCells(inside, cells, kinds, provenances, np.where(provenances == "user", 1.0, drop))


def _greatest_outside(
    patch: Patch, inside: BoolArray, cells: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """The greatest label (n,) and confidence (n,) of the four cells beside each that are not inside.

    -1 for none of them. Out of sight, and beyond the grid, the surface may as well go on.
    """
    beside = cells + _STEPS[:, None]
    limit = np.array(inside.shape) - 1
    in_grid = ((beside >= 0) & (beside <= limit)).all(axis=-1)
    row, column = np.moveaxis(np.clip(beside, 0, limit), -1, 0)
    outside, label = ~inside[row, column], patch.evidence.labels[row, column].astype(np.int64)
    unknown = np.isin(label, (Label.OUT, Label.NO_RETURN, Label.UNLIT)) & patch.is_within[row, column]
    still = np.where(unknown, 1.0, patch.confidence[row, column])
    labels = (np.where(in_grid, np.where(outside, label, -1), Label.OUT), np.where(outside, still, -1.0))
    return labels[0].max(axis=0), np.where(in_grid, labels[1], 1.0).max(axis=0)


def trace_boundary(grid: ChartGrid, cells: OutlineCells) -> list[BoundarySegment]:
    """Return the outline of the measured and inferred cells, cut where its kind or provenance changes."""
    segments = []
    for chain in trace_cells(cells.inside):
        if len(chain) < limits.LEAST_CHAIN_CELLS:
            continue
        number = cells.numbers(chain)
        code = list(zip(cells.kinds[number].tolist(), cells.provenances[number].tolist(), strict=True))
        for start, end in runs_of(code):
            kind, provenance = code[start]
            stretch = np.take(chain, range(start, end + 2), axis=0, mode="wrap")
            confidence = float(np.mean(cells.confidence[number[start : end + 1]]))
            segments.append(BoundarySegment(kind, provenance, confidence, _polyline(grid, stretch)))
    return segments


def trace_cells(mask: BoolArray, *, holes: bool = True) -> list[NDArray[np.int64]]:
    """Return the outlines of a mask (rows, columns), those of its `holes` too, as closed chains of its cells.

    Each is (n, 2): row and column of neighbouring cells; the first follows the last.
    """
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    contours, _ = cv2.findContours(mask.astype(np.uint8), mode, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour[:, 0, ::-1], dtype=np.int64) for contour in contours]


def straight_corners(chain: NDArray[np.int64], slack: float, *, closed: bool) -> NDArray[np.int64]:
    """Return those cells (k, 2) of a chain (n, 2) whose polygon stays within `slack` cells of the others."""
    points = chain[:, ::-1].astype(np.int32).reshape(-1, 1, 2)
    corners = cv2.approxPolyDP(points, slack, closed=closed).reshape(-1, 2)
    return np.asarray(corners[:, ::-1], dtype=np.int64)


def _kinds(label: NDArray[np.int64]) -> NDArray[np.str_]:
    """Kind that a cell has on the outline, by the strongest label (n,) just outside."""
    return np.select(
        [
            label == Label.FREE,
            label == Label.VISIBLE,
            label == Label.OCCLUDED,
            (label == Label.NO_RETURN) | (label == Label.UNLIT),
        ],
        ["edge", "crease", "occluded", "no-return"],
        "frame",
    )


def _provenances(
    patch: Patch, cells: NDArray[np.int64], uv: FloatArray, at_cuts: BoolArray
) -> NDArray[np.str_]:
    """Provenance of cells (n, 2) on the outline with their centres (n, 2), some at what was found to cut."""
    row, column = cells.T
    beside = limits.BESIDE_CELLS * float(patch.grid.cell.max())
    result = np.full(len(cells), "shadow-limit", dtype="<U16")
    for stretch in patch.stretches:
        progress = stretch.progress(uv)
        hidden = (progress >= -beside) & (progress <= abs(stretch.end - stretch.start) + beside)
        result[hidden & (np.abs(stretch.curve.across(uv)) <= beside)] = str(stretch.provenance)
    result[at_cuts] = str(Cue.ARCHITECTURAL)
    edits, fitted = patch.verdict, patch.verdict.of_features
    joints = [joint.plane for joint in fitted.joints]
    of_feature = _near(patch, uv, joints) | _near_openings(patch, fitted)[row, column] | (patch.feature > 0)
    result[of_feature] = "feature"
    by_person = SurfaceEdits(openings=edits.openings)
    result[_near(patch, uv, edits.ends) | _near_openings(patch, by_person)[row, column]] = "user"
    return np.where(patch.hypothesised[row, column], result, "measured")


def _near_openings(patch: Patch, edits: SurfaceEdits) -> BoolArray:
    """Cells (rows, columns) within about a cell of an opening that is said."""
    crossed = np.zeros(patch.grid.shape, dtype=np.bool_)
    for side in edits.trims(patch.grid):
        crossed |= side.cells
    return np.asarray(ndimage.binary_dilation(crossed, np.ones((3, 3))), dtype=np.bool_)


def _near(patch: Patch, uv: FloatArray, others: Sequence[Surface]) -> BoolArray:
    """Places (n, 2) of the chart within one and a half cells of others that the surface ends at."""
    points = patch.grid.surface.from_uv(uv)
    near = np.zeros(len(uv), dtype=np.bool_)
    for cut in others:
        near |= cut.distance(points) <= limits.BESIDE_CELLS * float(patch.grid.cell.max())
    return near


def runs_of(code: Sequence[tuple[str, str]], least: int = 1) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal entries; short ones join what comes before, or after."""
    starts = [0, *(k for k in range(1, len(code)) if code[k] != code[k - 1])]
    kept: list[int] = []
    for start, end in zip(starts, [*starts[1:], len(code)], strict=True):
        if end - start >= least and (not kept or code[start] != code[kept[-1]]):
            kept.append(start)
    begins = [0, *kept[1:]]
    return list(zip(begins, [b - 1 for b in [*begins[1:], len(code)]], strict=True))


def _polyline(grid: ChartGrid, chain: NDArray[np.int64]) -> FloatArray:
    """World points of a chain of cells, straightened to within a cell."""
    row, column = straight_corners(chain, 1.0, closed=False).T.astype(np.float64) + 0.5
    return grid.surface.from_uv(grid.uv_of(row, column))


_STRAIGHT = 1e-6  # cells that a place between two corners is off their line
_LEAST_RING = 3  # places of a closed ring; flatter ones are no polygon


@dataclass(frozen=True, slots=True, eq=False)
class GuideLine:
    """A line of the chart that an outline is laid on."""

    line: ChartLine  # where it is
    runs: FloatArray  # (k, 2) first and last arc length of the stretches along which it counts, metres
    reach_m: float  # how far off it an outline may be


def surface_polygon(patch: Patch, mesh: ChartMesh) -> Any:
    """Measured and inferred area of a plane as polygons (shapely) of its chart, `straighten_polygon`.

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
    size, least = float(grid.cell.max()), limits.LEAST_CELLS * grid.cell_area
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
        straight += _without_small(straighten_polygon(part, guides, size, is_declined), least)
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


def guides_of(patch: Patch) -> list[GuideLine]:
    """Return a surface's own straight edges, and where it meets what encloses the room.

    Cells that are seen obliquely make a saw of an edge. An edge that was fitted to the pixels holds within
    four cells; where two surfaces meet is known better than where the pixels between them ended, so that
    it holds within ten.
    """
    cell = float(patch.grid.cell.max())
    always = np.array([[-np.inf, np.inf]])
    meetings = [meeting_line(patch.grid.surface, cut) for cut in patch.limits.cuts]
    guides = [
        GuideLine(line, always, limits.MEETING_REACH_CELLS * cell) for line in meetings if line is not None
    ]
    for edge in patch.edges:
        if isinstance(edge.curve, ChartLine):
            slack = limits.FOLD_REACH_CELLS * cell * np.array([-1.0, 1.0])
            guides.append(GuideLine(edge.curve, edge.runs + slack, limits.EDGE_REACH_CELLS * cell))
    return guides


def straighten_polygon(
    polygon: Any,
    guides: Sequence[GuideLine],
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
            stays = is_declined((uv + moved) / 2) & (
                np.linalg.norm(moved - uv, axis=1) > limits.EDGE_REACH_CELLS * cell_m
            )
            moved[stays] = uv[stays]
        return moved

    laid = shapely.transform(dense, lay) if guides else dense
    corners = _from_corners(laid, _STRAIGHT * cell_m)
    return _from_corners(_put_right(corners)).simplify(limits.OUTLINE_ERROR_CELLS * cell_m)


def _union(polygons: Any) -> Any:
    """Union of polygons that may cross themselves: by their lines, or where that fails by their rings.

    GEOS's first method may return what is not valid itself.
    """
    try:
        return shapely.union_all(shapely.make_valid(polygons))
    except shapely.GEOSException:
        return shapely.union_all(shapely.make_valid(polygons, method="structure"))


def _put_right(polygons: Any) -> Any:
    """Polygons whose rings cross themselves or each other as valid ones, ring by ring.

    A ring that became a bow tie keeps both its parts, and a hole that was laid on the outline stays open.
    """
    parts = shapely.get_parts(polygons)
    rings = [[part.exterior for part in parts], [hole for part in parts for hole in part.interiors]]
    shells, holes = (_union([shapely.Polygon(r) for r in ring]) for ring in rings)
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


def _on_guides(uv: FloatArray, guides: Sequence[GuideLine]) -> FloatArray:
    """Places moved to the nearest guide that they follow, or to where the two nearest meet."""
    across = np.stack([np.where(_follows(uv, guide), guide.line.across(uv), np.inf) for guide in guides])
    order = np.argsort(np.abs(across), axis=0, kind="stable")[:2]
    moved = uv.copy()
    for k, guide in enumerate(guides):
        near = (order[0] == k) & np.isfinite(across[k])
        moved[near] -= across[k, near, None] * guide.line.normal
    if len(guides) > 1:
        for place in np.flatnonzero(np.isfinite(np.take_along_axis(across, order[1:2], axis=0)[0])):
            first, second = (guides[k] for k in order[:, place])
            corner = intersect_lines(first.line, second.line)
            reach = 1.5 * max(first.reach_m, second.reach_m)
            if corner is not None and np.linalg.norm(corner - uv[place]) <= reach:
                moved[place] = corner
    return moved


def _follows(uv: FloatArray, guide: GuideLine) -> Any:
    """Which places lie beside a stretch of a guide."""
    along = guide.line.along(uv)[:, None]
    beside = ((along >= guide.runs[:, 0]) & (along <= guide.runs[:, 1])).any(axis=1)
    return beside & (np.abs(guide.line.across(uv)) <= guide.reach_m)


def intersect_lines(first: ChartLine, second: ChartLine) -> FloatArray | None:
    """Return where two lines of a chart cross (2,); None where the angle between them is below 10 degrees."""
    across = float(second.normal @ first.direction)
    if abs(across) < limits.GUIDE_SINE:
        return None
    along = float(second.normal @ (second.point - first.point)) / across
    return np.asarray(first.at(np.array(along)), dtype=np.float64)
