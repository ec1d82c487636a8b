# SPDX-License-Identifier: MIT
"""Walls: planes in which openings are sought, and the beams that reach for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.features.openings.limits import BLOCKED, LEAST_SLOPE, MEETS, NEAR_SD, OPEN_NEIGHBOURS, STRAY
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A plane in which openings are sought.

    Attributes
    ----------
    fit : SurfaceFit
        The plane, in the frame of the observations.
    points : (n, 3) float
        Some of its measured points.
    number : int
        What it is called in files, and in `owners`, from 1.
    owners : sequence of (rows, columns) int
        Number of the surface that each pixel of each scan is of, 0 for none; empty where that is not known.
    """

    fit: SurfaceFit
    points: FloatArray
    number: int = 0
    owners: Sequence[NDArray[np.int32]] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A level plane that people stand on.

    Attributes
    ----------
    fit : SurfaceFit
        The plane, in the frame of the observations.
    points : (n, 3) float
        Some of its measured points.
    """

    fit: SurfaceFit
    points: FloatArray


_MOST_PIXELS = 80_000  # of one scan, that are looked at for one wall, and again for one rectangle
_COARSE = 4  # every so many rows and columns tell where to look
_MARGIN = 8  # pixels about those of beams that are known


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

    def turn(self, angle: float) -> WallFrame:
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
        Range measured; inf where nothing came back, or what did says nothing of the wall.
    deviation : (n,) float
        Standard deviation of a range on the wall, metres.
    gap : (n,) float
        Distance on the wall between neighbouring beams, metres.
    nats : (n,) float
        Log odds for no wall where it crosses, against wall; 0 where nothing came back.
    is_silent : (n,) bool
        Whether nothing came back.
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
    nats: FloatArray
    is_silent: BoolArray
    farthest: float
    scan: IntArray
    pixel: IntArray

    def __len__(self) -> int:
        return len(self.ranges)

    def select(self, which: BoolArray | IntArray) -> WallBeams:
        """Return some of them, by truth (n,) or by number (m,)."""
        names = [field.name for field in fields(self) if field.name != "farthest"]
        return replace(self, **{name: getattr(self, name)[which] for name in names})

    def silent_as_open(self) -> WallBeams:
        """Return the same with beams from which nothing came back as if they had gone on."""
        silent = self.is_silent
        ranges = np.where(silent, 0.99 * self.farthest, self.ranges)
        nats = np.where(silent, odds_of(ranges, self.wall_range, self.deviation, self.farthest), self.nats)
        return replace(self, ranges=ranges, nats=nats)

    def turn(self, angle: float) -> WallBeams:
        """Return the same in the frame turned by an angle from u towards v."""
        back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).T
        return replace(self, uv=self.uv @ back, slope=self.slope @ back)


def odds_of(ranges: FloatArray, wall_range: FloatArray, deviation: FloatArray, farthest: float) -> FloatArray:
    """Return the log odds (n,) of beams for no wall where they cross it, against wall; 0 without a return.

    A beam meets the wall, or goes on anywhere up to the greatest range; before that something else may stop
    it, and a few are strays. Where nothing came back that says nothing: walls may be dark.
    """
    back = np.isfinite(ranges)
    r = np.where(back, ranges, 0.0)
    off = (r - wall_range) / deviation
    other = BLOCKED * (off < 0) / np.maximum(wall_range, 1e-9) + STRAY / farthest
    wall = MEETS * np.exp(-0.5 * np.square(off)) / (deviation * np.sqrt(2 * np.pi))
    open_ = MEETS * (off >= 0) / np.maximum(farthest - wall_range, deviation)
    return np.where(back, np.log(open_ + other) - np.log(wall + other), 0.0)


def wall_beams(
    frame: WallFrame,
    observations: Sequence[Observation],
    low: FloatArray,
    high: FloatArray,
    wall: Wall,
    *,
    among: WallBeams | None = None,
) -> WallBeams:
    """Return beams that cross a window of a wall from its room: every k-th row and column of large scans.

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
    among : WallBeams, optional
        Some of the beams of a larger window: only pixels about those of them in the window are looked at, and
        so more closely.
    """
    window, beams = (low, high), []
    for number, seen in enumerate(observations):
        shape = seen.scan.shape
        if among is not None:
            inside = (among.scan == number) & ((among.uv > low) & (among.uv < high)).all(axis=1)
            known = among.pixel[inside]
        else:
            known = _reaching_pixels(frame, seen, window, wall=wall, number=number)
        scan = _of_scan(frame, seen, window, wall=wall, number=number, pixels=_pixels(shape, known))
        if scan is not None:
            beams.append(scan)
        trim()
    if not beams:
        none, pairs, whole = np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64)
        single = ("stretch", "wall_range", "ranges", "deviation", "gap", "nats")
        return WallBeams(
            uv=pairs,
            slope=pairs,
            is_silent=whole > 0,
            farthest=1.0,
            scan=whole,
            pixel=whole,
            **dict.fromkeys(single, none),
        )
    names = [field.name for field in fields(WallBeams) if field.name != "farthest"]
    joined = {name: np.concatenate([getattr(beams, name) for beams in beams]) for name in names}
    return WallBeams(**joined, farthest=max(beams.farthest for beams in beams))


def _reaching_pixels(
    frame: WallFrame,
    seen: Observation,
    window: tuple[FloatArray, FloatArray],
    *,
    wall: Wall,
    number: int,
) -> IntArray:
    """Some of a scan's pixels (n,) in a window of a wall that nothing stops before it: others say nothing."""
    rows, columns = (np.arange(0, size, _COARSE) for size in seen.scan.shape)
    pixels = rows[:, None] * seen.scan.shape[1] + columns
    scan = _of_scan(frame, seen, window, wall=wall, number=number, pixels=pixels)
    if scan is None:
        return np.zeros(0, np.int64)
    return scan.pixel[scan.ranges > scan.wall_range - NEAR_SD * scan.deviation]


def _pixels(shape: tuple[int, int], known: IntArray) -> IntArray:
    """Flat pixels (rows, columns) of a scan to look at: about known ones, thinned where they are many."""
    if not len(known):
        return np.zeros((0, 0), np.int64)
    (top, bottom), (left, right) = (
        (max(int(position.min()) - _MARGIN, 0), min(int(position.max()) + _MARGIN + 1, size))
        for position, size in zip(np.divmod(known, shape[1]), shape, strict=True)
    )
    step = max(1, int(np.ceil(np.sqrt((bottom - top) * (right - left) / _MOST_PIXELS))))
    return np.arange(top, bottom, step)[:, None] * shape[1] + np.arange(left, right, step)


def _of_scan(
    frame: WallFrame,
    seen: Observation,
    window: tuple[FloatArray, FloatArray],
    *,
    wall: Wall,
    number: int,
    pixels: IntArray,
) -> WallBeams | None:
    """The beams of some pixels (rows, columns) of a scan; None where it stands behind the wall or none is."""
    origin = frame.local(seen.scan.world_from_sensor.translation[None])[0]
    if origin[1] >= 0 or not pixels.size:
        return None
    shape = pixels.shape
    directions = seen.rays_at(pixels.ravel()) @ frame.axes.T
    with np.errstate(divide="ignore", invalid="ignore"):
        away = -origin[1] / directions[:, 1]
        uv = origin[[0, 2]] + away[:, None] * directions[:, [0, 2]]
    reaches = (directions[:, 1] > LEAST_SLOPE) & ((uv > window[0]) & (uv < window[1])).all(axis=1)
    place = np.flatnonzero(reaches)
    if not len(place):
        return None
    pixel, away = pixels.ravel()[place], away[place]
    ranges, valid = seen.scan.ranges, seen.valid
    into = directions[place, 1]
    noise = seen.noise.deviation(away)
    sd = np.sqrt(np.square(noise) + np.square((wall.fit.rms + seen.pose_error_m) / into))
    farthest = float(ranges[valid].max(initial=1.0)) * 1.05
    sd = np.maximum(sd, 1e-6)
    measured = ranges.ravel()[pixel].copy()
    is_silent = ~np.isfinite(measured)
    near = np.abs(np.where(is_silent, 0.0, measured) - away) < NEAR_SD * sd
    measured[near & _is_of_another(wall, number, pixel)] = np.inf
    on = np.zeros(shape, dtype=np.bool_)
    on.ravel()[place] = odds_of(measured, away, sd, farthest) > 0
    beside = ndimage.convolve(on.astype(np.int8), np.ones((3, 3), np.int8), mode="constant") - on
    measured[(on & (beside < OPEN_NEIGHBOURS)).ravel()[place]] = np.inf
    return WallBeams(
        uv=uv[place],
        slope=directions[place][:, [0, 2]] / into[:, None],
        stretch=1 / into,
        wall_range=away,
        ranges=measured,
        deviation=sd,
        gap=_gaps(uv.reshape(*shape, 2)).ravel()[place],
        nats=odds_of(measured, away, sd, farthest),
        is_silent=is_silent,
        farthest=farthest,
        scan=np.full(len(pixel), number),
        pixel=pixel,
    )


def _is_of_another(wall: Wall, scan: int, pixel: IntArray) -> BoolArray:
    """Pixels (n,) that are of another surface, as of a floor that meets the wall."""
    if not wall.owners:
        return np.zeros(len(pixel), dtype=np.bool_)
    owner = wall.owners[scan].ravel()[pixel]
    return np.asarray((owner > 0) & (owner != wall.number))


def _gaps(uv: FloatArray) -> FloatArray:
    """Distance (rows, columns) on the wall to the next pixel, the greater of along rows and columns."""
    gap = np.zeros(uv.shape[:2])
    for axis in (0, 1):
        if uv.shape[axis] > 1:
            step = np.linalg.norm(np.diff(uv, axis=axis), axis=-1)
            last = np.take(step, [-1], axis=axis)
            gap = np.fmax(gap, np.concatenate([step, last], axis=axis))
    return gap
