# SPDX-License-Identifier: MIT
"""Grouping: scans become groups, the surest first, each placed against all that are placed already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from completion.registration.candidates.motions import STILL, composed, inverse
from completion.registration.candidates.station_view import StationView
from completion.registration.hypotheses import MIDDLE_M, VIOLATION, Hypothesis, best_of, distinct, scores_of
from completion.registration.refinement import Placed
from completion.registration.verdict import Judgement, Verdict, is_approved, judge
from scenes.checks import FloatArray

Pair = tuple[int, int]
_Scans = tuple[int, ...]
Hypotheses = Mapping[Pair, Sequence[Hypothesis]]
"""By the numbers of two scans, the smaller first: motions of the second into the frame of the first."""

_N_TRIED = 8  # candidates of a joint placement that are refined


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Scans that are placed to each other: by the number of each its pose (3, 4) in the group's frame."""

    poses: Mapping[int, FloatArray]

    @property
    def scans(self) -> tuple[int, ...]:
        """The numbers of its scans, in order. In one run no two groups have the same."""
        return tuple(sorted(self.poses))

    def placed(self, views: Sequence[StationView]) -> list[Placed]:
        """Return its scans where they stand."""
        return [Placed(views[number], pose) for number, pose in self.poses.items()]

    def joined(self, other: Group, motion: FloatArray) -> Group:
        """Return both together; `motion` (3, 4) leads out of the other's frame."""
        poses = {**self.poses, **{number: composed(motion, pose) for number, pose in other.poses.items()}}
        return Group(dict(sorted(poses.items())))


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    """What is known of two groups' pose to each other."""

    hypotheses: Sequence[Hypothesis]
    judgement: Judgement

    @property
    def lead(self) -> float:
        """By how much the best one leads; below zero where nothing is claimed."""
        if self.judgement.verdict is not Verdict.REGISTERED:
            return -1.0
        second = self.hypotheses[1].score if len(self.hypotheses) > 1 else 0.0
        return self.hypotheses[0].score - max(second, 0.0)


def group_scans(
    views: Sequence[StationView],
    pairs: Hypotheses,
    level: float,
    settled: Callable[[Group], Group],
    groups: Iterable[Group] = (),
) -> list[Group]:
    """Return the scans in groups, each with the poses that were claimed.

    All scans begin by themselves, but for `groups` that are given. Of all pairs of groups those join whose
    best motion leads most, among those that may be claimed at `level`: motions come from the hypotheses of
    all pairs of scans across, and all scans across judge them. After each, `settled` brings a group's scans
    together by all that they share.
    """
    standing = list(groups)
    known = {number for group in standing for number in group.poses}
    standing += [Group({number: STILL}) for number in range(len(views)) if number not in known]
    joints: dict[tuple[_Scans, _Scans], _Joint] = {}
    while len(standing) > 1:
        for one, two in combinations(standing, 2):
            if (one.scans, two.scans) not in joints:
                joints[one.scans, two.scans] = _joint(one, two, views, pairs, level)
        ranked = sorted(
            ((joints[one.scans, two.scans].lead, one, two) for one, two in combinations(standing, 2)),
            key=lambda each: (-each[0], each[1].scans, each[2].scans),
        )
        lead, one, two = ranked[0]
        if lead < 0:
            break
        joined = settled(one.joined(two, joints[one.scans, two.scans].hypotheses[0].motion))
        standing = sorted(
            [*(group for group in standing if group is not one and group is not two), joined],
            key=lambda group: group.scans,
        )
    return standing


def _joint(one: Group, two: Group, views: Sequence[StationView], pairs: Hypotheses, level: float) -> _Joint:
    """Judge the motions of one group to another that pairs of their scans propose."""
    stay, move = one.placed(views), two.placed(views)
    motions = [
        composed(composed(pose_a, motion), inverse(pose_b))
        for a, pose_a in one.poses.items()
        for b, pose_b in two.poses.items()
        for motion in _motions(pairs, a, b)
    ]
    if not motions:
        return _Joint((), judge((), level))
    if len(one.poses) == len(two.poses) == 1:
        (a,), (b,) = one.poses, two.poses
        found: Sequence[Hypothesis] = pairs[a, b]
    else:
        several = np.array(motions)
        scores = scores_of(stay, move, several, MIDDLE_M, VIOLATION)
        found = best_of(stay, move, distinct(several, scores, move, _N_TRIED))
        alike = [
            composed(composed(pose_a, motion), inverse(pose_b))
            for a, pose_a in one.poses.items()
            for b, pose_b in two.poses.items()
            for motion in _motions(_alike(pairs), a, b)
        ]
        found = _with_images_told(found, alike, move)
    return _Joint(found, judge(found, level))


def _alike(pairs: Hypotheses) -> Hypotheses:
    """Of each pair the poses that are images of each other."""
    return {
        pair: [several[0], *(one for one in several if one.is_image)]
        for pair, several in pairs.items()
        if any(one.is_image for one in several)
    }


def _with_images_told(
    found: Sequence[Hypothesis], alike: Sequence[FloatArray], move: Sequence[Placed]
) -> list[Hypothesis]:
    """The hypotheses of two groups; those that are images of the first one, for some pair across, say so."""
    if not alike:
        return list(found)

    def is_alike(motion: FloatArray) -> bool:
        return any(len(distinct(np.array([motion, one]), np.zeros(2), move, 2)) == 1 for one in alike)

    told = is_alike(found[0].motion)
    return [
        replace(one, is_image=told and k > 0 and is_approved(one) and is_alike(one.motion))
        for k, one in enumerate(found)
    ]


def _motions(pairs: Hypotheses, a: int, b: int) -> list[FloatArray]:
    """The motions (3, 4) of scan b into the frame of scan a that are proposed."""
    if a < b:
        return [one.motion for one in pairs.get((a, b), ())]
    return [inverse(one.motion) for one in pairs.get((b, a), ())]
