# SPDX-License-Identifier: MIT
"""Evidence for a relation: how many times likelier its misfit is than among unrelated surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations import limits
from completion.relations.constraint import spacing_of
from completion.relations.equations import LENGTH, RADIUS, Placement, place
from completion.relations.estimate import JointEstimate, WaldTest, wald_test
from completion.relations.options import RelationOptions
from completion.relations.relation import Relation, RelationKind
from scenes.checks import FloatArray

CHOSEN = ("regular", "symmetric")
"""Kinds of which so many sets of surfaces come into question that each needs evidence by itself."""


def size_of(fits: Sequence[SurfaceFit]) -> float:
    """How far apart the surfaces' own points are, metres; for one surface its radius, or a metre."""
    points = np.array([_point(fit) for fit in fits])
    size = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) else 0.0
    radii = [float(getattr(fit.surface, "radius", 0.0)) for fit in fits]
    return max([size, *radii]) or 1.0


def log_evidence(
    relation: Relation, test: WaldTest, estimate: JointEstimate, options: RelationOptions, size_m: float
) -> float:
    """Logarithm of how many times likelier the misfit is if the relation holds.

    Against surfaces that lie anywhere near it: directions within 10 deg of it to either side, lengths within
    a twentieth of the size of all, radii of themselves; values that are round by chance anywhere between two
    round ones; the next of a row within half a spacing of its place. Of many sets of surfaces that lie so
    near, one will do so by chance: the evidence is the less for them (`Relation.n_tried`).
    """
    volume = sum(
        float(np.log(_extent(relation, test.constraint.rows[k], estimate, options, size_m)))
        for k in test.rows
    )
    return test.log_density + volume - float(np.log(relation.n_tried))


class JudgedRelation(NamedTuple):
    """A relation that comes into question, its test, and the evidence for it."""

    relation: Relation
    test: WaldTest
    evidence: float

    @property
    def is_implied(self) -> bool:
        """Whether others say it already."""
        return not self.test.rows


def judge(
    relation: Relation, estimate: JointEstimate, options: RelationOptions, size_m: float
) -> JudgedRelation | None:
    """Return what there is to say of a relation where the surfaces are; None where it is far off."""
    test = wald_test(relation, estimate)
    if not test.is_met or test.chi2 > limits.FAR_SD**2 * len(test.rows):
        return None
    return JudgedRelation(relation, test, log_evidence(relation, test, estimate, options, size_m))


def _extent(
    relation: Relation, what: int, estimate: JointEstimate, options: RelationOptions, size_m: float
) -> float:
    """How wide the values lie that an equation of this kind has among unrelated surfaces."""
    if relation.kind in ("angle", "half_angle"):
        return float(np.radians(options.round_angle_deg))
    if relation.kind in ("radius", "distance") and options.round_length_m is not None:
        return options.round_length_m
    if relation.kind == "regular" and what == LENGTH:
        return spacing_of(relation.surfaces, estimate.at)
    if what == RADIUS:
        placed = [estimate.at[number] for number in relation.surfaces]
        is_ring = relation.kind == "equal_ring_radius"
        radii = [placement.ring_radius if is_ring else placement.radius for placement in placed]
        return 2 * limits.SHARE * max(radii)
    return 2 * limits.SHARE * size_m if what == LENGTH else float(2 * limits.ASIDE)


def _point(fit: SurfaceFit) -> FloatArray:
    return place(fit.surface, np.zeros(len(fit.covariance))).point


def direction_classes(estimate: JointEstimate) -> list[list[int]]:
    """Group the surfaces whose directions may be parallel, the best known first, in each and of all.

    A surface joins the class whose first member it is nearest to, within 6 deg or three standard deviations.
    """
    directed = [number for number in range(len(estimate.fits)) if _has_direction(estimate, number)]
    deviation = {number: direction_sd(estimate, number) for number in directed}
    classes: list[list[int]] = []
    for number in sorted(directed, key=lambda number: (deviation[number], number)):
        if deviation[number] > limits.MOST_DIRECTION_SD:
            continue
        angles = [angle_between(estimate.at[number], estimate.at[kind[0]]) for kind in classes]
        nearest = int(np.argmin(angles)) if angles else -1
        if nearest >= 0 and angles[nearest] <= _angle_limit(
            deviation[number], deviation[classes[nearest][0]]
        ):
            classes[nearest].append(number)
        else:
            classes.append([number])
    return classes


def direction_sd(estimate: JointEstimate, number: int, *, by_fit_alone: bool = False) -> float:
    """Standard deviation of a direction, radians: of its greatest component, or of its fit alone."""
    by = estimate.at[number].across @ estimate.at[number].by_direction
    covariance = estimate.fits[number].covariance if by_fit_alone else estimate.covariance_of(number)
    return float(np.sqrt(np.linalg.eigvalsh(by @ covariance @ by.T)[-1]))


def near(relation: Relation, estimate: JointEstimate) -> Iterator[Relation]:
    """The relation, where it is not far off in the deviations of each of its equations."""
    constraint = estimate.constraint(relation)
    variance = np.diag(estimate.variance(constraint)) + estimate.built_within(constraint)
    if (np.square(constraint.value) <= limits.FAR_SD**2 * np.maximum(variance, 1e-24)).all():
        yield relation


def parallel_now(estimate: JointEstimate) -> list[list[int]]:
    """The surfaces with a direction, grouped by what is imposed as parallel, best known first."""
    order = [number for kind in direction_classes(estimate) for number in kind]
    return group_by_relation(order, estimate, ("parallel", "coplanar", "coaxial"))


def group_by_relation(
    order: Sequence[int], estimate: JointEstimate, kinds: Sequence[RelationKind]
) -> list[list[int]]:
    """Group surfaces by the relations of some kinds that are imposed, each group and all in their order."""
    group = {number: {number} for number in order}
    for relation in (imposed.relation for imposed in estimate.imposed):
        index, two = relation.surfaces[0], relation.surfaces[-1]
        if relation.kind in kinds and index in group and two in group and group[index] is not group[two]:
            group[index] |= group[two]
            for member in group[two]:
                group[member] = group[index]
    entries: dict[int, list[int]] = {}
    for number in order:
        entries.setdefault(id(group[number]), []).append(number)
    return list(entries.values())


def _has_direction(estimate: JointEstimate, number: int) -> bool:
    return bool(estimate.at[number].direction.any())


def angle_between(placement: Placement, two: Placement) -> float:
    """Angle between two directions without their signs, radians, 0 to 90 deg."""
    across: FloatArray = np.cross(placement.direction, two.direction)
    return float(np.arctan2(np.linalg.norm(across), abs(placement.direction @ two.direction)))


def angle_allowed(estimate: JointEstimate, *numbers: int) -> float:
    """How far off directions of surfaces may be to come into question, radians."""
    return _angle_limit(*(direction_sd(estimate, number) for number in numbers))


def _angle_limit(*deviations: float) -> float:
    return max(limits.DIRECTION_GATE, limits.GATE_SD * math.hypot(*deviations))
