# SPDX-License-Identifier: MIT
"""Findings: how much of the hidden true area was inferred, and how true its outlines and corners are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.scores.matching import hidden_distances, inferred_distances
from benchmarks.completion.scores.outline import corner_errors, outline_errors
from benchmarks.completion.truth.cells import TrueCells, nearest_index
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.samples import Samples
from benchmarks.completion.truth.sight import Sight
from benchmarks.completion.truth.tally import HEADLINE, N_STRATA, TOLERANCES_M
from benchmarks.completion.truth.truth import TrueModel
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Hidden true area against what was inferred.

    Attributes
    ----------
    hidden : (n_surfaces + 1, n_strata) float
        Reachable hidden square metres by true surface and stratum; the last row is empty.
    found : (n_surfaces + 1, n_strata, 3) float
        Of it, what has inferred area of its direction within each of `TOLERANCES_M`.
    in_breaks_hidden, in_breaks_found : () and (3,) float
        The same where the scene breaks the prior.
    visible_m2 : float
        Area that is seen.
    out_of_frame_m2, unreachable_m2 : float
        Outside the claim: area of seen surfaces that is in no scan's view (S5), and hidden area apart from
        all that is seen.
    contour_m, corner_m : (n,) float
        Errors of hidden outlines and hidden corners, metres; inf for what was missed.
    band_in_both, band_in_either : (n_strata,) float
        Square metres of the bands of the boundary IoU.
    """

    hidden: FloatArray
    found: FloatArray
    in_breaks_hidden: FloatArray
    in_breaks_found: FloatArray
    visible_m2: float
    out_of_frame_m2: float
    unreachable_m2: float
    contour_m: FloatArray
    corner_m: FloatArray
    band_in_both: FloatArray
    band_in_either: FloatArray


def judge_findings(
    model: TrueModel,
    cells: Sequence[TrueCells],
    strata: Sequence[NDArray[np.int8]],
    hypothesis: Hypothesis,
    samples: Samples,
    n_threads: int | None = None,
) -> Findings:
    """Compare the hidden cells of all true surfaces with the inferred area."""
    caster = RayCaster(hypothesis.vertices, hypothesis.faces, n_threads)
    hidden = np.zeros((len(model.surfaces) + 1, N_STRATA))
    found = np.zeros((*hidden.shape, len(TOLERANCES_M)))
    in_breaks, bands = np.zeros(1 + len(TOLERANCES_M)), np.zeros((2, N_STRATA))
    contours, corners = [np.zeros(0)], [np.zeros(0)]
    for cell, stratum_of in zip(cells, strata, strict=True):
        if not cell.reachable.any():
            continue
        area, index = cell.chart.grid.cell_area, cell.chart.surface
        across = inferred_distances(cell, hypothesis, caster)
        close = hidden_distances(cell, across, samples)[:, None] <= np.array(TOLERANCES_M)
        here = stratum_of[cell.reachable]
        np.add.at(hidden[index], here, area)
        np.add.at(found[index], here, area * close)
        broken = model.in_breaks(cell.chart.grid.centres()[cell.reachable.ravel()])
        in_breaks += area * np.array([broken.sum(), *close[broken].sum(axis=0)])
        counts_for = stratum_of.ravel()[nearest_index(stratum_of >= 0, cell.chart.grid.cell)]
        outline = outline_errors(cell, across <= TOLERANCES_M[HEADLINE], counts_for, N_STRATA)
        contours.append(outline.contour_m)
        corners.append(corner_errors(cell, hypothesis))
        bands += np.stack([outline.in_both, outline.in_either])
    return Findings(
        hidden=hidden,
        found=found,
        in_breaks_hidden=np.asarray(in_breaks[0]),
        in_breaks_found=in_breaks[1:],
        visible_m2=_area(cells, [cell.visible for cell in cells]),
        out_of_frame_m2=_area(
            cells, [cell.chart.present & (cell.sight == Sight.OUT) & cell.visible.any() for cell in cells]
        ),
        unreachable_m2=_area(cells, [cell.hidden & ~cell.reachable for cell in cells]),
        contour_m=np.concatenate(contours),
        corner_m=np.concatenate(corners),
        band_in_both=bands[0],
        band_in_either=bands[1],
    )


def _area(cells: Sequence[TrueCells], masks: Sequence[BoolArray]) -> float:
    """Square metres of the masks' cells, one mask for each surface."""
    areas = (mask.sum() * cell.chart.grid.cell_area for cell, mask in zip(cells, masks, strict=True))
    return float(sum(areas))
