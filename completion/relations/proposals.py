# SPDX-License-Identifier: MIT
"""Proposals: relations that come into question, a class at a time, and pairs mirrored in one plane."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.relations import limits
from completion.relations.equations import mirrors_between
from completion.relations.estimate import JointEstimate
from completion.relations.evidence import (
    JudgedRelation,
    angle_allowed,
    angle_between,
    direction_classes,
    direction_sd,
    group_by_relation,
    judge,
    near,
    parallel_now,
    size_of,
)
from completion.relations.options import RelationOptions
from completion.relations.relation import Relation, RelationKind
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

_MOST_MIRRORED = 40  # surfaces, the best known, among whose pairs mirrors are looked for
_MOST_RELATIONS = 40
_ANGLE_ROUNDING = 1e-7  # radians, to which a cosine tells an angle


def mirrored_pairs(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """The two pairs of each mirror for which there is most evidence, and those that others say already.

    One pair has always a mirror. `n_tried` counts the pairs of pairs whose mirrors lie as near each other as
    those of surfaces that have nothing to do with one another (`log_evidence`).
    """
    for mirror in _mirrors_of_several(estimate, options):
        implied = [judgement.relation for judgement in mirror.judged if judgement.is_implied]
        yield from implied
        if not implied:
            yield from _best(mirror, estimate, options)


def further_pairs(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Other pairs of mirrors that two pairs have told: `n_tried` counts the pairs near this one alone."""
    for mirror in _mirrors_of_several(estimate, options):
        if any(judgement.is_implied for judgement in mirror.judged):
            for judgement in mirror.judged:
                if judgement.is_implied or judgement.evidence > np.log(mirror.n_near):
                    yield replace(judgement.relation, n_tried=mirror.n_near)


def _best(mirror: _MirrorPairs, estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """The two pairs that tell most of a mirror; where these do not tell enough, all pairs together."""
    best, *others = sorted(mirror.judged, key=lambda judgement: -judgement.evidence)
    evidence = best.evidence - float(np.log(mirror.n_pairs))
    if evidence < limits.LEAST_ALONE and others:
        hub = best.relation.surfaces[:2]
        pairs = [number for judgement in mirror.judged for number in judgement.relation.surfaces[2:]]
        n_tried = mirror.n_pairs * mirror.n_near ** len(others)
        every = Relation(kind="symmetric", surfaces=(*hub, *pairs), n_tried=n_tried)
        judgement = judge(every, estimate, options, size_of(estimate.fits))
        if judgement is not None and judgement.evidence > max(evidence, 0.0):
            yield every
            return
    if evidence > 0:
        yield replace(best.relation, n_tried=mirror.n_pairs)


class _MirrorPairs(NamedTuple):
    """A pair and each other that may have its mirror; how many lie as near by chance, of all and to it."""

    judged: list[JudgedRelation]
    n_pairs: float
    n_near: float


def _mirrors_of_several(estimate: JointEstimate, options: RelationOptions) -> Iterator[_MirrorPairs]:
    """Mirrors that several pairs may have, those of the best known surfaces first."""
    mirrors = _Mirrors.of(_members(estimate), estimate)
    size_m, n_left = size_of(estimate.fits), _MOST_RELATIONS
    turned, off = mirrors.apart()
    apart = mirrors.disjoint()
    by_chance = apart & (turned <= limits.ASIDE) & (off <= limits.SHARE * size_m / 2)
    n_pairs = max(1.0, float(by_chance.sum()) / 2)
    angle, length = (
        limits.SAME_SD * np.hypot(sd[:, None], sd[None]) for sd in (mirrors.angle_sd, mirrors.length_sd)
    )
    is_one = apart & (turned <= angle + _ANGLE_ROUNDING) & (off <= length)
    taken = np.zeros(len(mirrors.pairs), dtype=bool)
    for first, hub in enumerate(mirrors.pairs.tolist()):
        pairs, used = list[JudgedRelation](), set(hub)
        for other in np.flatnonzero(is_one[first] & ~taken & ~taken[first]):
            pair = mirrors.pairs[other].tolist()
            if other < first or used & set(pair) or n_left == 0:
                continue
            relation = Relation(kind="symmetric", surfaces=(*hub, *pair))
            judged = judge(relation, estimate, options, size_m)
            if judged is not None:
                pairs.append(judged)
                taken[other], n_left = True, n_left - 1
                used |= set(pair)
        if pairs:
            yield _MirrorPairs(pairs, n_pairs, max(1.0, float(by_chance[first].sum())))


def _members(estimate: JointEstimate) -> list[int]:
    """The planes and cylinders that are known best; of planes that are imposed to be one the first."""
    deviation = {
        number: direction_sd(estimate, number, by_fit_alone=True)  # of parallel ones all are alike
        for number, fit in enumerate(estimate.fits)
        if isinstance(fit.surface, Plane | Cylinder)
        and direction_sd(estimate, number) <= limits.MOST_DIRECTION_SD
    }
    known = sorted(deviation, key=lambda number: (deviation[number], number))
    return [first for first, *_ in group_by_relation(known, estimate, ("coplanar",))][:_MOST_MIRRORED]


@dataclass(frozen=True, eq=False)
class _Mirrors:
    """Mirrors of n pairs of surfaces: normals (n, 3) and levels (n,) over a middle, with deviations."""

    pairs: IntArray  # (n, 2)
    normal: FloatArray
    level: FloatArray
    angle_sd: FloatArray
    length_sd: FloatArray

    @classmethod
    def of(cls, members: Sequence[int], estimate: JointEstimate) -> _Mirrors:
        points = np.array([estimate.at[member].point for member in members]).reshape(-1, 3)
        middle = points.mean(axis=0) if len(points) else np.zeros(3)
        place = {member: _place_sd(estimate, member) for member in members}
        turn = {member: direction_sd(estimate, member) for member in members}
        pairs, normals, levels, angles, lengths = [], [], [], [], []
        for number, two in combinations(members, 2):
            if not _may_be_images(estimate, number, two):
                continue
            first, second = estimate.at[number], estimate.at[two]
            for mirror in mirrors_between(first, second):
                tilt = float(np.hypot(turn[number], turn[two]))
                shift = float(np.hypot(place[number], place[two]))
                if not first.is_plane:
                    apart = float(np.abs(mirror.normal @ (second.point - first.point)))
                    tilt = float(np.hypot(tilt, shift / max(apart, shift)))
                lever = max(float(np.linalg.norm(half.point - middle)) for half in (first, second))
                pairs.append((number, two))
                normals.append(mirror.normal)
                levels.append(float(mirror.normal @ (mirror.point - middle)))
                angles.append(tilt)
                lengths.append(shift + tilt * lever)
        return cls(
            np.array(pairs, dtype=np.int32).reshape(-1, 2),
            np.array(normals).reshape(-1, 3),
            np.array(levels),
            np.array(angles),
            np.array(lengths),
        )

    def apart(self) -> tuple[FloatArray, FloatArray]:
        """Angles (n, n) between mirrors, and how far apart these are near the middle, metres."""
        cosine = self.normal @ self.normal.T
        sine = np.sqrt(np.maximum(0.0, 1.0 - np.minimum(1.0, np.square(cosine))))
        sign = np.where(cosine < 0, -1.0, 1.0)
        return np.arcsin(sine), np.abs(self.level[:, None] - sign * self.level[None])

    def disjoint(self) -> BoolArray:
        """Which (n, n) pairs have no surface in common."""
        first, two = self.pairs.T
        shares = (
            (first[:, None] == first)
            | (two[:, None] == two)
            | (first[:, None] == two)
            | (two[:, None] == first)
        )
        return np.asarray(~shares)


def _may_be_images(estimate: JointEstimate, number: int, two: int) -> bool:
    """Whether two surfaces are of one kind, of radii that may be equal and axes that may be in a plane."""
    first, second = estimate.at[number], estimate.at[two]
    if first.is_plane != second.is_plane:
        return False
    if first.is_plane:
        return True
    if not list(near(Relation(kind="equal_radius", surfaces=(number, two)), estimate)):
        return False
    apart, step = _place_sd(estimate, number) + _place_sd(estimate, two), second.point - first.point
    across = np.cross(first.direction, second.direction)
    if angle_between(first, second) <= angle_allowed(estimate, number, two):
        return float(np.linalg.norm(np.cross(first.direction, step))) > limits.FAR_SD * apart
    return float(np.abs(across @ step) / np.linalg.norm(across)) <= limits.FAR_SD * apart


def _place_sd(estimate: JointEstimate, number: int) -> float:
    """Standard deviation of where a surface is across itself, metres, with how exactly things are built."""
    by = estimate.at[number].by_point
    values = np.linalg.eigvalsh(by @ estimate.covariance_of(number) @ by.T)
    return float(np.hypot(np.sqrt(max(values[-1], 0.0)), estimate.built_sd[1]))


_LEAST_PLANES, _LEAST_AXES = (
    4,
    3,
)  # of a row: of three planes it is an equal distance
_MOST_MEMBERS = 150  # of a class, the best known, among which rows are looked for
_ROUNDING = 1e-9  # metres
_MOST_ROWS = 30  # of a class, the longest


def regular_rows(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Rows of at least four parallel planes, or three parallel axes, at one spacing.

    A row begins with any two; the next is looked for where the spacing puts it. `n_tried` counts the two that
    it might have begun with, and the surfaces that are within half a spacing of where each of the others is.
    """
    size_m = size_of(estimate.fits)
    for numbers in parallel_now(estimate):
        apart = [first for first, *_ in group_by_relation(numbers, estimate, ("coplanar", "coaxial"))]
        planes = [number for number in apart if isinstance(estimate.fits[number].surface, Plane)]
        axes = [number for number in apart if number not in planes]
        for members, least in ((planes, _LEAST_PLANES), (axes, _LEAST_AXES)):
            if len(members) >= least:
                for row in _rows_of(members[:_MOST_MEMBERS], least, estimate):
                    judgement = judge(row, estimate, options, size_m)
                    if judgement is not None and (judgement.is_implied or judgement.evidence > 0):
                        yield row


def _rows_of(members: Sequence[int], least: int, estimate: JointEstimate) -> Iterator[Relation]:
    place, deviation = places_across(members, estimate)
    apart = _distinct(place, deviation)
    place, deviation = place[apart], deviation[apart]
    entries: dict[frozenset[int], list[int]] = {}
    for row in _progressions(place, deviation):
        if len(row) >= least:
            entries.setdefault(frozenset(row), row)
    longest = sorted(entries.values(), key=lambda row: -len(row))
    kept: list[list[int]] = []
    for row in longest:
        if len(kept) < _MOST_ROWS and not any(set(row) <= set(other) for other in kept):
            kept.append(row)
    for row in kept:
        numbers = [members[apart[k]] for k in row]
        if numbers[0] > numbers[-1]:
            numbers.reverse()
        yield Relation(kind="regular", surfaces=tuple(numbers), n_tried=_n_tried(row, place))


def places_across(members: Sequence[int], estimate: JointEstimate) -> tuple[FloatArray, FloatArray]:
    """Places (m, d) of parallel planes (d = 1) or axes (d = 2) over the first, metres; deviations (m,)."""
    first = estimate.at[members[0]]
    is_plane = isinstance(estimate.fits[members[0]].surface, Plane)
    over = first.direction[None] if is_plane else first.across
    place = np.array([over @ (estimate.at[member].point - first.point) for member in members])
    deviation = [0.0]
    for member in members[1:]:
        constraint = estimate.constraint(
            Relation(kind="coplanar" if is_plane else "coaxial", surfaces=(members[0], member))
        ).only(range(2, 2 + len(over)))
        variance = np.diag(estimate.variance(constraint)) + estimate.built_within(constraint)
        deviation.append(float(np.sqrt(max(variance.max(), 0.0))))
    return place, np.maximum(deviation, _ROUNDING)


def _distinct(place: FloatArray, deviation: FloatArray) -> list[int]:
    """Those of places (m, d) that are not one with a place before them."""
    kept: list[int] = []
    for k in range(len(place)):
        far = np.linalg.norm(place[kept] - place[k], axis=1)
        if not (far <= limits.FAR_SD * (deviation[kept] + deviation[k])).any():
            kept.append(k)
    return kept


def _progressions(place: FloatArray, deviation: FloatArray) -> Iterator[list[int]]:
    """Places (m, d) that follow one another at one step, as long as they go on, from any two on."""
    n, tree = len(place), cKDTree(place)
    row_step, two = (steps.ravel() for steps in np.mgrid[:n, :n])
    away = np.linalg.norm(place[two] - place[row_step], axis=1)
    allowed = limits.SAME_SD * np.sqrt(np.square(deviation[row_step]) + 4 * np.square(deviation[two]))
    far, third = tree.query(2 * place[two] - place[row_step])
    goes_on = (far <= np.hypot(allowed, limits.SAME_SD * deviation[third])) & (row_step != two)
    goes_on &= (allowed <= limits.MOST_SPACING_SHARE * away) & (third != two)
    after = {
        (int(a), int(b)): int(c)
        for a, b, c in zip(*(x[goes_on] for x in (row_step, two, third)), strict=True)
    }
    goes_back = {(b, c) for (_, b), c in after.items()}
    for pair in after:
        if pair in goes_back:
            continue
        row = list(pair)
        while (row[-2], row[-1]) in after and len(row) < n:
            row.append(after[row[-2], row[-1]])
        yield row


def _n_tried(row: Sequence[int], place: FloatArray) -> float:
    """How many rows of as many there might have been at a row's spacing, among places (m, d)."""
    n, dimension = place.shape
    step = (place[row[-1]] - place[row[0]]) / (len(row) - 1)
    half = float(np.linalg.norm(step)) * (0.5 if dimension == 1 else 1 / np.sqrt(np.pi))
    expected = place[row[0]] + np.arange(2, len(row))[:, None] * step
    beside = (np.linalg.norm(place[None] - expected[:, None], axis=2) <= half).sum(axis=1)
    return float(n * (n - 1) / 2 * np.prod(np.maximum(1.0, beside)))


STAGES: tuple[tuple[RelationKind, ...], ...] = (
    ("parallel", "perpendicular", "vertical", "horizontal"),
    ("angle", "half_angle"),
    ("coaxial", "coplanar", "axis_in_plane", "tangent"),
    ("equal_radius", "equal_ring_radius", "radius"),
    ("distance", "equal_distance"),
    ("regular", "symmetric"),
    (),
)
"""The kinds in the order in which they are examined; those that a person stated come first within each.

In the last stage those mirrors that were told get their other pairs.
"""


def propose(stage: int, estimate: JointEstimate, options: RelationOptions) -> list[Relation]:
    """Return the relations of a stage (`STAGES`) that come into question where the surfaces are now."""
    makers: dict[int, Callable[[JointEstimate, RelationOptions], Iterator[Relation]]] = {
        0: _directions,
        1: _angles,
        2: _places,
        3: _radii,
        4: _distances,
        5: _patterns,
        6: _further,
    }
    return [relation for relation in makers[stage](estimate, options) if relation.kind in options.kinds]


def _directions(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """What is parallel to the best known of its class, and which of these are at right angles."""
    classes = direction_classes(estimate)
    for first, *others in classes:
        yield from (Relation(kind="parallel", surfaces=(first, other)) for other in others)
    for number, two in combinations([kind[0] for kind in classes], 2):
        if abs(angle_between(estimate.at[number], estimate.at[two]) - np.pi / 2) <= angle_allowed(
            estimate, number, two
        ):
            yield Relation(kind="perpendicular", surfaces=(number, two))
    if options.up is not None:
        for first, *_ in classes:
            cosine = float(np.abs(estimate.at[first].direction @ options.up))
            angle = float(np.arccos(min(1.0, cosine)))
            is_plane = isinstance(estimate.fits[first].surface, Plane)
            allowed = angle_allowed(estimate, first)
            for off, along in ((angle, True), (np.pi / 2 - angle, False)):
                if off <= allowed:
                    yield Relation(kind="vertical" if along != is_plane else "horizontal", surfaces=(first,))


def _angles(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Round angles between the best known of each class, and of cones."""
    step = np.radians(options.round_angle_deg)
    held = {frozenset(relation.relation.surfaces) for relation in estimate.imposed}
    for index, two in combinations([numbers[0] for numbers in parallel_now(estimate)], 2):
        angle = angle_between(estimate.at[index], estimate.at[two])
        value = float(np.rint(angle / step) * step)
        is_own = min(value, abs(np.pi / 2 - value)) < limits.FLAT_ANGLE or frozenset((index, two)) in held
        if not is_own and abs(angle - value) <= min(angle_allowed(estimate, index, two), step / 2):
            yield Relation(kind="angle", surfaces=(index, two), value=value)
    for number, fit in enumerate(estimate.fits):
        if isinstance(fit.surface, Cone):
            value = float(np.rint(estimate.at[number].half_angle / step) * step)
            if 0 < value < np.pi / 2:
                yield Relation(kind="half_angle", surfaces=(number,), value=value)


def _places(estimate: JointEstimate, _options: RelationOptions) -> Iterator[Relation]:
    """Planes in one, axes in one, and axes in planes."""
    classes = parallel_now(estimate)
    for kind in classes:
        planes = [number for number in kind if isinstance(estimate.fits[number].surface, Plane)]
        axes = [number for number in kind if number not in planes]
        yield from _cluster("coplanar", planes, estimate)
        yield from _cluster("coaxial", axes, estimate)
    for first, second in combinations(classes, 2):
        apart = angle_between(estimate.at[first[0]], estimate.at[second[0]])
        if abs(apart - np.pi / 2) > angle_allowed(estimate, first[0], second[0]):
            continue
        for number, two in [(a, b) for a in first for b in second]:
            flat, axis = (number, two) if isinstance(estimate.fits[number].surface, Plane) else (two, number)
            if isinstance(estimate.fits[flat].surface, Plane) and not isinstance(
                estimate.fits[axis].surface, Plane
            ):
                yield from near(Relation(kind="axis_in_plane", surfaces=(flat, axis)), estimate)


def _radii(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Equal radii, and round ones; a fillet's tube, straight or round, is one with other tubes."""
    spheres, tubes, rings = (
        [number for number, fit in enumerate(estimate.fits) if isinstance(fit.surface, kinds)]
        for kinds in (Sphere, (Cylinder, Torus), Torus)
    )
    for numbers in (spheres, tubes):
        yield from _cluster("equal_radius", numbers, estimate)
    yield from _cluster("equal_ring_radius", rings, estimate)
    if options.round_length_m is not None:
        for number in spheres + tubes:
            value = float(
                np.rint(estimate.at[number].radius / options.round_length_m) * options.round_length_m
            )
            if value > 0:
                yield from near(Relation(kind="radius", surfaces=(number,), value=value), estimate)


def _distances(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Round and equal distances between parallel planes that follow one another."""
    steps: list[tuple[int, int]] = []
    for numbers in parallel_now(estimate):
        planes = [number for number in numbers if isinstance(estimate.fits[number].surface, Plane)]
        normal = estimate.at[numbers[0]].direction
        along = {plane: float(normal @ estimate.at[plane].point) for plane in planes}
        placed = sorted(planes, key=lambda number: (along[number], number))
        steps += [pair for pair in pairwise(placed) if not _are_one(estimate, *pair)]
    known = {pair: _length(estimate, pair) for pair in steps}
    if options.round_length_m is not None:
        for pair in steps:
            value = float(np.rint(known[pair][0] / options.round_length_m) * options.round_length_m)
            if value > 0:
                yield from near(Relation(kind="distance", surfaces=pair, value=value), estimate)
    firsts: list[tuple[int, int]] = []
    for pair in steps:
        for first in firsts:
            if abs(known[first][0] - known[pair][0]) > limits.FAR_SD * (known[first][1] + known[pair][1]):
                continue  # whatever errors they share, they are too far off
            relations = list(near(Relation(kind="equal_distance", surfaces=(*first, *pair)), estimate))
            if relations:
                yield from relations
                break
        else:
            firsts.append(pair)


def _cluster(kind: RelationKind, members: Sequence[int], estimate: JointEstimate) -> Iterator[Relation]:
    """Each member with the first of those before it that it may be one with."""
    firsts: list[int] = []
    for member in members:
        for first in firsts:
            relations = list(near(Relation(kind=kind, surfaces=(first, member)), estimate))
            if relations:
                yield from relations
                break
        else:
            firsts.append(member)


def _are_one(estimate: JointEstimate, number: int, two: int) -> bool:
    """Whether two planes are imposed to be one, or not apart by more than may be by chance."""
    return bool(list(near(Relation(kind="coplanar", surfaces=(number, two)), estimate)))


def _length(estimate: JointEstimate, pair: tuple[int, int]) -> tuple[float, float]:
    """How far apart two surfaces are, and the deviation of that, with how exactly things are built."""
    constraint = estimate.constraint(Relation(kind="distance", surfaces=pair, value=0.0))
    variances = estimate.variance(constraint)[0, 0], estimate.built_within(constraint)[0]
    deviations = np.sqrt(np.maximum(variances, 0.0))  # an imposed length has none, but for rounding
    return float(constraint.value[0]), float(deviations.sum()) + 1e-12


def _patterns(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """What has one spacing, and what is alike in one mirror."""
    rows = list(regular_rows(estimate, options))
    yield from rows
    yield from _beyond(rows, mirrored_pairs(estimate, options))


def _further(estimate: JointEstimate, options: RelationOptions) -> Iterator[Relation]:
    """Other pairs of mirrors that were told."""
    yield from _beyond(list(regular_rows(estimate, options)), further_pairs(estimate, options))


def _beyond(rows: Sequence[Relation], pairs: Iterator[Relation]) -> Iterator[Relation]:
    """Those pairs that are not of one row, which has mirrors in any case."""
    for pair in pairs:
        if not any(set(pair.surfaces) <= set(row.surfaces) for row in rows):
            yield pair
