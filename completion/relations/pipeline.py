# SPDX-License-Identifier: MIT
"""Relations on one page: from fits to relations, and to fits and surfaces of scans for which these hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from completion.edits.application import EditedSurface, surface_at
from completion.edits.edit import Anchor
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.sensor_modes import range_displacements
from completion.observe.tolerance import POSE_BOUND
from completion.relations import limits
from completion.relations.equations import ANGLE
from completion.relations.estimate import (
    NO_DOUBT,
    Doubt,
    JointEstimate,
    WaldTest,
    multiplier_tests,
    wald_test,
    what_determines,
    with_only,
)
from completion.relations.evidence import CHOSEN, log_evidence, near, size_of
from completion.relations.graph import RelationGraph, is_settled
from completion.relations.options import RelationOptions
from completion.relations.proposals import STAGES, propose
from completion.relations.relation import Relation, RelationStatus, StatedRelation
from completion.uncertainty.joint_errors import UNRELATED, JointErrors, RelatedErrors
from completion.uncertainty.pipeline import StatedFits, shift_by_sensors
from scenes.checks import FloatArray, InputError, Value
from scenes.pose import Pose
from scenes.scan.range_image import MESH_SENSOR

_NOTHING = 1e-9  # of the greatest misfit: rounding
_MOST_MEMBERS = 12  # of a conflict that is settled by trying


def by_evidence(
    relations: Sequence[Relation], estimate: JointEstimate, options: RelationOptions, size_m: float
) -> list[Relation]:
    """Return the relations in the order of the evidence for them where the surfaces are now."""
    evidence = [
        log_evidence(relation, wald_test(relation, estimate), estimate, options, size_m)
        for relation in relations
    ]
    return [relations[k] for k in sorted(range(len(relations)), key=lambda k: (-evidence[k], k))]


def examine(
    relation: Relation, estimate: JointEstimate, options: RelationOptions, size_m: float, level: float
) -> Relation:
    """Return the relation with its status, given what is imposed; one that is accepted is imposed.

    What is determined already is implied or redundant where it holds, else rejected: those that determine it
    are its conflicts. What misses by more than chance is rejected. A proposal without evidence is undecided.
    """
    test = wald_test(relation, estimate)
    tested = replace(relation, p=test.p, chi2=test.chi2, rank=len(test.rows))
    if not test.is_met:
        against = tuple(what_determines(test.constraint, estimate)) if estimate.imposed else ()
        reason = f"{_misfit(test)} off, though others determine it"
        return replace(tested, status=RelationStatus.REJECTED, p=0.0, reason=reason, conflicts=against)
    if not test.rows:
        status = RelationStatus.REDUNDANT if relation.is_given else RelationStatus.IMPLIED
        return replace(tested, status=status, reason="others say it already")
    evidence = log_evidence(relation, test, estimate, options, size_m)
    tested = replace(tested, log_evidence=evidence)
    if test.p < level:
        reason = f"{_misfit(test)} off, which is {np.sqrt(test.chi2):.1f} standard deviations"
        return replace(tested, status=RelationStatus.REJECTED, reason=reason)
    least = limits.LEAST_ALONE if relation.kind in CHOSEN else limits.LEAST_LOG_EVIDENCE
    if not relation.is_given and evidence < least:
        word = "it hardly holds" if test.p < limits.HARDLY else "that well it may be met by chance"
        reason = f"{_misfit(test)} off: {word}, and the evidence is weak"
        return replace(tested, status=RelationStatus.UNDECIDED, reason=reason)
    accepted = replace(tested, status=RelationStatus.ACCEPTED)
    if not estimate.impose(accepted, test.rows):
        reason = f"{_misfit(test)} off: it would leave a surface no radius"
        return replace(tested, status=RelationStatus.REJECTED, reason=reason)
    return accepted


def settle_conflict(refused: Relation, estimate: JointEstimate) -> Relation | None:
    """Return the accepted relation that had better go than the one that was refused; None where none had.

    All that contradict each other are left out in turn; the best is the one without which the surfaces are
    moved least. Proposals are not set against what a person stated.
    """
    against = [estimate.imposed[k].relation for k in refused.conflicts]
    rivals = [relation for relation in against if relation.is_given == refused.is_given or refused.is_given]
    if not rivals or len(against) > _MOST_MEMBERS:
        return None
    kept = [relation.relation for relation in estimate.imposed]
    least, worst = estimate.cost, None
    for rival in rivals:
        cost = with_only([*(relation for relation in kept if relation is not rival), refused], estimate).cost
        if cost < least:
            least, worst = cost, rival
    return worst


def worst_of(estimate: JointEstimate, level: float) -> tuple[Relation, float] | None:
    """Return the accepted relation that the others contradict most, and its p; None where none does.

    By its multiplier, given all others, at the level for so many tests.
    """
    if not estimate.imposed:
        return None
    values = multiplier_tests(estimate)
    least = int(np.argmin(values))
    if values[least] >= level / len(values):
        return None
    return estimate.imposed[least].relation, values[least]


def without_evidence(relations: Sequence[Relation]) -> list[Relation]:
    """Return the accepted proposals that hang together in groups with too little evidence in all."""
    group: dict[int, set[int]] = {}
    for relation in relations:
        members = set(relation.surfaces).union(*(group.get(surface, set()) for surface in relation.surfaces))
        for member in members:
            group[member] = members
    total: dict[int, float] = {}
    for relation in relations:
        gain = np.inf if relation.is_given else relation.log_evidence
        key = id(group[relation.surfaces[0]])
        total[key] = total.get(key, 0.0) + gain
    return [relation for relation in relations if total[id(group[relation.surfaces[0]])] < limits.LEAST_GROUP]


def _misfit(test: WaldTest) -> str:
    """How far the equations are from 0, in words."""
    misfits: list[str] = []
    least = _NOTHING * float(np.abs(test.constraint.value).max())
    for value, what in zip(test.constraint.value, test.constraint.rows, strict=True):
        if abs(value) < least:
            continue
        size = f"{np.degrees(abs(value)):.3g} deg" if what == ANGLE else f"{1000 * abs(value):.3g} mm"
        misfits.append(size)
    angles = [text for text in misfits if text.endswith("deg")]
    lengths = [text for text in misfits if text.endswith("mm")]
    return " and ".join(
        max(lines, key=lambda text: float(text.split()[0])) for lines in (angles, lengths) if lines
    )


_TRIED = np.radians(np.geomspace(1e-4, 1.0, 81))
_LEVER_M = 1.0  # over which an angle is an error of a length


def with_tolerance(
    options: RelationOptions, relations: Sequence[Relation], estimate: JointEstimate
) -> RelationOptions:
    """Return the options with a tolerance, where none is given.

    The most probable one by the misfits of `relations` between directions: normal, with the variance of the
    fits and the tolerance, or anything within 10 deg where nobody meant it; before these a tenth of a degree,
    within a factor of 4.5 or so. Lengths have the same tolerance over a metre.
    """
    if options.tolerance_deg is not None:
        return options
    log_posterior = -0.5 * np.square(np.log(_TRIED / limits.USUAL_TOLERANCE) / limits.TOLERANCE_SPREAD)
    for relation in relations:
        constraint = estimate.constraint(relation)
        log_posterior = log_posterior + _log_likelihood(
            constraint.value, np.diag(estimate.variance(constraint))
        )
    angle = float(_TRIED[int(np.argmax(log_posterior))])
    length = options.tolerance_m if options.tolerance_m is not None else angle * _LEVER_M
    return replace(options, tolerance_deg=float(np.degrees(angle)), tolerance_m=length)


def _log_likelihood(misfit: FloatArray, variance: FloatArray) -> FloatArray:
    """Of a relation's misfits (m,) with these variances (m,), for each tolerance that is tried (k,)."""
    total = variance[:, None] + np.square(_TRIED)
    log_meant = -0.5 * (np.log(2 * np.pi * total) + np.square(misfit)[:, None] / total).sum(axis=0)
    log_chance = -len(misfit) * np.log(2 * limits.ASIDE)
    return np.asarray(
        np.logaddexp(np.log(limits.MEANT_SHARE) + log_meant, np.log(1 - limits.MEANT_SHARE) + log_chance)
    )


def infer(
    fits: Sequence[SurfaceFit],
    given: Sequence[Relation] = (),
    options: RelationOptions = RelationOptions(),
    *,
    doubt: Doubt = NO_DOUBT,
    proposes: bool = True,
    candidates: Sequence[Relation] = (),
) -> RelationGraph:
    """Infer the relations between surfaces, reject those that do not hold, and impose the rest.

    After Fisher (2004), Applying knowledge to reverse engineering problems, section 2, where relations are
    stated and imposed; here they are proposed and tested as well, by the covariances of the fits.

    Parameters
    ----------
    fits : sequence of SurfaceFit
        Planes, spheres, cylinders, cones and tori, in one frame, with covariances that hold.
    given : sequence of Relation
        What a person states, and what he forbids (`is_forbidden`): surfaces by their places in `fits`.
    options : RelationOptions
        How exactly things are built, which values are round.
    doubt : Doubt
        How well the covariances are known, and what errors the surfaces share.
    proposes : bool
        Whether relations are inferred; else only the given ones are tested and imposed (`impose`).
    candidates : sequence of Relation
        What comes into question besides what is proposed, such as neighbours that may be tangent.

    Raises
    ------
    InputError
        A relation of surfaces that there are not, or that these cannot have; a surface without relations.
    """
    # 1. Begin: every fit is where it is, known as well as its covariance says, on its own.
    for relation in given:
        if not all(0 <= number < len(fits) for number in relation.surfaces):
            raise InputError(
                f"{relation.kind} of surfaces {list(relation.surfaces)}: there are {len(fits)}, from 0"
            )
    estimate = JointEstimate(fits, options.up, options.built_sd, doubt)
    options = with_tolerance(options, propose(0, estimate, options), estimate)
    estimate = JointEstimate(fits, options.up, options.built_sd, doubt)
    size_m, relations = size_of(fits), list[Relation]()
    stated = [replace(relation, is_given=True) for relation in given if not relation.is_forbidden]
    forbidden = {_key(relation) for relation in given if relation.is_forbidden}

    # 2. Examine: directions first, then angles, places, radii and distances; in each stage what a person
    #    states, then what is proposed, the strongest evidence first. Each is tested given those before it.
    for stage, kinds in enumerate(STAGES):
        n_found = len(relations)
        todo = [relation for relation in stated if relation.kind in kinds]
        known = {_key(relation) for relation in [*stated, *relations]} | forbidden
        for proposed in (False, True):
            if proposed:
                new = propose(stage, estimate, options) if proposes else []
                new += [each for one in candidates if one.kind in kinds for each in near(one, estimate)]
                unknown = list({_key(one): one for one in new if _key(one) not in known}.values())
                todo = by_evidence(unknown, estimate, options, size_m)
            level = options.level / max(len(todo), 1)
            for relation in todo:
                tested = examine(relation, estimate, options, size_m, level)
                if tested.conflicts and tested.is_given:
                    estimate, relations, tested = _accept_instead(tested, estimate, relations)
                relations.append(_with_conflicts(tested, relations))
                estimate.settle()
        if len(relations) > n_found:
            estimate.solve()

    # 3. Release: an accepted relation that all others together contradict goes, the worst first.
    while (worst := worst_of(estimate, options.level)) is not None:
        reason = "all other relations together contradict it"
        relations = _withdraw(relations, worst[0], RelationStatus.REJECTED, reason, p=worst[1])
        estimate = _again(relations, estimate)

    # 4. Weigh: what was proposed stays where all that hangs together has evidence enough.
    weak = without_evidence([relation.relation for relation in estimate.imposed])
    for relation in weak:
        reason = "it is met, but so little hangs together with it that it may be by chance"
        relations = _withdraw(relations, relation, RelationStatus.UNDECIDED, reason)
    if weak:
        estimate = _again(relations, estimate)
    return RelationGraph.of(estimate, relations, options)


def impose(
    fits: Sequence[SurfaceFit],
    relations: Sequence[Relation],
    options: RelationOptions = RelationOptions(),
    *,
    doubt: Doubt = NO_DOUBT,
) -> RelationGraph:
    """Test the relations that a person states, and impose those that hold; see `infer`."""
    return infer(fits, relations, options, doubt=doubt, proposes=False)


def _accept_instead(
    refused: Relation, estimate: JointEstimate, relations: list[Relation]
) -> tuple[JointEstimate, list[Relation], Relation]:
    """Where another had better go than what was refused, that goes, and this is accepted."""
    worst = settle_conflict(refused, estimate)
    if worst is None:
        return estimate, relations, refused
    reason = "what contradicts it fits better without it"
    relations = _withdraw(relations, worst, RelationStatus.REJECTED, reason)
    accepted = replace(
        refused, status=RelationStatus.ACCEPTED, reason="what contradicted it was rejected", conflicts=()
    )
    estimate = _again([*relations, accepted], estimate)
    return estimate, relations, accepted


def _with_conflicts(tested: Relation, relations: Sequence[Relation]) -> Relation:
    """The relation with its conflicts numbered among all `relations` instead of the accepted ones."""
    if not tested.conflicts:
        return tested
    accepted = [k for k, relation in enumerate(relations) if relation.status is RelationStatus.ACCEPTED]
    return replace(tested, conflicts=tuple(accepted[k] for k in tested.conflicts))


def _withdraw(
    relations: Sequence[Relation],
    which: Relation,
    status: RelationStatus,
    reason: str,
    p: float | None = None,
) -> list[Relation]:
    """The relations with one of them not accepted after all; its p stays unless another is given."""
    changed = replace(which, status=status, reason=reason, p=which.p if p is None else p)
    return [changed if relation is which else relation for relation in relations]


def _again(relations: Sequence[Relation], estimate: JointEstimate) -> JointEstimate:
    """The estimate made anew with what is accepted, in the same order."""
    return with_only(
        [relation for relation in relations if relation.status is RelationStatus.ACCEPTED], estimate
    )


def _key(relation: Relation) -> tuple[object, ...]:
    """What makes two relations the same, whatever their value."""
    if relation.kind == "regular":
        return relation.kind, frozenset(relation.surfaces)
    pairs = [frozenset(relation.surfaces[k : k + 2]) for k in range(0, len(relation.surfaces), 2)]
    return relation.kind, frozenset(pairs)


MOST_LEAST, LEAST_LEAST, LEAST_SHARE = 1_200, 200, 0.004
"""Pixels of a surface that relations are inferred of: that share of a scan's, between the other two."""
_N_SAMPLE = 1_000  # pixels that tell how far a surface was moved off what was measured


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceRelations(Value):
    """What was found of surfaces' relations.

    Attributes
    ----------
    graph : RelationGraph
        Surfaces where their relations hold, working frame.
    before : tuple of SurfaceFit
        The same n surfaces without, with the covariances of all errors.
    numbers : tuple of int
        Their numbers (n,) in files, from 1; 0 for one that has none.
    off_m : tuple of float
        How far each (n,) would stand off its measured points, metres: 95 % are nearer.
    is_moved : tuple of bool
        Which (n,) are where their relations hold; the others stayed where they were measured.
    """

    graph: RelationGraph
    before: tuple[SurfaceFit, ...]
    numbers: tuple[int, ...]
    off_m: tuple[float, ...]
    is_moved: tuple[bool, ...]

    def renumber(self, chosen: Sequence[bool]) -> SurfaceRelations:
        """Return it with numbers counted anew, of surfaces (m,) that are `chosen` alone."""
        anew = np.where(chosen, np.cumsum(chosen), 0)
        return replace(self, numbers=tuple(int(anew[number - 1]) for number in self.numbers))


@dataclass(frozen=True, slots=True, eq=False)
class RelatedSurfaces:
    """Surfaces where their relations hold.

    Attributes
    ----------
    surfaces : tuple of EditedSurface
        All n, in their order.
    stated : tuple of SurfaceFit
        Their fits (n,) with the covariances of all errors, given the relations.
    errors : JointErrors
        The same, jointly.
    inferred : SurfaceRelations, optional
        Which relations there are; None where nobody asked for them, or there is nothing to relate.
    """

    surfaces: tuple[EditedSurface, ...]
    stated: tuple[SurfaceFit, ...]
    errors: JointErrors
    inferred: SurfaceRelations | None = None


def relate_surfaces(
    edited: Sequence[EditedSurface],
    stated: StatedFits,
    observations: Sequence[Observation],
    options: RelationOptions | None,
    given: Sequence[StatedRelation[Anchor]] = (),
    *,
    world_from_reference: Pose,
) -> RelatedSurfaces:
    """Infer what the surfaces of scans are to each other, and move them to where that holds.

    Relations are inferred of surfaces of at least 1,200 pixels (fewer in small scans), and of all that a
    person names. A surface is
    moved where its measured points hardly show it: by less than half of their scatter about it. One that a
    sensor bent stays where it was measured, so that what is inferred of it joins what was measured.

    Parameters
    ----------
    edited : sequence of EditedSurface
        The surfaces (n,), working frame.
    stated : StatedFits
        How well they are known.
    observations : sequence of Observation
        The scans.
    options : RelationOptions, optional
        How exactly things are built, and what is looked for; None leaves the surfaces as they are.
    given : sequence of StatedRelation
        What a person states, world coordinates.
    world_from_reference : Pose
        From the working frame to the world.

    Raises
    ------
    InputError
        A person names a place where nothing was measured, or a relation that the surfaces there cannot have.
    """
    fits = [stated.total(k) for k in range(len(edited))]
    if options is None:
        return RelatedSurfaces(tuple(edited), tuple(fits), _errors(edited, fits, stated, observations))
    named = [[surface_at(edited, anchor, relation.source, observations, world_from_reference)
              for anchor in relation.surfaces] for relation in given]  # fmt: skip
    largest = max((seen.scan.ranges.size for seen in observations), default=0)
    least = float(np.clip(LEAST_SHARE * largest, LEAST_LEAST, MOST_LEAST))
    large = {
        k
        for k, (surface, fit) in enumerate(zip(edited, fits, strict=True))
        if surface.surface.n_pixels >= least and is_settled(fit)
    }
    numbers = sorted(large.union(*named))
    if not numbers:
        return RelatedSurfaces(tuple(edited), tuple(fits), _errors(edited, fits, stated, observations))
    place = {number: k for k, number in enumerate(numbers)}
    relations = [
        relation.of([place[number] for number in numbers])
        for relation, numbers in zip(given, named, strict=True)
    ]
    doubt = Doubt([stated.freedom[number] for number in numbers], stated.smooth.covariance_of(numbers))
    graph = infer([stated.fits[number] for number in numbers], relations, options, doubt=doubt)
    short = _short_covariances([edited[number].surface.fit for number in numbers], graph)
    off = [_off(edited[k].surface, fit, observations) for k, fit in zip(numbers, graph.fits, strict=True)]
    is_moved = [
        far <= limits.MOST_OFF * edited[k].surface.fit.rms for k, far in zip(numbers, off, strict=True)
    ]
    before, surfaces = tuple(fits[k] for k in numbers), list(edited)
    for number, fit, covariance, moves in zip(numbers, graph.fits, short, is_moved, strict=True):
        if moves:
            surface = edited[number].surface
            moved = replace(surface.fit, surface=fit.surface, covariance=covariance)
            surfaces[number] = replace(edited[number], surface=replace(surface, fit=moved))
            fits[number] = replace(moved, covariance=fit.covariance)
    places = tuple(number + 1 for number in numbers)
    found_relations = SurfaceRelations(graph, before, places, off_m=tuple(off), is_moved=tuple(is_moved))
    first = tuple(accumulate((len(fit.covariance) for fit in graph.fits), initial=0))
    related = RelatedErrors(tuple(numbers), first, graph.covariance, tuple(is_moved))
    return RelatedSurfaces(
        tuple(surfaces), tuple(fits), _errors(surfaces, fits, stated, observations, related), found_relations
    )


def _errors(
    edited: Sequence[EditedSurface],
    errors: Sequence[SurfaceFit],
    stated: StatedFits,
    observations: Sequence[Observation],
    related: RelatedErrors = UNRELATED,
) -> JointErrors:
    """All errors of the surfaces, jointly, those of the scans' places included."""
    shares = np.zeros((len(edited), len(observations)))
    for number, surface in enumerate(edited):
        for scan, held in surface.surface.pixels.held:
            shares[number, scan] = len(held) / surface.surface.n_pixels
    return JointErrors(
        separate=tuple(fit.covariance for fit in errors),
        shared=stated.smooth,
        related=related,
        ranges=tuple(
            shift_by_sensors(surface.surface, observations, range_displacements) for surface in edited
        ),
        freedom=stated.freedom,
        shares=shares,
        pose_sd=np.array([seen.pose_error_m for seen in observations]) / POSE_BOUND,
        is_known=not any(seen.scan.sensor == MESH_SENSOR and not seen.is_noisy for seen in observations),
    )


def _short_covariances(fits: Sequence[SurfaceFit], graph: RelationGraph) -> list[FloatArray]:
    """The covariances (k, k) of errors as long as blocks of pixels, given the relations that hold.

    These tell how far a surface may stray from where it was measured nearby, which is what its continuation
    goes by; errors of the whole image move both alike.
    """
    placed = [
        replace(fit, surface=surface_fit.surface) for fit, surface_fit in zip(fits, graph.fits, strict=True)
    ]
    estimate = with_only(graph.accepted, JointEstimate(placed, graph.options.up, graph.options.built_sd))
    return [estimate.covariance_of(number) for number in range(len(fits))]


def _off(before: MergedSurface, after: SurfaceFit, observations: Sequence[Observation]) -> float:
    points = before.points(observations, _N_SAMPLE)
    apart = after.surface.distance(points) - before.fit.surface.distance(points)
    return float(np.quantile(np.abs(apart), limits.OFF_QUANTILE)) if len(points) else 0.0
