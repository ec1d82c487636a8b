# SPDX-License-Identifier: MIT
"""Occupancy: what the scans so far say about each voxel of the volume to explore.

After Massios and Fisher (1998): a voxel is `UNSEEN` at first, `SEEN` when it holds a range sample, `EMPTY`
between sensor and surface, `OCCLUDED` behind a surface, and `OCCPLANE` when it is occluded next to an empty
one: the face of the shadow. The aperture leaves another such face, unseen voxels next to empty ones: the
frontier. Seen beats empty, empty beats occluded, so that thin surfaces stay and shadows shrink.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from nbv.online.limits import FEWEST_VOTES, MOST_VIEW_PIXELS, NEAR_VOXELS, SURE_SD
from nbv.online.voxels import ImageNormals, Surfels, VoxelGrid, image_normals
from nbv.scanning.sensor import Sensor
from scenes.checks import BoolArray, FloatArray, Value, frozen_copy
from scenes.scan.range_image import RangeImage

UNSEEN, SEEN, EMPTY, OCCLUDED, OCCPLANE = range(5)
LABELS = ("unseen", "seen", "empty", "occluded", "occplane")
_HALF_DIAGONAL = np.sqrt(3) / 2  # of a voxel, in sides
_AT_A_TIME = 32  # positions, to bound memory


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryFaces(Value):
    """Voxel faces between empty space and anything else.

    `voxel` (n,) is not empty; `centres` (n, 3) are of the faces in metres, and `outward` (n, 3) the unit
    directions from the voxel into the empty space.
    """

    voxel: NDArray[np.int64]
    centres: FloatArray
    outward: FloatArray

    def triangles(self, voxel_m: float) -> tuple[FloatArray, NDArray[np.int32]]:
        """Return vertices (4 * n, 3), metres, and faces (2 * n, 3) of the n squares."""
        u = np.roll(np.abs(self.outward), 1, axis=1) * voxel_m / 2
        v = np.roll(np.abs(self.outward), 2, axis=1) * voxel_m / 2
        corners = np.stack([-u - v, u - v, u + v, v - u], axis=1) + self.centres[:, None]
        first = 4 * np.arange(len(self.voxel))[:, None, None]
        return corners.reshape(-1, 3), (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(
            np.int32
        )


@dataclass(frozen=True, slots=True, eq=False)
class NearSurface(Value):
    """Distances of voxel centres from the surface, along the beams that met it near them, over all scans.

    `sums` (n_voxels,) are of the distances, metres, positive before the surface, `counts` (n_voxels,) the
    number of scans they come from.
    """

    sums: NDArray[np.float32]
    counts: NDArray[np.int16]

    @classmethod
    def none(cls, n_voxels: int) -> NearSurface:
        """Return the distances before any scan."""
        return cls(np.zeros(n_voxels, np.float32), np.zeros(n_voxels, np.int16))

    def after(self, voxel: NDArray[np.int64], distance: FloatArray, reach_m: float) -> NearSurface:
        """Return them after a scan whose beams ended `distance` (n,) beyond the voxels; NaN for nowhere."""
        near = np.abs(distance) <= reach_m
        sums, counts = self.sums.copy(), self.counts.copy()
        sums[voxel[near]] += distance[near].astype(np.float32)
        counts[voxel[near]] += 1
        return NearSurface(sums, counts)


@dataclass(frozen=True, slots=True, eq=False)
class DepthView(Value):
    """A scan, and the normals (rows, columns, 3) of what its pixels see, NaN where unknown.

    They are means over what lies in the same voxel and leans to the same side: noise does not turn them.
    """

    scan: RangeImage
    normals: NDArray[np.float32]

    @classmethod
    def of(cls, scan: RangeImage, local: ImageNormals, surfels: Surfels, grid: VoxelGrid) -> DepthView:
        """Return the view of a scan with its image of normals and its surfels, as fine as half a voxel."""
        voxel = grid.index_of(local.points.reshape(-1, 3))
        normals = surfels.normals_at(voxel, local.normals.reshape(-1, 3)).reshape(local.normals.shape)
        reach = scan.ranges[scan.valid]
        spacing = float(np.median(reach)) * scan.projection.pixel_angle if len(reach) else grid.voxel_m
        finest = int(np.ceil(np.sqrt(scan.ranges.size / MOST_VIEW_PIXELS)))
        step = max(int(grid.voxel_m / 2 / spacing), finest, 1)
        few = scan.thin(-(-scan.ranges.size // step**2))
        return cls(few, normals[::step, ::step].astype(np.float32))


@dataclass(frozen=True, slots=True, eq=False)
class VoxelMap(Value):
    """What is known of a volume.

    Attributes
    ----------
    grid : VoxelGrid
        The voxels.
    labels : (n_voxels,) int8
        Index into `LABELS`.
    surfels : Surfels
        Seen surface with its normals and best quality.
    votes : (n_voxels,) int16
        How many more scans ended in each voxel than went through it, -2 at the least.
    outside_is_empty : bool
        Whether the space around the volume is free (an object on a turntable) or solid (a room in a
        building).
    stood : (s, 3) float
        Where the scanners stood, metres.
    near : NearSurface
        How far the voxels near surface lie off it.
    views : tuple of DepthView
        What the scans, thinned, say of each place of the surface.
    """

    grid: VoxelGrid
    labels: NDArray[np.int8]
    surfels: Surfels
    votes: NDArray[np.int16]
    outside_is_empty: bool = False
    stood: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    near: NearSurface = field(default_factory=lambda: NearSurface.none(0))
    views: tuple[DepthView, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frozen_copy(self.labels, np.int8))
        object.__setattr__(self, "votes", frozen_copy(self.votes, np.int16))
        object.__setattr__(self, "stood", frozen_copy(self.stood))

    @classmethod
    def unknown(
        cls, volume: FloatArray, *, voxel_m: float | None = None, outside_is_empty: bool = False
    ) -> VoxelMap:
        """Return the map of a volume (2, 3), metres, of which nothing is known."""
        grid = VoxelGrid.around(volume, voxel_m)
        labels, votes = np.full(grid.n_voxels, UNSEEN, np.int8), np.zeros(grid.n_voxels, np.int16)
        near = NearSurface.none(grid.n_voxels)
        return cls(grid, labels, Surfels.none(), votes, outside_is_empty, near=near)

    def integrate(self, scan: RangeImage, sensor: Sensor | None) -> VoxelMap:
        """Return the map after one more scan.

        Every voxel centre is looked up in the pixel that sees it: nearer than the measured range by more
        than half a voxel's diagonal and three standard deviations of the scan's noise, the voxel is empty;
        farther by as much, it is occluded. A pixel without return says that the ray is empty as far as the
        sensor reaches. A seen voxel without a surfel (a mixed pixel between two surfaces, a stray echo)
        is empty when more scans went through it than ended in it.

        Parameters
        ----------
        scan : RangeImage
            The scan; without a known `sigma_m` it counts as exact.
        sensor : Sensor or None
            What took it: its aperture tells pixels without return from pixels that never looked. None where
            that is not known: then a pixel without return says nothing.
        """
        local = image_normals(scan, self.grid.voxel_m / 2)
        seen = Surfels.of_image(local, self.grid)
        surfels = self.surfels.merge(seen)
        behind, before, near = self._sides_of(scan, sensor)
        hit = np.unique(self.grid.index_of(scan.points()[scan.valid]))
        hit = hit[hit >= 0]
        votes = self._count_votes(hit, before)
        labels = np.where(self.labels == OCCPLANE, OCCLUDED, self.labels)
        labels[behind[labels[behind] == UNSEEN]] = OCCLUDED
        labels[before[labels[before] != SEEN]] = EMPTY
        labels[hit] = SEEN
        labels[_strays(labels, votes, surfels)] = EMPTY
        stood = np.vstack([self.stood, scan.origin])
        views = (*self.views, DepthView.of(scan, local, seen, self.grid))
        return replace(
            self, labels=labels, surfels=surfels, votes=votes, stood=stood, near=near, views=views
        )._with_occplane()

    def with_scan(self, scan: RangeImage, sensor: Sensor | None, clearance_m: float) -> VoxelMap:
        """Return the map after one more scan; within a room, the place where the sensor stands is free too.

        A standing sensor proves free space of the radius `clearance_m` metres, beside a voxel.
        """
        voxels = self.integrate(scan, sensor)
        if self.outside_is_empty:
            return voxels
        return voxels.clear_around(scan.origin, clearance_m + self.grid.voxel_m)

    def with_given(self, scans: Sequence[RangeImage], sensor: Sensor, clearance_m: float) -> VoxelMap:
        """Return the map after scans that were taken before, by `sensor` or by other instruments.

        Pixels without return of other instruments say nothing: nobody knows what they would have met, and
        how far away.
        """
        voxels = self
        for scan in scans:
            voxels = voxels.with_scan(scan, sensor if scan.sensor == sensor.name else None, clearance_m)
        return voxels

    def _count_votes(self, hit: NDArray[np.int64], before: NDArray[np.int64]) -> NDArray[np.int16]:
        """Return the votes after a scan that ended in the voxels `hit` and went through those `before`."""
        votes = self.votes.copy()
        votes[before] = np.maximum(self.votes[before] - 1, FEWEST_VOTES)
        votes[hit] = self.votes[hit] + 1
        return votes

    def clear_around(self, position: FloatArray, radius_m: float) -> VoxelMap:
        """Return the map with unknown voxels around `position` (3,) empty: the sensor stands there."""
        here = self.grid.index_of(position[None])
        near = self.grid.around_cells(here[here >= 0], radius_m)
        labels = self.labels.copy()
        labels[near[(near >= 0) & (labels[near] != SEEN)]] = EMPTY
        return replace(self, labels=labels)._with_occplane()

    def is_free(self, positions: FloatArray, clearance_m: float) -> BoolArray:
        """Tell at which positions (p, 3) all voxels nearer than `clearance_m` are known to be empty."""
        cell = self.grid.index_of(positions)
        if self.outside_is_empty:
            return np.asarray((cell < 0) | (self.labels[cell] == EMPTY))
        free = cell >= 0
        inside = np.flatnonzero(free)
        for few in np.split(inside, range(_AT_A_TIME, len(inside), _AT_A_TIME)):
            near = self.grid.around_cells(cell[few], clearance_m)
            free[few] = ((near >= 0) & (self.labels[near] == EMPTY)).all(axis=1)
        return np.asarray(free)

    def boundary(self) -> BoundaryFaces:
        """Return the faces between empty voxels and all others."""
        return self.faces_between(self.labels != EMPTY, self.labels == EMPTY, self.outside_is_empty)

    def faces_between(
        self, inside: BoolArray, outside: BoolArray, beyond_grid: bool = False
    ) -> BoundaryFaces:
        """Return the faces between voxels `inside` (n_voxels,) and those `outside`.

        `beyond_grid` tells whether what lies around the volume counts as outside too.
        """
        shape = self.grid.shape
        open_ = np.pad(outside.reshape(shape), 1, constant_values=beyond_grid)
        closed = inside.reshape(shape)
        voxels, steps = [], []
        for axis in range(3):
            for step in (1, -1):
                number = np.flatnonzero(closed & _neighbour(open_, axis, step))
                voxels.append(number)
                steps.append(np.broadcast_to(step * np.eye(3)[axis], (len(number), 3)))
        voxel, outward = np.concatenate(voxels), np.concatenate(steps)
        return BoundaryFaces(voxel, self.grid.centres(voxel) + outward * (self.grid.voxel_m / 2), outward)

    def towards_empty(self, voxel: NDArray[np.int64]) -> FloatArray:
        """Unit directions (n, 3) in which it gets emptier around each voxel: normals of what is unknown.

        Voxel faces make stairs of a slanted boundary; this is the slope of the stairs.
        """
        empty = gaussian_filter(self._padded_empty().astype(np.float32), 1.0, mode="nearest")
        around = np.stack([slope[1:-1, 1:-1, 1:-1].ravel()[voxel] for slope in np.gradient(empty)], axis=1)
        length = np.linalg.norm(around, axis=1, keepdims=True)
        unit: FloatArray = np.divide(around, length, out=np.zeros(around.shape), where=length > 0)
        return unit

    def _sides_of(
        self, scan: RangeImage, sensor: Sensor | None
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NearSurface]:
        """Return the voxels behind what the scan has met, those before it, and the distances near it."""
        local = self.grid.centres_in(scan.world_from_sensor.inverse())
        looked = np.arange(len(local)) if sensor is None else np.flatnonzero(sensor.sees(local))
        local = local[looked]
        pixels = scan.projection.pixels(local)
        inside = np.isfinite(pixels).all(axis=1)
        looked, local = looked[inside], local[inside]
        row, column = np.rint(pixels[inside]).astype(np.int64).T
        rows, columns = scan.shape
        measured = scan.ranges[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        distance = np.linalg.norm(local, axis=1)
        noise = SURE_SD * (scan.sigma_m or 0.0)
        margin = _HALF_DIAGONAL * self.grid.voxel_m + noise
        nothing_to = -np.inf if sensor is None else sensor.max_range_m
        reach = np.where(np.isfinite(measured), measured, nothing_to)
        behind = np.isfinite(measured) & (distance > measured + margin)
        near = self.near.after(looked, measured - distance, NEAR_VOXELS * self.grid.voxel_m + noise)
        return looked[behind], looked[distance < reach - margin], near

    def _padded_empty(self) -> BoolArray:
        empty = (self.labels == EMPTY).reshape(self.grid.shape)
        return np.pad(empty, 1, constant_values=self.outside_is_empty)

    def _with_occplane(self) -> VoxelMap:
        empty = self._padded_empty()
        beside = np.zeros(self.grid.shape, dtype=np.bool_)
        for axis in range(3):
            beside |= _neighbour(empty, axis, 1) | _neighbour(empty, axis, -1)
        shadow = (self.labels == OCCLUDED) | (self.labels == OCCPLANE)
        labels = np.where(shadow, np.where(beside.ravel(), OCCPLANE, OCCLUDED), self.labels)
        return replace(self, labels=labels.astype(np.int8))


def _strays(labels: NDArray[np.int8], votes: NDArray[np.int16], surfels: Surfels) -> NDArray[np.int64]:
    """Seen voxels that hold no surfel and through which more scans went than ended in them."""
    stray = (labels == SEEN) & (votes < 0)
    stray[surfels.voxels] = False
    return np.flatnonzero(stray)


def _neighbour(padded: BoolArray, axis: int, step: int) -> BoolArray:
    """Value of the neighbour `step` along `axis`, of an array padded by one on every side."""
    take = [slice(1, -1)] * 3
    take[axis] = slice(1 + step, padded.shape[axis] - 1 + step)
    return padded[tuple(take)]
