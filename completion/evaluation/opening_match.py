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

_SEEN_SHARE = 0.1  # of an opening's area that a beam must go through for it to be known at all
_SAME_IOU = 0.5
_STEP_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class OpeningScore:
    """Openings right, wrong and missed, and distances (n,) of true edges from the found ones, metres."""

    counts: PairCounts
    edge_m: FloatArray


def match_openings(model: TrueModel, cells: Sequence[TrueCells], hypothesis: Hypothesis) -> OpeningScore:
    """Match found openings with true ones of the same surface: the same at an IoU of a half.

    True openings that no beam goes through (to less than a tenth) are neither asked for nor counted as
    wrong when found.
    """
    by_surface = {cell.chart.surface: cell for cell in cells}
    right, wrong, missed, edges = 0, 0, 0, [np.zeros(0)]
    matched: set[int] = set()
    for opening in model.openings:
        if opening.surface not in by_surface:
            continue
        cell = by_surface[opening.surface]
        surface = cell.chart.grid.surface
        true = shapely.Polygon(surface.to_uv(opening.outline))
        overlap = {
            index: _iou(true, shapely.Polygon(surface.to_uv(found.outline)).buffer(0))
            for index, found in enumerate(hypothesis.openings)
            if hypothesis.true_surface[found.surface] == opening.surface and index not in matched
        }
        best = max(overlap, key=lambda index: overlap[index], default=-1)
        seen = _share_seen(cell, true)
        if best >= 0 and overlap[best] >= _SAME_IOU:
            matched.add(best)
            right += seen >= _SEEN_SHARE
            edges.append(_edge_errors(true, surface.to_uv(hypothesis.openings[best].outline)))
        else:
            missed += seen >= _SEEN_SHARE
    wrong = len(hypothesis.openings) - len(matched)
    return OpeningScore(PairCounts(right, wrong, missed), np.concatenate(edges))


def _iou(one: shapely.Polygon, other: shapely.Polygon) -> float:
    return float(one.intersection(other).area / max(one.union(other).area, 1e-12))


def _share_seen(cell: TrueCells, opening: shapely.Polygon) -> float:
    uv = cell.chart.grid.centres_uv()
    inside = shapely.contains_xy(opening, uv[..., 0], uv[..., 1])
    return float((cell.sight[inside] == Sight.FREE).mean()) if inside.any() else 0.0


def _edge_errors(true: shapely.Polygon, found: FloatArray) -> FloatArray:
    ring = true.exterior
    places = shapely.line_interpolate_point(ring, np.arange(0.0, ring.length, _STEP_M))
    return np.asarray(shapely.distance(places, shapely.LinearRing(found)), dtype=np.float64)
