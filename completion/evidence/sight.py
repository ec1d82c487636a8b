# SPDX-License-Identifier: MIT
"""Sight: which pixel of a scan sees a place of a surface, and what its range says, for compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import int64

from completion.evidence.form import Form, slope_at
from completion.observe.observation import Observation
from completion.observe.rays import Noise, Rays
from completion.observe.shadow import Devices
from completion.observe.tolerance import Tolerance
from completion.observe.triple import Triple, dot, minus, triple
from scenes.checks import FloatArray
from scenes.scan.projection import PinholeProjection, SphericalProjection
from texture.engine.compiled import inlined

_LEAST_COSINE = 1e-3  # of incidence that tolerances are reckoned with
_LEAST_M = 1e-12  # from the sensor
_SEAM = 1e-9  # radians; so that rounding opens no seam where a full turn closes
_FULL_TURN = 2 * np.pi


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


class Sight(NamedTuple):
    """A scan as compiled loops read it."""

    eye: Eye
    angles: FloatArray  # (rows + columns,) elevations and azimuths of a turning scanner, radians
    ranges: FloatArray  # (pixels,) metres
    noise: Noise  # their standard deviations
    rays: Rays
    devices: Devices


class Look(NamedTuple):
    """How a range compares with a place of a surface."""

    distance: float  # of the place from the sensor, metres
    cosine: float  # of the incidence angle, without sign
    behind: float  # by how much the place is farther than what was measured, metres
    allowed: float  # by how much they may differ and agree, metres


def sight_of(observation: Observation, tolerance: Tolerance) -> Sight:
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
        raise TypeError(f"no place can be looked up in a {type(camera).__name__}")
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
    return Sight(eye, angles, ranges=ranges, noise=noise, rays=observation.rays, devices=devices)


@inlined
def along_ray(eye: Eye, sigma: float, sd: float, cosine: float) -> float:
    """`Tolerance.along_ray` of one beam, metres."""
    safe = max(cosine, _LEAST_COSINE)
    across = (sd * sd + eye.flatness_m * eye.flatness_m) / (safe * safe)
    return eye.n_sigma * float(np.sqrt(sigma * sigma + across)) + eye.registration_m / safe


@inlined
def look(eye: Eye, form: Form, place: Triple, sd: float, beam: tuple[float, float]) -> Look:
    """Hold a place of a surface against the range, and its sd, of the pixel that sees it, metres.

    `sd` is that of the surface along its normal.
    """
    ray = minus(place, eye.origin)
    distance = np.sqrt(dot(ray, ray))
    cosine = abs(slope_at(form, place, ray)) / max(distance, _LEAST_M)
    safe = max(cosine, _LEAST_COSINE)
    tangent = np.sqrt(max(1.0 - safe * safe, 0.0)) / safe
    oblique = distance * eye.pixel_angle * tangent / 2
    return Look(distance, cosine, distance - beam[0], along_ray(eye, beam[1], sd, cosine) + oblique)


@inlined
def pixel_of(eye: Eye, angles: FloatArray, place: Triple) -> int:
    """The flat pixel that sees a place, -1 outside the field of view.

    `angles` (rows + columns,) are those of `Sight`.
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
