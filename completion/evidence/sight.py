# SPDX-License-Identifier: MIT
"""Sight: which pixel of a scan sees a place of a surface, and what its range says, for compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.evidence.form import Form, Triple, dot, minus, slope_at, triple
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import FloatArray
from scenes.scan.projection import PinholeProjection, SphericalProjection
from texture.engine.compiled import compiled

_LEAST_COSINE = 1e-3  # of incidence that tolerances are reckoned with
_LEAST_M = 1e-12  # from the sensor
_SEAM = 1e-9  # radians; so that rounding opens no seam where a full turn closes
_FULL_TURN = 2 * np.pi


class Sight(NamedTuple):
    """A scan and the tolerance along its rays as compiled loops read them."""

    turn: tuple[Triple, Triple, Triple]  # rows of the rotation into the sensor frame
    shift: Triple  # metres, after it
    origin: Triple  # of the sensor, working frame
    shape: tuple[int, int]  # rows and columns
    is_spherical: bool
    lens: tuple[float, float, float, float]  # fx, fy, cx, cy of a pinhole, pixels
    elevations: FloatArray  # (rows,) of a turning scanner, radians
    azimuths: FloatArray  # (columns,)
    pixel_angle: float  # radians
    ranges: FloatArray  # (pixels,) metres
    sigma: FloatArray  # (pixels,) their standard deviations
    n_sigma: float
    flatness_m: float
    registration_m: float
    max_m: float


class Look(NamedTuple):
    """What the pixel that sees a place says of it."""

    pixel: int  # flat, -1 outside the field of view
    distance: float  # of the place from the sensor, metres
    cosine: float  # of the incidence angle, without sign
    measured: float  # range, metres
    allowed: float  # how far it may differ and agree, metres


def sight_of(observation: Observation, tolerance: Tolerance) -> Sight:
    """Return a scan as the loops read it."""
    scan = observation.scan
    camera, inverse = scan.projection, scan.world_from_sensor.inverse()
    x, y, z = map(triple, inverse.rotation)
    lens, elevations, azimuths = (1.0, 1.0, 0.0, 0.0), np.zeros(0), np.zeros(0)
    if isinstance(camera, PinholeProjection):
        lens = float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)
    elif isinstance(camera, SphericalProjection):
        elevations, azimuths = camera.elevations.copy(), camera.azimuths.copy()
    else:
        raise TypeError(f"no place can be looked up in a {type(camera).__name__}")
    return Sight(
        turn=(x, y, z),
        shift=triple(inverse.translation),
        origin=triple(scan.origin),
        shape=camera.shape,
        is_spherical=len(azimuths) > 0,
        lens=lens,
        elevations=elevations,
        azimuths=azimuths,
        pixel_angle=camera.pixel_angle,
        ranges=scan.ranges.ravel(),
        sigma=observation.sigma.ravel(),
        n_sigma=tolerance.n_sigma,
        flatness_m=tolerance.flatness_m,
        registration_m=tolerance.registration_m,
        max_m=tolerance.max_m,
    )


@compiled
def along_ray(sight: Sight, sigma: float, sd: float, cosine: float) -> float:
    """`Tolerance.along_ray` of one beam, metres."""
    safe = max(cosine, _LEAST_COSINE)
    across = (sd * sd + sight.flatness_m * sight.flatness_m) / (safe * safe)
    return sight.n_sigma * float(np.sqrt(sigma * sigma + across)) + sight.registration_m / safe


@compiled
def look(sight: Sight, form: Form, place: Triple, sd: float) -> Look:
    """Hold a place of a surface against the pixel that sees it; `sd` is the surface's there, metres."""
    pixel = pixel_of(sight, place)
    if pixel < 0:
        return Look(-1, 0.0, 1.0, np.inf, np.inf)
    ray = minus(place, sight.origin)
    distance = np.sqrt(dot(ray, ray))
    cosine = abs(slope_at(form, place, ray)) / max(distance, _LEAST_M)
    safe = max(cosine, _LEAST_COSINE)
    tangent = np.sqrt(max(1.0 - safe * safe, 0.0)) / safe
    oblique = distance * sight.pixel_angle * tangent / 2
    sigma = sight.sigma[pixel]
    allowed = along_ray(sight, 0.0 if np.isnan(sigma) else sigma, sd, cosine) + oblique
    return Look(pixel, distance, cosine, sight.ranges[pixel], allowed)


@compiled
def pixel_of(sight: Sight, place: Triple) -> int:
    """The flat pixel that sees a place, -1 outside the field of view."""
    x = dot(sight.turn[0], place) + sight.shift[0]
    y = dot(sight.turn[1], place) + sight.shift[1]
    z = dot(sight.turn[2], place) + sight.shift[2]
    rows, columns = sight.shape
    if sight.is_spherical:
        row = _nearest(sight.elevations, np.arctan2(-y, np.sqrt(x * x + z * z)), sight.pixel_angle)
        if row < 0:
            return -1
        middle = (sight.azimuths[0] + sight.azimuths[columns - 1]) / 2
        azimuth = middle + (np.arctan2(x, z) - middle + np.pi) % _FULL_TURN - np.pi
        column = _nearest(sight.azimuths, azimuth, sight.pixel_angle)
        return row * columns + column if column >= 0 else -1
    if not z > 0.0:
        return -1
    fx, fy, cx, cy = sight.lens
    scale = 1.0 / z
    down, right = fy * y * scale + cy, fx * x * scale + cx
    if not (-0.5 <= down < rows - 0.5 and -0.5 <= right < columns - 0.5):
        return -1
    return int(np.rint(down)) * columns + int(np.rint(right))


@compiled
def _nearest(angles: FloatArray, wanted: float, only_step: float) -> int:
    """Index of the nearest of monotonic angles (n,), -1 beyond half a step outside.

    Found from where it would be if all steps were alike. A single angle has the step `only_step`.
    """
    last = angles.size - 1
    if last == 0:
        return 0 if abs(wanted - angles[0]) <= only_step / 2 else -1
    sign = 1.0 if angles[last] > angles[0] else -1.0
    wanted, low, high = sign * wanted, sign * angles[0], sign * angles[last]
    before = (sign * angles[1] - low) / 2 + _SEAM
    beyond = (high - sign * angles[last - 1]) / 2 + _SEAM
    if not low - before <= wanted <= high + beyond:
        return -1
    k = min(max(int((wanted - low) / (high - low) * last), 0), last - 1)
    while k > 0 and sign * angles[k] > wanted:
        k -= 1
    while k < last - 1 and sign * angles[k + 1] <= wanted:
        k += 1
    share = (wanted - sign * angles[k]) / (sign * angles[k + 1] - sign * angles[k])
    return int(np.rint(k + min(max(share, 0.0), 1.0)))
