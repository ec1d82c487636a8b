# SPDX-License-Identifier: MIT
"""Registered: groups of scans with their poses, and what is known of each pair."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from completion.registration import limits
from completion.registration.correction import Registration
from completion.registration.hypotheses import Hypothesis, judge_motion
from completion.registration.motions import STILL, compose, in_units, inverse
from completion.registration.network import Hypotheses, Network, NetworkEdge, ScanGroup
from completion.registration.refinement import PlacedScan, equations_of
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict, judge
from scenes.checks import FloatArray, Value
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class PairVerdict(Value):
    """What is known of the pose of one scan to another.

    Attributes
    ----------
    scans : (int, int)
        Their numbers, from 0, the smaller first.
    verdict : Verdict
        "registered" where both are in one group and share surface there.
    reason : str
        Why, for a person.
    overlap, violations : float
        Shares of the facets in view of the other that agree, and that beams contradict: of the pose in the
        group, else of the best hypothesis.
    direction : (3,) float or None
        Along which the pose slides, frame of the first scan.
    alternatives : (n, 3, 4) float
        Poses of the second scan in the frame of the first, best first; the one in the group alone where
        registered.
    """

    scans: tuple[int, int]
    verdict: Verdict
    reason: str
    overlap: float
    violations: float
    direction: FloatArray | None
    alternatives: FloatArray

    @classmethod
    def of_pose(cls, scans: tuple[int, int], held: Hypothesis, verdict: Verdict, reason: str) -> PairVerdict:
        """Return what is said of one pose alone."""
        return cls(
            scans=scans,
            verdict=verdict,
            reason=reason,
            overlap=held.agree,
            violations=held.violate,
            direction=None,
            alternatives=held.motion[None],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Registered(Value):
    """What n scans told of their poses.

    Attributes
    ----------
    networks : tuple of Network
        Groups, by their first scan; those of one scan are by themselves.
    pairs : tuple of PairVerdict
        All pairs.
    views : tuple of StationView
        What was compared of each scan, in its own frame.
    level : float or None
        Accepted probability of a false claim; None where poses were only checked.
    unit_m : float
        The unit of the views, metres.
    checked : Registration or None
        What `complete` makes of the poses that scans came with; None where no pose was checked.
    """

    networks: tuple[Network, ...]
    pairs: tuple[PairVerdict, ...]
    views: tuple[StationView, ...]
    level: float | None
    unit_m: float = 1.0
    checked: Registration | None = None

    def _facts(self) -> list[tuple[str, str]]:
        """Which scans were placed together, and what is known of their pairs."""
        verdicts = Counter(pair.verdict for pair in self.pairs)
        groups = ", ".join(str(len(network.group.poses)) for network in self.groups)
        alone = len(self.networks) - len(self.groups)
        return [
            ("scans", str(len(self.views))),
            ("placed together", groups or "none"),
            ("by themselves", str(alone)),
            *((f"pairs {verdict}", str(n)) for verdict, n in sorted(verdicts.items())),
        ]

    def in_metres(self, unit_m: float) -> Registered:
        """Return the same in metres whose poses and alternatives were in units of `unit_m`."""
        if unit_m == 1.0:
            return self
        networks = tuple(network.in_metres(unit_m) for network in self.networks)
        pairs = tuple(
            replace(pair, alternatives=in_units(pair.alternatives, 1.0 / unit_m)) for pair in self.pairs
        )
        return replace(self, networks=networks, pairs=pairs, unit_m=unit_m)

    @property
    def groups(self) -> tuple[Network, ...]:
        """Groups of two scans or more."""
        return tuple(network for network in self.networks if len(network.group.poses) > 1)

    def group_of(self, scan: int) -> int | None:
        """Return the number of a scan's group, from 0; None where it is by itself."""
        for number, group in enumerate(self.groups):
            if scan in group.group.poses:
                return number
        return None

    def pose_of(self, scan: int) -> FloatArray | None:
        """Return the pose (3, 4) of a scan in its group's frame; None where it is by itself."""
        number = self.group_of(scan)
        return None if number is None else self.groups[number].group.poses[scan]

    def covariance_of(self, scan: int) -> FloatArray | None:
        """Return the covariance (6, 6) of a scan's pose: turn (radians) and shift (metres), there."""
        number = self.group_of(scan)
        if number is None:
            return None
        network = self.groups[number]
        k = 6 * list(network.group.poses).index(scan)
        return np.asarray(network.covariance[k : k + 6, k : k + 6])

    def places_of(self, scan: int) -> FloatArray:
        """Return the places (n, 3) of a scan's facets in its own frame, metres."""
        return np.asarray(self.unit_m * self.views[scan].facets.centre)

    def residuals_of(self, network: Network) -> tuple[FloatArray, FloatArray]:
        """Return where facets of a group's scans met (n, 3), in its frame, and by how much they are off (n,).

        Metres; above zero where the later scan's surface lies behind the earlier one's.
        """
        placed = {
            number: PlacedScan(self.views[number], in_units(pose, self.unit_m))
            for number, pose in network.group.poses.items()
        }
        met = [
            equations_of([placed[edge.scans[0]]], [placed[edge.scans[1]]], STILL, limits.NETWORK_GATES_M[0])[
                0
            ]
            for edge in network.edges
        ]
        if not met:
            return np.zeros((0, 3)), np.zeros(0)
        places, offset = (
            np.concatenate([getattr(equations, name) for equations in met]) for name in ("places", "offset")
        )
        return self.unit_m * places, self.unit_m * offset

    def world_poses(self, scans: Sequence[RangeImage]) -> list[Pose | None]:
        """Return the pose of each scan in the world; None of scans that are by themselves.

        The first scan of each group stays where it says that it is: groups know nothing of each other.
        """
        poses: list[Pose | None] = [None] * len(scans)
        for network in self.networks if self.level is None else self.groups:
            first, *others = network.group.poses
            world = poses[first] = scans[first].world_from_sensor
            for number in others:
                motion = np.vstack([network.group.poses[number], [0.0, 0.0, 0.0, 1.0]])
                poses[number] = world @ Pose(motion)
        return poses

    def pose_deviation(self, scan: int) -> float:
        """Return by how much the error of a scan's pose shifts its facets along their normals, metres.

        It is the root mean square of what the pose's covariance makes probable; NaN where that is not known.
        """
        pose, covariance = self.pose_of(scan), self.covariance_of(scan)
        if pose is None or covariance is None:
            return float("nan")
        normals = self.views[scan].facets.normal @ pose[:, :3].T
        arms = self.places_of(scan) @ pose[:, :3].T
        growth = np.concatenate([np.cross(arms, normals), normals], axis=1)
        return float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", growth, covariance, growth))))


def verdicts_of(
    hypotheses: Hypotheses, networks: Sequence[Network], views: Sequence[StationView], level: float
) -> tuple[PairVerdict, ...]:
    """Return what is known of each pair of scans."""
    group_of = {scan: network for network in networks for scan in network.group.poses}
    verdicts = []
    for (i, j), several in hypotheses.items():
        network = group_of[i]
        if j in network.group.poses and any(edge.scans == (i, j) for edge in network.edges):
            motion = compose(inverse(network.group.poses[i]), network.group.poses[j])
            held = judge_motion([PlacedScan(views[i], STILL)], [PlacedScan(views[j], STILL)], motion)
            reason = "placed in one group, and they share surface there"
            verdicts.append(PairVerdict.of_pose((i, j), held, Verdict.REGISTERED, reason))
            continue
        judgement = judge(several, level)
        verdict = judgement.verdict
        reason, direction = judgement.reason, judgement.direction
        if j in network.group.poses:
            verdict, reason, direction = Verdict.NO_OVERLAP, "in one group, but they share no surface", None
        elif verdict is Verdict.REGISTERED:
            verdict, reason = Verdict.AMBIGUOUS, "other scans speak against it"
        motions = np.array([hypothesis.motion for hypothesis in several]).reshape(-1, 3, 4)
        best = several[0] if several else None
        verdicts.append(
            PairVerdict(
                scans=(i, j),
                verdict=verdict,
                reason=reason,
                overlap=best.agree if best else 0.0,
                violations=best.violate if best else 0.0,
                direction=direction,
                alternatives=motions if verdict in (Verdict.AMBIGUOUS, Verdict.SLIDES) else motions[:0],
            )
        )
    return tuple(verdicts)


def held_poses(
    views: Sequence[StationView], poses: Sequence[FloatArray], checked: Registration
) -> Registered:
    """Return what beams say of n poses (3, 4) in the frame of the first scan, as they are.

    Groups are those that `checked` leaves together, all scans where it refuses no pair. No pose has a
    covariance.
    """
    pairs, edges = [], []
    for i, j in combinations(range(len(views)), 2):
        motion = compose(inverse(poses[i]), poses[j])
        held = judge_motion([PlacedScan(views[i], STILL)], [PlacedScan(views[j], STILL)], motion)
        verdict, reason = Verdict.REGISTERED, "beams hardly contradict the poses"
        if held.violate >= limits.MOST_VIOLATED:
            verdict = Verdict.AMBIGUOUS
            reason = f"beams contradict {100 * held.violate:.1f} % of what these poses put in view"
        elif (i, j) in checked.refused:
            verdict = Verdict.AMBIGUOUS
            reason = "what both measured lies apart, and beams approve no motion that brings it together"
        elif held.score <= limits.LEAST_SCORE:
            verdict, reason = Verdict.NO_OVERLAP, "in these poses they share too little to tell"
        else:
            edges.append(NetworkEdge((i, j), 0, float("nan")))
        pairs.append(PairVerdict.of_pose((i, j), held, verdict, reason))
    networks = tuple(
        Network(
            ScanGroup({k: compose(inverse(poses[part[0]]), poses[k]) for k in part}),
            np.full((6 * len(part), 6 * len(part)), np.nan),
            tuple(edge for edge in edges if {*edge.scans} <= {*part}),
        )
        for part in checked.parts
    )
    return Registered(networks, tuple(pairs), tuple(views), None, checked=checked)


def pose_doubts(
    registration: Registration, names: Sequence[str] | None = None, *, way_out: str = ""
) -> list[str]:
    """Return what scans say against the poses that they came with, where that is more than was expected.

    Scans have `names`, or numbers from 1. `way_out` follows in brackets where scans were moved.
    """
    doubts, stated = [], registration.stated_m
    off = [pair for pair in registration.pairs if pair.offset_m > max(stated, limits.SURE * pair.offset_sd_m)]
    if off:
        worst = max(off, key=lambda pair: pair.offset_m)
        more = (
            f", and {len(off) - 1} more pairs by more than the {1000 * stated:.3g} mm stated"
            if off[1:]
            else ""
        )
        doubts.append(
            f"poses contradict what was measured: {_words([worst.first, worst.second], names)} lie "
            f"{1000 * worst.offset_m:.0f} mm apart where both measured the same{more}; "
            f"{_cure(registration, names, way_out)}"
        )
    passed = [
        pair
        for pair in registration.pairs
        if pair.still_contradicted_m2
        > max(limits.CONTRADICTED_M2, limits.CONTRADICTED_SHARE * pair.overlap_m2)
        and (pair.first, pair.second) not in registration.refused
    ]
    if passed:
        worst = max(passed, key=lambda pair: pair.still_contradicted_m2)
        more = f"; so it is with {len(passed) - 1} more pairs" if passed[1:] else ""
        doubts.append(
            f"{_words([worst.first, worst.second], names)} contradict each other: beams of one went through "
            f"{worst.still_contradicted_m2:.2g} m2 that the other measured, where both see "
            f"{worst.overlap_m2:.2g} m2 alike{more}; did something move between them?"
        )
    return doubts


def _cure(registration: Registration, names: Sequence[str] | None, way_out: str) -> str:
    """What was done about poses that are off."""
    cures = []
    if registration.refused:
        groups = " | ".join(_words(part, names) for part in registration.parts)
        cures.append(
            "beams approve no motion that brings all together, so these groups stay to each other as they "
            f"came: {groups}"
        )
    if registration.is_moved:
        cures.append(
            f"the scans were moved by up to {1000 * registration.moved_m.max():.0f} mm so that they agree"
            + (f" ({way_out})" if way_out else "")
        )
    elif not registration.refused:
        cures.append("they were kept: surfaces that several scans measured are no more exact than that")
    return "; ".join(cures)


def _words(scans: Sequence[int], names: Sequence[str] | None) -> str:
    """Scans in words."""
    each = [str(k + 1) for k in scans] if names is None else [names[k] for k in scans]
    text = " and ".join([", ".join(each[:-1]), each[-1]] if each[1:] else each)
    return text if names is not None else f"scan{'s' if each[1:] else ''} {text}"


FORMAT = "unseen-registration/1"


def registration_record(
    registration: Registered, scans: Sequence[RangeImage], names: Sequence[str]
) -> dict[str, Any]:
    """Return registration.json: scans with group, pose and covariance, and what is known of each pair.

    Parameters
    ----------
    registration : Registered
        What was found.
    scans : sequence of RangeImage
        The scans (n,), with the poses that they came with.
    names : sequence of str
        What each is called.
    """
    poses = registration.world_poses(scans)
    return {
        "format": FORMAT,
        "units": "m",
        "level": registration.level,
        "groups": len(registration.groups),
        "scans": [
            {
                "scan": names[number],
                "group": registration.group_of(number),
                "world_from_sensor": None if pose is None else pose.matrix.tolist(),
                "covariance": _covariance(registration, number, scans),
            }
            for number, pose in enumerate(poses)
        ],
        "pairs": [_pair_record(pair, scans) for pair in registration.pairs],
    }


def _covariance(
    registration: Registered, number: int, scans: Sequence[RangeImage]
) -> list[list[float]] | None:
    """The covariance of a pose, turned into the world's axes; None where it is not known."""
    covariance_here, group = registration.covariance_of(number), registration.group_of(number)
    if covariance_here is None or group is None or not np.isfinite(covariance_here).all():
        return None
    first = next(iter(registration.groups[group].group.poses))
    turn = np.kron(np.eye(2), scans[first].world_from_sensor.rotation)
    turned: FloatArray = turn @ covariance_here @ turn.T
    return [[float(value) for value in row] for row in turned]


def _pair_record(verdict: PairVerdict, scans: Sequence[RangeImage]) -> dict[str, Any]:
    """A pair; alternatives are poses of its second scan in the world in which the first stands."""
    world = scans[verdict.scans[0]].world_from_sensor
    direction = None if verdict.direction is None else (world.rotation @ verdict.direction).tolist()
    there = (
        compose(world.matrix[:3], verdict.alternatives) if len(verdict.alternatives) else verdict.alternatives
    )
    row = np.array([[0.0, 0.0, 0.0, 1.0]])
    return {
        "scans": list(verdict.scans),
        "verdict": verdict.verdict.value,
        "reason": verdict.reason,
        "overlap": verdict.overlap,
        "violations": verdict.violations,
        "direction": direction,
        "alternatives": [np.vstack([motion, row]).tolist() for motion in there],
    }
