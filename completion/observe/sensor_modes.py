# SPDX-License-Identifier: MIT
"""Sensor modes: how a sensor's own errors, alike over its whole image, move what it measures.

Noise averages out over many pixels; what bends or scales a whole image does not, and leaves no residual where
a surface, or the pose of a scan, takes it on. So it is stated by the kind of sensor:

* triangulating cameras bend what they see by an error of the disparity, in metres with the square of the
  distance, from one sensor to the next otherwise (Khoshelham & Elberink 2012; Teichman, Miller & Thrun 2013).
  Here it is any polynomial of second order over the image, of `_DISTORTION` times `RangeNoise.bias`. Nobody
  calibrated most of them, and a focal length is then known to half a percent;
* terrestrial scanners turn about axes that are off by some hundredths of a degree: collimation, trunnion
  axis, vertical index (Lichti 2007);
* of others, and where there is no noise, nothing is known.

What is said of lengths (`range_displacements`) also holds how wrong ranges are as a whole, by a constant and
by a share of them. Makers of scanners state that together with the noise, by one number (1.2 mm and 10 ppm of
a Leica P40, 2 mm of a Faro Focus); additive constants of that size are found by calibration (Lichti 2007).
Angles hardly know of it.
"""

from __future__ import annotations

import numpy as np

from completion.fitting.rounding import rounding_modes
from completion.observe.observation import Observation
from scenes.checks import FloatArray

N_MODES = 10
"""Seven of triangulating cameras, three of scanners."""

_DISTORTION = 1.0
"""How many times `RangeNoise.bias` a triangulating camera's image is bent by, root mean square.

What is larger shows in residual modes (`completion.uncertainty.pipeline`): with these, angles between
the walls and floors of four rooms before four cameras are off by as much as this makes probable (`python -m
benchmarks.completion.angles`). Without, it took five times as much.
"""

_N_CAMERA_MODES = 7
_FOCAL = 0.005  # of the focal length
_AXES = np.radians(0.02)
_OFFSET_M, _SCALE = 1.2e-3, 10e-6


def displacements(seen: Observation, points: FloatArray) -> FloatArray:
    """Return how far each mode moves points (n, 3) that a scan measured: (10, n, 3), metres.

    Seven modes of triangulating cameras, then three of scanners; zeros where nothing is known of the sensor.
    """
    modes = np.zeros((N_MODES, len(points), 3))
    if not seen.noise.is_known:
        return modes
    pose = seen.scan.world_from_sensor
    local = pose.inverse().apply(points)
    if seen.scan.projection.kind == "spherical":
        modes[_N_CAMERA_MODES:] = _of_scanner(local)
    elif seen.noise.is_triangulated:
        modes[:_N_CAMERA_MODES] = _of_camera(seen, local)
    return np.asarray(np.einsum("ij,mnj->mni", pose.rotation, modes))


def range_displacements(seen: Observation, points: FloatArray, scale: float = 1.0) -> FloatArray:
    """Return how far an offset and a scale of all ranges move points (n, 3) of a scan: (2, n, 3), metres.

    The offset is as large as the noise of single ranges, 1.2 mm at least, times the `scale` of what is
    measured: what measures small parts is no scanner of buildings. Zeros where there is no noise, and of
    triangulating cameras, whose bends hold both.
    """
    modes = np.zeros((2, len(points), 3))
    if not seen.noise.is_known or (seen.scan.projection.kind == "pinhole" and seen.noise.is_triangulated):
        return modes
    along = points - seen.scan.world_from_sensor.translation
    ranges = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    modes[0] = max(_OFFSET_M * scale, seen.noise.constant_m) * along / ranges
    modes[1] = _SCALE * along
    return modes


def rounding_displacements(seen: Observation, points: FloatArray) -> FloatArray:
    """Return how far rounded coordinates move points (n, 3) of a surface: (12, n, 3), metres.

    Rounding moves each surface by itself, unlike the errors of a sensor.
    """
    return rounding_modes(points, np.sqrt(12) * seen.noise.common_m)


def _of_camera(seen: Observation, points: FloatArray) -> FloatArray:
    """Bends of second order over the image along the rays, and a focal length that is off: (7, n, 3).

    The polynomials have unit mean square over an image of unit half width, and share the distortion.
    """
    ranges = np.linalg.norm(points, axis=1)
    half = seen.scan.projection.pixel_angle * max(seen.scan.shape) / 2  # tangent of half the view
    x, y = points[:, :2].T / np.maximum(points[:, 2], 1e-9) / half
    unit, linear, square = np.ones_like(x), np.sqrt(3.0), np.sqrt(11.25)
    bends = np.stack([
        unit, linear * x, linear * y, square * (x**2 - 1 / 3), 3 * x * y, square * (y**2 - 1 / 3)
    ])  # fmt: skip
    far = _DISTORTION * seen.noise.bias(ranges) / np.sqrt(len(bends)) * bends
    along = far[:, :, None] * (points / ranges[:, None])
    return np.concatenate([along, [_FOCAL * points * [1.0, 1.0, 0.0]]])


def _of_scanner(points: FloatArray) -> FloatArray:
    """Collimation, trunnion axis and vertical index of a scanner that turns about its y axis: (3, n, 3)."""
    ranges = np.linalg.norm(points, axis=1)
    level = np.hypot(points[:, 0], points[:, 2])
    elevation = np.arctan2(-points[:, 1], level)
    sine, cosine = points[:, 0] / np.maximum(level, 1e-9), points[:, 2] / np.maximum(level, 1e-9)
    sideways = np.column_stack([cosine, np.zeros_like(sine), -sine]) * ranges[:, None]
    upwards = np.column_stack([-sine * np.sin(elevation), -np.cos(elevation), -cosine * np.sin(elevation)])
    trunnion = np.sin(elevation)[:, None] * sideways
    return np.asarray(_AXES * np.stack([sideways, trunnion, ranges[:, None] * upwards]))
