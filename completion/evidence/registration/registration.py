# SPDX-License-Identifier: MIT
"""Registration: what scans say of their poses, and by how much they were moved for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.evidence.registration.scan_pair import ScanPair
from completion.observe.observation import Observation
from completion.observe.rays import rays_of
from scenes.checks import FloatArray
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """What n scans say of their poses.

    Attributes
    ----------
    motions : (n, 4, 4) float
        By which each was moved, working frame; the identity where poses are kept.
    moved_m : (n,) float
        Root mean square by which that shifted what each measured, along the normals, metres.
    left_m : (n,) float
        How far each pose may still be off along the normals of what it measured, two standard deviations,
        metres; NaN where no other scan measured the same.
    pairs : tuple of ScanPair
        Those that measured the same surfaces.
    stated_m : float
        How far poses were said to be off, metres.
    """

    motions: FloatArray
    moved_m: FloatArray
    left_m: FloatArray
    pairs: tuple[ScanPair, ...]
    stated_m: float

    @property
    def is_moved(self) -> bool:
        """Whether any scan was moved."""
        return bool((self.moved_m > 0).any())

    def applied(self, observations: Sequence[Observation], errors_m: FloatArray) -> list[Observation]:
        """Return the scans, moved, with the errors (n,) of their poses, metres."""
        return [
            replace(_moved(seen, motion), pose_error_m=error)
            for seen, motion, error in zip(observations, self.motions, errors_m.tolist(), strict=True)
        ]

    def seen_from_first(self, observations: Sequence[Observation]) -> tuple[Observation, ...]:
        """Return scans that were moved as the first one sees them: in the frame in which it did not move."""
        back = np.linalg.inv(self.motions[0])
        return tuple(_moved(seen, back) for seen in observations)

    def moved_world(self, number: int, world_from_reference: Pose) -> Pose:
        """Return by how much a scan moved in the world, seen from the first one."""
        if np.array_equal(self.motions[number], self.motions[0]):
            return Pose.identity()
        motion = np.linalg.inv(self.motions[0]) @ self.motions[number]
        return world_from_reference @ Pose(motion) @ world_from_reference.inverse()


def _moved(seen: Observation, motion: FloatArray) -> Observation:
    """A scan moved, to the bit where it is not."""
    if np.array_equal(motion, np.eye(4)):
        return seen
    scan = seen.scan.restated(world_from_sensor=Pose(motion) @ seen.scan.world_from_sensor)
    return replace(seen, scan=scan, rays=rays_of(scan))
