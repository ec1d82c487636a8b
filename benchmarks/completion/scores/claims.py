# SPDX-License-Identifier: MIT
"""Claims: how much of the inferred area is right, and how well it knew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.scores.calibration import ReasonClaims, Reliability, SurfaceErrors
from benchmarks.completion.scores.matching import NearestTruth, nearest_truth
from benchmarks.completion.truth.cells import TrueCells, nearest_index
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.samples import Samples
from benchmarks.completion.truth.sight import Sight, sight_of
from benchmarks.completion.truth.strata import Stratum
from benchmarks.completion.truth.tally import HEADLINE, N_STRATA, TOLERANCES_M
from benchmarks.completion.truth.truth import TrueModel
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

SIGHT_TOLERANCE_M = 0.02
_ROUNDING_M = 1e-5  # what noise-free fits may stray by


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """Inferred area against the truth.

    Attributes
    ----------
    claimed : (n_surfaces + 1, n_strata) float
        Square metres hidden from all scans or looked through, by true surface (the last row: none) and
        stratum.
    right : (n_surfaces + 1, n_strata, 3) float
        Of it, what lies on a true surface of the same direction within each of `TOLERANCES_M`.
    in_breaks_claimed, in_breaks_right : () and (3,) float
        The same where the scene breaks the prior.
    seen_m2, out_m2 : float
        Inferred area where the scans see a surface anyway, and in no scan's view: not scored.
    unscored_m2 : float
        Inferred area of surfaces that continue a true one that is not scored.
    violation_m2 : float
        Inferred area that noise-free beams go through.
    squared_m4 : float
        Sum over right area of area times squared distance along the normal.
    reliability, in_breaks_reliability : Reliability
        Of the confidences, everywhere and where the scene breaks the prior.
    surfaces : tuple of SurfaceErrors
        Each inferred surface against its predicted deviation.
    by_reason : tuple of ReasonClaims
        What was claimed for each reason, right within 2 cm.
    """

    claimed: FloatArray
    right: FloatArray
    in_breaks_claimed: FloatArray
    in_breaks_right: FloatArray
    seen_m2: float
    out_m2: float
    unscored_m2: float
    violation_m2: float
    squared_m4: float
    reliability: Reliability
    in_breaks_reliability: Reliability
    surfaces: tuple[SurfaceErrors, ...]
    by_reason: tuple[ReasonClaims, ...]


def judge_claims(
    model: TrueModel,
    cells: Sequence[TrueCells],
    strata: Sequence[NDArray[np.int8]],
    scans: Sequence[RangeImage],
    hypothesis: Hypothesis,
    samples: Samples,
    caster: RayCaster,
) -> Claims:
    """Compare samples of inferred area with the truth; `caster` holds the true mesh.

    Area counts for the stratum of the hidden part that is nearest to it, on the true surface where it is
    right, and on the true surface that its own surface continues where it is wrong.
    """
    sight = sight_of(samples.points, scans, caster, SIGHT_TOLERANCE_M, samples.normals).sight
    claimed = (sight == Sight.HIDDEN) | (sight == Sight.FREE)
    nearest = nearest_truth(samples, [cell.chart for cell in cells])
    right = nearest.distance[:, None] <= np.array(TOLERANCES_M)
    is_right = right[:, HEADLINE]
    counted = _is_scored(samples, hypothesis, model)
    weight = samples.areas * (claimed & counted)
    where = _attributed(
        samples,
        nearest,
        is_right=is_right,
        hypothesis=hypothesis,
        cells=cells,
        strata=strata,
        n_surfaces=len(model.surfaces),
    )
    by_surface = np.zeros((len(model.surfaces) + 1, N_STRATA))
    right_by_surface = np.zeros((*by_surface.shape, len(TOLERANCES_M)))
    np.add.at(by_surface, where, weight)
    np.add.at(right_by_surface, where, weight[:, None] * right)
    broken = model.in_breaks(samples.points)
    return Claims(
        claimed=by_surface,
        right=right_by_surface,
        in_breaks_claimed=np.asarray(weight[broken].sum()),
        in_breaks_right=(weight[:, None] * right)[broken].sum(axis=0),
        seen_m2=float(samples.areas[counted & (sight == Sight.VISIBLE)].sum()),
        out_m2=float(samples.areas[counted & (sight == Sight.OUT)].sum()),
        unscored_m2=float(samples.areas[~counted].sum()),
        violation_m2=float(samples.areas[sight == Sight.FREE].sum()),
        squared_m4=_squared(samples, nearest, cells, weight * is_right),
        reliability=Reliability.of(samples.confidence, is_right, weight),
        in_breaks_reliability=Reliability.of(samples.confidence[broken], is_right[broken], weight[broken]),
        surfaces=_surface_errors(samples, nearest.distance, hypothesis, model, weight),
        by_reason=_by_reason(samples, hypothesis, is_right, weight),
    )


def _by_reason(
    samples: Samples, hypothesis: Hypothesis, is_right: BoolArray, weight: FloatArray
) -> tuple[ReasonClaims, ...]:
    sums = (
        np.bincount(samples.reason, values, len(hypothesis.reasons)).tolist()
        for values in (weight, weight * is_right, weight * samples.confidence)
    )
    return tuple(ReasonClaims(*row) for row in zip(hypothesis.reasons, *sums, strict=True))


def _is_scored(samples: Samples, hypothesis: Hypothesis, model: TrueModel) -> BoolArray:
    """Samples of surfaces that continue a scored true surface, or none."""
    scored = np.array([*model.scored, True], dtype=np.bool_)  # -1, none, is the last
    return np.asarray(scored[hypothesis.true_surface[samples.surface]], dtype=np.bool_)


def _attributed(
    samples: Samples,
    nearest: NearestTruth,
    is_right: BoolArray,
    hypothesis: Hypothesis,
    cells: Sequence[TrueCells],
    strata: Sequence[NDArray[np.int8]],
    n_surfaces: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """True surface (`n_surfaces` for none) and stratum that each sample counts for."""
    chart_of = np.full(n_surfaces + 1, -1, np.int64)
    chart_of[[cell.chart.surface for cell in cells]] = np.arange(len(cells))
    continued = hypothesis.true_surface[samples.surface]
    chart = np.where(is_right, nearest.chart, np.where(continued < 0, -1, chart_of[continued]))
    surface = np.full(len(chart), n_surfaces, np.int64)
    stratum = np.full(len(chart), int(Stratum.NONE), np.int64)
    for index, (cell, stratum_of) in enumerate(zip(cells, strata, strict=True)):
        here = np.flatnonzero(chart == index)
        surface[here] = cell.chart.surface
        hidden = stratum_of >= 0
        if len(here) and hidden.any():
            place = _clipped_cells(cell, samples.points[here])
            stratum[here] = stratum_of.ravel()[nearest_index(hidden, cell.chart.grid.cell).ravel()[place]]
    return surface, stratum


def _clipped_cells(cell: TrueCells, points: FloatArray) -> NDArray[np.int64]:
    """Flat cell of the chart that each point falls into, the nearest one for points beside the chart."""
    grid = cell.chart.grid
    uv = (grid.surface.to_uv(points) - grid.corner) / grid.cell
    column = np.clip(np.floor(uv[:, 0]), 0, grid.shape[1] - 1).astype(np.int64)
    row = np.clip(np.floor(uv[:, 1]), 0, grid.shape[0] - 1).astype(np.int64)
    return np.asarray(row * grid.shape[1] + column, dtype=np.int64)


def _squared(
    samples: Samples, nearest: NearestTruth, cells: Sequence[TrueCells], weight: FloatArray
) -> float:
    result = 0.0
    for index, cell in enumerate(cells):
        here = (nearest.chart == index) & (weight > 0)
        across = cell.chart.grid.surface.distance(samples.points[here])
        result += float(np.sum(weight[here] * np.square(across)))
    return result


def _surface_errors(
    samples: Samples, distance: FloatArray, hypothesis: Hypothesis, model: TrueModel, weight: FloatArray
) -> tuple[SurfaceErrors, ...]:
    """Each inferred surface's errors: to the nearest true surface, and to the one it continues, unbounded."""
    result = []
    reach = 2 * samples.sd + _ROUNDING_M
    for number in np.unique(samples.surface[weight > 0]):
        here = (samples.surface == number) & (weight > 0)
        share = weight[here] / weight[here].sum()
        true = int(hypothesis.true_surface[number])
        surface = model.surfaces[true] if true >= 0 else None
        own = float("nan")
        if surface is not None:
            own = float(share @ (np.abs(surface.distance(samples.points[here])) <= reach[here]))
        within = float(share @ (distance[here] <= reach[here]))
        sd = float(np.median(samples.sd[here]))
        result.append(SurfaceErrors(float(weight[here].sum()), sd, within, own))
    return tuple(result)
