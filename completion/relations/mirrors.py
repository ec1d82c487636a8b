# SPDX-License-Identifier: MIT
"""Mirrored pairs: planes and cylinders two pairs of which may be alike in one mirror."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from completion.relations.engine.equations import mirrors_between
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation
from completion.relations.evidence import (
    ASIDE,
    FAR,
    LEAST_ALONE,
    MOST_SD,
    SHARE,
    Judged,
    angle_allowed,
    angle_between,
    direction_sd,
    grouped,
    judge,
    near,
    size_of,
)
from completion.relations.options import RelationOptions
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder, Plane

_N_SD = 4.0  # within which two mirrors may be one
_MOST_MEMBERS = 40  # surfaces, the best known, among whose pairs mirrors are looked for
_MOST_RELATIONS = 40
_ROUNDING = 1e-7  # radians, to which a cosine tells an angle


def mirrored_pairs(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """The two pairs of each mirror for which there is most evidence, and those that others say already.

    One pair has always a mirror. `n_tried` counts the pairs of pairs whose mirrors lie as near each other as
    those of surfaces that have nothing to do with one another (`log_evidence`).
    """
    for mirror in _mirrors_of_several(estimate, options):
        implied = [one.relation for one in mirror.told if one.is_implied]
        yield from implied
        if not implied:
            yield from _best(mirror, estimate, options)


def further_pairs(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """Other pairs of mirrors that two pairs have told: `n_tried` counts the pairs near this one alone."""
    for mirror in _mirrors_of_several(estimate, options):
        if any(one.is_implied for one in mirror.told):
            for one in mirror.told:
                if one.is_implied or one.evidence > np.log(mirror.n_near):
                    yield replace(one.relation, n_tried=mirror.n_near)


def _best(mirror: _Mirror, estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """The two pairs that tell most of a mirror; where these do not tell enough, all pairs together."""
    best, *others = sorted(mirror.told, key=lambda one: -one.evidence)
    evidence = best.evidence - float(np.log(mirror.n_pairs))
    if evidence < LEAST_ALONE and others:
        hub = best.relation.surfaces[:2]
        pairs = [number for one in mirror.told for number in one.relation.surfaces[2:]]
        n_tried = mirror.n_pairs * mirror.n_near ** len(others)
        every = Relation(kind="symmetric", surfaces=(*hub, *pairs), n_tried=n_tried)
        told = judge(every, estimate, options, size_of(estimate.fits))
        if told is not None and told.evidence > max(evidence, 0.0):
            yield every
            return
    if evidence > 0:
        yield replace(best.relation, n_tried=mirror.n_pairs)


class _Mirror(NamedTuple):
    """A pair and each other that may have its mirror; how many lie as near by chance, of all and to it."""

    told: list[Judged]
    n_pairs: float
    n_near: float


def _mirrors_of_several(estimate: Estimate, options: RelationOptions) -> Iterator[_Mirror]:
    """Mirrors that several pairs may have, those of the best known surfaces first."""
    mirrors = _Mirrors.of(_members(estimate), estimate)
    size_m, n_left = size_of(estimate.fits), _MOST_RELATIONS
    turned, off = mirrors.apart()
    apart = mirrors.disjoint()
    by_chance = apart & (turned <= ASIDE) & (off <= SHARE * size_m / 2)
    n_pairs = max(1.0, float(by_chance.sum()) / 2)
    angle, length = (_N_SD * np.hypot(sd[:, None], sd[None]) for sd in (mirrors.angle_sd, mirrors.length_sd))
    is_one = apart & (turned <= angle + _ROUNDING) & (off <= length)
    taken = np.zeros(len(mirrors.pairs), dtype=bool)
    for first, hub in enumerate(mirrors.pairs.tolist()):
        told, used = list[Judged](), set(hub)
        for other in np.flatnonzero(is_one[first] & ~taken & ~taken[first]):
            pair = mirrors.pairs[other].tolist()
            if other < first or used & set(pair) or n_left == 0:
                continue
            relation = Relation(kind="symmetric", surfaces=(*hub, *pair))
            judged = judge(relation, estimate, options, size_m)
            if judged is not None:
                told.append(judged)
                taken[other], n_left = True, n_left - 1
                used |= set(pair)
        if told:
            yield _Mirror(told, n_pairs, max(1.0, float(by_chance[first].sum())))


def _members(estimate: Estimate) -> list[int]:
    """The planes and cylinders that are known best; of planes that are imposed to be one the first."""
    deviation = {
        number: direction_sd(estimate, number, own=True)  # of parallel ones all are alike
        for number, fit in enumerate(estimate.fits)
        if isinstance(fit.surface, Plane | Cylinder) and direction_sd(estimate, number) <= MOST_SD
    }
    known = sorted(deviation, key=lambda number: (deviation[number], number))
    return [first for first, *_ in grouped(known, estimate, ("coplanar",))][:_MOST_MEMBERS]


@dataclass(frozen=True, eq=False)
class _Mirrors:
    """Mirrors of n pairs of surfaces: normals (n, 3) and levels (n,) over a middle, with deviations."""

    pairs: IntArray  # (n, 2)
    normal: FloatArray
    level: FloatArray
    angle_sd: FloatArray
    length_sd: FloatArray

    @classmethod
    def of(cls, members: Sequence[int], estimate: Estimate) -> _Mirrors:
        points = np.array([estimate.at[one].point for one in members]).reshape(-1, 3)
        middle = points.mean(axis=0) if len(points) else np.zeros(3)
        place = {one: _place_sd(estimate, one) for one in members}
        turn = {one: direction_sd(estimate, one) for one in members}
        pairs, normals, levels, angles, lengths = [], [], [], [], []
        for one, two in combinations(members, 2):
            if not _may_be_images(estimate, one, two):
                continue
            first, second = estimate.at[one], estimate.at[two]
            for mirror in mirrors_between(first, second):
                tilt = float(np.hypot(turn[one], turn[two]))
                shift = float(np.hypot(place[one], place[two]))
                if not first.is_plane:
                    apart = float(np.abs(mirror.normal @ (second.point - first.point)))
                    tilt = float(np.hypot(tilt, shift / max(apart, shift)))
                lever = max(float(np.linalg.norm(half.point - middle)) for half in (first, second))
                pairs.append((one, two))
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
        one, two = self.pairs.T
        alike = (one[:, None] == one) | (two[:, None] == two) | (one[:, None] == two) | (two[:, None] == one)
        return np.asarray(~alike)


def _may_be_images(estimate: Estimate, one: int, two: int) -> bool:
    """Whether two surfaces are of one kind, of radii that may be equal and axes that may be in a plane."""
    first, second = estimate.at[one], estimate.at[two]
    if first.is_plane != second.is_plane:
        return False
    if first.is_plane:
        return True
    if not list(near(Relation(kind="equal_radius", surfaces=(one, two)), estimate)):
        return False
    apart, step = _place_sd(estimate, one) + _place_sd(estimate, two), second.point - first.point
    across = np.cross(first.direction, second.direction)
    if angle_between(first, second) <= angle_allowed(estimate, one, two):
        return float(np.linalg.norm(np.cross(first.direction, step))) > FAR * apart
    return float(np.abs(across @ step) / np.linalg.norm(across)) <= FAR * apart


def _place_sd(estimate: Estimate, number: int) -> float:
    """Standard deviation of where a surface is across itself, metres, with how exactly things are built."""
    by = estimate.at[number].by_point
    values = np.linalg.eigvalsh(by @ estimate.covariance_of(number) @ by.T)
    return float(np.hypot(np.sqrt(max(values[-1], 0.0)), estimate.built_sd[1]))
