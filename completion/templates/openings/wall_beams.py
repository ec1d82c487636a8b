# SPDX-License-Identifier: MIT
"""Wall beams: the beams that reach for a wall, where each crosses its plane, and what that says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy import ndimage

from completion.observe.observation import Observation
from completion.templates.openings.wall import Wall
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Plane

_LEAST_SLOPE = 0.05  # sine between beam and wall: flatter beams do not say where they cross it
_BLOCKED, _STRAY, _MEETS = 0.20, 0.01, 0.79  # shares of beams that something stops before, of strays, others
_NEAR = 6.0  # deviations of the range
_NEIGHBOURS = 2  # pixels beside one that goes on which go on too; a stray return has none


@dataclass(frozen=True, slots=True, eq=False)
class WallFrame:
    """Axes of a wall: u to the right as seen from the room, y into the wall, v up.

    Attributes
    ----------
    origin : (3,) float
        On the wall.
    axes : (3, 3) float
        Rows u, y, v; unit vectors.
    """

    origin: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, plane: Plane, before: FloatArray, up: FloatArray) -> WallFrame:
        """Return the frame of a plane that is seen from `before` (3,), with `up` (3,) as it stands."""
        into = plane.normal_direction * -np.sign(plane.distance(before[None])[0] or 1.0)
        upright = up - (up @ into) * into
        upright = upright / np.linalg.norm(upright)
        return cls(plane.point, np.stack([np.cross(into, upright), into, upright]))

    def local(self, points: FloatArray) -> FloatArray:
        """Coordinates (n, 3) along u, y and v of points (n, 3)."""
        return np.asarray((points - self.origin) @ self.axes.T)

    def turned(self, angle: float) -> WallFrame:
        """Return the frame turned in its wall, from u towards v."""
        u, y, v = self.axes
        cos, sin = np.cos(angle), np.sin(angle)
        return WallFrame(self.origin, np.stack([cos * u + sin * v, y, cos * v - sin * u]))

    def points(self, uv: FloatArray, depth: float = 0.0) -> FloatArray:
        """Places (n, 3) at (n, 2) in the wall, so deep in it."""
        return np.asarray(self.origin + uv @ self.axes[[0, 2]] + depth * self.axes[1])


@dataclass(frozen=True, slots=True, eq=False)
class WallBeams:
    """Beams of n pixels that reach for a wall from its room.

    Attributes
    ----------
    uv : (n, 2) float
        Where each crosses the wall's plane, metres, in the wall's frame.
    slope : (n, 2) float
        How far it goes on along u and v for a metre into the wall.
    stretch : (n,) float
        Range for a metre into the wall.
    wall_range : (n,) float
        Range at which it crosses the plane.
    ranges : (n,) float
        Range measured; inf where nothing came back.
    deviation : (n,) float
        Standard deviation of a range on the wall, metres.
    gap : (n,) float
        Distance on the wall between neighbouring beams, metres.
    farthest : float
        The greatest range, metres.
    scan, pixel : (n,) int
        Which scan and flat pixel.
    """

    uv: FloatArray
    slope: FloatArray
    stretch: FloatArray
    wall_range: FloatArray
    ranges: FloatArray
    deviation: FloatArray
    gap: FloatArray
    farthest: float
    scan: IntArray
    pixel: IntArray

    def __len__(self) -> int:
        return len(self.ranges)

    def chosen(self, which: BoolArray | IntArray) -> WallBeams:
        """Return some of them, by truth (n,) or by number (m,)."""
        names = [field.name for field in fields(self) if field.name != "farthest"]
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def turned(self, angle: float) -> WallBeams:
        """Return the same in the frame turned by an angle from u towards v."""
        back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).T
        return replace(self, uv=self.uv @ back, slope=self.slope @ back)

    def odds(self) -> FloatArray:
        """Log odds (n,) of each beam for no wall where it crosses, against wall; 0 without a return."""
        return self.log_density(np.full(len(self), np.inf), self.wall_range) - self.log_density(
            self.wall_range, self.wall_range
        )

    def log_density(self, expected: FloatArray, least: FloatArray) -> FloatArray:
        """Log density of the measured ranges, of the shape of `expected`, (n,) or (n, k).

        Where `expected` is inf the beam goes on beyond `least`, anywhere up to the greatest range. Before
        what is expected something else may stop it. Where nothing came back the density is 1: that says
        nothing of walls, which may be dark, or of openings.
        """
        shape = (-1,) + (1,) * (np.ndim(expected) - 1)
        ranges, sd = self.ranges.reshape(shape), self.deviation.reshape(shape)
        back = np.isfinite(ranges)
        r = np.where(back, ranges, 0.0)
        meets = np.isfinite(expected)
        stop = np.where(meets, expected, least)
        normal = np.exp(-0.5 * np.square((r - stop) / sd)) / (sd * np.sqrt(2 * np.pi))
        room = np.maximum(self.farthest - stop, sd)
        density = np.where(meets, normal, (r >= stop) / room) * _MEETS
        density = density + _BLOCKED * (r < stop) / np.maximum(stop, 1e-9) + _STRAY / self.farthest
        return np.where(back, np.log(density), 0.0)


def wall_beams(
    frame: WallFrame,
    observations: Sequence[Observation],
    low: FloatArray,
    high: FloatArray,
    wall: Wall,
) -> WallBeams:
    """Return the beams that cross a window of a wall from its room.

    Parameters
    ----------
    frame : WallFrame
        Of the wall.
    observations : sequence of Observation
        The scans, in the same frame.
    low, high : (2,) float
        The window in the wall, metres.
    wall : Wall
        How uneven it is, and which pixels are of other surfaces: where these meet the wall they say nothing.
    """
    found = [
        one
        for number, seen in enumerate(observations)
        if (one := _of_scan(frame, seen, (low, high), wall, number)) is not None
    ]
    if not found:
        none, pairs = np.zeros(0), np.zeros((0, 2))
        empty = np.zeros(0, np.int64)
        return WallBeams(pairs, pairs, none, none, none, none, none, 1.0, empty, empty)
    names = [field.name for field in fields(WallBeams) if field.name != "farthest"]
    joined = {name: np.concatenate([getattr(one, name) for one in found]) for name in names}
    return WallBeams(**joined, farthest=max(one.farthest for one in found))


def _of_scan(
    frame: WallFrame,
    seen: Observation,
    window: tuple[FloatArray, FloatArray],
    wall: Wall,
    number: int,
) -> WallBeams | None:
    """The beams of one scan; None where it stands behind the wall or no beam crosses the window."""
    origin = frame.local(seen.scan.world_from_sensor.translation[None])[0]
    if origin[1] >= 0:
        return None
    shape = seen.scan.shape
    directions = seen.rays_at(np.arange(shape[0] * shape[1])) @ frame.axes.T
    with np.errstate(divide="ignore", invalid="ignore"):
        away = -origin[1] / directions[:, 1]
        uv = origin[[0, 2]] + away[:, None] * directions[:, [0, 2]]
    reaches = (directions[:, 1] > _LEAST_SLOPE) & ((uv > window[0]) & (uv < window[1])).all(axis=1)
    pixel = np.flatnonzero(reaches)
    if not len(pixel):
        return None
    ranges, valid = seen.scan.ranges, seen.valid
    into = directions[pixel, 1]
    noise = seen.noise.deviation(away[pixel])
    sd = np.sqrt(np.square(noise) + np.square((wall.fit.rms + seen.pose_error_m) / into))
    beams = WallBeams(
        uv=uv[pixel],
        slope=directions[pixel][:, [0, 2]] / into[:, None],
        stretch=1 / into,
        wall_range=away[pixel],
        ranges=ranges.ravel()[pixel],
        deviation=np.maximum(sd, 1e-6),
        gap=_gaps(uv.reshape(*shape, 2)).ravel()[pixel],
        farthest=float(ranges[valid].max(initial=1.0)) * 1.05,
        scan=np.full(len(pixel), number),
        pixel=pixel,
    )
    beams.ranges[_is_of_another(beams, wall, number)] = np.inf  # of a copy
    on = np.zeros(shape, dtype=np.bool_)
    on.ravel()[pixel] = np.isfinite(beams.ranges) & (beams.odds() > 0)
    beside = ndimage.convolve(on.astype(np.int8), np.ones((3, 3), np.int8), mode="constant") - on
    alone = (on & (beside < _NEIGHBOURS)).ravel()[pixel]
    beams.ranges[alone] = np.inf
    return beams


def _is_of_another(beams: WallBeams, wall: Wall, scan: int) -> BoolArray:
    """Beams (n,) that end near the wall's plane but on another surface, as on a floor that meets it."""
    if not wall.owners:
        return np.zeros(len(beams), dtype=np.bool_)
    owner = wall.owners[scan].ravel()[beams.pixel]
    with np.errstate(invalid="ignore"):
        near = np.abs(beams.ranges - beams.wall_range) < _NEAR * beams.deviation
    return np.asarray(near & (owner > 0) & (owner != wall.number))


def _gaps(uv: FloatArray) -> FloatArray:
    """Distance (rows, columns) on the wall to the next pixel, the greater of along rows and columns."""
    gap = np.zeros(uv.shape[:2])
    for axis in (0, 1):
        if uv.shape[axis] > 1:
            step = np.linalg.norm(np.diff(uv, axis=axis), axis=-1)
            last = np.take(step, [-1], axis=axis)
            gap = np.fmax(gap, np.concatenate([step, last], axis=axis))
    return gap
