# SPDX-License-Identifier: MIT
"""Record: registration.json."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from completion.registration.candidates.motions import composed
from completion.registration.registered import PairVerdict, Registered
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

FORMAT = "unseen-registration/1"


def registration_record(
    found: Registered, scans: Sequence[RangeImage], names: Sequence[str]
) -> dict[str, Any]:
    """Return registration.json: scans with group, pose and covariance, and what is known of each pair.

    Parameters
    ----------
    found : Registered
        What was found.
    scans : sequence of RangeImage
        The scans (n,), with the poses that they came with.
    names : sequence of str
        What each is called.
    """
    poses = found.world_poses(scans)
    return {
        "format": FORMAT,
        "units": "m",
        "level": found.level,
        "groups": len(found.groups),
        "scans": [
            {
                "scan": names[number],
                "group": found.group_of(number),
                "world_from_sensor": None if pose is None else pose.matrix.tolist(),
                "covariance": _covariance(found, number, scans),
            }
            for number, pose in enumerate(poses)
        ],
        "pairs": [_pair_record(one, scans) for one in found.pairs],
    }


def _covariance(found: Registered, number: int, scans: Sequence[RangeImage]) -> list[list[float]] | None:
    """The covariance of a pose, turned into the world's axes; None where it is not known."""
    own, group = found.covariance_of(number), found.group_of(number)
    if own is None or group is None or not np.isfinite(own).all():
        return None
    first = next(iter(found.groups[group].group.poses))
    turn = np.kron(np.eye(2), scans[first].world_from_sensor.rotation)
    turned: FloatArray = turn @ own @ turn.T
    return [[float(value) for value in row] for row in turned]


def _pair_record(one: PairVerdict, scans: Sequence[RangeImage]) -> dict[str, Any]:
    """A pair; alternatives are poses of its second scan in the world in which the first stands."""
    world = scans[one.scans[0]].world_from_sensor
    direction = None if one.direction is None else (world.rotation @ one.direction).tolist()
    there = composed(world.matrix[:3], one.alternatives) if len(one.alternatives) else one.alternatives
    row = np.array([[0.0, 0.0, 0.0, 1.0]])
    return {
        "scans": list(one.scans),
        "verdict": one.verdict.value,
        "reason": one.reason,
        "overlap": one.overlap,
        "violations": one.violations,
        "direction": direction,
        "alternatives": [np.vstack([motion, row]).tolist() for motion in there],
    }
