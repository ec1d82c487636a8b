# SPDX-License-Identifier: MIT
"""Openings: holes that beams went through, closed behind what hides part of them; results, not leftovers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from scipy import ndimage

from completion.boundary.edges import BoundaryEdge, ChartLine
from completion.edits.edit import FittedHole, FittedOpening, SurfaceEdits, outline_uv
from completion.evidence.chart_grid import ChartGrid
from completion.export.panels.outline import intersect_lines, straight_corners, trace_cells
from completion.extension.patch import Patch
from scenes.checks import BoolArray, FloatArray, Value

_MIN_CELLS = 25  # that beams went through
_NEAR = 1.5  # cells between an outline and the edge that it follows
_SEEN_CELLS = 2.0  # between a side and measured surface, up to which the side was seen
_FEW = 0.1  # share of the places along a side that may be wrong
_FOLLOWS = 0.6  # share of a side that must lie near one edge


@dataclass(frozen=True, slots=True, eq=False)
class OpeningSides(Value):
    """How well the n sides of an opening are known within their surface.

    Attributes
    ----------
    sd_m : (n,) float
        Standard deviation across the side, metres: of the edge that it follows, else of a cell.
    inwards_m, outwards_m : (n,) float
        How far it may be off where it is hidden: inwards to where beams went through, outwards to where the
        surface was measured; 0 where it was seen.
    measured : (n,) float
        Share of it beside which the surface was measured.
    """

    sd_m: FloatArray
    inwards_m: FloatArray
    outwards_m: FloatArray
    measured: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceOpening(Value):
    """A hole in a surface.

    Attributes
    ----------
    area_m2 : float
        Its area in square metres.
    seen_share : float
        Share of it that beams went through; the rest is hidden and inferred to be open.
    points : (n, 3) float
        Its outline, metres, working frame.
    sides : Sides
        How well each side is known, from that point to the next.
    declared : bool
        Whether a person drew it.
    feature : int
        Which feature of `features.json` it is, from 1; 0 for none.
    """

    area_m2: float
    seen_share: float
    points: FloatArray
    sides: OpeningSides
    declared: bool = False
    feature: int = 0


def find_openings(patch: Patch) -> list[SurfaceOpening]:
    """Find the holes of a surface that it encloses, together with where it ends at what encloses the room.

    To what beams went through belongs the hidden area beside it that is inferred to be no surface. A hole
    that leaves the field of view, or that borders on area of which nothing is known, is not closed and is no
    opening. Sides follow the surface's own edges where they lie near one. Declared openings come first, then
    fitted ones, and holes that they reach into are none beside them.
    """
    solid = patch.observed | patch.hypothesised
    through = ndimage.binary_closing(patch.evidence.open, np.ones((3, 3))) & ~solid
    unfilled = (patch.shadows.region >= 0) & ~solid
    within = patch.is_within | solid
    openings = [_declared_opening(patch, outline, through) for outline in patch.verdict.openings]
    openings += [_fitted_opening(patch, feature, through) for feature in patch.verdict.fitted]
    openings += [_round(patch, feature, through) for feature in patch.verdict.holes]
    undecided = within & ~solid & ~patch.verdict.open_cells(patch.grid)
    part, _ = ndimage.label((through | unfilled) & undecided)
    seen = np.bincount(part[through])
    for number in 1 + np.flatnonzero(seen[1:] >= _MIN_CELLS):
        hole = part == number
        if not _is_closed(hole, solid, within):
            continue
        outline = _outline(patch.grid, hole, patch.edges)
        if outline is not None:
            corners, side_sd = outline
            sides = _sides(patch, corners, side_sd)
            area = float(shapely.Polygon(corners).area)
            share = min(float(seen[number] / hole.sum()), 1.0)
            openings.append(SurfaceOpening(area, share, patch.grid.surface.from_uv(corners), sides))
    return openings


def _declared_opening(patch: Patch, outline: FloatArray, through: BoolArray) -> SurfaceOpening:
    """An opening that a person drew."""
    corners = outline_uv(patch.grid.surface, outline)
    area = float(shapely.Polygon(corners).area)
    inside = SurfaceEdits(openings=(outline,)).open_cells(patch.grid)
    seen = float((through & inside).sum()) * patch.grid.cell_area
    known = np.zeros(len(corners))
    sides = OpeningSides(known, known, known, measured=known)
    return SurfaceOpening(
        area, min(seen / area, 1.0), patch.grid.surface.from_uv(corners), sides, declared=True
    )


def _fitted_opening(patch: Patch, fitted: FittedOpening, through: BoolArray) -> SurfaceOpening:
    """An opening that was fitted as a whole: its sides are as well known as the fit says."""
    corners = outline_uv(patch.grid.surface, fitted.outline)
    area = float(shapely.Polygon(corners).area)
    inside = SurfaceEdits(openings=(fitted.outline,)).open_cells(patch.grid)
    seen = float((through & inside).sum()) * patch.grid.cell_area
    inwards, outwards = fitted.slack.T
    sides = OpeningSides(fitted.deviation, inwards, outwards, measured=fitted.seen)
    return SurfaceOpening(area, min(seen / area, 1.0), fitted.outline, sides, feature=fitted.number)


def _round(patch: Patch, hole: FittedHole, through: BoolArray) -> SurfaceOpening:
    """A hole of a fitted pattern."""
    outline = _declared_opening(patch, hole.outline, through)
    ones = np.ones(len(hole.outline))
    sides = OpeningSides(hole.deviation * ones, 0 * ones, 0 * ones, measured=hole.seen * ones)
    return replace(outline, sides=sides, declared=False, feature=hole.number)


def _is_closed(hole: BoolArray, solid: BoolArray, within: BoolArray) -> bool:
    """Tell whether all that borders on a hole is surface, or lies beyond where the surface ends."""
    if hole[0].any() or hole[-1].any() or hole[:, 0].any() or hole[:, -1].any():
        return False
    rim = ndimage.binary_dilation(hole) & ~hole
    near_solid = ndimage.binary_dilation(solid, np.ones((3, 3)))
    return bool(np.mean(near_solid[rim] | ~within[rim]) > 0.98) and bool(solid[rim].any())


def _outline(
    grid: ChartGrid, hole: BoolArray, edges: Sequence[BoundaryEdge]
) -> tuple[FloatArray, FloatArray] | None:
    """The hole's outline (n, 2) in the chart, its sides laid on the edges that they follow; their sd (n,)."""
    filled = ndimage.binary_fill_holes(hole)
    scaled = np.kron(filled, np.ones((2, 2), np.uint8))  # so that contours run along the cells' sides
    chain = max(trace_cells(scaled, holes=False), key=len)
    if len(chain) < 8:
        return None
    corners = straight_corners(chain, 2.5, closed=True)
    if len(corners) < 3:
        return None
    cells = (chain + 0.5) / 2
    uv = grid.uv_of(cells[:, 0], cells[:, 1])
    start = [int(np.flatnonzero((chain == corner).all(axis=1))[0]) for corner in corners]
    sides = [_side(uv, start[k], start[(k + 1) % len(start)], grid, edges) for k in range(len(start))]
    merged = [side for k, side in enumerate(sides) if side.line is not sides[k - 1].line]
    if len(merged) < 3:
        return uv[start], np.array([side.sd for side in sides])
    corner = [intersect_lines(merged[k - 1].line, side.line) for k, side in enumerate(merged)]
    places = [side.start if at is None else at for side, at in zip(merged, corner, strict=True)]
    return np.array(places), np.array([side.sd for side in merged])


def _sides(patch: Patch, corners: FloatArray, sd: FloatArray) -> OpeningSides:
    """How far each side of an outline (n, 2) of the chart may lie inwards and outwards."""
    cell = float(patch.grid.cell.max())
    sign = 1.0 if shapely.is_ccw(shapely.LinearRing(corners)) else -1.0
    reaches = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.linalg.norm(end - start))
        share = (np.arange(max(int(length / cell), 1)) + 0.5) / max(int(length / cell), 1)
        places = start + share[:, None] * (end - start)
        outwards = sign * np.array([end[1] - start[1], start[0] - end[0]]) / max(length, 1e-12)
        beyond = _until(patch.grid, patch.observed, places, outwards)
        within = _until(patch.grid, patch.evidence.open, places, -outwards)
        reaches.append(
            [
                float(max(np.quantile(within, _FEW) - _SEEN_CELLS * cell, 0.0)),
                float(max(np.quantile(beyond, _FEW) - _SEEN_CELLS * cell, 0.0)),
                float(np.mean(beyond <= _SEEN_CELLS * cell)),
            ]
        )
    inwards, out, measured = np.array(reaches).T
    return OpeningSides(sd, inwards, out, measured=measured)


def _until(grid: ChartGrid, cells: BoolArray, places: FloatArray, along: FloatArray) -> FloatArray:
    """How far (n,) it is from places (n, 2) of the chart along a direction to the next of some cells.

    To the border of the grid where there is none.
    """
    step = float(grid.cell.min()) / 2
    reach = np.arange(int(np.ceil(np.hypot(*(np.array(grid.shape[::-1]) * grid.cell)) / step))) * step
    at = places[:, None] + reach[None, :, None] * along
    column, row = np.moveaxis(np.floor((at - grid.corner) / grid.cell).astype(np.int64), -1, 0)
    column = column % grid.shape[1] if grid.wraps else column
    inside = (row >= 0) & (row < grid.shape[0]) & (column >= 0) & (column < grid.shape[1])
    met = ~inside
    met[inside] = cells[row[inside], column[inside]]
    return np.asarray(np.where(met.any(axis=1), reach[np.argmax(met, axis=1)], reach[-1]))


@dataclass(frozen=True, slots=True, eq=False)
class _OpeningSide:
    line: ChartLine
    start: FloatArray
    sd: float  # of the line across itself, metres


def _side(
    uv: FloatArray, first: int, last: int, grid: ChartGrid, edges: Sequence[BoundaryEdge]
) -> _OpeningSide:
    """The line of an edge that the stretch of outline follows, else the line through its points."""
    stretch = uv[first : last + 1] if last > first else np.concatenate([uv[first:], uv[: last + 1]])
    near = _NEAR * float(grid.cell.max())
    share, line, sd = 0.0, None, float(grid.cell.max())
    for edge in edges:
        if isinstance(edge.curve, ChartLine):
            follows = float(np.mean(np.abs(edge.curve.across(stretch)) <= near))
            if follows > max(share, _FOLLOWS):
                share, line, sd = follows, edge.curve, float(np.hypot(edge.deviation, edge.common))
    if line is None:
        middle = stretch.mean(axis=0)
        vectors = np.linalg.svd(stretch - middle)[2]
        line = ChartLine(middle, vectors[0])
    return _OpeningSide(line, stretch[0], sd)
