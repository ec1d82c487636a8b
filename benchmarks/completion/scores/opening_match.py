# SPDX-License-Identifier: MIT
"""Opening match: found openings against true ones, by overlap and by the error of their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from benchmarks.completion.scores.splits import PairCounts
from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.sight import Sight
from benchmarks.completion.truth.truth import TrueModel
from scenes.checks import BoolArray, FloatArray

_SEEN_SHARE = 0.1  # of an opening's area that beams must go through for it to be known at all
_OUT_SHARE = 0.1  # of it that may lie out of view
_SAME_IOU = 0.5
_STEP_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class OpeningScore:
    """Openings right, wrong and missed, and how far their edges stray.

    Attributes
    ----------
    counts : PairCounts
        Openings.
    edge_m, hidden_edge_m : (n,) and (k,) float
        Distance of places on the true edges, 1 cm apart, from the found ones, metres: all of those openings
        that were found, and of them those that no scan sees.
    """

    counts: PairCounts
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
