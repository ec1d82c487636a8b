# SPDX-License-Identifier: MIT
"""Systematics: how far a sensor's own errors, alike over its whole image, shift and tilt what is fitted.

Noise averages out over a surface's pixels, and means over blocks of them show errors of middling length.
What bends or tilts a surface as a whole leaves no residual: it is in the fit, and no fit can tell. So it is
stated by the kind of sensor:

* triangulating cameras bend what they see by an error of the disparity, in metres with the square of the
  distance, from one sensor to the next otherwise (Khoshelham & Elberink 2012; Teichman, Miller & Thrun 2013).
  Here it is any polynomial of second order over the image, of `_DISTORTION` times `RangeNoise.bias`. Nobody
  calibrated most of them, and a focal length is then known to half a percent;
* terrestrial scanners turn about axes that are off by some hundredths of a degree: collimation, trunnion
  axis, vertical index (Lichti 2007);
* of others, and where there is no noise, nothing is known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray
from scenes.run.mapping import trim

_DISTORTION = 1.0
"""How many times `RangeNoise.bias` a triangulating camera's image is bent by, root mean square.

What is larger shows in residual modes (`residual_modes`): with these, angles between the walls and floors of
four rooms before four cameras are off by as much as this makes probable (`python -m
benchmarks.completion.angles`). Without, it took five times as much.
"""

N_MODES = 10
_N_CAMERA_MODES = 7
_FOCAL = 0.005  # of the focal length
_AXES = np.radians(0.02)
_N_BEAMS = 2000  # of a surface that tell what its fit takes on


def shift_by_sensors(merged: MergedSurface, observations: Sequence[Observation]) -> FloatArray:
    """Return what systematic errors do to a surface's fit: (k, 10), its parameters' change by each mode.

    Each error is a mode: a displacement of all measured points, as far as one standard deviation takes it.
    What the fit makes of it is by least squares over the surface's own beams, the same mode in all scans.
    """
    size = len(merged.fit.covariance)
    moment, pull = np.zeros((size, size)), np.zeros((size, N_MODES))
    for seen, pixels in merged.sampled_by(observations, _N_BEAMS):
        points = seen.points_at(pixels)
        gradient = merged.fit.gradient(points)
        weight = 1.0 / np.maximum(np.square(seen.sigma_at(pixels)), 1e-12)
        along = np.einsum("mij,ij->im", displacements(seen, pixels), merged.fit.surface.normal(points))
        both = gradient.T * weight
        moment += both @ gradient
        pull += both @ along
        trim()
    return np.asarray(np.linalg.pinv(moment, rcond=1e-12, hermitian=True) @ pull)


def displacements(seen: Observation, pixels: IntArray) -> FloatArray:
    """Return how far each mode moves the points of flat pixels: (10, n, 3), metres.

    Seven modes of triangulating cameras, then three of scanners; zeros where nothing is known of the sensor.
    """
    found = np.zeros((N_MODES, len(pixels), 3))
    if not seen.noise.is_known:
        return found
    pose = seen.scan.world_from_sensor
    local = pose.inverse().apply(seen.points_at(pixels))
    if seen.scan.projection.kind == "spherical":
        found[_N_CAMERA_MODES:] = _of_scanner(local)
    elif seen.noise.is_triangulated:
        found[:_N_CAMERA_MODES] = _of_camera(seen, local)
    return np.asarray(np.einsum("ij,mnj->mni", pose.rotation, found))


def _of_camera(seen: Observation, points: FloatArray) -> FloatArray:
    """Bends of second order over the image along the rays, and a focal length that is off: (7, n, 3).

    The polynomials have unit mean square over an image of unit half width, and share the distortion.
    """
    ranges = np.linalg.norm(points, axis=1)
    half = seen.scan.projection.pixel_angle * max(seen.scan.shape) / 2  # tangent of half the view
    x, y = points[:, :2].T / np.maximum(points[:, 2], 1e-9) / half
    one, linear, square = np.ones_like(x), np.sqrt(3.0), np.sqrt(11.25)
    bends = np.stack([
        one, linear * x, linear * y, square * (x**2 - 1 / 3), 3 * x * y, square * (y**2 - 1 / 3)
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
