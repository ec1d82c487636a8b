# SPDX-License-Identifier: MIT
"""Registration from any start: how often it is right, and how often it claims what is not so.

Right is within 3 degrees and 10 cm of the truth.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from benchmarks.cases.frames import REAL
from benchmarks.cases.pairs import (
    ANGLES_DEG,
    NOISE_M,
    OBJECTS,
    Room,
    Thing,
    is_right,
    is_right_of_objects,
    overlap,
)
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.registration.hypotheses import find_hypotheses
from completion.registration.motions import STILL, compose, inverse
from completion.registration.network import ScanGroup, settle_group
from completion.registration.pipeline import LEVEL, register_scans
from completion.registration.registered import Registered
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict, judge, with_images
from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_BINS = (0.0, 0.1, 0.2, 0.4, 0.6, 1.0)


class _Pair(NamedTuple):
    """A pair of scans: overlap; whether the best motion is claimed, right, and any is right; CPU seconds."""

    overlap: float
    is_claimed: bool
    is_right: bool
    any_right: bool
    cpu_s: float


class _Pairs(NamedTuple):
    """Pairs of a room; coordinates within three deviations, of how many; whether strangers are claimed."""

    pairs: list[_Pair]
    within: IntArray
    strangers: bool | None


def _room_pairs(seed: int, has_before: bool) -> _Pairs:
    """Three pairs of scans of a room, and the last pair's first scan of the room before as a stranger."""
    pairs, within, strangers = list[_Pair](), np.zeros((2, 2), np.int64), None
    for k, (a, b) in enumerate([room.pair() for room in [Room(seed)] for _ in range(3)]):
        shared, started = overlap(a, b), time.process_time()
        one, two = StationView.of(a), StationView.of(b)
        motions = with_images(find_hypotheses(one, two), one, two)
        spent, right = time.process_time() - started, [is_right(each.motion, a, b) for each in motions]
        claimed = judge(motions, LEVEL).verdict is Verdict.REGISTERED
        pairs.append(_Pair(shared, claimed, right[:1] == [True], any(right), spent))
        if right[:1] == [True] and claimed:
            within += within_three(motions[0].motion, (one, two), (a, b))
        if k == 2 and has_before:
            *_, (last, _) = [room.pair() for room in [Room(seed - 1)] for _ in range(3)]
            before = StationView.of(last)
            found = with_images(find_hypotheses(before, two), before, two)
            strangers = judge(found, LEVEL).verdict is Verdict.REGISTERED
    return _Pairs(pairs, within, strangers)


@suite("pairs", smallest="--rooms 1")
def pairs(first: int = 9000, rooms: int = 100) -> Iterator[str]:
    """Pairs of scans of rooms that look 30 to 120 degrees apart, and of different rooms, without a start.

    By overlap, the least share of either scan's points that the other measured: how often the best motion is
    right, how often the right one is claimed, how often the truth is among the others, and wrong claims.
    """
    results = [*each(_room_pairs, first, False), *each(_room_pairs, range(first + 1, first + rooms), True)]
    yield from head(
        "overlap", "pairs", "best is right", "of these claimed", "else truth among them", "wrong claims"
    )
    every = [pair for result in results for pair in result.pairs]
    for low, high in pairwise(_BINS):
        own = [pair for pair in every if low <= pair.overlap < high]
        unclaimed = [pair.any_right for pair in own if not pair.is_claimed]
        yield row(
            f"{100 * low:.0f}-{100 * high:.0f} %", len(own), sum(pair.is_right for pair in own),
            sum(pair.is_claimed and pair.is_right for pair in own),
            f"{sum(unclaimed)} of {len(unclaimed)}",
            sum(pair.is_claimed and not pair.is_right for pair in own),
        )  # fmt: skip
    strangers = [result.strangers for result in results if result.strangers is not None]
    yield row("strangers", len(strangers), "", "", "", sum(strangers))
    within = np.sum([result.within for result in results], axis=0)
    yield (
        f"within 3 sd of what is stated: turns {within[0, 0]} of {within[0, 1]} coordinates, "
        f"shifts {within[1, 0]} of {within[1, 1]}"
    )
    yield f"median {np.median([pair.cpu_s for pair in every]):.2f} CPU s a pair, segmentation included"


def within_three(
    motion: FloatArray, views: tuple[StationView, StationView], scans: tuple[RangeImage, RangeImage]
) -> IntArray:
    """Return how many coordinates of a pair's pose lie within three deviations, of how many: (2, 2)."""
    network = settle_group(ScanGroup({0: STILL, 1: motion}), views)
    return coordinates_within(network.group.poses[1], network.covariance[6:, 6:], scans)


def coordinates_within(
    motion: FloatArray, covariance: FloatArray, scans: tuple[RangeImage, RangeImage]
) -> IntArray:
    """Return how many coordinates of a motion (3, 4) lie within three deviations of the truth, of how many.

    A row for turns and one for shifts (2, 2).
    """
    true = scans[0].world_from_sensor.inverse() @ scans[1].world_from_sensor
    turn = Rotation.from_matrix(motion[:, :3] @ true.rotation.T).as_rotvec()
    off = np.abs(np.concatenate([turn, motion[:, 3] - true.translation]))
    met = (off < 3 * np.sqrt(np.diag(covariance))).reshape(2, 3)
    return np.stack([met.sum(axis=1), [3, 3]], axis=1)


_LEAST = 0.2  # overlap that connects two scans


@suite("joint", smallest="--rooms 1 --scans 2")
def joint(first: int = 9000, rooms: int = 20, scans: int = 6) -> Iterator[str]:
    """All scans of a room registered at once: groups, right and wrong poses in them."""
    n_scans = scans
    yield from head(
        "room", "groups", "connected at 20 %", "right", "wrong", "turns, shifts within 3 sd", "alone", "CPU s"
    )
    total, all_within = np.zeros(4, np.int64), np.zeros((2, 2), np.int64)
    for seed in range(first, first + rooms):
        room = Room(seed)
        taken = [room.scan()[0] for _ in range(n_scans)]
        started = time.process_time()
        found = register_scans(taken, n_threads=1)
        spent = time.process_time() - started
        right = wrong = 0
        within = np.zeros((2, 2), np.int64)
        for network in found.groups:
            anchor, *others = network.group.poses
            for number in others:
                pose = network.group.poses[number]
                covariance = found.covariance_of(number)
                assert covariance is not None
                good = is_right(pose, taken[anchor], taken[number])
                right, wrong = right + good, wrong + (not good)
                within += coordinates_within(pose, covariance, (taken[anchor], taken[number]))
        alone = sum(found.group_of(k) is None for k in range(n_scans))
        sizes = " + ".join(str(len(one.group.poses)) for one in found.groups) or "none"
        met = connected(taken)
        yield f"| {seed} | {sizes} | {met} | {right} | {wrong} | {_told(within)} | {alone} | {spent:.1f} |"
        total += [right, wrong, alone, met]
        all_within += within
    yield f"| all | | {total[3]} | {total[0]} | {total[1]} | {_told(all_within)} | {total[2]} | |"


def _told(within: IntArray) -> str:
    """Turns and shifts within three deviations, of how many coordinates."""
    return f"{within[0, 0]} and {within[1, 0]} of {within[0, 1]}"


def connected(scans: list[RangeImage]) -> int:
    """Return how many poses scans that share a fifth with another one would settle."""
    n = len(scans)
    shares = np.array([[i < j and overlap(scans[i], scans[j]) >= _LEAST for j in range(n)] for i in range(n)])
    return n - int(connected_components(shares, directed=False)[0])


_LEAST_OF_REAL, _MOST_M = 0.3, 10.0  # overlap of pairs that are counted, and how far frames are moved


@suite("real-pairs", smallest="--only open3d_redwood")
def real_pairs(only: str = "") -> Iterator[str]:
    """Real frames, each turned by any angle and moved by up to 10 m first: pairs, and all frames at once."""
    yield from head(
        "frames | pairs, overlap from 30 % | best is right | of these claimed | wrong claims, all pairs | "
        "no motion is right | together: right | wrong | by themselves | median deg, mm"
    )
    rng = np.random.default_rng(24)
    for source in REAL:
        if only not in ("", source.name):
            continue
        frames, moved = source.frames, [_put_off(frame, rng) for frame in source.frames]
        counts = np.zeros(5, np.int64)
        for i, j in combinations(range(len(frames)), 2):
            found = register_scans([moved[i], moved[j]], level=LEVEL, n_threads=1)
            claimed, best = bool(found.groups), _best(found, 0, 1)
            right = best is not None and is_right(best, frames[i], frames[j])
            counts[4] += claimed and not right
            if overlap(frames[i], frames[j], max(0.03, 2 * source.registration_m)) < _LEAST_OF_REAL:
                continue
            counts[:4] += [1, right, right and claimed, is_right(STILL, frames[i], frames[j])]
        yield (
            "| "
            + " | ".join([source.name, *map(str, counts[[0, 1, 2, 4, 3]]), *_together(frames, moved)])
            + " |"
        )


def _together(frames: tuple[RangeImage, ...], moved: list[RangeImage]) -> list[str]:
    """What comes of all frames at once."""
    found = register_scans(moved, level=LEVEL, n_threads=1)
    right = wrong = 0
    off: list[tuple[float, float]] = []
    for network in found.groups:
        anchor, *others = network.group.poses
        for k in others:
            pose = compose(inverse(network.group.poses[anchor]), network.group.poses[k])
            good = is_right(pose, frames[anchor], frames[k])
            right, wrong = right + good, wrong + (not good)
            true = frames[anchor].world_from_sensor.inverse() @ frames[k].world_from_sensor
            turn = Rotation.from_matrix(pose[:, :3].T @ true.rotation).magnitude()
            off.append((float(np.degrees(turn)), 1000 * float(np.linalg.norm(pose[:, 3] - true.translation))))
    alone = sum(found.group_of(k) is None for k in range(len(frames)))
    middle = np.median(np.array(off), axis=0) if off else (np.nan, np.nan)
    return [str(right), str(wrong), str(alone), f"{middle[0]:.2f}, {middle[1]:.0f}"]


def _best(found: Registered, i: int, j: int) -> FloatArray | None:
    """The motion (3, 4) of scan j to scan i that is claimed, else the first of those that are told."""
    a, b = found.pose_of(i), found.pose_of(j)
    if a is not None and b is not None:
        return compose(inverse(a), b)
    (pair,) = found.pairs
    return pair.alternatives[0] if len(pair.alternatives) else None


def _put_off(scan: RangeImage, rng: np.random.Generator) -> RangeImage:
    """The scan turned and moved at random."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=rng).as_matrix()
    direction = rng.normal(size=3)
    matrix[:3, 3] = rng.uniform(0, _MOST_M) * direction / np.linalg.norm(direction)
    return scan.with_facts(world_from_sensor=Pose(matrix))


@suite("objects", smallest="--pairs 1")
def objects(first: int = 0, pairs: int = 4) -> Iterator[str]:
    """Free-form objects of the shared data seen from two sides, 30, 60 and 90 degrees apart."""
    n_pairs = pairs
    yield from head(
        "object", "degrees apart", "pairs", "median overlap", "best is right", "claimed", "falsely", "CPU s"
    )
    for name in OBJECTS:
        thing = Thing(name)
        for angle in ANGLES_DEG:
            rng = np.random.default_rng([first, angle])
            counts, shares, spent = np.zeros(3, np.int64), [], 0.0
            for _ in range(n_pairs):
                a, b = thing.pair(angle, rng)
                shares.append(overlap(a, b, 4 * NOISE_M))
                started = time.process_time()
                found = register_scans([a, b], level=LEVEL, n_threads=1)
                spent += time.process_time() - started
                (told,) = found.pairs
                held = found.pose_of(1)
                motions = told.alternatives if held is None else [compose(inverse(STILL), held)]
                right = len(motions) > 0 and is_right_of_objects(motions[0], a, b)
                counts += [right, held is not None, held is not None and not right]
            yield (
                f"| {name} | {angle} | {n_pairs} | {np.median(shares):.2f} | {counts[0]} | {counts[1]} "
                f"| {counts[2]} | {spent / n_pairs:.2f} |"
            )
