# SPDX-License-Identifier: MIT
"""Examination: what becomes of a relation, given those accepted before it, and of these in the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.relations.engine.equation import ANGLE
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation, Status
from completion.relations.engine.wald import WaldTest, multiplier_tests, wald_test, what_determines, with_only
from completion.relations.evidence import CHOSEN, LEAST_ALONE, log_evidence
from completion.relations.options import RelationOptions

LEAST_LOG_EVIDENCE = 0.7  # of a proposal by itself: hardly more than a word for it
LEAST_GROUP = float(np.log(20.0))  # of all that hang together
_HARDLY = 0.05
_NOTHING = 1e-9  # of the greatest misfit: rounding
_MOST_MEMBERS = 12  # of a conflict that is settled by trying


def by_evidence(
    relations: Sequence[Relation], estimate: Estimate, options: RelationOptions, size_m: float
) -> list[Relation]:
    """Return the relations in the order of the evidence for them where the surfaces are now."""
    evidence = [log_evidence(one, wald_test(one, estimate), estimate, options, size_m) for one in relations]
    return [relations[k] for k in sorted(range(len(relations)), key=lambda k: (-evidence[k], k))]


def examine(
    relation: Relation, estimate: Estimate, options: RelationOptions, size_m: float, level: float
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
        return replace(tested, status=Status.REJECTED, p=0.0, reason=reason, conflicts=against)
    if not test.rows:
        status = Status.REDUNDANT if relation.is_given else Status.IMPLIED
        return replace(tested, status=status, reason="others say it already")
    evidence = log_evidence(relation, test, estimate, options, size_m)
    tested = replace(tested, log_evidence=evidence)
    if test.p < level:
        reason = f"{_misfit(test)} off, which is {np.sqrt(test.chi2):.1f} standard deviations"
        return replace(tested, status=Status.REJECTED, reason=reason)
    least = LEAST_ALONE if relation.kind in CHOSEN else LEAST_LOG_EVIDENCE
    if not relation.is_given and evidence < least:
        word = "it hardly holds" if test.p < _HARDLY else "that well it may be met by chance"
        reason = f"{_misfit(test)} off: {word}, and the evidence is weak"
        return replace(tested, status=Status.UNDECIDED, reason=reason)
    accepted = replace(tested, status=Status.ACCEPTED)
    estimate.impose(accepted, test.rows)
    return accepted


def settle_conflict(refused: Relation, estimate: Estimate) -> Relation | None:
    """Return the accepted relation that had better go than the one that was refused; None where none had.

    All that contradict each other are left out in turn; the best is the one without which the surfaces are
    moved least. Proposals are not set against what a person stated.
    """
    against = [estimate.imposed[k].relation for k in refused.conflicts]
    rivals = [one for one in against if one.is_given == refused.is_given or refused.is_given]
    if not rivals or len(against) > _MOST_MEMBERS:
        return None
    kept = [one.relation for one in estimate.imposed]
    least, worst = estimate.cost, None
    for rival in rivals:
        cost = with_only([*(one for one in kept if one is not rival), refused], estimate).cost
        if cost < least:
            least, worst = cost, rival
    return worst


def worst_of(estimate: Estimate, level: float) -> tuple[Relation, float] | None:
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
        members = set(relation.surfaces).union(*(group.get(one, set()) for one in relation.surfaces))
        for member in members:
            group[member] = members
    total: dict[int, float] = {}
    for relation in relations:
        gain = np.inf if relation.is_given else relation.log_evidence
        key = id(group[relation.surfaces[0]])
        total[key] = total.get(key, 0.0) + gain
    return [one for one in relations if total[id(group[one.surfaces[0]])] < LEAST_GROUP]


def _misfit(test: WaldTest) -> str:
    """How far the equations are from 0, in words."""
    found: list[str] = []
    least = _NOTHING * float(np.abs(test.constraint.value).max())
    for value, what in zip(test.constraint.value, test.constraint.rows, strict=True):
        if abs(value) < least:
            continue
        size = f"{np.degrees(abs(value)):.3g} deg" if what == ANGLE else f"{1000 * abs(value):.3g} mm"
        found.append(size)
    angles = [one for one in found if one.endswith("deg")]
    lengths = [one for one in found if one.endswith("mm")]
    return " and ".join(
        max(some, key=lambda one: float(one.split()[0])) for some in (angles, lengths) if some
    )
