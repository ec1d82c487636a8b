# SPDX-License-Identifier: MIT
"""Gain: how much unknown or badly seen surface each candidate view would see.

After Sanchiz and Fisher (1999): gain = w_v * visible area of unknown faces (occplane and frontier,
foreshortened) + w_q * visible area of surface that has only been seen at a worse angle than required and
would now be seen at a good one. All directions of a position are scored by one cast: rays from the targets
to the position against the faces of the voxel map fill a spherical accumulator, over which the aperture
slides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from nbv.online.expected_gain import ExpectedGain
from nbv.online.targets import Targets
from nbv.online.view_evaluation import Accumulator, ViewEvaluation
from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.viewpoints import Candidates
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads

_BYTES_A_TARGET = 200  # that a thread takes for each target
_BYTES_A_LOOK = 2_000_000  # and for the rays into unknown space
_FLATTEST = 0.05  # unknown faces seen flatter than this do not count


@dataclass(frozen=True, slots=True, eq=False)
class BestView:
    """The best candidate: its pose, its gain in weighted square metres, and what it should see.

    Attributes
    ----------
    pose : Pose
        Where to scan from.
    gain_m2 : float
        Weighted square metres.
    sees : ViewEvaluation
        The targets that it sees.
    """

    pose: Pose
    gain_m2: float
    sees: ViewEvaluation


def best_view(
    boundary: RayCaster,
    targets: Targets,
    candidates: Candidates,
    *,
    sensor: Sensor,
    required_cosine: float,
    expected: ExpectedGain | None = None,
    n_most: int = 2000,
    n_threads: int | None = None,
) -> BestView | None:
    """Return the candidate with the largest gain, the first of equals; None where none has any.

    Parameters
    ----------
    boundary : RayCaster
        The faces between empty voxels and all others, which end lines of sight.
    candidates : Candidates
        Positions that are free, and directions.
    required_cosine : float
        At which badly seen surface counts as seen well, margin included.
    expected : ExpectedGain, optional
        What views into unknown space are worth; it replaces the unknown faces among the targets.
    n_most : int
        Candidates are compared by at most so many of the targets; the gain of the best is that of all.
    n_threads : int, optional
        Threads; the result does not depend on it.
    """
    if not candidates.n_poses or not (len(targets) or expected):
        return None
    few = targets.thinned(n_most)
    if expected is not None:
        few, targets = (some.some(~some.is_unknown) for some in (few, targets))
    # what each position sees in any direction, and the pose whose aperture holds most of it
    sees = partial(
        seen_from, boundary=boundary, required_cosine=required_cosine, sensor=sensor, expected=expected
    )
    with threads(_BYTES_A_TARGET * len(few) + _BYTES_A_LOOK, n_threads) as pool:
        seen = list(pool.map(partial(sees, few), candidates.positions))
    accumulator = Accumulator.of([evaluation.offsets for evaluation in seen], candidates, sensor)
    number = accumulator.best([evaluation.worth_m2 for evaluation in seen])
    if number is None:
        return None
    # the gain of that pose by all targets
    pose = candidates.pose(number)
    there = sees(targets, pose.translation)
    inside = sensor.sees(there.offsets @ pose.rotation)
    return BestView(pose, float(there.worth_m2[inside].sum()), there.some(inside))


def seen_from(
    targets: Targets,
    position: FloatArray,
    *,
    boundary: RayCaster,
    required_cosine: float,
    sensor: Sensor,
    expected: ExpectedGain | None,
) -> ViewEvaluation:
    """Return what a position (3,) sees in any direction, and what each is worth from there."""
    floor = np.where(targets.is_unknown, _FLATTEST, required_cosine)
    towards = position - targets.points
    distance = np.linalg.norm(towards, axis=1)
    slope = np.einsum("ij,ij->i", towards, targets.normals)
    nearest = np.where(targets.is_unknown, 0.0, sensor.min_range_m)  # beams go on into what is unknown
    near = (distance >= nearest) & (distance <= sensor.max_range_m) & (distance > 0)
    index = np.flatnonzero(near & (slope >= floor * distance))
    if len(index):
        origins = np.broadcast_to(position, (len(index), 3))
        index = index[~boundary.blocked(targets.points[index], origins)]
    unknown = targets.is_unknown[index]
    worth = targets.worth_m2[index] * np.where(unknown, slope[index] / distance[index], 1.0)
    seen = ViewEvaluation(-towards[index], worth, targets.voxel[index], unknown, np.full(len(index), -1))
    return seen if expected is None else expected.look(position, sensor.max_range_m).joined(seen)
