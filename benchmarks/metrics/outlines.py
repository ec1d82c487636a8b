# SPDX-License-Identifier: MIT
"""Outlines, corners and openings of inferred area against those of the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.metrics.inferred import Hypothesis, PairCounts
from benchmarks.metrics.truth import Sight, TrueCells, TrueModel
from scenes.checks import BoolArray, FloatArray

BAND_M = 0.02
_CORNER_REACH_M = 0.1  # a corner without an inferred outline this near has been missed


@dataclass(frozen=True, slots=True, eq=False)
class OutlineErrors:
    """Outline of one surface, in its chart.

    `in_both`, `in_either` (n_strata,) float: square metres of the bands of 2 cm inside both outlines, hidden
    part, by stratum.
    """

    # (n,) float: For each hidden cell at the true outline, the distance to the outline of seen and inferred
    # area
    contour_m: FloatArray
    in_both: FloatArray
    in_either: FloatArray


def outline_errors(
    cells: TrueCells, inferred: BoolArray, stratum: NDArray[np.int8], n_strata: int
) -> OutlineErrors:
    """Compare the outlines of what is and of what was seen or inferred.

    Gaps of up to four cells between what is seen and what was inferred are closed: there the rim of a pixel
    was measured. Boundary IoU as in Cheng et al., "Boundary IoU", CVPR 2021, with a band of 2 cm, on the
    hidden part.
    `cells`: a surface as the scans see it. `inferred` (rows, columns) bool: cells not seen at which the
    surface was inferred. `stratum` (rows, columns) int8: stratum that each cell counts for. `n_strata`: how
    many there are.
    """
    known = cells.sight != Sight.OUT
    true, found = cells.visible | cells.reachable, _closed(cells.visible | inferred, cells.chart.grid.wraps)
    true_rim = cells.reachable & _touches(~cells.chart.present & known)
    found_rim = found & _touches(~found & known)
    contour = np.full(int(true_rim.sum()), np.inf)
    if found_rim.any():
        contour = ndimage.distance_transform_edt(~found_rim, sampling=cells.chart.grid.cell[::-1])[true_rim]
    bands = [_band(region, known, cells.chart.grid.cell) & cells.in_view for region in (true, found)]
    area = cells.chart.grid.cell_area
    both, either = bands[0] & bands[1], bands[0] | bands[1]
    return OutlineErrors(
        contour,
        np.bincount(stratum[both], minlength=n_strata).astype(np.float64) * area,
        np.bincount(stratum[either], minlength=n_strata).astype(np.float64) * area,
    )


def _closed(region: BoolArray, wraps: bool) -> BoolArray:
    """The region with gaps of up to four cells closed."""
    margin = ((3, 3), (3, 3))
    around = np.pad(region, margin, mode="wrap") if wraps else np.pad(region, margin)
    if wraps:
        around[:3] = around[-3:] = False
    return np.asarray(ndimage.binary_closing(around, np.ones((5, 5)))[3:-3, 3:-3], dtype=np.bool_)


def _touches(mask: BoolArray) -> BoolArray:
    """Cells with one of their four neighbours in `mask`."""
    return np.asarray(ndimage.binary_dilation(mask), dtype=np.bool_)


def _band(region: BoolArray, known: BoolArray, cell: FloatArray) -> BoolArray:
    """Cells of the region within the band of where it is known to end."""
    beyond = known & ~region
    if not beyond.any():
        return np.zeros_like(region)
    return np.asarray(region & (ndimage.distance_transform_edt(~beyond, sampling=cell[::-1]) <= BAND_M))


def corner_errors(cells: TrueCells, hypothesis: Hypothesis) -> FloatArray:
    """How far (k,) the inferred outline strays from each hidden corner of a surface, metres.

    A corner is hidden where the surface beside it is reachable but not seen. What counts is the largest
    distance to the outline from the corner itself and from the true outline 3 cm to either side, where that
    is hidden too: an outline that passes the corner without a turn misses it. inf beyond 10 cm.
    """
    places = cells.chart.grid.surface.from_uv(cells.chart.corners.reshape(-1, 2))
    is_hidden = _hidden(cells, places)
    corner_hidden = is_hidden.reshape(-1, 3)[:, 0]
    edges = outline_edges(hypothesis, hypothesis.true_surface[hypothesis.surface] == cells.chart.surface)
    if not len(edges) or not corner_hidden.any():
        return np.full(int(corner_hidden.sum()), np.inf)
    start, way = edges[:, 0], edges[:, 1] - edges[:, 0]
    length2 = np.maximum(np.einsum("ij,ij->i", way, way), 1e-18)
    asked = is_hidden & np.repeat(corner_hidden, 3)
    apart = np.zeros(len(places))
    apart[asked] = [_to_segments(place, start, way, length2) for place in places[asked]]
    largest = apart.reshape(-1, 3).max(axis=1)[corner_hidden]
    return np.where(largest <= _CORNER_REACH_M, largest, np.inf)


def hidden_corners(cells: TrueCells) -> FloatArray:
    """The hidden corners (k, 3) of a surface, world coordinates, in the order of `corner_errors`."""
    corners = cells.chart.grid.surface.from_uv(cells.chart.corners[:, 0])
    return corners[_hidden(cells, corners)]


def _hidden(cells: TrueCells, places: FloatArray) -> BoolArray:
    """Which places (n, 3) have reachable surface beside them, and none that is seen."""
    beside = ndimage.maximum_filter(cells.reachable, 3) & ~ndimage.maximum_filter(cells.visible, 3)
    index, cell = cells.chart.grid.cells_of(places)
    is_hidden = np.zeros(len(places), dtype=np.bool_)
    is_hidden[index] = beside.ravel()[cell]
    return is_hidden


def _to_segments(point: FloatArray, start: FloatArray, way: FloatArray, length2: FloatArray) -> float:
    along = np.clip(np.einsum("ij,ij->i", point - start, way) / length2, 0.0, 1.0)
    return float(np.linalg.norm(start + along[:, None] * way - point, axis=1).min())


def outline_edges(hypothesis: Hypothesis, chosen: BoolArray) -> FloatArray:
    """Edges (n, 2, 3) that only one of the chosen faces has; vertices within a micrometre are one."""
    faces = hypothesis.faces[chosen]
    if not len(faces):
        return np.zeros((0, 2, 3))
    used, index = np.unique(faces, return_inverse=True)
    place, welded = np.unique(hypothesis.vertices[used].round(6), axis=0, return_inverse=True)
    corner = welded.reshape(-1)[index].reshape(-1, 3)
    edges = np.sort(np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]]), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    single, count = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(place[single[count == 1]], dtype=np.float64)


_SEEN_SHARE = 0.1  # of an opening's area that beams must go through for it to be known at all
_OUT_SHARE = 0.1  # of it that may lie out of view
_SAME_IOU = 0.5
_STEP_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class OpeningScore:
    """Openings right, wrong and missed, and how far their edges stray.

    `edge_m`, `hidden_edge_m` (n,) and (k,) float: distance of places on the true edges, 1 cm apart, from the
    found ones, metres: all of those openings that were found, and of them those that no scan sees.
    """

    counts: PairCounts  # openings
    edge_m: FloatArray
    hidden_edge_m: FloatArray


def match_openings(model: TrueModel, cells: Sequence[TrueCells], hypothesis: Hypothesis) -> OpeningScore:
    """Match found openings with true ones of the same surface: the same at an IoU of a half.

    True openings that hardly a beam goes through (less than a tenth), or of which more than a tenth is out
    of view, are not asked for; what is found of them is not wrong.
    """
    by_surface = {cell.chart.surface: cell for cell in cells}
    right, missed, edges, hidden = 0, 0, [np.zeros(0)], [np.zeros(0)]
    settled: set[int] = set()  # found openings that are no longer wrong
    for opening in model.openings:
        cell = by_surface.get(opening.surface)
        if cell is None:
            continue
        true = shapely.Polygon(cell.chart.grid.surface.to_uv(opening.outline))
        found = _found_in(cell, hypothesis)
        overlap = {k: _iou(true, polygon) for k, polygon in found.items() if k not in settled}
        best = max(overlap, key=lambda k: overlap[k], default=-1)
        matches = best >= 0 and overlap[best] >= _SAME_IOU
        if matches:
            settled.add(best)
            errors, is_hidden = _edge_errors(cell, true, found[best])
            edges.append(errors)
            hidden.append(errors[is_hidden])
        if _is_asked_for(cell, true):
            right, missed = right + matches, missed + (not matches)
        else:
            settled |= {
                k for k, polygon in found.items() if true.intersection(polygon).area > polygon.area / 2
            }
    return OpeningScore(
        PairCounts(right, len(hypothesis.openings) - len(settled), missed),
        np.concatenate(edges),
        np.concatenate(hidden),
    )


def _found_in(cell: TrueCells, hypothesis: Hypothesis) -> dict[int, shapely.Polygon]:
    """Openings found in the surfaces that continue this one, in its chart, by their number."""
    return {
        number: shapely.Polygon(cell.chart.grid.surface.to_uv(opening.outline)).buffer(0)
        for number, opening in enumerate(hypothesis.openings)
        if hypothesis.true_surface[opening.surface] == cell.chart.surface
    }


def _iou(one: shapely.Polygon, other: shapely.Polygon) -> float:
    return float(one.intersection(other).area / max(one.union(other).area, 1e-12))


def _is_asked_for(cell: TrueCells, opening: shapely.Polygon) -> bool:
    uv = cell.chart.grid.centres_uv()
    sight = cell.sight[shapely.contains_xy(opening, uv[..., 0], uv[..., 1])]
    seen, out = (sight == Sight.FREE).sum(), (sight == Sight.OUT).sum()
    return bool(len(sight) and seen >= _SEEN_SHARE * len(sight) and out <= _OUT_SHARE * len(sight))


def _edge_errors(
    cell: TrueCells, true: shapely.Polygon, found: shapely.Polygon
) -> tuple[FloatArray, BoolArray]:
    """Distance of places on the true edges from the found ones, and whether each place is hidden."""
    ring, grid = true.exterior, cell.chart.grid
    places = shapely.line_interpolate_point(ring, np.arange(0.0, ring.length, _STEP_M))
    column, row = np.floor((shapely.get_coordinates(places) - grid.corner) / grid.cell).astype(np.int64).T
    last_row, last_column = np.array(grid.shape) - 1
    sight = cell.sight[np.clip(row, 0, last_row), np.clip(column, 0, last_column)]
    return np.asarray(shapely.distance(places, found.boundary), dtype=np.float64), sight == Sight.HIDDEN
