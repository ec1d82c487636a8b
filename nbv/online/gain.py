# SPDX-License-Identifier: MIT
"""Gain: how much unknown or badly seen surface each candidate view would see.

After Sanchiz and Fisher (1999): gain = w_v * visible area of unknown faces (occplane and frontier,
foreshortened) + w_q * visible area of surface that has only been seen at a worse angle than required and
would now be seen at a good one. All directions of a position are scored by one cast: rays from the targets
to the position against the faces of the voxel map fill a spherical accumulator, over which the aperture
slides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.online.limits import FLATTEST
from nbv.online.look_ahead import plan_ahead
from nbv.online.targets import GainOptions, Targets
from nbv.scanning.sensor import Sensor
from nbv.visibility.viewpoints import Candidates
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads
from texture.engine.compiled import compiled


@compiled
def fill_cells(offsets: FloatArray, n: int, cells: NDArray[np.int64]) -> None:
    """Write the cell (k,) of a cube map with n cells along an edge that each direction (k, 3) falls into."""
    for k in range(len(offsets)):
        axis = 0
        for other in range(1, 3):
            if abs(offsets[k, other]) > abs(offsets[k, axis]):
                axis = other
        away = abs(offsets[k, axis])
        cell = axis + 3 if offsets[k, axis] < 0 else axis
        for step in range(1, 3):
            along = (offsets[k, (axis + step) % 3] / away + 1) / 2 * n
            cell = cell * n + int(min(max(along, 0.0), n - 1.0))
        cells[k] = cell


@compiled
def add_gains(
    worth: FloatArray,
    cells: NDArray[np.int64],
    ends: NDArray[np.int64],
    begins: NDArray[np.int32],
    directions: NDArray[np.int32],
    gains: FloatArray,
) -> None:
    """Add to the gains (positions, directions) what each position sees within the aperture of each direction.

    What position i sees stands from `ends[i]` to `ends[i + 1]`, its `worth` and its cell; the directions in
    whose aperture a cell lies stand from `begins` of that cell to the next one's.
    """
    for i in range(len(gains)):
        for k in range(ends[i], ends[i + 1]):
            if worth[k] != 0:
                for at in range(begins[cells[k]], begins[cells[k] + 1]):
                    gains[i, directions[at]] += worth[k]


_SPHERE_CELLS = 16  # cells of the accumulator along a cube edge: 6 x 16 x 16, about 5.6 deg each
_REFINED = 8  # best poses of the accumulator whose gain is counted exactly


@dataclass(frozen=True, slots=True, eq=False)
class ViewEvaluation:
    """What a position sees of n targets in all directions.

    `offsets` (n, 3) are from the position, metres along the world's axes; `worth_m2` (n,) is what each is
    worth from there, and `share` (n,) the part 0..1 of it that seeing it from there settles.
    """

    offsets: FloatArray
    worth_m2: FloatArray
    voxel: NDArray[np.int64]
    is_unknown: BoolArray
    share: FloatArray

    def some(self, chosen: BoolArray) -> ViewEvaluation:
        """Return those that are chosen (n,)."""
        return ViewEvaluation(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Accumulator:
    """What each position sees, by direction, over which the sensor's aperture slides.

    Attributes
    ----------
    offsets : tuple of (k, 3) float
        For each position what it sees in any direction, from there, metres along the world's axes.
    cells : (sum of k,) int
        Cell of the accumulator in which each of them is seen.
    apertures : (n_cells, n_directions) csr or None
        1 where a cell lies in the aperture of a direction; None where each position has its own directions.
    """

    candidates: Candidates
    sensor: Sensor
    offsets: tuple[FloatArray, ...]
    cells: NDArray[np.int64]
    apertures: csr_array | None

    @classmethod
    def of(cls, offsets: Sequence[FloatArray], candidates: Candidates, sensor: Sensor) -> Accumulator:
        """Return the accumulator of what each position sees, as offsets (k, 3) along the world's axes."""
        cells = cell_of(np.concatenate(offsets))
        if candidates.directions.ndim == 3:
            return cls(candidates, sensor, tuple(offsets), cells, None)
        middles = cell_directions()
        inside = [sensor.sees(middles @ rotation) for rotation in candidates.rotations()]
        apertures = csr_array(np.array(inside, dtype=np.float64).T)
        return cls(candidates, sensor, tuple(offsets), cells, apertures)

    def best(self, worth: Sequence[FloatArray]) -> int | None:
        """Return the number of the pose that sees the largest worth, the first of equals; None without any.

        `worth` holds for each position (k,) what each that it sees is worth from there.
        """
        best, most = None, 0.0
        for number in self._select_promising(worth):
            i, inside = self.inside(number)
            gain = float(worth[i][inside].sum())
            if gain > most:
                best, most = number, gain
        return best

    def inside(self, number: int) -> tuple[int, BoolArray]:
        """Return the position of a pose, and which (k,) of what that sees lie in the pose's aperture."""
        i, pose = number // self.candidates.n_directions, self.candidates.pose(number)
        return i, self.sensor.sees(self.offsets[i] @ pose.rotation)

    def _select_promising(self, worth: Sequence[FloatArray]) -> list[int]:
        """Numbers of the few poses that see most by whole cells; of all where directions differ."""
        if self.apertures is None:
            return list(range(self.candidates.n_poses))
        ends = np.cumsum([0] + [len(offsets) for offsets in self.offsets])
        gains, apertures = np.zeros((len(self.offsets), self.candidates.n_directions)), self.apertures
        add_gains(np.concatenate(worth), self.cells, ends, apertures.indptr, apertures.indices, gains)
        numbers = np.argsort(-gains.ravel(), kind="stable")[:_REFINED]
        return sorted(numbers.tolist())


def cell_of(offsets: FloatArray) -> NDArray[np.int64]:
    """Cell (n,) of the spherical accumulator, a cube map, that each direction (n, 3) falls into."""
    cells = np.empty(len(offsets), np.int64)
    fill_cells(offsets, _SPHERE_CELLS, cells)
    return cells


def cell_directions(n: int = _SPHERE_CELLS) -> FloatArray:
    """Unit directions (6 * n * n, 3) of the middles of a cube map's cells; by default the accumulator's."""
    side, i, j = np.unravel_index(np.arange(6 * n**2), (6, n, n))
    rows, axis = np.arange(len(side)), side % 3
    directions = np.zeros((len(side), 3))
    directions[rows, axis] = np.where(side < 3, 1.0, -1.0)
    directions[rows, (axis + 1) % 3] = (i + 0.5) / n * 2 - 1
    directions[rows, (axis + 2) % 3] = (j + 0.5) / n * 2 - 1
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


_DEFAULT_GAIN = GainOptions()
_BYTES_A_TARGET = 200  # that a thread takes for each target


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
    expected: Callable[[FloatArray, FloatArray, float], FloatArray] | None = None,
    gain: GainOptions = _DEFAULT_GAIN,
    n_threads: int | None = None,
) -> BestView | None:
    """Return the candidate to take next; None where none has any gain.

    Once less of the worth is unknown than was seen badly, the next views are planned together, as many as
    `gain` looks ahead (`plan_ahead`), and the one of them with the largest gain is taken; before that, what
    the next scan finds changes more than a plan can tell, and the candidate with the largest gain is taken.

    Parameters
    ----------
    boundary : RayCaster
        The surface of the possible solid, which ends lines of sight.
    candidates : Candidates
        Positions that are free, and directions.
    required_cosine : float
        At which badly seen surface counts as seen well, margin included.
    expected : callable, optional
        `ExpectedGain.chance_behind`: how probably rays from a position (3,) along offsets (n, 3) find new
        surface within a range in metres; unknown surface is worth that much of its area.
    gain : GainOptions
        By how many targets candidates are compared (the gain of the best is that of all), and how many views
        are planned together.
    n_threads : int, optional
        Threads; the result does not depend on it.
    """
    if not candidates.n_poses or not len(targets):
        return None
    few = targets.thin(gain.max_targets)
    # what each position sees in any direction, and the pose whose aperture holds most of it
    sees = partial(
        seen_from, boundary=boundary, required_cosine=required_cosine, sensor=sensor, expected=expected
    )
    with threads(_BYTES_A_TARGET * len(few), n_threads) as pool:
        seen = list(pool.map(partial(sees, few), candidates.positions))
    accumulator = Accumulator.of([evaluation.offsets for evaluation in seen], candidates, sensor)
    unknown = targets.worth_m2[targets.is_unknown].sum()
    is_known = unknown < targets.worth_m2.sum() / 2
    number = plan_ahead(
        accumulator,
        worth=[evaluation.worth_m2 for evaluation in seen],
        share=[evaluation.share for evaluation in seen],
        target=[2 * evaluation.voxel + evaluation.is_unknown for evaluation in seen],
        n_views=gain.views_ahead if is_known else 1,
    )
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
    expected: Callable[[FloatArray, FloatArray, float], FloatArray] | None,
) -> ViewEvaluation:
    """Return what a position (3,) sees in any direction, and what each is worth from there."""
    floor = np.where(targets.is_unknown, FLATTEST, required_cosine)
    towards = position - targets.points
    distance = np.linalg.norm(towards, axis=1)
    slope = np.einsum("ij,ij->i", towards, targets.normals)
    nearest = np.where(targets.is_unknown, 0.0, sensor.min_range_m)  # beams go on into what is unknown
    near = (distance >= nearest) & (distance <= sensor.max_range_m) & (distance > 0)
    index = np.flatnonzero(near & (slope >= floor * distance))
    if len(index):
        origins = np.broadcast_to(position, (len(index), 3))
        index = index[~boundary.are_blocked(targets.points[index], origins)]
    unknown = targets.is_unknown[index]
    share = np.where(unknown, slope[index] / distance[index], 1.0)
    worth = targets.worth_m2[index] * share
    if expected is not None:
        worth[unknown] *= expected(position, -towards[index[unknown]], sensor.max_range_m)
    return ViewEvaluation(
        offsets=-towards[index],
        worth_m2=worth,
        voxel=targets.voxel[index],
        is_unknown=unknown,
        share=share,
    )
