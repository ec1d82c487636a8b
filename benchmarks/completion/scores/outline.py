# SPDX-License-Identifier: MIT
"""Outlines: where inferred area ends, against where the hidden surface really ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.sight import Sight
from scenes.checks import BoolArray, FloatArray

BAND_M = 0.02
_CORNER_REACH_M = 0.1  # a corner without an inferred outline this near has been missed


@dataclass(frozen=True, slots=True, eq=False)
class OutlineErrors:
    """Outline of one surface, in its chart.

    Attributes
    ----------
    contour_m : (n,) float
        For each hidden cell at the true outline, the distance to the outline of seen and inferred area.
    in_both, in_either : (n_strata,) float
        Square metres of the bands of 2 cm inside both outlines, hidden part, by stratum.
    """

    contour_m: FloatArray
    in_both: FloatArray
    in_either: FloatArray


def outline_errors(
    cells: TrueCells, inferred: BoolArray, stratum: NDArray[np.int8], n_strata: int
) -> OutlineErrors:
    """Compare the outlines of what is and of what was seen or inferred.

    Parameters
    ----------
    cells : TrueCells
        A surface as the scans see it.
    inferred : (rows, columns) bool
        Cells not seen at which the surface was inferred.
    stratum : (rows, columns) int8
        Stratum that each cell counts for.
    n_strata : int
        How many there are.

    Notes
    -----
    Gaps of up to four cells between what is seen and what was inferred are closed: there the rim of a pixel
    was measured. Boundary IoU as in Cheng et al., "Boundary IoU", CVPR 2021, with a band of 2 cm, on the
    hidden part.
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
