# SPDX-License-Identifier: MIT
"""Joint: all scans of a room at once."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.sparse.csgraph import connected_components

from benchmarks.registration.rooms import Room, is_right, overlap
from completion.registration.pipeline import register_scans
from scenes.scan.range_image import RangeImage

_LEAST = 0.2  # overlap that connects two scans


def joint_table(first: int, n_rooms: int, n_scans: int) -> Iterator[str]:
    """Yield the lines of a table: a room each, its groups, right and wrong poses in them."""
    yield "| room | groups | connected at 20 % | right | wrong | within 3 sd | by themselves | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    total = np.zeros(5, np.int64)
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        scans = [room.scan()[0] for _ in range(n_scans)]
        started = time.process_time()
        found = register_scans(scans, n_threads=1)
        spent = time.process_time() - started
        right = wrong = within = 0
        for network in found.groups:
            anchor, *others = network.group.poses
            for number in others:
                pose = network.group.poses[number]
                true = scans[anchor].world_from_sensor.inverse() @ scans[number].world_from_sensor
                covariance = found.covariance_of(number)
                assert covariance is not None
                off = np.abs(pose[:, 3] - true.translation) / np.sqrt(np.diag(covariance)[3:])
                right, wrong = (
                    right + is_right(pose, scans[anchor], scans[number]),
                    wrong + (not is_right(pose, scans[anchor], scans[number])),
                )
                within += int((off < 3).sum())
        alone = sum(found.group_of(k) is None for k in range(n_scans))
        sizes = " + ".join(str(len(one.group.poses)) for one in found.groups) or "none"
        told = f"{within} of {3 * (right + wrong)}"
        met = connected(scans)
        yield f"| {seed} | {sizes} | {met} | {right} | {wrong} | {told} | {alone} | {spent:.1f} |"
        total += [right, wrong, within, alone, met]
    placed = total[0] + total[1]
    yield f"| all | | {total[4]} | {total[0]} | {total[1]} | {total[2]} of {3 * placed} | {total[3]} | |"


def connected(scans: list[RangeImage]) -> int:
    """Return how many poses scans that share a fifth with another one would settle."""
    n = len(scans)
    shares = np.array([[i < j and overlap(scans[i], scans[j]) >= _LEAST for j in range(n)] for i in range(n)])
    return n - int(connected_components(shares, directed=False)[0])
