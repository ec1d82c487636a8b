# SPDX-License-Identifier: MIT
"""Score of a completion against the truth: right and wrong inferred area, hidden area that was inferred."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.metrics.inferred import (
    HEADLINE,
    N_STRATA,
    TOLERANCES_M,
    Hypothesis,
    PairCounts,
    ReasonClaims,
    Reliability,
    Samples,
    SurfaceErrors,
    Tally,
    sample,
)
from benchmarks.metrics.outlines import OpeningScore, corner_errors, match_openings, outline_errors
from benchmarks.metrics.truth import (
    FARTHEST_M,
    SAME_WAY,
    Sight,
    Stratum,
    TrueCells,
    TrueChart,
    TrueModel,
    nearest_index,
    sight_of,
    strata_of,
)
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Surface

_LIFT_M = 1e-4  # rays start this far off, so that area in place is met


@dataclass(frozen=True, slots=True, eq=False)
class NearestTruth:
    """What true surface each sample is nearest to."""

    # (n,) float: Distance to the bounded true surfaces of the same direction, metres; inf beyond 5 cm
    distance: FloatArray
    chart: NDArray[np.int32]  # (n,) int32: Index of the chart, -1 where there is none


def nearest_truth(samples: Samples, charts: Sequence[TrueChart]) -> NearestTruth:
    """Find the nearest true surface, of the same direction within 10 degrees, to each sample."""
    distance = np.full(len(samples.points), np.inf)
    nearest = np.full(len(samples.points), -1, np.int32)
    for index, chart in enumerate(charts):
        apart = chart.distances(samples.points, samples.normals)
        closer = apart < distance
        distance[closer], nearest[closer] = apart[closer], index
    return NearestTruth(distance, nearest)


def inferred_distances(cells: TrueCells, hypothesis: Hypothesis, caster: RayCaster) -> FloatArray:
    """Distance (rows, columns) across the surface from cells that are not seen to inferred area there.

    By rays along the normals into the inferred mesh, both ways. inf where there is no inferred area of the
    same direction within 5 cm, and for cells that are visible or out of view.
    """
    grid = cells.chart.grid
    result = np.full(cells.sight.size, np.inf)
    asked = np.flatnonzero((cells.hidden | (~cells.chart.present & cells.in_view)).ravel())
    if not len(asked) or not len(hypothesis.faces):
        return result.reshape(grid.shape)
    points = grid.centres()[asked]
    normals = grid.surface.normal(points)
    for way in (normals, -normals):
        hits = caster.first_hit(points - _LIFT_M * way, way)
        parallel = hits.hit & (hits.incidence_cosine >= SAME_WAY) & (hits.ranges <= FARTHEST_M + _LIFT_M)
        met = asked[parallel]
        result[met] = np.minimum(result[met], np.abs(hits.ranges[parallel] - _LIFT_M))
    return result.reshape(grid.shape)


def hidden_distances(cells: TrueCells, across: FloatArray, samples: Samples) -> FloatArray:
    """Distance (n,) from each reachable hidden cell, in order, to inferred area of the same direction.

    Where inferred area lies before or behind the cell it is the distance `across`, beside its edges the
    distance to `samples` of it. inf beyond 5 cm.
    """
    result = across[cells.reachable]
    missed = ~np.isfinite(result)
    points = cells.chart.grid.centres()[cells.reachable.ravel()][missed]
    result[missed] = _to_samples(points, samples, _parallel(samples, cells.chart))
    return result


def _parallel(samples: Samples, chart: TrueChart) -> BoolArray:
    """Samples near the unbounded surface and of its direction."""
    surface = chart.grid.surface
    near = np.abs(surface.distance(samples.points)) <= FARTHEST_M
    near[near] = (
        np.abs(np.einsum("ij,ij->i", surface.normal(samples.points[near]), samples.normals[near])) >= SAME_WAY
    )
    return np.asarray(near, dtype=np.bool_)


def _to_samples(points: FloatArray, samples: Samples, chosen: BoolArray) -> FloatArray:
    if not chosen.any() or not len(points):
        return np.full(len(points), np.inf)
    distance, _ = cKDTree(samples.points[chosen]).query(points, distance_upper_bound=FARTHEST_M)
    return np.asarray(distance, dtype=np.float64)


SIGHT_TOLERANCE_M = 0.02
_ROUNDING_M = 1e-5  # what noise-free fits may stray by


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """Inferred area against the truth.

    `in_breaks_claimed`, `in_breaks_right` () and (3,) float: the same where the scene breaks the prior.
    `seen_m2`, `out_m2`: inferred area where the scans see a surface anyway, and in no scan's view: not
    scored. `reliability`, `in_breaks_reliability`: of the confidences, everywhere and where the scene breaks
    the prior.
    """

    # (n_surfaces + 1, n_strata) float: Square metres hidden from all scans or looked through, by true surface
    # (the last row: none) and stratum
    claimed: FloatArray
    # (n_surfaces + 1, n_strata, 3) float: Of it, what lies on a true surface of the same direction within
    # each of `TOLERANCES_M`
    right: FloatArray
    in_breaks_claimed: FloatArray
    in_breaks_right: FloatArray
    seen_m2: float
    out_m2: float
    unscored_m2: float  # inferred area of surfaces that continue a true one that is not scored
    violation_m2: float  # inferred area that noise-free beams go through
    squared_m4: float  # sum over right area of area times squared distance along the normal
    reliability: Reliability
    in_breaks_reliability: Reliability
    surfaces: tuple[SurfaceErrors, ...]  # each inferred surface against its predicted deviation
    by_reason: tuple[ReasonClaims, ...]  # what was claimed for each reason, right within 2 cm


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


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """Hidden true area against what was inferred.

    `in_breaks_hidden`, `in_breaks_found` () and (3,) float: the same where the scene breaks the prior.
    `out_of_frame_m2`, `unreachable_m2`: outside the claim: area of seen surfaces that is in no scan's view
    (S5), and hidden area apart from all that is seen. `contour_m`, `corner_m` (n,) float: errors of hidden
    outlines and hidden corners, metres; inf for what was missed. `band_in_both`, `band_in_either` (n_strata,)
    float: square metres of the bands of the boundary IoU.
    """

    # (n_surfaces + 1, n_strata) float: Reachable hidden square metres by true surface and stratum; the last
    # row is empty
    hidden: FloatArray
    # (n_surfaces + 1, n_strata, 3) float: Of it, what has inferred area of its direction within each of
    # `TOLERANCES_M`
    found: FloatArray
    in_breaks_hidden: FloatArray
    in_breaks_found: FloatArray
    visible_m2: float  # area that is seen
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


def radius_errors(
    model: TrueModel,
    scans: Sequence[RangeImage],
    found: Sequence[Surface],
    true_surface: NDArray[np.int32],
    min_pixels: int = 200,
) -> FloatArray:
    """Return |radius found - true radius| (n,) in metres for each scored cylinder in view; inf if missed.

    `model`: the truth. `scans`: with truth; a cylinder with fewer than `min_pixels` in all of them is not
    asked for. `found`: found surfaces, largest first; the first cylinder that continues the true one counts.
    `true_surface` (k,) int: for each found surface the id of the true one that it continues, -1 for none.
    """
    pixels = np.zeros(len(model.surfaces), np.int64)
    for scan in scans:
        if scan.truth is not None:
            met = scan.truth.surface[scan.truth.surface >= 0]
            pixels += np.bincount(met, minlength=len(pixels))
    errors = []
    for index, true in enumerate(model.surfaces):
        if isinstance(true, Cylinder) and model.scored[index] and pixels[index] >= min_pixels:
            radii = (
                surface.radius
                for surface, continued in zip(found, true_surface, strict=True)
                if continued == index and isinstance(surface, Cylinder)
            )
            errors.append(abs(next(radii, np.inf) - true.radius))
    return np.array(errors, dtype=np.float64)


_SAMPLE_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """One completion against the truth."""

    claims: Claims  # how much of what was inferred is right
    findings: Findings  # how much of what is hidden was inferred
    openings: OpeningScore  # openings found and missed

    @property
    def areas(self) -> Tally:
        """Areas by true surface (the last row: none) and stratum."""
        claims, findings = self.claims, self.findings
        return Tally(findings.hidden, findings.found, claims.claimed, claims.right)

    @property
    def in_breaks(self) -> Tally:
        """Areas where the scene breaks the prior, without axes."""
        claims, findings = self.claims, self.findings
        return Tally(
            findings.in_breaks_hidden,
            findings.in_breaks_found,
            claims.in_breaks_claimed,
            claims.in_breaks_right,
        )


def score(
    model: TrueModel,
    cells: Sequence[TrueCells],
    scans: Sequence[RangeImage],
    hypothesis: Hypothesis,
    *,
    n_threads: int | None = None,
) -> Score:
    """Score inferred area against the truth.

    A place of inferred area is claimed where it is hidden from all scans or looked through by some, and
    right within 1, 2 or 5 cm of a true surface of the same direction. A hidden place of a true surface that
    is connected with what is seen of it is found where inferred area of its direction is as near.
    `model`: the truth. `cells`: what `look` makes of it with the same scans. `scans`: simulated scans with
    truth. `hypothesis`: what was inferred from them, world coordinates. `n_threads`: threads that cast.
    Raises InputError: a scan without truth.
    """
    strata = [strata_of(cell) for cell in cells]
    samples = sample(hypothesis, _SAMPLE_M)
    caster = RayCaster(model.mesh.vertices, model.mesh.faces, n_threads)
    return Score(
        judge_claims(
            model, cells, strata=strata, scans=scans, hypothesis=hypothesis, samples=samples, caster=caster
        ),
        judge_findings(
            model, cells, strata=strata, hypothesis=hypothesis, samples=samples, n_threads=n_threads
        ),
        match_openings(model, cells, hypothesis),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One method on one case.

    `hypothesised_m2`, `violation_m2`: inferred area, and by our audit how much of it beams went through.
    """

    case: str  # name of the case
    breaks_prior: bool  # whether the scene breaks the prior (S7)
    method: str  # a mode of ours, with or without a cue, or a baseline
    noise: str  # what the scans err by
    score: Score  # what came of it
    # parts of surfaces joined across occluders; empty for baselines, whose segmentation is the truth
    merges: PairCounts
    # (n,) float: For each true cylinder in view how far its radius is missed, metres; inf where no cylinder
    # was found
    radius_m: FloatArray
    hypothesised_m2: float
    violation_m2: float
    kinds: tuple[tuple[str, int], ...]  # kind of furniture and surface id, for figures by kind
    # what a sweep measures on the noise-free rays of the case, see there; NaN elsewhere
    measured: float = float("nan")
