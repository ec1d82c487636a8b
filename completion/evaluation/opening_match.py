# SPDX-License-Identifier: MIT
"""Opening match: found openings against true ones, by overlap and by the error of their edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from completion.evaluation.cells import TrueCells
from completion.evaluation.hypothesis import Hypothesis
from completion.evaluation.sight import Sight
from completion.evaluation.splits import PairCounts
from completion.evaluation.truth import TrueModel
from scenes.checks import FloatArray

_SEEN_SHARE = 0.1  # of an opening's area that beams must go through for it to be known at all
_OUT_SHARE = 0.1  # of it that may lie out of view
_SAME_IOU = 0.5
_STEP_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class OpeningScore:
    """Openings right, wrong and missed, and distances (n,) of true edges from the found ones, metres."""

    counts: PairCounts
    edge_m: FloatArray


def match_openings(model: TrueModel, cells: Sequence[TrueCells], hypothesis: Hypothesis) -> OpeningScore:
    """Match found openings with true ones of the same surface: the same at an IoU of a half.

    True openings that hardly a beam goes through (less than a tenth), or of which more than a tenth is out
    of view, are not asked for; what is found of them is not wrong.
    """
    by_surface = {cell.chart.surface: cell for cell in cells}
    right, missed, edges = 0, 0, [np.zeros(0)]
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
            edges.append(_edge_errors(true, found[best]))
        if _is_asked_for(cell, true):
            right, missed = right + matches, missed + (not matches)
        else:
            settled |= {
                k for k, polygon in found.items() if true.intersection(polygon).area > polygon.area / 2
            }
    return OpeningScore(
        PairCounts(right, len(hypothesis.openings) - len(settled), missed), np.concatenate(edges)
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


def _edge_errors(true: shapely.Polygon, found: shapely.Polygon) -> FloatArray:
    ring = true.exterior
    places = shapely.line_interpolate_point(ring, np.arange(0.0, ring.length, _STEP_M))
    return np.asarray(shapely.distance(places, found.boundary), dtype=np.float64)
