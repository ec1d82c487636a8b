# SPDX-License-Identifier: MIT
"""Proposals: which relations come into question, a class of them at a time, best known surfaces first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, pairwise

import numpy as np

from completion.relations.engine.estimate import Estimate
from completion.relations.engine.placement import Placement
from completion.relations.engine.relation import Relation, RelationKind
from completion.relations.options import RelationOptions
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

_MOST_SD = float(np.radians(5.0))  # of a direction: less well known, it says nothing
_GATE = float(np.radians(6.0))  # within which directions come into question, or within three deviations
_N_SD = 3.0
_FAR = 6.0  # standard deviations, from which on offsets and radii do not come into question
_FLAT_ANGLE = float(
    np.radians(1.0)
)  # round angles nearer than this to 0 or 90 deg are relations of their own

STAGES: tuple[tuple[RelationKind, ...], ...] = (
    ("parallel", "perpendicular", "vertical", "horizontal"),
    ("angle", "half_angle"),
    ("coaxial", "coplanar", "axis_in_plane"),
    ("equal_radius", "equal_ring_radius", "radius"),
    ("distance", "equal_distance"),
)
"""The kinds in the order in which they are examined; those that a person stated come first within each."""


def propose(stage: int, estimate: Estimate, options: RelationOptions) -> list[Relation]:
    """Return the relations of a stage (`STAGES`) that come into question where the surfaces are now."""
    makers: dict[int, Callable[[Estimate, RelationOptions], Iterator[Relation]]] = {
        0: _directions,
        1: _angles,
        2: _places,
        3: _radii,
        4: _distances,
    }
    return [one for one in makers[stage](estimate, options) if one.kind in options.kinds]


def direction_classes(estimate: Estimate) -> list[list[int]]:
    """Group the surfaces whose directions may be parallel, the best known first, in each and of all.

    A surface joins the class whose first member it is nearest to, within 6 deg or three standard deviations.
    """
    directed = [number for number in range(len(estimate.fits)) if _has_direction(estimate, number)]
    deviation = {number: direction_sd(estimate, number) for number in directed}
    classes: list[list[int]] = []
    for number in sorted(directed, key=lambda one: (deviation[one], one)):
        if deviation[number] > _MOST_SD:
            continue
        angles = [_between(estimate.at[number], estimate.at[own[0]]) for own in classes]
        nearest = int(np.argmin(angles)) if angles else -1
        if nearest >= 0:
            first = deviation[classes[nearest][0]]
            allowed = max(_GATE, _N_SD * float(np.hypot(deviation[number], first)))
            if angles[nearest] <= allowed:
                classes[nearest].append(number)
                continue
        classes.append([number])
    return classes


def direction_sd(estimate: Estimate, number: int) -> float:
    """Standard deviation of a surface's direction, radians: of its greatest component."""
    by = estimate.at[number].across @ estimate.at[number].by_direction
    return float(np.sqrt(np.linalg.eigvalsh(by @ estimate.covariance_of(number) @ by.T)[-1]))


def _directions(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """What is parallel to the best known of its class, and which of these are at right angles."""
    classes = direction_classes(estimate)
    for first, *others in classes:
        yield from (Relation(kind="parallel", surfaces=(first, other)) for other in others)
    for one, two in combinations([own[0] for own in classes], 2):
        if abs(_between(estimate.at[one], estimate.at[two]) - np.pi / 2) <= _allowed(estimate, one, two):
            yield Relation(kind="perpendicular", surfaces=(one, two))
    if options.up is not None:
        for first, *_ in classes:
            cosine = float(np.abs(estimate.at[first].direction @ options.up))
            angle = float(np.arccos(min(1.0, cosine)))
            is_plane = isinstance(estimate.fits[first].surface, Plane)
            allowed = max(_GATE, _N_SD * direction_sd(estimate, first))
            for off, along in ((angle, True), (np.pi / 2 - angle, False)):
                if off <= allowed:
                    yield Relation(kind="vertical" if along != is_plane else "horizontal", surfaces=(first,))


def _angles(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """Round angles between the best known of each class, and of cones."""
    step = np.radians(options.round_angle_deg)
    held = {frozenset(one.relation.surfaces) for one in estimate.imposed}
    for one, two in combinations([own[0] for own in _parallel_now(estimate)], 2):
        angle = _between(estimate.at[one], estimate.at[two])
        value = float(np.rint(angle / step) * step)
        is_own = min(value, abs(np.pi / 2 - value)) < _FLAT_ANGLE or frozenset((one, two)) in held
        if not is_own and abs(angle - value) <= min(_allowed(estimate, one, two), step / 2):
            yield Relation(kind="angle", surfaces=(one, two), value=value)
    for number, fit in enumerate(estimate.fits):
        if isinstance(fit.surface, Cone):
            value = float(np.rint(estimate.at[number].half_angle / step) * step)
            if 0 < value < np.pi / 2:
                yield Relation(kind="half_angle", surfaces=(number,), value=value)


def _places(estimate: Estimate, _options: RelationOptions) -> Iterator[Relation]:
    """Planes in one, axes in one, and axes in planes."""
    classes = _parallel_now(estimate)
    for own in classes:
        planes = [one for one in own if isinstance(estimate.fits[one].surface, Plane)]
        axes = [one for one in own if one not in planes]
        yield from _clustered("coplanar", planes, estimate)
        yield from _clustered("coaxial", axes, estimate)
    for first, second in combinations(classes, 2):
        apart = _between(estimate.at[first[0]], estimate.at[second[0]])
        if abs(apart - np.pi / 2) > _allowed(estimate, first[0], second[0]):
            continue
        for one, two in [(a, b) for a in first for b in second]:
            flat, axis = (one, two) if isinstance(estimate.fits[one].surface, Plane) else (two, one)
            if isinstance(estimate.fits[flat].surface, Plane) and not isinstance(
                estimate.fits[axis].surface, Plane
            ):
                yield from _near(Relation(kind="axis_in_plane", surfaces=(flat, axis)), estimate)


def _radii(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """Equal radii, and round ones; a fillet's tube, straight or round, is one with other tubes."""
    spheres, tubes, rings = (
        [number for number, fit in enumerate(estimate.fits) if isinstance(fit.surface, kinds)]
        for kinds in (Sphere, (Cylinder, Torus), Torus)
    )
    for some in (spheres, tubes):
        yield from _clustered("equal_radius", some, estimate)
    yield from _clustered("equal_ring_radius", rings, estimate)
    if options.round_length_m is not None:
        for number in spheres + tubes:
            value = float(
                np.rint(estimate.at[number].radius / options.round_length_m) * options.round_length_m
            )
            if value > 0:
                yield from _near(Relation(kind="radius", surfaces=(number,), value=value), estimate)


def _distances(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """Round and equal distances between parallel planes that follow one another."""
    steps: list[tuple[int, int]] = []
    for own in _parallel_now(estimate):
        planes = [one for one in own if isinstance(estimate.fits[one].surface, Plane)]
        normal = estimate.at[own[0]].direction
        along = {one: float(normal @ estimate.at[one].point) for one in planes}
        placed = sorted(planes, key=lambda one: (along[one], one))
        steps += [pair for pair in pairwise(placed) if not _are_one(estimate, *pair)]
    known = {pair: _length(estimate, pair) for pair in steps}
    if options.round_length_m is not None:
        for pair in steps:
            value = float(np.rint(known[pair][0] / options.round_length_m) * options.round_length_m)
            if value > 0:
                yield from _near(Relation(kind="distance", surfaces=pair, value=value), estimate)
    firsts: list[tuple[int, int]] = []
    for pair in steps:
        for first in firsts:
            if abs(known[first][0] - known[pair][0]) > _FAR * (known[first][1] + known[pair][1]):
                continue  # whatever errors they share, they are too far off
            found = list(_near(Relation(kind="equal_distance", surfaces=(*first, *pair)), estimate))
            if found:
                yield from found
                break
        else:
            firsts.append(pair)


def _clustered(kind: RelationKind, members: Sequence[int], estimate: Estimate) -> Iterator[Relation]:
    """Each member with the first of those before it that it may be one with."""
    firsts: list[int] = []
    for member in members:
        for first in firsts:
            found = list(_near(Relation(kind=kind, surfaces=(first, member)), estimate))
            if found:
                yield from found
                break
        else:
            firsts.append(member)


def _near(relation: Relation, estimate: Estimate) -> Iterator[Relation]:
    """The relation, where it is not far off in the deviations of each of its equations."""
    constraint = estimate.constraint(relation)
    variance = np.diag(estimate.variance(constraint)) + estimate.built_within(constraint)
    if (np.square(constraint.value) <= _FAR**2 * np.maximum(variance, 1e-24)).all():
        yield relation


def _parallel_now(estimate: Estimate) -> list[list[int]]:
    """The surfaces with a direction, grouped by what is imposed as parallel, best known first."""
    pairs = [
        one.relation.surfaces
        for one in estimate.imposed
        if one.relation.kind in ("parallel", "coplanar", "coaxial")
    ]
    order = [number for own in direction_classes(estimate) for number in own]
    group = {number: {number} for number in order}
    for one, two in pairs:
        if one in group and two in group and group[one] is not group[two]:
            group[one] |= group[two]
            for member in group[two]:
                group[member] = group[one]
    found: dict[int, list[int]] = {}
    for number in order:
        found.setdefault(id(group[number]), []).append(number)
    return list(found.values())


def _are_one(estimate: Estimate, one: int, two: int) -> bool:
    """Whether two planes are imposed to be one, or not apart by more than may be by chance."""
    return bool(list(_near(Relation(kind="coplanar", surfaces=(one, two)), estimate)))


def _length(estimate: Estimate, pair: tuple[int, int]) -> tuple[float, float]:
    """How far apart two surfaces are, and the deviation of that, with how exactly things are built."""
    found = estimate.constraint(Relation(kind="distance", surfaces=pair, value=0.0))
    deviations = np.sqrt([estimate.variance(found)[0, 0], estimate.built_within(found)[0]])
    return float(found.value[0]), float(deviations.sum()) + 1e-12


def _has_direction(estimate: Estimate, number: int) -> bool:
    return bool(estimate.at[number].direction.any())


def _between(one: Placement, two: Placement) -> float:
    """Angle between two directions without their signs, radians, 0 to 90 deg."""
    across: FloatArray = np.cross(one.direction, two.direction)
    return float(np.arctan2(np.linalg.norm(across), abs(one.direction @ two.direction)))


def _allowed(estimate: Estimate, one: int, two: int) -> float:
    together = np.hypot(direction_sd(estimate, one), direction_sd(estimate, two))
    return max(float(_GATE), _N_SD * float(together))
