# SPDX-License-Identifier: MIT
"""Joint: all scans of a room at once."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.sparse.csgraph import connected_components

from benchmarks.registration.pairs import coordinates_within
from benchmarks.registration.rooms import Room, is_right, overlap
from completion.registration.pipeline import register_scans
from scenes.checks import IntArray
from scenes.scan.range_image import RangeImage

_LEAST = 0.2  # overlap that connects two scans


def joint_table(first: int, n_rooms: int, n_scans: int) -> Iterator[str]:
    """Yield the lines of a table: a room each, its groups, right and wrong poses in them."""
    yield "| room | groups | connected at 20 % | right | wrong | turns, shifts within 3 sd | alone | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    total, all_within = np.zeros(4, np.int64), np.zeros((2, 2), np.int64)
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        scans = [room.scan()[0] for _ in range(n_scans)]
        started = time.process_time()
        found = register_scans(scans, n_threads=1)
        spent = time.process_time() - started
        right = wrong = 0
        within = np.zeros((2, 2), np.int64)
        for network in found.groups:
            anchor, *others = network.group.poses
            for number in others:
                pose = network.group.poses[number]
                covariance = found.covariance_of(number)
                assert covariance is not None
                good = is_right(pose, scans[anchor], scans[number])
                right, wrong = right + good, wrong + (not good)
                within += coordinates_within(pose, covariance, (scans[anchor], scans[number]))
        alone = sum(found.group_of(k) is None for k in range(n_scans))
        sizes = " + ".join(str(len(one.group.poses)) for one in found.groups) or "none"
        met = connected(scans)
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
