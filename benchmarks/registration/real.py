# SPDX-License-Identifier: MIT
"""Real frames as scans of their own, each turned by any angle and moved by up to 10 m first."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.completion.ledger.sources import REAL
from benchmarks.registration.rooms import is_right, overlap
from completion.registration.motions import STILL, composed, inverse
from completion.registration.pipeline import LEVEL, register_scans
from completion.registration.registered import Registered
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_LEAST, _MOST_M = 0.3, 10.0  # overlap of pairs that are counted, and how far frames are moved


def real_table() -> Iterator[str]:
    """Yield the lines of a table: pairs of each source by themselves, and all its frames at once."""
    yield (
        "| frames | pairs, overlap from 30 % | best is right | of these claimed | wrong claims, all pairs "
        "| no motion is right | together: right | wrong | by themselves | median deg, mm |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    rng = np.random.default_rng(24)
    for source in REAL:
        frames, moved = source.frames, [_put_off(frame, rng) for frame in source.frames]
        counts = np.zeros(5, np.int64)
        for i, j in combinations(range(len(frames)), 2):
            found = register_scans([moved[i], moved[j]], level=LEVEL, n_threads=1)
            claimed, best = bool(found.groups), _best(found, 0, 1)
            right = best is not None and is_right(best, frames[i], frames[j])
            counts[4] += claimed and not right
            if overlap(frames[i], frames[j], max(0.03, 2 * source.registration_m)) < _LEAST:
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
            pose = composed(inverse(network.group.poses[anchor]), network.group.poses[k])
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
        return composed(inverse(a), b)
    (pair,) = found.pairs
    return pair.alternatives[0] if len(pair.alternatives) else None


def _put_off(scan: RangeImage, rng: np.random.Generator) -> RangeImage:
    """The scan turned and moved at random."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=rng).as_matrix()
    direction = rng.normal(size=3)
    matrix[:3, 3] = rng.uniform(0, _MOST_M) * direction / np.linalg.norm(direction)
    return scan.restated(world_from_sensor=Pose(matrix))
