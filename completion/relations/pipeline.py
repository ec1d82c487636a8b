# SPDX-License-Identifier: MIT
"""Relations on one page: from fits to what they are to each other, and to fits for which that holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from completion.fitting.result import SurfaceFit
from completion.relations.engine.estimate import NO_DOUBT, Doubt, Estimate
from completion.relations.engine.relation import Relation, Status
from completion.relations.engine.wald import with_only
from completion.relations.evidence import size_of
from completion.relations.examination import by_evidence, examine, settle_conflict, without_evidence, worst_of
from completion.relations.graph import RelationGraph
from completion.relations.options import RelationOptions
from completion.relations.proposals import STAGES, propose
from completion.relations.tolerance import with_tolerance
from scenes.checks import InputError


def infer(
    fits: Sequence[SurfaceFit],
    given: Sequence[Relation] = (),
    options: RelationOptions = RelationOptions(),
    *,
    doubt: Doubt = NO_DOUBT,
    proposes: bool = True,
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
    estimate = Estimate(fits, options.up, options.built_sd, doubt)
    options = with_tolerance(options, propose(0, estimate, options), estimate)
    estimate = Estimate(fits, options.up, options.built_sd, doubt)
    size_m, found = size_of(fits), list[Relation]()
    stated = [replace(one, is_given=True) for one in given if not one.is_forbidden]
    forbidden = {_key(one) for one in given if one.is_forbidden}

    # 2. Examine: directions first, then angles, places, radii and distances; in each stage what a person
    #    states, then what is proposed, the strongest evidence first. Each is tested given those before it.
    for stage, kinds in enumerate(STAGES):
        n_found = len(found)
        todo = [one for one in stated if one.kind in kinds]
        known = {_key(one) for one in [*stated, *found]} | forbidden
        for proposed in (False, True):
            if proposed:
                new = propose(stage, estimate, options) if proposes else []
                unknown = [one for one in new if _key(one) not in known]
                todo = by_evidence(unknown, estimate, options, size_m)
            level = options.level / max(len(todo), 1)
            for relation in todo:
                tested = examine(relation, estimate, options, size_m, level)
                if tested.conflicts and tested.is_given:
                    estimate, found, tested = _settled(tested, estimate, found)
                found.append(_with_conflicts(tested, found))
                estimate.settle()
        if len(found) > n_found:
            estimate.solve()

    # 3. Release: an accepted relation that all others together contradict goes, the worst first.
    while (worst := worst_of(estimate, options.level)) is not None:
        reason = "all other relations together contradict it"
        found = _refused(found, worst[0], Status.REJECTED, reason, p=worst[1])
        estimate = _again(found, estimate)

    # 4. Weigh: what was proposed stays where all that hangs together has evidence enough.
    weak = without_evidence([one.relation for one in estimate.imposed])
    for relation in weak:
        reason = "it is met, but so little hangs together with it that it may be by chance"
        found = _refused(found, relation, Status.UNDECIDED, reason)
    if weak:
        estimate = _again(found, estimate)
    return RelationGraph.of(estimate, found, options)


def impose(
    fits: Sequence[SurfaceFit],
    relations: Sequence[Relation],
    options: RelationOptions = RelationOptions(),
    *,
    doubt: Doubt = NO_DOUBT,
) -> RelationGraph:
    """Test the relations that a person states, and impose those that hold; see `infer`."""
    return infer(fits, relations, options, doubt=doubt, proposes=False)


def _settled(
    refused: Relation, estimate: Estimate, found: list[Relation]
) -> tuple[Estimate, list[Relation], Relation]:
    """Where another had better go than what was refused, that goes, and this is accepted."""
    worst = settle_conflict(refused, estimate)
    if worst is None:
        return estimate, found, refused
    reason = "what contradicts it fits better without it"
    found = _refused(found, worst, Status.REJECTED, reason)
    accepted = replace(
        refused, status=Status.ACCEPTED, reason="what contradicted it was rejected", conflicts=()
    )
    estimate = _again([*found, accepted], estimate)
    return estimate, found, accepted


def _with_conflicts(tested: Relation, found: Sequence[Relation]) -> Relation:
    """The relation with its conflicts by their places among all found, not among those that are imposed."""
    if not tested.conflicts:
        return tested
    accepted = [k for k, one in enumerate(found) if one.status is Status.ACCEPTED]
    return replace(tested, conflicts=tuple(accepted[k] for k in tested.conflicts))


def _refused(
    relations: Sequence[Relation], which: Relation, status: Status, reason: str, p: float | None = None
) -> list[Relation]:
    """The relations with one of them not accepted after all; its p stays unless another is given."""
    changed = replace(which, status=status, reason=reason, p=which.p if p is None else p)
    return [changed if one is which else one for one in relations]


def _again(relations: Sequence[Relation], estimate: Estimate) -> Estimate:
    """The estimate made anew with what is accepted, in the same order."""
    return with_only([one for one in relations if one.status is Status.ACCEPTED], estimate)


def _key(relation: Relation) -> tuple[object, ...]:
    """What makes two relations the same, whatever their value."""
    if relation.kind == "regular":
        return relation.kind, frozenset(relation.surfaces)
    pairs = [frozenset(relation.surfaces[k : k + 2]) for k in range(0, len(relation.surfaces), 2)]
    return relation.kind, frozenset(pairs)
