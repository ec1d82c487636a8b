# SPDX-License-Identifier: MIT
"""Upright: which way is up for scans, as said, or by their level surfaces and how cameras are held."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from scenes import limits
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.inclination import LEVEL_COSINE
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

SignedAxis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[SignedAxis, ...] = ("x", "y", "z", "-x", "-y", "-z")
_MOST_SCANS = 24  # that tell which way is up
_APART = 40  # facets along the longer side of an image
_NARROWER = np.cos(np.radians([4.0, 3.0, 2.0]))
_SIDE = np.sin(np.radians(6.0))
_TRIED = 400  # facets whose normals are tried


class _PlanarPieces(NamedTuple):
    """Planar pieces of scans: normals (n, 3) towards the sensor, world; areas (n,); places (n, 3)."""

    normal: FloatArray
    area: FloatArray
    place: FloatArray


def upright(scans: Sequence[RangeImage], up: SignedAxis, *, of_points: bool) -> tuple[Pose, str]:
    """Return the turn after which z is up, and a word about it where it was not said.

    Parameters
    ----------
    scans : sequence of RangeImage
        All in one world.
    up : "auto" or an axis, "x" to "-z"
        Which way is up in that world. With "auto", cameras are taken to be held upright: up is the normal of
        the largest level surface within 50 degrees of their upward direction; z, where it is one. Points that
        were put on a grid may have any axis up: the one with most area at right angles for its extent, as
        rooms are wider than high; z unless another leads clearly. Which way along it is told by the tops of
        what stands on the floor. Structured scans of scanners have z up.
    of_points : bool
        Whether the scans were made of points without a grid.

    Raises
    ------
    InputError
        Another axis.
    """
    if up != "auto":
        return _turn_to_z(axis_direction(up)), ""
    seen = [scan for scan in scans if _has_returns(scan)]
    if of_points:
        return _of_points(seen)
    cameras = [scan for scan in seen if isinstance(scan.projection, PinholeProjection)]
    return _of_cameras(cameras) if cameras else (Pose.identity(), "")


def axis_direction(up: str) -> FloatArray:
    """Return the unit vector (3,) of an axis like "-y".

    Raises InputError: another one.
    """
    if up not in AXES:
        raise InputError(f"up must be auto, {', '.join(AXES)}, got {up!r}")
    sign = -1.0 if up.startswith("-") else 1.0
    return np.asarray(sign * np.eye(3)["xyz".index(up[-1])])


def _has_returns(scan: RangeImage) -> bool:
    returns = bool(scan.valid.any())
    scan.release()
    return returns


def _of_cameras(scans: Sequence[RangeImage]) -> tuple[Pose, str]:
    held = np.mean([_upwards(scan) for scan in scans], axis=0)
    if np.linalg.norm(held) < 0.5:
        return Pose.identity(), ""
    held = held / np.linalg.norm(held)
    facets = _facets(scans)
    z = np.array([0.0, 0.0, 1.0])
    whole = max(float(facets.area.sum()), 1e-12)
    if held @ z > limits.HELD or (
        held @ z > limits.UPSIDE and _level_area(facets, z, LEVEL_COSINE) >= limits.LEAST_LEVEL * whole
    ):
        return Pose.identity(), ""
    level = _largest_level(facets, held)
    if level is None:
        return _turn_to_z(held), _word(held, "as the camera was held; no level surface confirms it")
    if level @ z >= LEVEL_COSINE:
        return Pose.identity(), ""
    nearest = int(np.argmax(np.abs(level)))
    if abs(level[nearest]) >= limits.EXACT:
        level = np.sign(level[nearest]) * np.eye(3)[nearest]
    return _turn_to_z(level), _word(level, "the normal of the largest level surface, and the camera's up")


def _upwards(scan: RangeImage) -> FloatArray:
    """Where the upper side of a camera's image is, world; a negative fy has it along y."""
    camera = scan.projection
    flipped = isinstance(camera, PinholeProjection) and camera.fy < 0
    return np.asarray(scan.world_from_sensor.rotation[:, 1] * (1.0 if flipped else -1.0))


def _of_points(scans: Sequence[RangeImage]) -> tuple[Pose, str]:
    facets = _facets(scans)
    points = np.concatenate([np.zeros((0, 3)), *(scan.points()[scan.valid] for scan in scans)])
    if not len(points) or not len(facets.area):
        return Pose.identity(), ""
    extent = np.diff(np.quantile(points, [0.02, 0.98], axis=0), axis=0)[0]
    across = np.abs(facets.normal) >= LEVEL_COSINE
    score = (facets.area @ across) / np.maximum(extent, 1e-9)
    best = int(np.argmax(score))
    if best == 2 or not score[best] > limits.CLEAR_LEAD * score[2]:
        return Pose.identity(), ""
    below, above = (_tops(facets, sign * np.eye(3)[best]) for sign in (1.0, -1.0))
    axis = np.eye(3)[best] * (-1.0 if above > below else 1.0)
    return _turn_to_z(axis), _word(axis, "by the area of level surfaces")


def _tops(facets: _PlanarPieces, up: FloatArray) -> float:
    """Level area that faces `up` above the lowest: tops of what stands on a floor, if this is up."""
    facing = facets.normal @ up >= limits.FLAT
    height = facets.place[facing] @ up
    if not len(height):
        return 0.0
    return float(facets.area[facing][height > np.quantile(height, 0.02) + limits.ABOVE_FLOOR_M].sum())


def _word(up: FloatArray, why: str) -> str:
    best = int(np.argmax(np.abs(up)))
    name = ("-" if up[best] < 0 else "") + "xyz"[best]
    x, y, z = up + 0.0
    return (
        f"z is not up in the files, as it seems: up is estimated to be ({x:.2f}, {y:.2f}, {z:.2f}) in them, "
        f"nearest to {name}, {why}; everything was turned so that it is z; --up z keeps the files' axes"
    )


def _turn_to_z(up: FloatArray) -> Pose:
    """A turn that makes unit `up` (3,) the z axis: the shortest, after a half turn about x if it is far."""
    z = np.array([0.0, 0.0, 1.0])
    if up @ z < -0.5:
        half = Pose(np.diag([1.0, -1.0, -1.0, 1.0]))
        return _turn_to_z(half.apply(up[None])[0]) @ half
    axis, cosine = np.cross(up, z), float(up @ z)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return Pose.from_parts(np.eye(3) + skew + skew @ skew / (1 + cosine), np.zeros(3))


def _level_area(facets: _PlanarPieces, up: FloatArray, cosine: float) -> float:
    return float(facets.area[facets.normal @ up >= cosine].sum())


def _largest_level(facets: _PlanarPieces, held: FloatArray) -> FloatArray | None:
    """The upward normal within 50 degrees of `held` that most area shares or stands on; None without any."""
    able = facets.normal @ held
    tried = np.flatnonzero(np.abs(able) >= limits.HELD)
    tried = tried[:: max(1, len(tried) // _TRIED)]
    if not len(tried):
        return None
    ups = facets.normal[tried] * np.sign(able[tried])[:, None]
    best = ups[int(np.argmax([_support(facets, up) for up in ups]))]
    for narrow in (limits.ALIKE, *_NARROWER):
        lean = facets.normal @ best
        is_level = np.abs(lean) >= narrow
        if not is_level.any():
            break
        best = (np.sign(lean[is_level]) * facets.area[is_level]) @ facets.normal[is_level]
        best = best / np.linalg.norm(best)
    level = np.abs(facets.normal @ best) >= limits.ALIKE
    return np.asarray(best) if facets.area[level].sum() >= limits.LEAST_LEVEL * facets.area.sum() else None


def _support(facets: _PlanarPieces, up: FloatArray) -> float:
    lean = facets.normal @ up
    parts: tuple[tuple[float, BoolArray], ...] = (
        (1.0, lean >= limits.ALIKE),
        (limits.CEILING_WEIGHT, lean <= -limits.ALIKE),
        (limits.WALL_WEIGHT, np.abs(lean) <= _SIDE),
    )
    return float(sum(weight * facets.area[chosen].sum() for weight, chosen in parts))


def _facets(scans: Sequence[RangeImage]) -> _PlanarPieces:
    """Facets of the scans, of many of some, whose four corners lie in a plane."""
    pairs = [_facets_of(scan) for scan in scans[:: max(1, -(-len(scans) // _MOST_SCANS))]]
    none = _PlanarPieces(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)))
    parts = zip(*(none, *pairs), strict=True)
    return _PlanarPieces(*(np.concatenate(part) for part in parts))


def _facets_of(scan: RangeImage) -> _PlanarPieces:
    step = max(1, max(scan.shape) // _APART)
    grid = scan.points()[::step, ::step]
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[:-1, 1:], grid[1:, 1:]
    normal = np.cross(b - a, c - a).reshape(-1, 3)
    area = np.linalg.norm(normal, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / area[:, None]
        side = np.sqrt(area)
        off = np.abs(np.einsum("ij,ij->i", normal, (d - a).reshape(-1, 3)))
        usual = np.linalg.norm(a.reshape(-1, 3) - scan.origin, axis=1) * scan.projection.pixel_angle * step
        good = (off < limits.PLANAR * side) & (area > 0) & (area < 100 * usual**2)
    place = a.reshape(-1, 3)[good]
    normal = normal[good]
    scan.release()
    towards = np.einsum("ij,ij->i", normal, scan.origin - place)
    return _PlanarPieces(normal * np.where(towards < 0, -1.0, 1.0)[:, None], area[good], place)
