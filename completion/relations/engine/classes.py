# SPDX-License-Identifier: MIT
"""Classes of directions: surfaces that may be parallel, or are imposed as such; what is near a relation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from completion.relations.engine.estimate import Estimate
from completion.relations.engine.placement import Placement
from completion.relations.engine.relation import Relation, RelationKind
from scenes.checks import FloatArray

MOST_SD = float(np.radians(5.0))
"""Of a direction: less well known, it says nothing."""
_GATE = float(np.radians(6.0))  # within which directions come into question, or within three deviations
_N_SD = 3.0
FAR = 6.0
"""Standard deviations, from which on offsets and radii do not come into question."""


def direction_classes(estimate: Estimate) -> list[list[int]]:
    """Group the surfaces whose directions may be parallel, the best known first, in each and of all.

    A surface joins the class whose first member it is nearest to, within 6 deg or three standard deviations.
    """
    directed = [number for number in range(len(estimate.fits)) if _has_direction(estimate, number)]
    deviation = {number: direction_sd(estimate, number) for number in directed}
    classes: list[list[int]] = []
    for number in sorted(directed, key=lambda one: (deviation[one], one)):
        if deviation[number] > MOST_SD:
            continue
        angles = [angle_between(estimate.at[number], estimate.at[own[0]]) for own in classes]
        nearest = int(np.argmin(angles)) if angles else -1
        if nearest >= 0 and angles[nearest] <= _allowed(deviation[number], deviation[classes[nearest][0]]):
            classes[nearest].append(number)
        else:
            classes.append([number])
    return classes


def direction_sd(estimate: Estimate, number: int, *, own: bool = False) -> float:
    """Standard deviation of a direction, radians: of its greatest component; by its `own` fit alone."""
    by = estimate.at[number].across @ estimate.at[number].by_direction
    covariance = estimate.fits[number].covariance if own else estimate.covariance_of(number)
    return float(np.sqrt(np.linalg.eigvalsh(by @ covariance @ by.T)[-1]))


def near(relation: Relation, estimate: Estimate) -> Iterator[Relation]:
    """The relation, where it is not far off in the deviations of each of its equations."""
    constraint = estimate.constraint(relation)
    variance = np.diag(estimate.variance(constraint)) + estimate.built_within(constraint)
    if (np.square(constraint.value) <= FAR**2 * np.maximum(variance, 1e-24)).all():
        yield relation


def parallel_now(estimate: Estimate) -> list[list[int]]:
    """The surfaces with a direction, grouped by what is imposed as parallel, best known first."""
    order = [number for own in direction_classes(estimate) for number in own]
    return grouped(order, estimate, ("parallel", "coplanar", "coaxial"))


def grouped(order: Sequence[int], estimate: Estimate, kinds: Sequence[RelationKind]) -> list[list[int]]:
    """Group surfaces by the relations of some kinds that are imposed, each group and all in their order."""
    group = {number: {number} for number in order}
    for relation in (imposed.relation for imposed in estimate.imposed):
        one, two = relation.surfaces[0], relation.surfaces[-1]
        if relation.kind in kinds and one in group and two in group and group[one] is not group[two]:
            group[one] |= group[two]
            for member in group[two]:
                group[member] = group[one]
    found: dict[int, list[int]] = {}
    for number in order:
        found.setdefault(id(group[number]), []).append(number)
    return list(found.values())


def _has_direction(estimate: Estimate, number: int) -> bool:
    return bool(estimate.at[number].direction.any())


def angle_between(one: Placement, two: Placement) -> float:
    """Angle between two directions without their signs, radians, 0 to 90 deg."""
    across: FloatArray = np.cross(one.direction, two.direction)
    return float(np.arctan2(np.linalg.norm(across), abs(one.direction @ two.direction)))


def angle_allowed(estimate: Estimate, *numbers: int) -> float:
    """How far off directions of surfaces may be to come into question, radians."""
    return _allowed(*(direction_sd(estimate, number) for number in numbers))


def _allowed(*deviations: float) -> float:
    return max(_GATE, _N_SD * math.hypot(*deviations))
