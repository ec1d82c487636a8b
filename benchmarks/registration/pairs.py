# SPDX-License-Identifier: MIT
"""Pairs: three pairs of scans of each room that look 30 to 120 degrees apart, and strangers.

Those that are claimed rightly are settled, and their poses held against the deviations that are stated.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.registration.rooms import Room, is_right, overlap
from completion.registration.hypotheses import Hypothesis, find_hypotheses
from completion.registration.motions import STILL
from completion.registration.network import Group, settle_group
from completion.registration.pipeline import LEVEL
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict, judge, with_images
from scenes.checks import FloatArray, IntArray
from scenes.scan.range_image import RangeImage

_BINS = (0.0, 0.1, 0.2, 0.4, 0.6, 1.0)


def pair_table(first: int, n_rooms: int) -> Iterator[str]:
    """Yield the lines of a table: pairs by overlap, and strangers."""
    rows: list[tuple[float, list[Hypothesis], list[bool], float]] = []
    strangers: list[list[Hypothesis]] = []
    within = np.zeros((2, 2), np.int64)
    before: StationView | None = None
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        for _ in range(3):
            a, b = room.pair()
            shared = overlap(a, b)
            started = time.process_time()
            one, two = StationView.of(a), StationView.of(b)
            found = with_images(find_hypotheses(one, two), one, two)
            rows.append(
                (
                    shared,
                    found,
                    [is_right(each.motion, a, b) for each in found],
                    time.process_time() - started,
                )
            )
            if rows[-1][2][:1] == [True] and judge(found, LEVEL).verdict is Verdict.REGISTERED:
                within += within_three(found[0].motion, (one, two), (a, b))
        if before is not None:
            strangers.append(with_images(find_hypotheses(before, two), before, two))
        before = one
    yield "| overlap | pairs | best is right | of these claimed | else truth among them | wrong claims |"
    yield "|---|---|---|---|---|---|"
    for low, high in pairwise(_BINS):
        own = [row for row in rows if low <= row[0] < high]
        claimed = [judge(row[1], LEVEL).verdict is Verdict.REGISTERED for row in own]
        best = [bool(row[2]) and row[2][0] for row in own]
        sure = sum(c and r for c, r in zip(claimed, best, strict=True))
        among = [any(row[2]) for row, c in zip(own, claimed, strict=True) if not c]
        wrong = sum(c and not r for c, r in zip(claimed, best, strict=True))
        yield (
            f"| {100 * low:.0f}-{100 * high:.0f} % | {len(own)} | {sum(best)} | {sure} "
            f"| {sum(among)} of {len(among)} | {wrong} |"
        )
    false = sum(judge(one, LEVEL).verdict is Verdict.REGISTERED for one in strangers)
    yield f"| strangers | {len(strangers)} | | | | {false} |"
    yield (
        f"within 3 sd of what is stated: turns {within[0, 0]} of {within[0, 1]} coordinates, "
        f"shifts {within[1, 0]} of {within[1, 1]}"
    )
    yield f"median {np.median([row[3] for row in rows]):.2f} CPU s a pair, segmentation included"


def within_three(
    motion: FloatArray, views: tuple[StationView, StationView], scans: tuple[RangeImage, RangeImage]
) -> IntArray:
    """Return how many coordinates of a pair's pose lie within three deviations, of how many: (2, 2)."""
    network = settle_group(Group({0: STILL, 1: motion}), views)
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
