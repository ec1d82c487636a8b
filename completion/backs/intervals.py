# SPDX-License-Identifier: MIT
"""Intervals: how much room a thing takes up, and how deep it is, each with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.backs.closing import ClosedShape
from completion.backs.limits import BACK_FACE, DEPTH_SLACK, LEAST_EXTENT, SEEN_DEPTH, TOLERANCE_SD
from completion.backs.symmetry import Symmetry
from completion.backs.views import Scale, Setting, Sight, ThingView
from completion.backs.weights import VOLUMES
from scenes.checks import FloatArray, Value

_SHARE = 0.8


@dataclass(frozen=True, slots=True)
class VolumeInterval(Value):
    """Volume that a thing takes up, cubic metres: of the closed mesh, an 80 % interval, the certain bound.

    `certain_most` is what lies in the thing's shadow, down to the support and up to walls; None where that
    is not bounded, or an occluder or the image's border cuts the thing.
    """

    closed: float
    least: float
    most: float
    share: float
    certain_most: float | None


@dataclass(frozen=True, slots=True)
class DepthInterval(Value):
    """Extent of a thing along a level direction (`way`, away from its front), metres, and why."""

    least: float
    most: float | None
    way: tuple[float, float, float]
    why: str


def volume_interval(
    shape: ClosedShape,
    chosen: Sequence[Symmetry],
    views: Sequence[ThingView],
    sights: Sequence[Sight],
    setting: Setting,
) -> VolumeInterval:
    """Return the closed volume times quantiles of true over closed volumes of things closed the same way."""
    closed = shape.volume_m3
    low, high = (closed * factor for factor in VOLUMES[closed_by(chosen)])
    shadows = [
        shadow_volume(view, setting) for view, sight in zip(views, sights, strict=True) if not sight.cut.any()
    ]
    certain = min(shadows, default=np.inf)
    return VolumeInterval(
        closed,
        min(low, certain),
        min(high, certain),
        _SHARE,
        float(certain) if np.isfinite(certain) else None,
    )


def closed_by(chosen: Sequence[Symmetry]) -> str:
    """Return what shaped a closed mesh: axis (or turn), mirrors, mirror or none."""
    if not chosen:
        return "none"
    if chosen[0].kind != "mirror":
        return "axis"
    return "mirrors" if len(chosen) > 1 else "mirror"


def shadow_volume(view: ThingView, setting: Setting) -> float:
    """Return the volume behind a view's pixels of a thing, up to support and walls, cubic metres.

    The sum over pixels of solid angle (R^3 - r^3) / 3; infinite where a beam meets neither.
    """
    scan = view.scan
    rows, columns = np.nonzero(view.of_thing)
    grid, pose = scan.projection.ray_grid(), scan.world_from_sensor
    rays = pose.rotate(grid.at(rows, columns))
    across = []
    for axis, n in enumerate(scan.shape):
        step = np.array([axis == 0, axis == 1], dtype=int)
        at = np.stack([rows, columns])
        after, before = (np.clip(at[axis] + s, 0, n - 1) for s in (1, -1))
        ends = [np.where(step[:, None] == 1, one, at) for one in (after, before)]
        change = grid.at(*ends[0]) - grid.at(*ends[1])
        across.append(change / np.maximum(after - before, 1)[:, None])
    solid = np.linalg.norm(np.cross(across[0], across[1]), axis=1)
    planes = np.concatenate([[[0.0, 0.0, 1.0, setting.support_m]], setting.walls])
    end = np.full(len(rays), np.inf)
    for plane in planes:
        slope, height = rays @ plane[:3], float(scan.origin @ plane[:3] - plane[3])
        with np.errstate(divide="ignore"):
            end = np.minimum(end, np.where(slope < 0, -height / slope, np.inf))
    own = scan.ranges[rows, columns]
    return float((solid * np.maximum(end**3 - own**3, 0)).sum() / 3)


def depth_interval(
    sights: Sequence[Sight], asserted: FloatArray, setting: Setting, scale: Scale
) -> DepthInterval:
    """Return the extent of a thing away from its front: to the wall behind it, or along the line of sight.

    The measured extent, less the noise, is certain. Where a side or the top was seen to its end it is the
    depth, to 2 % of the size, unless a symmetry puts surface (`asserted` (n, 3)) farther back; else a
    symmetry says where the back is; else the thing ends before the wall, or is open.
    """
    points = np.concatenate([sight.points[sight.thing] for sight in sights])
    way = _away(sights, setting, scale)
    along = points @ way
    front, back = float(along.min()), float(along.max())
    slack = DEPTH_SLACK * scale.size
    wall = _to_wall(way, setting)
    reach = np.inf if wall is None else max(wall, back) - front
    least = max(back - front - max(TOLERANCE_SD * setting.sigma_m, LEAST_EXTENT * scale.size), 0.0)
    mirrored = asserted @ way - front if len(asserted) else np.zeros(1)
    implied = float(mirrored.max())
    ends = np.concatenate([sight.points[sight.limb & ~sight.cut] for sight in sights]) @ way
    cut = np.concatenate([sight.points[sight.cut] for sight in sights]) @ way
    at_end = (ends > back - slack).sum() >= 3 and not (cut > back - slack).any()
    if at_end and back - front > SEEN_DEPTH * scale.size:
        most, why = max(back - front, implied) + slack, "side or top seen to its end"
    elif implied > back - front + slack:
        least = max(float(np.quantile(mirrored, BACK_FACE)) - slack, least)
        most, why = implied + slack, "symmetry"
    else:
        most = np.inf
        why = f"front alone, {'nothing known' if wall is None else 'wall'} behind"
    most = min(most, reach)
    return DepthInterval(min(least, most), most if np.isfinite(most) else None, tuple(way.tolist()), why)


def _away(sights: Sequence[Sight], setting: Setting, scale: Scale) -> FloatArray:
    """Level unit direction (3,) away from the front: into the nearest wall, else along the lines of sight."""
    if len(setting.walls):
        gap = setting.walls[:, :3] @ scale.middle - setting.walls[:, 3]
        way = -setting.walls[int(np.argmin(gap)), :3]
    else:
        way = np.sum([_unit(scale.middle - np.array(sight.eye.origin)) for sight in sights], axis=0)
    return _unit(np.array([way[0], way[1], 0.0]))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _to_wall(way: FloatArray, setting: Setting) -> float | None:
    """Where along `way` the wall is that it leads into; None without one."""
    facing = [float(wall[3] / (way @ wall[:3])) for wall in setting.walls if way @ wall[:3] < -0.9]
    return min(facing) if facing else None
