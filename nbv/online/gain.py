# SPDX-License-Identifier: MIT
"""Gain: how much unknown or badly seen surface each candidate view would see.

After Sanchiz and Fisher (1999): gain = w_v * visible area of unknown faces (occplane and frontier,
foreshortened) + w_q * visible area of surface that has only been seen at a worse angle than required and
would now be seen at a good one. All directions of a position are scored by one cast: rays from the targets
to the position against the faces of the voxel map fill a spherical accumulator, over which the aperture
slides.

Expected gain: how much new surface a view into unknown space is expected to find.
A ray that enters unknown space is followed until it meets what is known. Inferred surface may be missing (an
opening): it is new with the probability that it is not there. Measured surface met from its front tells
nothing new. Where a ray meets measured surface from the rear, or meets nothing, unknown surface lies before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.limits import FLATTEST, FLATTEST_EXPECTED, INTO_M, TRUSTED_RAYS
from nbv.online.occupancy import EMPTY, SEEN, VoxelMap
from nbv.online.targets import Targets
from nbv.online.voxels import VoxelGrid
from nbv.scanning.sensor import Sensor
from nbv.visibility.viewpoints import Candidates
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.memory import threads
from scenes.scan.range_image import RangeImage
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
    worth from there. A ray that meets nothing known leaves the volume by the `side` (n,) 0..5 (+x, +y, +z,
    -x, -y, -z); -1 for what is known to be there.
    """

    offsets: FloatArray
    worth_m2: FloatArray
    voxel: NDArray[np.int64]
    is_unknown: BoolArray
    side: NDArray[np.int64]

    def some(self, chosen: BoolArray) -> ViewEvaluation:
        """Return those that are chosen (n,)."""
        return ViewEvaluation(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def join(self, other: ViewEvaluation) -> ViewEvaluation:
        """Return both together."""
        parts = [
            np.concatenate([getattr(self, field.name), getattr(other, field.name)]) for field in fields(self)
        ]
        return ViewEvaluation(*parts)


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
            i, pose = number // self.candidates.n_directions, self.candidates.pose(number)
            gain = float(worth[i][self.sensor.sees(self.offsets[i] @ pose.rotation)].sum())
            if gain > most:
                best, most = number, gain
        return best

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


_CELLS = 32  # of the cube map along an edge: rays 2.8 deg apart


@dataclass(frozen=True, slots=True, eq=False)
class SurfacePrior:
    """How likely a ray that meets nothing known is to meet surface before it leaves the volume.

    `trust` (6,) is that for each side (+x, +y, +z, -x, -y, -z) by which the ray would leave.
    """

    trust: FloatArray

    @classmethod
    def none(cls) -> SurfacePrior:
        """Return the prior before any look: the volume is closed on every side."""
        return cls(np.ones(6))

    def after(self, scan: RangeImage, predicted: ViewEvaluation, grid: VoxelGrid) -> SurfacePrior:
        """Return the prior updated by a scan whose rays into the unknown were `predicted`."""
        pixels = scan.pixels(scan.origin + predicted.offsets)
        seen = np.flatnonzero((predicted.side >= 0) & np.isfinite(pixels).all(axis=1))
        row, column = np.rint(pixels[seen]).astype(np.int64).T
        met = grid.index_of(scan.points()[row, column]) >= 0
        n_looked = np.bincount(predicted.side[seen], minlength=6)
        n_met = np.bincount(predicted.side[seen], met, minlength=6)
        return SurfacePrior((TRUSTED_RAYS * self.trust + n_met) / (TRUSTED_RAYS + n_looked))


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedGain:
    """Unknown space and what is known behind it, prepared for rays.

    Attributes
    ----------
    boundary, entered : RayCaster, (k,) int64
        The faces between empty voxels and all others, and the voxel behind each of their triangles.
    worth_entering : (n_voxels,) bool
        Voxels that are unknown, and have not been sought in vain too often.
    caster : RayCaster or None
        Seen voxels as they border on unknown ones, and completed surface; None where there is neither.
    voxel, normal, doubt : (m,) int64, (m, 3) float, (m,) float
        Of each of its triangles the voxel, -1 for completed surface; the normal, of completed surface towards
        where it was seen from; and the probability that inferred surface is not there, 0 elsewhere.
    trust : (6,) float
        As of `SurfacePrior`.
    """

    boundary: RayCaster
    entered: NDArray[np.int64]
    worth_entering: BoolArray
    caster: RayCaster | None
    voxel: NDArray[np.int64]
    normal: FloatArray
    doubt: FloatArray
    voxels: VoxelMap
    trust: FloatArray

    @classmethod
    def of(
        cls,
        voxels: VoxelMap,
        boundary: RayCaster,
        entered: NDArray[np.int64],
        *,
        worth_entering: BoolArray,
        completed: KnownSurfaces,
        trust: FloatArray,
    ) -> ExpectedGain:
        """Return what views into the unknown space of a map may bring, after completion of its scans.

        `entered` (k,), `worth_entering` (n_voxels,) and `trust` (6,) are as in the attributes.
        """
        faces = voxels.faces_between(_loose(voxels, completed), ~np.isin(voxels.labels, (SEEN, EMPTY)))
        corners, squares = faces.triangles(voxels.grid.voxel_m)
        measured, measured_faces = completed.measured_mesh()
        inferred, inferred_faces, confidence = completed.inferred_mesh()
        vertices = np.concatenate([corners, measured, inferred])
        n_squares, n_measured = len(squares), len(measured_faces)
        triangles = np.concatenate(
            [squares, measured_faces + len(corners), inferred_faces + len(corners) + len(measured)]
        )
        voxel, doubt = np.full(len(triangles), -1, np.int64), np.zeros(len(triangles))
        voxel[:n_squares] = np.repeat(faces.voxel, 2)
        doubt[n_squares + n_measured :] = 1.0 - confidence
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        caster = RayCaster(vertices, triangles, n_threads=1) if len(triangles) else None
        return cls(
            boundary=boundary,
            entered=entered,
            worth_entering=worth_entering,
            caster=caster,
            voxel=voxel,
            normal=normal,
            doubt=doubt,
            voxels=voxels,
            trust=trust,
        )

    def look(self, position: FloatArray, max_range_m: float) -> ViewEvaluation:
        """Evaluate a position (3,), world coordinates in metres, in all directions within the range.

        The worth of a ray is the area that its cell of the cube map cuts out of the surface that it meets,
        or of the side by which it leaves the volume, times the probability that surface there is new.
        """
        rays, solid_angles = _directions()
        hits = self.boundary.first_hit(position[None], rays)
        enters = np.flatnonzero((hits.face >= 0) & (hits.ranges <= max_range_m))
        enters = enters[self.worth_entering[self.entered[hits.face[enters]]]]
        rays, near, voxel = rays[enters], hits.ranges[enters], self.entered[hits.face[enters]]
        entry = position + near[:, None] * rays
        reach, side = self.voxels.grid.way_out(entry, rays)
        news, cosine = self.trust[side], np.abs(rays[np.arange(len(rays)), side % 3])
        if self.caster is not None and len(rays):
            beyond = self.caster.first_hit(entry + INTO_M * rays, rays)
            met = np.flatnonzero(beyond.face >= 0)
            news[met] = self._news_at(beyond.face[met], rays[met])
            reach[met], side[met] = beyond.ranges[met], -1
            cosine[met] = np.where(self.voxel[beyond.face[met]] >= 0, 1.0, beyond.incidence_cosine[met])
        area = solid_angles[enters] * np.square(np.minimum(near + reach, max_range_m))
        worth = np.where(
            cosine >= FLATTEST_EXPECTED, area * news / np.maximum(cosine, FLATTEST_EXPECTED), 0.0
        )
        kept = np.flatnonzero(worth > 0)
        is_unknown = np.ones(len(kept), dtype=np.bool_)
        return ViewEvaluation(near[kept, None] * rays[kept], worth[kept], voxel[kept], is_unknown, side[kept])

    def _news_at(self, face: NDArray[np.int32], rays: FloatArray) -> FloatArray:
        """Probability (n,) that there is unknown surface where rays meet triangles."""
        voxel = self.voxel[face]
        front = np.einsum("ij,ij->i", rays, self.normal[face]) < 0
        front = np.where(voxel >= 0, self._shows_front(voxel, rays), front)
        return np.where(front, self.doubt[face], 1.0)

    def _shows_front(self, voxel: NDArray[np.int64], rays: FloatArray) -> BoolArray:
        """Tell which rays (n, 3) run against a measured normal of the voxel they meet."""
        surfels = self.voxels.surfels
        front = np.zeros(len(voxel), dtype=np.bool_)
        if not len(surfels.keys):
            return front
        for side in range(6):
            at = np.searchsorted(surfels.keys, voxel * 6 + side)
            at = np.minimum(at, len(surfels.keys) - 1)
            has = surfels.keys[at] == voxel * 6 + side
            front |= has & (np.einsum("ij,ij->i", rays, surfels.normals[at]) < -FLATTEST)
        return front


def _loose(voxels: VoxelMap, completed: KnownSurfaces) -> BoolArray:
    """Seen voxels (n_voxels,) with surface off the completed surfaces; those tell the place of the rest."""
    surfels = voxels.surfels
    known = completed.on_modelled(surfels.points, surfels.normals, voxels.grid.voxel_m / 2)
    loose: BoolArray = np.asarray(voxels.labels == SEEN)
    loose[surfels.voxels[known]] = False
    loose[surfels.voxels[~known]] = True
    return loose


@cache
def _directions() -> tuple[FloatArray, FloatArray]:
    """Unit rays (n, 3) through the cells of a cube map, and the solid angle (n,) of each cell, sr."""
    rays = cell_directions(_CELLS)
    largest = np.abs(rays).max(axis=1)
    return rays, (2 / _CELLS) ** 2 * largest**3


_BYTES_A_TARGET = 200  # that a thread takes for each target
_BYTES_A_LOOK = 2_000_000  # and for the rays into unknown space


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
    few = targets.thin(n_most)
    if expected is not None:
        few, targets = (surfels.some(~surfels.is_unknown) for surfels in (few, targets))
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
    worth = targets.worth_m2[index] * np.where(unknown, slope[index] / distance[index], 1.0)
    seen = ViewEvaluation(-towards[index], worth, targets.voxel[index], unknown, np.full(len(index), -1))
    return seen if expected is None else expected.look(position, sensor.max_range_m).join(seen)
