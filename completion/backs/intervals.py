# SPDX-License-Identifier: MIT
"""Intervals: how much room a thing takes up, and how deep it is, each with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from completion.backs.closing import ClosedShape
from completion.backs.limits import BACK_FACE, DEPTH_SLACK, LEAST_EXTENT, SEEN_DEPTH, TOLERANCE_SD
from completion.backs.symmetry import Symmetry
from completion.backs.views import Scale, Setting, Sight, ThingView
from completion.backs.weights import EXTENTS, VOLUMES
from completion.observe.rays import triple
from scenes.checks import FloatArray, Value

_SHARE = 0.8
SEEN = "seen to its end"
"""Why an extent is what was measured of it."""


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
class Extent(Value):
    """Length of a thing along a unit direction (`way`), metres, and why; `most` is None without a bound.

    `estimate` is that of the closed shape.
    """

    estimate: float
    least: float
    most: float | None
    way: tuple[float, float, float]
    why: str

    @property
    def is_seen(self) -> bool:
        """Whether both ends were seen."""
        return self.why == SEEN


@dataclass(frozen=True, slots=True)
class Extents(Value):
    """Width (level, across the depth), depth (level, away from the front) and height above the support."""

    width: Extent
    depth: Extent
    height: Extent


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


def extents_of(
    sights: Sequence[Sight],
    asserted: FloatArray,
    shape: ClosedShape,
    chosen: Sequence[Symmetry],
    *,
    setting: Setting,
    scale: Scale,
) -> Extents:
    """Return how wide, deep and high a thing is: to the wall behind it, or along the line of sight.

    The measured extent, less the noise, is certain. Where its ends were seen, or a symmetry puts surface
    there (`asserted` (n, 3)), it is that of the closed shape, and at most longer by the quantile of things
    closed the same way; else the thing ends before a wall, or nothing bounds it.
    """
    away = _away(sights, setting, scale)
    outline = _Outline(
        points=np.concatenate([sight.points[sight.thing] for sight in sights]),
        ends=np.concatenate([sight.points[sight.limb & ~sight.cut] for sight in sights]),
        cut=np.concatenate([sight.points[sight.cut] for sight in sights]),
        asserted=asserted,
        closed=shape.vertices,
        slack_m=scale.size * np.array(EXTENTS[closed_by(chosen)]),
        least_m=max(TOLERANCE_SD * setting.sigma_m, LEAST_EXTENT * scale.size),
        size=scale.size,
    )
    is_deep = float(np.ptp(outline.points @ away)) > SEEN_DEPTH * scale.size  # a front alone shows no back
    back_seen = is_deep and _is_end(outline, away)
    to_wall, slack = _to_wall(away, setting), outline.slack_m
    depth = _extent(outline, away, (True, back_seen), (slack[1], to_wall), hidden="front alone")
    across = np.array([-away[1], away[0], 0.0])
    seen = _is_end(outline, -across), _is_end(outline, across)
    width = _extent(outline, across, seen, (slack[0], _to_wall(across, setting)), hidden="an end hidden")
    return Extents(width, depth, _height(outline, sights, setting, depth))


class _Outline(NamedTuple):
    """What is known of where a thing ends: points (n, 3) of each kind, metres."""

    points: FloatArray
    ends: FloatArray  # pixels beside a farther one: the thing was seen to end there
    cut: FloatArray  # pixels at which an occluder or the image's border cuts it
    asserted: FloatArray
    closed: FloatArray  # vertices of the closed shape
    slack_m: FloatArray  # by how much it may be too narrow and too shallow
    least_m: float  # by how much the measured extent may be too long
    size: float


def _is_end(outline: _Outline, way: FloatArray) -> bool:
    """Whether the thing was seen to end where its measured points lie farthest along a direction (3,)."""
    edge = float((outline.points @ way).max()) - DEPTH_SLACK * outline.size
    return bool((outline.ends @ way > edge).sum() >= 3 and not (outline.cut @ way > edge).any())


def _extent(
    outline: _Outline,
    way: FloatArray,
    seen: tuple[bool, bool],
    bounds: tuple[float, float | None],
    *,
    hidden: str,
) -> Extent:
    """The extent along a direction (3,), where its near and its far end were seen, or are `hidden`.

    `bounds` are by how much it may be longer than that of the closed shape, and where a wall is.
    """
    along = outline.points @ way
    low, high = float(along.min()), float(along.max())
    slack, edge = bounds[0], DEPTH_SLACK * outline.size
    least = max(high - low - outline.least_m, 0.0)
    estimate = max(high - low, float(np.ptp(outline.closed @ way)))
    implied = outline.asserted @ way if len(outline.asserted) else along
    known = seen[0] or float(implied.min()) < low - edge, seen[1] or float(implied.max()) > high + edge
    if all(seen):
        most, why = estimate + slack, SEEN
    elif all(known):
        inner = [float(np.quantile(implied, share)) for share in (1 - BACK_FACE, BACK_FACE)]
        least = max(max(inner[1], high) - min(inner[0], low) - edge, least)
        most, why = estimate + slack, "symmetry"
    else:
        most, why = np.inf, f"{hidden}, {'nothing known' if bounds[1] is None else 'wall'} behind"
    if bounds[1] is not None:
        most = min(most, max(bounds[1], high) - low)
    least = min(least, most)
    bound = most if np.isfinite(most) else None
    return Extent(float(np.clip(estimate, least, most)), least, bound, triple(way), why)


def _height(outline: _Outline, sights: Sequence[Sight], setting: Setting, depth: Extent) -> Extent:
    """The extent above the support; over a top that is seen from below, as far as the line of sight goes."""
    top = float(outline.points[:, 2].max())
    measured, slack = top - setting.support_m, DEPTH_SLACK * outline.size
    rises = []
    for sight in sights:
        over = outline.points[:, 2].argmax()
        away = float(np.linalg.norm(outline.points[over, :2] - np.array(sight.eye.origin)[:2]))
        rises.append(max(top - sight.eye.origin[2], 0.0) / max(away, 1e-9))
    slope, most, why = min(rises), np.inf, "its top hidden"
    if _is_end(outline, np.array([0.0, 0.0, 1.0])):
        most, why = measured + slack, SEEN
        if slope > 0:
            most = np.inf if depth.most is None else most + slope * depth.most
            why = "its top seen from below"
    least = max(measured - outline.least_m, 0.0)
    return Extent(measured, least, most if np.isfinite(most) else None, (0.0, 0.0, 1.0), why)


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
