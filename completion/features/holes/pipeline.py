# SPDX-License-Identifier: MIT
"""Hole patterns on one page: rows, grids and bolt circles of equal holes in plates, and their acceptance.

The null: how evident patterns become on plates without any, of which patches were lost.
Measured on 125 simulated blank plates, 30 % of them lost in discs, ellipses, strips, stars, clouds and
rectangles, 10 % outliers (`python -m benchmarks run hole-nulls --first 80000 --n 125`): of each kind the
greatest evidence of those patterns that nothing else refuses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from completion.features.engine.template import (
    FeatureSide,
    FeatureStatus,
    Given,
    Measurements,
    TemplateFit,
    best_first,
)
from completion.features.holes import limits
from completion.features.holes.circles import N_SECTORS, candidates
from completion.features.holes.lattices import count_range, lattices, proposals
from completion.features.holes.pattern_evidence import (
    Ground,
    WeighedPattern,
    are_notches,
    best_window,
    climb_pattern,
    cut_ends,
    open_sides,
)
from completion.features.holes.patterns import (
    CIRCLE,
    GRID,
    KINDS,
    LEAST_SEEN,
    PARAMETERS,
    ROW,
    PatternRefinement,
    assign_faces,
    refine,
    sharpen_pattern,
    walls,
)
from completion.features.holes.plates import (
    HolePlate,
    PlateSurvey,
    openings,
    plates,
    rim_corners,
    scatter_points,
    survey,
)
from scenes.checks import BoolArray, FloatArray, InputError, IntArray

_N_PLATES = 125
_TAIL = {ROW: (0.3, 0.2, 2.1), GRID: (-1.3, 0.2, 2.5), CIRCLE: (3.5, 0.2, 2.3)}
"""Of each kind: nats, the share of plates that show a pattern beyond them, and the nats in which that falls
by e; one standard deviation more than was measured."""


def false_fit_probability(kind: str, evidence: float, *, n_kinds: int = 1) -> float:
    """Return how probably a blank plate with losses shows as evident a pattern of any kind asked for.

    The tail of the most evident pattern of a kind on a plate, with all places, radii and pitches that were
    tried, times the kinds that were (Bonferroni). Tails are exponential; no less is quoted than one in as
    many plates as were simulated.
    """
    start, share, scale = _TAIL[kind]
    if evidence < start:
        return 1.0
    return float(np.clip(n_kinds * share * np.exp(-(evidence - start) / scale), 1 / _N_PLATES, 1.0))


_KIND_NAMES = {"hole-row": "row", "hole-grid": "grid", "bolt-circle": "bolt circle"}


def fit_of(
    survey: PlateSurvey,
    weighed: WeighedPattern,
    refined: PatternRefinement,
    assignment: IntArray,
    given: Mapping[str, float],
    *,
    n_kinds: int,
) -> TemplateFit:
    """Return the fit in space: parameters with covariance, a side a hole, and the decision.

    `assignment` (n,) numbers the faces of the input's points: 1 the plate, 2 and on its holes' walls.
    Patterns of `n_kinds` were looked for.
    """
    pattern, plate = refined.pattern, survey.plate
    names, x, slopes = _in_space(plate, refined)
    covariance = slopes @ refined.covariance @ slopes.T
    across = np.zeros(len(x))
    across[:3] = plate.frame[2]
    covariance += np.outer(across, across) * plate.noise**2 / max(int(plate.is_on.sum()), 1)
    probability = false_fit_probability(pattern.kind, weighed.evidence, n_kinds=n_kinds)
    status, reason = _decision(weighed, probability, _spread(refined), survey.spacing)
    least, most = count_range(pattern, weighed.seen, survey)
    if status is FeatureStatus.FOUND and least < most:
        doubt = f"{least} to {most} holes: nothing was measured where the others would be"
        reason = f"{reason}; {doubt}" if reason else doubt
    return TemplateFit(
        kind=pattern.kind,
        status=status,
        names=names,
        x=x,
        covariance=covariance,
        sides=_sides(weighed, refined),
        evidence=weighed.evidence,
        false_fit_probability=probability,
        faces=("plate", *(f"hole {k + 1}" for k in range(pattern.count))),
        assignment=assignment,
        evaluations=refined.evaluations,
        reason=reason,
        geometry={
            "count": pattern.count,
            "count_range": (least, most),
            **({"counts": list(pattern.shape)} if pattern.kind == GRID else {}),
            "centres": plate.space(pattern.centres),
            "radius": pattern.radius,
            "axis": plate.frame[2],
        },
        held=tuple(name for name in names if name in given),
    )


def no_pattern(kind: str, n_points: int, reason: str) -> TemplateFit:
    """Return that there is no pattern of a kind, and why."""
    empty = np.zeros(0)
    return TemplateFit(
        kind=kind, status=FeatureStatus.NONE, names=(), x=empty, covariance=np.zeros((0, 0)), sides=(),
        evidence=0.0, faces=(), assignment=np.zeros(n_points, np.int64), reason=reason,
    )  # fmt: skip


def _in_space(plate: HolePlate, refined: PatternRefinement) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    """Names (k,), values (k,), and derivatives (k, p + 1) by the chart's parameters and the radius."""
    pattern = refined.pattern
    along, across = plate.frame[:2]
    cosine, sine = np.cos(pattern.x[2]), np.sin(pattern.x[2])
    names = [f"{what}_{axis}" for what in ("centre", "direction") for axis in "xyz"]
    names += [*PARAMETERS[pattern.kind][3:], "radius"]
    x = [
        *plate.space(pattern.x[None, :2])[0],
        *(cosine * along + sine * across),
        *pattern.x[3:],
        pattern.radius,
    ]
    slopes = np.zeros((len(x), len(pattern.x) + 1))
    slopes[:3, :2] = plate.frame[:2].T
    slopes[3:6, 2] = cosine * across - sine * along
    slopes[6:, 3:] = np.eye(len(x) - 6)
    return tuple(names), np.array(x), slopes


def _sides(weighed: WeighedPattern, refined: PatternRefinement) -> tuple[FeatureSide, ...]:
    """One side a hole: sectors of its rim that were seen, or all against it where it is filled."""
    sides = []
    for k, deviation in enumerate(_spread(refined)):
        confirmed = int(weighed.rims[k].sum()) if weighed.seen[k] else 0
        contradicted = N_SECTORS if weighed.filled[k] else 0
        sides.append(FeatureSide(f"hole {k + 1}", confirmed, contradicted, N_SECTORS, float(deviation)))
    return tuple(sides)


def _spread(refined: PatternRefinement) -> FloatArray:
    """Standard deviation (count,) of each hole's place in the direction in which it is known worst."""
    slopes = refined.pattern.slopes
    covariance = np.einsum("nip,pq,njq->nij", slopes, refined.covariance[:-1, :-1], slopes)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0)))


def _decision(
    weighed: WeighedPattern, probability: float, spread: FloatArray, spacing: float
) -> tuple[FeatureStatus, str]:
    """Whether a pattern is believed, and why not, or what is doubtful of it."""
    what, seen = _KIND_NAMES[weighed.pattern.kind], int(weighed.seen.sum())
    least = LEAST_SEEN[weighed.pattern.kind]
    if seen < least:
        return FeatureStatus.NONE, f"only {seen} holes of the {what} were seen, {least} are needed"
    if probability > limits.DOUBTFUL_FITS:
        return (
            FeatureStatus.NONE,
            f"lost patches make a {what} as regular on {probability:.0%} of blank plates",
        )
    if are_notches(weighed.pattern, weighed.rims, weighed.seen):
        return FeatureStatus.NONE, f"all holes of the {what} are open on the same side: they are no holes"
    if weighed.blocked:
        return (
            FeatureStatus.NONE,
            f"beams came back from behind the plate, but none through the {what}: lost data",
        )
    if np.median(spread[weighed.seen]) > limits.SOFT_PLACE * spacing:
        return FeatureStatus.NONE, f"nothing holds the {what} in its place: its circles could slide"
    absent, unseen = weighed.filled, ~weighed.seen & ~weighed.filled
    if absent.sum() + unseen.sum() > seen:
        return FeatureStatus.NONE, f"{seen} of {len(absent)} holes of the {what} were seen, less than half"
    if weighed.joined:
        return FeatureStatus.AMBIGUOUS, f"no plate between neighbours of the {what}: slots look like it"
    if open_sides(weighed.rims[weighed.seen]).all():
        return (
            FeatureStatus.AMBIGUOUS,
            f"every hole of the {what} is open on a side: notches and slots look like it",
        )
    if probability > limits.FALSE_FITS:
        return (
            FeatureStatus.AMBIGUOUS,
            f"lost patches make a {what} as regular on {probability:.0%} of blank plates",
        )
    sentences = [f"{_hole_numbers(which)} {_is(which)} {why}" for which, why in
            ((absent, "absent: measured surface fills it"), (unseen, "unseen")) if which.any()]  # fmt: skip
    return FeatureStatus.FOUND, "; ".join(sentences)


def _hole_numbers(which: BoolArray) -> str:
    numbers = [str(k + 1) for k in np.flatnonzero(which)]
    return f"hole{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"


def _is(which: BoolArray) -> str:
    return "are" if which.sum() > 1 else "is"


def distinct(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """Leave out of fits of one kind, the best first, those whose holes lie over a better one's.

    Holes seen from both faces of a plate are the same holes: places are compared along the axis.
    """
    kept = list[TemplateFit]()
    for fit in fits:
        if not any(_overlap(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _overlap(first: TemplateFit, second: TemplateFit) -> bool:
    """Whether holes of two patterns with one axis lie over one another."""
    axis, radius = np.asarray(second.geometry["axis"]), float(str(second.geometry["radius"]))
    if abs(float(axis @ np.asarray(first.geometry["axis"]))) < limits.PARALLEL:
        return False
    gap = np.asarray(first.geometry["centres"])[:, None] - np.asarray(second.geometry["centres"])
    gap = gap - (gap @ axis)[..., None] * axis
    return bool((np.linalg.norm(gap, axis=2) < radius).any())


_MOST_CLIMBED = 12  # lattices through pairs that are moved to where they are most evident
_MOST = 3  # patterns of one kind in one plate that are refined


def find_holes(
    measured: Measurements, kinds: Sequence[str], given: Given, *, rng: np.random.Generator, budget: int
) -> list[TemplateFit]:
    """Find rows, grids and bolt circles of equal holes in the flat parts of what was measured.

    A hole is a circle with nothing of the plate inside and plate around it. So is a patch that was lost; but
    lost patches have no equal radii at equal distances, no beam comes back from behind the plate through
    them, and no wall of a bore stands on their rims. Whole patterns are weighed, never single holes.

    Parameters
    ----------
    measured : Measurements
        Points, the triangles of a mesh, or a scan with its beams, in any unit.
    kinds : sequence of str
        Of "hole-row", "hole-grid" and "bolt-circle".
    given : mapping
        What is known and held: "radius", "pitch", "pitch_2", "circle_radius", "count", "count_2".
    rng : Generator
        Where the draws come from.
    budget : int
        Draws of refinement at most; what is found with them is marked as not complete.

    Returns
    -------
    list of TemplateFit
        All that was found or may be, the best first; of a kind without any, what came nearest. Each has a
        side a hole: confirmed, contradicted (measured surface fills it) or unseen.

    Raises
    ------
    InputError
        Another kind, or a value that is not positive.
    """
    _check(kinds, given)
    # a mesh is looked at as points all over it
    looked_at = scatter_points(measured, rng=rng)
    fits, spent = list[TemplateFit](), 0
    for plate in plates(looked_at, rng=rng):
        ground = _survey_plate(plate, looked_at, given)
        for kind in kinds:
            for begun in _lattices(kind, ground, given):
                coarse, refined = _together(begun, ground, measured, given, rng=rng)
                faces = assign_faces(refined.pattern, plate, ground.opened, measured.points)
                weighed = ground.weigh(refined.pattern, coarse, limits.SOFT_REFINED)
                fits.append(fit_of(ground.survey, weighed, refined, faces, given, n_kinds=len(kinds)))
                spent += refined.evaluations
                if spent >= budget:
                    return _choose_fits(fits, kinds, measured, is_complete=False)
    return _choose_fits(fits, kinds, measured, is_complete=True)


def _survey_plate(plate: HolePlate, looked_at: Measurements, given: Given) -> Ground:
    """Step 1: the plate as it was measured, what went through it, and circles with nothing inside."""
    surveyed = survey(plate)
    opened = openings(plate, looked_at, surveyed.spacing)
    circles = candidates(surveyed, opened, given.get("radius"))
    return Ground(surveyed, opened, circles, surveyed.area)


def _lattices(kind: str, ground: Ground, given: Given) -> list[WeighedPattern]:
    """Step 2: lattices through like circles, those that chance explains worst, and of each the best part."""
    begun = proposals(kind, ground.candidates, ground.area, ground.survey.spacing, given)
    wide = lattices(kind, ground.candidates, ground.survey, given)
    weighed = [
        [row for row in (best_window(proposal, ground, given) for proposal in proposed) if row is not None]
        for proposed in (begun, wide)
    ]
    # two circles tell others less exactly than three: patterns through them are moved first
    promising = sorted(weighed[1], key=lambda weight: -weight.evidence)[:_MOST_CLIMBED]
    # ... and so are large circles, which many points hold
    wide_from = limits.LARGE_RADIUS * ground.survey.spacing
    every = [
        climb_pattern(weight, ground, given) if weight.pattern.radius > wide_from else weight
        for weight in weighed[0]
    ]
    every += [climb_pattern(weight, ground, given) for weight in promising]
    best = list[WeighedPattern]()
    for weight in sorted(every, key=lambda weight: -weight.evidence):
        taken = {number for other in best for number in other.chosen.tolist()}
        least = limits.FURTHER_NATS if best else limits.HOPELESS_NATS
        if weight.evidence > least and not taken & set(weight.chosen.tolist()):
            best.append(weight)
    return best[:_MOST]


def _together(
    coarse: WeighedPattern, ground: Ground, measured: Measurements, given: Given, *, rng: np.random.Generator
) -> tuple[WeighedPattern, PatternRefinement]:
    """Step 3: all holes at once, by their rims; with more holes where now more of the lattice is evident."""
    held = np.array([name in given for name in (*PARAMETERS[coarse.pattern.kind], "radius")])
    refined = refine(coarse.pattern, ground.survey, held, ~coarse.filled, rng=rng)
    moved = replace(coarse, pattern=refined.pattern)
    again = cut_ends(best_window(moved, ground, given) or moved, ground, given)
    if again.pattern.shape != coarse.pattern.shape:
        coarse = again
        refined = refine(coarse.pattern, ground.survey, held, ~coarse.filled, rng=rng)
    return coarse, _by_walls(refined, coarse.seen, ground, measured, held)


def _by_walls(
    refined: PatternRefinement, seen: BoolArray, ground: Ground, measured: Measurements, held: BoolArray
) -> PatternRefinement:
    """Step 4: by the walls of their bores, or a mesh's corners on the rims, where there are any."""
    plate = ground.survey.plate
    corners = rim_corners(measured, plate)
    on_walls = walls(refined.pattern, plate, ground.opened, measured.points if corners is None else corners)
    return sharpen_pattern(refined, on_walls, seen, ground.survey, held) or refined


def _choose_fits(
    fits: list[TemplateFit], kinds: Sequence[str], measured: Measurements, *, is_complete: bool
) -> list[TemplateFit]:
    """Step 5: of each kind what was found or may be; else what came nearest, or that there is none."""
    chosen = list[TemplateFit]()
    for kind in kinds:
        template_fit = best_first([fit for fit in fits if fit.kind == kind])
        kept = (
            distinct([fit for fit in template_fit if fit.status is not FeatureStatus.NONE])
            or template_fit[:1]
        )
        none = no_pattern(
            kind, len(measured.points), "no circles in any flat part are more regular than by chance"
        )
        chosen += kept or [none]
    return best_first([replace(fit, is_complete=is_complete) for fit in chosen])


def _check(kinds: Sequence[str], given: Given) -> None:
    """Refuse unknown kinds, and values that no pattern has."""
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no pattern of holes called {unknown[0]}; there are {', '.join(KINDS)}")
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is given as {value}; give a positive number")
