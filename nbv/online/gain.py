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
from numpy.typing import NDArray

from nbv.coverage.completed_surfaces import CompletedSurfaces
from nbv.online.accumulator import Accumulator
from nbv.online.expected_gain import ExpectedGain
from nbv.online.occupancy import EMPTY, OCCPLANE, UNSEEN, BoundaryFaces, VoxelMap
from nbv.online.view_evaluation import ViewEvaluation
from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.viewpoints import Candidates
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads

_BYTES_A_TARGET, _BYTES_A_LOOK = (
    200,
    2_000_000,
)  # that a thread takes: what it asks of targets, a prospect's rays
_FLATTEST = 0.05  # unknown faces seen flatter than this do not count


@dataclass(frozen=True, slots=True, kw_only=True)
class GainOptions:
    """Weights of the gain.

    Parameters
    ----------
    occplane_weight : float
        w_v, for unknown faces; with completion a `ExpectedGain` says what they are worth instead.
    quality_weight : float
        w_q, for surface seen worse than required; 0 gives the planner that only looks for the unknown.
    modelled_weight : float
        By what w_q is multiplied where completion knows the surface well enough without a better view.
    angle_margin_deg : float
        By how many degrees a predicted view must be better than required: voxels know normals roughly.
    max_attempts : int
        A target that this many views should have settled, and did not, no longer counts.
    max_targets : int
        Candidates are compared by at most so many targets; above, every k-th stands for its neighbours.

    Raises
    ------
    InputError
        Negative weights or margin, both weights 0, counts below 1.
    """

    occplane_weight: float = 1.0
    quality_weight: float = 1.0
    modelled_weight: float = 0.05
    angle_margin_deg: float = 2.0
    max_attempts: int = 2
    max_targets: int = 2000

    def __post_init__(self) -> None:
        least = min(self.occplane_weight, self.quality_weight, self.modelled_weight, self.angle_margin_deg)
        if least < 0:
            raise InputError(f"weights and margin of the gain must not be negative, got {self}")
        if self.occplane_weight == 0 and self.quality_weight == 0:
            raise InputError("with both weights 0 no view has any gain; give one a positive weight")
        if min(self.max_attempts, self.max_targets) < 1:
            raise InputError(f"max_attempts and max_targets must be at least 1, got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """What is worth seeing.

    Attributes
    ----------
    points, normals : (n, 3) float
        Where a view must look, in free space just before the target; and the target's normal.
    worth_m2 : (n,) float
        Weighted area.
    voxel : (n,) int64
        Voxel of the target.
    is_unknown : (n,) bool
        Unknown face (its worth is foreshortened) or badly seen surface (all or nothing).
    """

    points: FloatArray
    normals: FloatArray
    worth_m2: FloatArray
    voxel: NDArray[np.int64]
    is_unknown: BoolArray

    def __len__(self) -> int:
        return len(self.points)

    def some(self, chosen: BoolArray | NDArray[np.int64] | slice, times_worth: int = 1) -> Targets:
        """Return the chosen targets, each worth so many times as much."""
        worth = self.worth_m2[chosen] * times_worth
        return Targets(
            self.points[chosen], self.normals[chosen], worth, self.voxel[chosen], self.is_unknown[chosen]
        )

    def thinned(self, n_most: int) -> Targets:
        """Return at most about `n_most` targets: every k-th, worth k times as much."""
        k = -(-len(self) // n_most)
        return self if k <= 1 else self.some(slice(k // 2, None, k), k)


@dataclass(frozen=True, slots=True, eq=False)
class BestView:
    """The best candidate: its pose, its gain in weighted square metres, and what it should settle.

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


def find_targets(
    voxels: VoxelMap,
    faces: BoundaryFaces,
    required_cosine: float,
    attempts: NDArray[np.int32],
    options: GainOptions,
    completed: CompletedSurfaces | None = None,
) -> Targets:
    """List what is worth seeing.

    Parameters
    ----------
    voxels, faces : VoxelMap, BoundaryFaces
        The map and its boundary.
    required_cosine : float
        Surfels of lower quality are targets.
    attempts : (2, n_voxels) int
        How many views should have settled a voxel's badly seen surface (0) and unknown faces (1).
    options : GainOptions
        Weights.
    completed : CompletedSurfaces, optional
        What completion makes of the scans: badly seen surface that it knows is worth little.
    """
    side = voxels.grid.voxel_m
    label = voxels.labels[faces.voxel]
    unknown = ((label == OCCPLANE) | (label == UNSEEN)) & (attempts[1, faces.voxel] < options.max_attempts)
    surfels = voxels.surfels
    poor = (surfels.quality < required_cosine) & (attempts[0, surfels.voxels] < options.max_attempts)
    worse = np.full(len(surfels.keys), options.quality_weight)
    if completed is not None:
        known = completed.modelled(surfels.points, surfels.normals, side / 2)
        worse[known] *= options.modelled_weight
    before_faces = faces.centres[unknown] + faces.outward[unknown] * (side / 2)
    before_surface = _lifted(voxels, surfels.points[poor], surfels.normals[poor])
    slope = voxels.towards_empty(faces.voxel[unknown])
    flatter = np.maximum(np.einsum("ij,ij->i", slope, faces.outward[unknown]), 0.0)
    worth = [
        options.occplane_weight * side**2 * flatter,
        worse[poor] * surfels.areas[poor],
    ]
    targets = Targets(
        points=np.concatenate([before_faces, before_surface]),
        normals=np.concatenate([slope, surfels.normals[poor]]),
        worth_m2=np.concatenate(worth),
        voxel=np.concatenate([faces.voxel[unknown], surfels.voxels[poor]]),
        is_unknown=np.repeat([True, False], [len(before_faces), len(before_surface)]),
    )
    return targets.some(targets.worth_m2 > 0)


def best_view(
    voxels: VoxelMap,
    faces: BoundaryFaces,
    targets: Targets,
    candidates: Candidates,
    sensor: Sensor,
    required_cosine: float,
    *,
    expected: ExpectedGain | None = None,
    n_most: int = 2000,
    n_threads: int | None = None,
) -> BestView | None:
    """Return the candidate with the largest gain, the first of equals; None where none has any.

    Parameters
    ----------
    voxels, faces, targets
        The map, its boundary and `find_targets` of it.
    candidates : Candidates
        Positions that are free, and directions.
    sensor : Sensor
        Aperture and range gate.
    required_cosine : float
        At which badly seen surface counts as seen well, margin included.
    n_most : int
        Candidates are compared by at most so many of the targets; the gain of the best is that of all
        targets.
    n_threads : int, optional
        Threads; the result does not depend on it.
    """
    if not candidates.n_poses or not (len(targets) or expected):
        return None
    caster = RayCaster(*faces.triangles(voxels.grid.voxel_m), n_threads=1)
    sees = partial(_seen_from, caster, required_cosine, sensor, expected)
    few = targets.thinned(n_most)
    if expected is not None:  # what is unknown is its affair
        few, targets = (some.some(~some.is_unknown) for some in (few, targets))
    with threads(_BYTES_A_TARGET * len(few) + _BYTES_A_LOOK, n_threads) as pool:
        seen = list(pool.map(partial(sees, few), candidates.positions))
    accumulator = Accumulator.of([evaluation.offsets for evaluation in seen], candidates, sensor)
    number = accumulator.best([evaluation.worth_m2 for evaluation in seen])
    if number is None:
        return None
    pose = candidates.pose(number)
    there = sees(targets, pose.translation)
    inside = sensor.sees(there.offsets @ pose.rotation)
    gain = float(there.worth_m2[inside].sum())
    return BestView(pose, gain, there.some(inside))


def _seen_from(
    caster: RayCaster,
    required_cosine: float,
    sensor: Sensor,
    expected: ExpectedGain | None,
    targets: Targets,
    position: FloatArray,
) -> ViewEvaluation:
    """Return what a position sees in any direction, and what each is worth from there."""
    floor = np.where(targets.is_unknown, _FLATTEST, required_cosine)
    towards = position - targets.points
    distance = np.linalg.norm(towards, axis=1)
    slope = np.einsum("ij,ij->i", towards, targets.normals)
    nearest = np.where(targets.is_unknown, 0.0, sensor.min_range_m)  # beams go on into what is unknown
    near = (distance >= nearest) & (distance <= sensor.max_range_m) & (distance > 0)
    index = np.flatnonzero(near & (slope >= floor * distance))
    if len(index):
        origins = np.broadcast_to(position, (len(index), 3))
        index = index[~caster.blocked(targets.points[index], origins)]
    unknown = targets.is_unknown[index]
    worth = targets.worth_m2[index] * np.where(unknown, slope[index] / distance[index], 1.0)
    seen = ViewEvaluation(-towards[index], worth, targets.voxel[index], unknown, np.full(len(index), -1))
    return seen if expected is None else expected.look(position, sensor.max_range_m).joined(seen)


def _lifted(voxels: VoxelMap, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Move surface points along their normals until they lie in an empty voxel, by one to two voxels."""
    lifted = points + normals * voxels.grid.voxel_m * 2
    for sides in (1.75, 1.5, 1.25, 1.0):
        nearer = points + normals * voxels.grid.voxel_m * sides
        cell = voxels.grid.index_of(nearer)
        free = np.where(cell >= 0, voxels.labels[cell] == EMPTY, voxels.outside_is_empty)
        lifted[free] = nearer[free]
    return lifted
