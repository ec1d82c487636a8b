# SPDX-License-Identifier: MIT
"""Views of one thing: its pixels in a scan, cut out and prepared for compiled loops; what it stands on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from completion.backs.limits import JUMP, MARGIN, SAME_NORMAL_PX, TOLERANCE, TOLERANCE_SD
from completion.evidence.sight import Eye
from completion.observe.range_noise import estimate_noise
from completion.observe.rays import triple
from scenes.checks import BoolArray, FloatArray, InputError, IntArray, frozen_copy
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from texture.engine.compiled import compiled

_BESIDE = ((0, 1), (0, -1), (1, 0), (-1, 0))


@dataclass(frozen=True, eq=False)
class ThingView:
    """A scan and the pixels of one thing in it.

    Parameters
    ----------
    scan : RangeImage
        Its pose puts it into a frame whose z points up.
    of_thing : (rows, columns) bool
        Pixels that measured the thing; all others, of the room and of other things, stay as beams.

    Raises
    ------
    InputError
        A mask of another shape, or without any pixel that has a return.
    """

    scan: RangeImage
    of_thing: BoolArray

    def __post_init__(self) -> None:
        if np.shape(self.of_thing) != self.scan.shape:
            raise InputError(f"of_thing has shape {np.shape(self.of_thing)}, the scan {self.scan.shape}")
        mask = np.asarray(self.of_thing, dtype=np.bool_) & self.scan.valid
        if not mask.any():
            raise InputError(f"{self.scan.name}: no pixel of the thing has a return")
        object.__setattr__(self, "of_thing", frozen_copy(mask))

    @cached_property
    def points(self) -> FloatArray:
        """Measured points (n, 3) of the thing, metres."""
        rows, columns = np.nonzero(self.of_thing)
        if self.scan.sensor_points is not None:
            own = np.asarray(self.scan.sensor_points[rows, columns], dtype=np.float64)
            return self.scan.world_from_sensor.apply(own)
        rays = self.scan.projection.ray_grid().at(rows, columns)
        return self.scan.world_from_sensor.apply(rays * self.scan.ranges[rows, columns, None])

    @cached_property
    def is_cut_by_image(self) -> bool:
        """Whether the thing touches the border of the image, so that it may go on beyond."""
        mask = self.of_thing
        camera = self.scan.projection
        rows = bool(mask[0].any() or mask[-1].any())
        if isinstance(camera, SphericalProjection) and len(camera.azimuths) > 1:
            turn = abs(float(camera.azimuths[-1] - camera.azimuths[0])) + camera.pixel_angle
            if turn >= 2 * np.pi - 1e-6:
                return rows
        return rows or bool(mask[:, 0].any() or mask[:, -1].any())


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What is known around a thing, in a frame whose z points up.

    Attributes
    ----------
    support_m : float
        Height of what the thing stands on, metres.
    sigma_m : float
        Standard deviation of ranges at the thing's distance, metres.
    walls : (m, 4) float
        Planes n x = d of walls behind the thing, n towards the room: n x - d is positive before the wall.
    """

    support_m: float
    sigma_m: float
    walls: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))

    def __post_init__(self) -> None:
        walls = np.asarray(self.walls, dtype=np.float64)
        if walls.ndim != 2 or walls.shape[1] != 4 or not np.isfinite(walls).all():
            raise InputError(f"walls must be finite with shape (m, 4), got {walls.shape}")
        if not (np.isfinite(self.support_m) and np.isfinite(self.sigma_m) and self.sigma_m >= 0):
            raise InputError(f"support_m and sigma_m must be finite, got {self.support_m}, {self.sigma_m}")
        object.__setattr__(self, "walls", frozen_copy(walls))


def sigma_of(views: Sequence[ThingView]) -> float:
    """Return the standard deviation of ranges on a thing, metres: as stated, or read off the scans."""
    found = [0.0]
    for view in views:
        if view.scan.sigma_m is not None:
            found.append(float(view.scan.sigma_m))
        else:
            middle = np.median(view.scan.ranges[view.of_thing])
            found.append(float(estimate_noise(view.scan).sigma(np.array([middle]))[0]))
    return max(found)


class Sight(NamedTuple):
    """A view as compiled loops read it: the image around the thing, flat arrays of pixels."""

    eye: Eye
    angles: FloatArray  # (rows + columns,) of a turning scanner, radians
    ranges: FloatArray  # (pixels,) metres, inf for no return
    low: FloatArray  # (pixels,) least of 3 x 3 ranges; -inf where one of them is not known
    high: FloatArray  # (pixels,) largest of 3 x 3 ranges; inf where one of them is not known
    thing: BoolArray  # (pixels,) pixels of the thing
    points: FloatArray  # (pixels, 3) metres; of pixels of the thing
    normals: FloatArray  # (pixels, 3) towards the sensor; 0 where not known
    to_limb: IntArray  # (pixels,) nearest pixel of the limb, -1 where there is none
    to_cut: IntArray  # (pixels,) nearest pixel where an occluder or the image's border cuts the thing
    limb: BoolArray  # (pixels,)
    cut: BoolArray  # (pixels,)
    side: FloatArray  # (pixels, 3) of limb pixels: outwards across the line of sight
    is_whole: bool  # whether the thing ends within the image
    pixel_m: float  # size of a pixel at the thing


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """Lengths of a thing that all steps share, metres: its size, and how far surfaces may differ."""

    size: float  # diagonal of the box of the measured points, down to the support
    tolerance: float
    middle: FloatArray  # (3,) of that box
    ground: float  # height below which pixels are of what it stands on


def scale_of(views: Sequence[ThingView], setting: Setting) -> Scale:
    """Return the scale of a thing: the box of its measured points reaches down to its support."""
    points = np.concatenate([view.points for view in views])
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = min(low[2], setting.support_m)
    size = float(np.linalg.norm(high - low))
    tolerance = max(TOLERANCE * size, TOLERANCE_SD * setting.sigma_m)
    return Scale(size, tolerance, (low + high) / 2, setting.support_m + tolerance)


def prepare_sight(view: ThingView, scale: Scale) -> Sight:
    """Cut the image around a thing out of its scan, and find limb, cuts and normals."""
    scan, mask = view.scan, view.of_thing
    inside = [np.flatnonzero(mask.any(axis=1 - axis)) for axis in (0, 1)]
    spans = []
    for found, n in zip(inside, scan.shape, strict=True):
        extent = found[-1] - found[0] + 1
        spans.append(
            slice(max(int(found[0] - MARGIN * extent), 0), min(int(found[-1] + 1 + MARGIN * extent), n))
        )
    part = spans[0], spans[1]
    eye, angles = _eye_of(scan, part)
    ranges, thing = np.ascontiguousarray(scan.ranges[part]), np.ascontiguousarray(mask[part])
    points = np.zeros((*ranges.shape, 3))
    points[thing] = view.points
    reach = float(np.median(ranges[thing]))
    pixel_m = reach * scan.projection.pixel_angle
    radius = int(np.clip(np.rint(SAME_NORMAL_PX * scale.size / pixel_m), 2, 6))
    normals = _normals(points, thing, radius, JUMP * scale.size, scan.origin)
    rays = _rays(scan, part)
    ground = scan.origin[2] + np.where(np.isfinite(ranges), ranges, 0.0) * rays[..., 2] < scale.ground
    limb, cut = _outline(ranges, thing, thing | ground, JUMP * scale.size)
    if view.is_cut_by_image:
        cut[[0, -1]] |= thing[[0, -1]]
        cut[:, [0, -1]] |= thing[:, [0, -1]]
    low = ndimage.minimum_filter(np.where(np.isfinite(ranges), ranges, -np.inf), 3)
    side = np.zeros_like(points)
    side[limb] = _outwards(thing, rays)[limb]
    return Sight(
        eye=eye, angles=angles, ranges=ranges.ravel(), low=low.ravel(),
        high=ndimage.maximum_filter(ranges, 3).ravel(), thing=thing.ravel(), points=points.reshape(-1, 3),
        normals=normals.reshape(-1, 3), to_limb=_nearest(limb), to_cut=_nearest(cut), limb=limb.ravel(),
        cut=cut.ravel(), side=side.reshape(-1, 3), is_whole=not view.is_cut_by_image, pixel_m=pixel_m,
    )  # fmt: skip


def _eye_of(scan: RangeImage, part: tuple[slice, slice]) -> tuple[Eye, FloatArray]:
    """The part of a scan's image as compiled loops look places up in it; without a tolerance."""
    camera, inverse = scan.projection, scan.world_from_sensor.inverse()
    rows, columns = part
    lens, angles = (1.0, 1.0, 0.0, 0.0), np.zeros(0)
    if isinstance(camera, PinholeProjection):
        lens = float(camera.fx), float(camera.fy), camera.cx - columns.start, camera.cy - rows.start
    elif isinstance(camera, SphericalProjection):
        angles = np.concatenate([camera.elevations[rows], camera.azimuths[columns]])
    else:
        raise TypeError(f"points cannot be projected into a {type(camera).__name__}")
    x, y, z = map(triple, inverse.rotation)
    eye = Eye(
        turn=(x, y, z), shift=triple(inverse.translation), origin=triple(scan.origin),
        shape=(rows.stop - rows.start, columns.stop - columns.start), is_spherical=len(angles) > 0, lens=lens,
        pixel_angle=camera.pixel_angle, n_sigma=0.0, flatness_m=0.0, registration_m=0.0, max_m=0.0,
    )  # fmt: skip
    return eye, angles


def _rays(scan: RangeImage, part: tuple[slice, slice]) -> FloatArray:
    """Unit rays (rows, columns, 3) of a part of the image, world frame."""
    rows, columns = (np.arange(one.start, one.stop) for one in part)
    at = np.broadcast_arrays(rows[:, None], columns[None, :])
    if scan.sensor_points is not None:
        points = np.asarray(scan.sensor_points[part], dtype=np.float64)
        rays = scan.projection.ray_grid().at(at[0].ravel(), at[1].ravel()).reshape(points.shape)
        measured = points / np.linalg.norm(points, axis=-1, keepdims=True)
        return scan.world_from_sensor.rotate(np.where(np.isfinite(measured), measured, rays))
    rays = scan.projection.ray_grid().at(at[0].ravel(), at[1].ravel())
    return scan.world_from_sensor.rotate(rays).reshape(*at[0].shape, 3)


def _outline(
    ranges: FloatArray, thing: BoolArray, own: BoolArray, jump: float
) -> tuple[BoolArray, BoolArray]:
    """Pixels of the thing beside a farther one or none, and beside a nearer one of something else.

    `own` (rows, columns) are pixels of the thing and of what it stands on.
    """
    limb, cut = np.zeros_like(thing), np.zeros_like(thing)
    padded = np.pad(ranges, 1, mode="edge")
    others = np.pad(own, 1, mode="edge")
    rows, columns = thing.shape
    for down, right in _BESIDE:
        there = slice(1 + down, 1 + down + rows), slice(1 + right, 1 + right + columns)
        with np.errstate(invalid="ignore"):
            beyond = padded[there] - ranges
        limb |= thing & (beyond > jump)
        cut |= thing & ~others[there] & (beyond < -jump)
    return limb, cut


def _nearest(mask: BoolArray) -> IntArray:
    """Flat number (pixels,) of the nearest pixel of a mask, -1 where it is empty."""
    if not mask.any():
        return np.full(mask.size, -1, dtype=np.int64)
    found = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return np.asarray(np.ravel_multi_index(tuple(found), mask.shape), dtype=np.int64).ravel()


def _outwards(thing: BoolArray, rays: FloatArray) -> FloatArray:
    """Unit directions (rows, columns, 3) out of the thing across the lines of sight."""
    soft = ndimage.gaussian_filter(thing.astype(np.float64), 1.5)
    down, right = (-ndimage.sobel(soft, axis)[..., None] for axis in (0, 1))
    way = right * _unit(np.gradient(rays, axis=1)) + down * _unit(np.gradient(rays, axis=0))
    return _unit(way)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))


def _normals(
    points: FloatArray, thing: BoolArray, radius: int, jump: float, origin: FloatArray
) -> FloatArray:
    """Normals (rows, columns, 3) of planes through windows of the thing's pixels, towards the sensor."""
    spread = np.zeros((*thing.shape, 6))
    count = np.zeros(thing.shape, dtype=np.int64)
    _spreads(points, thing, radius, jump, spread, count)
    normals = np.zeros_like(points)
    known = thing & (count >= 6)
    xx, xy, xz, yy, yz, zz = np.moveaxis(spread[known], -1, 0)
    matrix = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)
    value, vector = np.linalg.eigh(matrix)
    found = vector[:, :, 0]
    found[value[:, 1] < 1e-3 * value[:, 2]] = 0.0  # on one line: no plane
    towards = np.einsum("ij,ij->i", found, origin - points[known])
    normals[known] = found * np.sign(towards)[:, None]
    return normals


@compiled
def _spreads(
    points: FloatArray, thing: BoolArray, radius: int, jump: float, spread: FloatArray, count: IntArray
) -> None:
    """Second moments (rows, columns, 6) of the points in each pixel's window, within a ball about it."""
    rows, columns = thing.shape
    for row in range(rows):
        for column in range(columns):
            if not thing[row, column]:
                continue
            n, sx, sy, sz = 0, 0.0, 0.0, 0.0
            xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(max(row - radius, 0), min(row + radius + 1, rows)):
                for j in range(max(column - radius, 0), min(column + radius + 1, columns)):
                    if not thing[i, j]:
                        continue
                    x = points[i, j, 0] - points[row, column, 0]
                    y = points[i, j, 1] - points[row, column, 1]
                    z = points[i, j, 2] - points[row, column, 2]
                    if x * x + y * y + z * z > jump * jump:
                        continue
                    n += 1
                    sx, sy, sz = sx + x, sy + y, sz + z
                    xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
                    yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
            count[row, column] = n
            spread[row, column, 0], spread[row, column, 1] = xx - sx * sx / n, xy - sx * sy / n
            spread[row, column, 2], spread[row, column, 3] = xz - sx * sz / n, yy - sy * sy / n
            spread[row, column, 4], spread[row, column, 5] = yz - sy * sz / n, zz - sz * sz / n
