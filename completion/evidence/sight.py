# SPDX-License-Identifier: MIT
"""Sight: which scans, which part of an image and which pixel see a place, and what its range says of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import int64

from completion.evidence.form import Form, slope_at
from completion.evidence.limits import LEAST_COSINE, MARGIN_CELLS, MARGIN_PIXELS
from completion.observe.observation import Observation
from completion.observe.rays import Noise, Rays, Triple, dot, minus, triple
from completion.observe.shadow import Devices
from completion.observe.tolerance import Tolerance
from scenes.card import shown
from scenes.checks import BoolArray, FloatArray
from scenes.scan.projection import PinholeProjection, SphericalProjection
from texture.engine.compiled import inlined

_LEAST_M = 1e-12  # from the sensor
_SEAM = 1e-9  # radians; so that rounding opens no seam where a full turn closes
_FULL_TURN = 2 * np.pi


@shown
class Eye(NamedTuple):
    """A sensor and the tolerance along its rays as compiled loops read them: numbers alone."""

    turn: tuple[Triple, Triple, Triple]  # rows of the rotation into the sensor frame
    shift: Triple  # metres, after it
    origin: Triple  # of the sensor, working frame
    shape: tuple[int, int]  # rows and columns
    is_spherical: bool
    lens: tuple[float, float, float, float]  # fx, fy, cx, cy of a pinhole, pixels
    pixel_angle: float  # radians
    n_sigma: float
    flatness_m: float
    registration_m: float
    max_m: float


@shown
class ScanSight(NamedTuple):
    """A scan as compiled loops read it."""

    eye: Eye
    angles: FloatArray  # (rows + columns,) elevations and azimuths of a turning scanner, radians
    ranges: FloatArray  # (pixels,) metres
    ends: FloatArray  # (pixels,) the same, and how far beams got that met two surfaces (`beam_ends`)
    noise: Noise  # their standard deviations
    rays: Rays
    devices: Devices


class RangeVerdict(NamedTuple):
    """How a range compares with a place of a surface."""

    distance: float  # of the place from the sensor, metres
    cosine: float  # of the incidence angle, without sign
    behind: float  # by how much the place is farther than what was measured, metres
    allowed: float  # by how much they may differ and agree, metres


def sight_of(observation: Observation, tolerance: Tolerance) -> ScanSight:
    """Return a scan as the loops read it."""
    scan = observation.scan
    camera, inverse = scan.projection, scan.world_from_sensor.inverse()
    x, y, z = map(triple, inverse.rotation)
    lens, angles = (1.0, 1.0, 0.0, 0.0), np.zeros(0)
    if isinstance(camera, PinholeProjection):
        lens = float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)
    elif isinstance(camera, SphericalProjection):
        angles = np.concatenate([camera.elevations, camera.azimuths])
    else:
        raise TypeError(f"points cannot be projected into a {type(camera).__name__}")
    eye = Eye(
        turn=(x, y, z),
        shift=triple(inverse.translation),
        origin=triple(scan.origin),
        shape=camera.shape,
        is_spherical=len(angles) > 0,
        lens=lens,
        pixel_angle=camera.pixel_angle,
        n_sigma=tolerance.n_sigma,
        flatness_m=tolerance.flatness_m,
        registration_m=tolerance.of_pose(observation.pose_error_m).registration_m,
        max_m=tolerance.max_m,
    )
    ranges, noise = scan.ranges.ravel(), observation.noise.numbers()
    devices = Devices(observation.shadow, lens, camera.shape)
    return ScanSight(
        eye=eye,
        angles=angles,
        ranges=ranges,
        ends=observation.beam_ends().ravel(),
        noise=noise,
        rays=observation.rays,
        devices=devices,
    )


@inlined
def along_ray(eye: Eye, sigma: float, sd: float, cosine: float) -> float:
    """`Tolerance.along_ray` of one beam, metres."""
    safe = max(cosine, LEAST_COSINE)
    across = (sd * sd + eye.flatness_m * eye.flatness_m) / (safe * safe)
    return eye.n_sigma * float(np.sqrt(sigma * sigma + across)) + eye.registration_m / safe


@inlined
def look(eye: Eye, form: Form, place: Triple, sd: float, beam: tuple[float, float]) -> RangeVerdict:
    """Hold a place of a surface against the range, and its sd, of the pixel that sees it, metres.

    `sd` is that of the surface along its normal.
    """
    ray = minus(place, eye.origin)
    distance = np.sqrt(dot(ray, ray))
    cosine = abs(slope_at(form, place, ray)) / max(distance, _LEAST_M)
    safe = max(cosine, LEAST_COSINE)
    tangent = np.sqrt(max(1.0 - safe * safe, 0.0)) / safe
    oblique = distance * eye.pixel_angle * tangent / 2
    return RangeVerdict(distance, cosine, distance - beam[0], along_ray(eye, beam[1], sd, cosine) + oblique)


@inlined
def pixel_of(eye: Eye, angles: FloatArray, place: Triple) -> int:
    """The flat pixel that sees a place, -1 outside the field of view.

    `angles` (rows + columns,) are those of `ScanSight`.
    """
    x = dot(eye.turn[0], place) + eye.shift[0]
    y = dot(eye.turn[1], place) + eye.shift[1]
    z = dot(eye.turn[2], place) + eye.shift[2]
    rows, columns = eye.shape
    if eye.is_spherical:
        row = _nearest(angles, int64(0), rows, np.arctan2(-y, np.sqrt(x * x + z * z)), eye.pixel_angle)
        if row < 0:
            return -1
        middle = (angles[rows] + angles[rows + columns - 1]) / 2
        azimuth = middle + (np.arctan2(x, z) - middle + np.pi) % _FULL_TURN - np.pi
        column = _nearest(angles, rows, columns, azimuth, eye.pixel_angle)
        return row * columns + column if column >= 0 else -1
    if not z > 0.0:
        return -1
    fx, fy, cx, cy = eye.lens
    scale = 1.0 / z
    down, right = fy * y * scale + cy, fx * x * scale + cx
    if not (-0.5 <= down < rows - 0.5 and -0.5 <= right < columns - 0.5):
        return -1
    return int(np.rint(down)) * columns + int(np.rint(right))


@inlined
def _nearest(angles: FloatArray, first: int, n: int, wanted: float, only_step: float) -> int:
    """Which of n monotonic angles from `first` on is nearest, -1 beyond half a step outside.

    Found from where it would be if all steps were alike. A single angle has the step `only_step`.
    """
    last = first + n - 1
    if n == 1:
        return 0 if abs(wanted - angles[first]) <= only_step / 2 else -1
    sign = 1.0 if angles[last] > angles[first] else -1.0
    wanted, low, high = sign * wanted, sign * angles[first], sign * angles[last]
    before = (sign * angles[first + 1] - low) / 2 + _SEAM
    beyond = (high - sign * angles[last - 1]) / 2 + _SEAM
    if not low - before <= wanted <= high + beyond:
        return -1
    k = first + min(max(int((wanted - low) / (high - low) * (n - 1)), 0), n - 2)
    while k > first and sign * angles[k] > wanted:
        k -= 1
    while k < last - 1 and sign * angles[k + 1] <= wanted:
        k += 1
    share = (wanted - sign * angles[k]) / (sign * angles[k + 1] - sign * angles[k])
    return int(np.rint(k - first + min(max(share, 0.0), 1.0)))


Window: TypeAlias = tuple[int, int, int, int]
"""First and last row, first and last column of pixels; a last one of -1 says that there are none."""

_SLACK = 1e-9  # of rounding, radians


@inlined
def window_of(eye: Eye, angles: FloatArray, middle: Triple, radius: float) -> Window:
    """Rows and columns of all pixels that see a place within a sphere.

    `angles` (rows + columns,) are those of `ScanSight`.
    """
    at = (
        dot(eye.turn[0], middle) + eye.shift[0],
        dot(eye.turn[1], middle) + eye.shift[1],
        dot(eye.turn[2], middle) + eye.shift[2],
    )
    if eye.is_spherical:
        return _of_turning(eye, angles, at, radius)
    return _of_pinhole(eye, at, radius)


@inlined
def _of_pinhole(eye: Eye, at: Triple, radius: float) -> Window:
    """First and last row and column that a sphere about a place, sensor frame, may be seen in."""
    x, y, z = at
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    near, farther = z - radius, z + radius
    if farther < 0.0:
        return 0, -1, 0, -1
    if near <= 0.0:
        return 0, rows - 1, 0, columns - 1
    low, high = (y - radius), (y + radius)
    ups = fy * low / near, fy * low / farther, fy * high / near, fy * high / farther
    low, high = (x - radius), (x + radius)
    sides = fx * low / near, fx * low / farther, fx * high / near, fx * high / farther
    top, bottom = _pixel_window(cy + min(ups), cy + max(ups), rows)
    left, right = _pixel_window(cx + min(sides), cx + max(sides), columns)
    return top, bottom, left, right


@inlined
def _pixel_window(low: float, high: float, n: int) -> tuple[int, int]:
    """First and last of n pixels between two places, and one more on either side."""
    if high < -1.0 or low > n:
        return 0, -1
    return int(max(np.floor(low) - 1.0, 0.0)), int(min(np.ceil(high) + 1.0, n - 1.0))


@inlined
def _of_turning(eye: Eye, angles: FloatArray, at: Triple, radius: float) -> Window:
    """`_of_pinhole` for a turning scanner."""
    x, y, z = at
    rows, columns = eye.shape
    distance = np.sqrt(x * x + y * y + z * z)
    if not distance > radius:
        return 0, rows - 1, 0, columns - 1
    half = np.arcsin(radius / distance) + _SLACK
    elevation = np.arctan2(-y, np.sqrt(x * x + z * z))
    top, bottom = _angle_window(angles, int64(0), rows, (elevation - half, elevation + half), eye.pixel_angle)
    if abs(elevation) + half >= np.pi / 2 - 1e-3:
        return top, bottom, 0, columns - 1
    side = np.arcsin(min(np.sin(half) / np.cos(elevation), 1.0)) + _SLACK
    middle = (angles[rows] + angles[rows + columns - 1]) / 2
    turned = (np.arctan2(x, z) - middle + np.pi) % (2 * np.pi) - np.pi
    if abs(turned) + side >= np.pi:
        return top, bottom, 0, columns - 1
    around = middle + turned - side, middle + turned + side
    left, right = _angle_window(angles, rows, columns, around, eye.pixel_angle)
    return top, bottom, left, right


@inlined
def _angle_window(
    angles: FloatArray, first: int, n: int, within: tuple[float, float], only_step: float
) -> tuple[int, int]:
    """First and last of n monotonic angles from `first` on within two, and one more on either side.

    There are none where the nearest is a whole step away; a single angle has the step `only_step`.
    """
    low, high = within
    a, b = angles[first], angles[first + n - 1]
    before = abs(angles[first + 1] - a) if n > 1 else only_step
    beyond = abs(b - angles[first + n - 2]) if n > 1 else only_step
    rises = b >= a
    if rises and (high < a - before - _SLACK or low > b + beyond + _SLACK):
        return 0, -1
    if not rises and (high < b - beyond - _SLACK or low > a + before + _SLACK):
        return 0, -1
    start, end = _count_below(angles, first, n, rises, low), _count_below(angles, first, n, rises, high)
    if not rises:
        start, end = n - end, n - start
    return max(start - 2, 0), min(end + 1, n - 1)


@inlined
def _count_below(angles: FloatArray, first: int, n: int, rises: bool, limit: float) -> int:
    """How many of n monotonic angles from `first` on are smaller than a limit."""
    low, high = 0, n
    while low < high:
        k = (low + high) // 2
        if angles[first + k if rises else first + n - 1 - k] < limit:
            low = k + 1
        else:
            high = k
    return low


_SLACK_M = 1e-6  # of lengths, for rounding


@shown
class Ball(NamedTuple):
    """A ball around a chart's cells."""

    middle: Triple
    radius: float  # metres


def ball_around(bounds: FloatArray, cell: FloatArray) -> Ball:
    """Return a ball around cells of a size (2,), whose centres have bounds (2, 3), and two cells more."""
    low, high = bounds
    radius = float(np.linalg.norm(high - low)) / 2 + MARGIN_CELLS * float(np.hypot(*cell))
    return Ball(triple((low + high) / 2), radius)


@shown
class Views(NamedTuple):
    """Where n scans stand and look, so that all are asked at once."""

    origin: FloatArray  # (n, 3) of the sensors, metres
    outside: FloatArray  # (n, 5, 4) how far a place lies outside each of five planes: factors, and a summand
    farthest: FloatArray  # (n,) greatest range, metres; -inf where nothing came back

    @classmethod
    def of(cls, eyes: Iterable[Eye], farthest: Iterable[float]) -> Views:
        """Return the views of scans that measured no farther than `farthest` (n,), metres."""
        known = list(eyes)
        return cls(
            origin=np.array([eye.origin for eye in known]),
            outside=np.array([_outside(eye) for eye in known]),
            farthest=np.array(list(farthest), dtype=np.float64),
        )

    def may_see(self, ball: Ball) -> BoolArray:
        """Tell which scans (n,) have a ray that may meet a ball; a no is sure, turning scanners never say it.

        The pyramid of a camera's rays is the space in front of four planes through the sensor.
        """
        outside = self.outside[:, :, :3] @ np.array(ball.middle) + self.outside[:, :, 3]
        return np.asarray((outside <= ball.radius).all(axis=1), dtype=np.bool_)

    def may_reach(self, ball: Ball) -> BoolArray:
        """Tell which scans (n,) have a beam that may have got into a ball; a no is sure."""
        distance = np.linalg.norm(self.origin - np.array(ball.middle), axis=1)
        reaches = self.farthest >= distance * (1 - _SLACK_M) - ball.radius - _SLACK_M
        return np.asarray(self.may_see(ball) & reaches, dtype=np.bool_)


def _outside(eye: Eye) -> FloatArray:
    """How far a place lies behind a sensor, and outside each side of its image (5, 4); -inf without sides."""
    if eye.is_spherical:
        return np.tile([0.0, 0.0, 0.0, -np.inf], (5, 1))
    x, y, z = np.column_stack([np.array(eye.turn), np.array(eye.shift)])
    rows, columns = eye.shape
    fx, fy, cx, cy = eye.lens
    planes = [-z]
    for across, n, focal, centre in ((x, columns, fx, cx), (y, rows, fy, cy)):
        sides = (-0.5 - MARGIN_PIXELS - centre) / focal, (n - 0.5 + MARGIN_PIXELS - centre) / focal
        low, high = min(sides), max(sides)
        planes += [(across - high * z) / np.hypot(1.0, high), (low * z - across) / np.hypot(1.0, low)]
    return np.array(planes)
