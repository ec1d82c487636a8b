# SPDX-License-Identifier: MIT
"""Sensors with systematic errors: scanners off by offset, scale and axes; cameras with smooth errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor, View
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_AXES = np.radians(0.02)  # collimation, trunnion axis, vertical index: one standard deviation
_SCALE = 10e-6
SENSOR = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=85.0, width=1080, height=435,
    name="scanner",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Scanner:
    """A kind of terrestrial scanner: noise of single ranges, deviation of their offset; metres."""

    name: str
    noise_m: float
    offset_m: float

    def scan(self, scene: Scene, pose: Pose, seed: int) -> RangeImage:
        """Scan with one scanner of the kind, whose own errors `seed` draws; they are for others to find out.

        It looks along other directions than it says, and its ranges are off by a constant and a share.
        """
        rng = np.random.default_rng([20269, seed])
        nominal = scan_scene(scene, View(pose, SENSOR), noise="none", truth=False)
        rays = nominal.rays().reshape(-1, 3)
        local = pose.inverse().rotate(rays)
        true = pose.rotate(local - _misdirection(local, _AXES * rng.normal(size=3)))
        hits = scene.ray_caster().first_hit(nominal.origin[None], true)
        ranges = np.where(np.isfinite(hits.ranges), hits.ranges, np.nan)
        offset, scale = self.offset_m * rng.normal(), _SCALE * rng.normal()
        measured = ranges * (1 + scale) + offset + self.noise_m * rng.normal(size=len(ranges))
        return replace(nominal, ranges=measured.reshape(nominal.shape), sigma_m=None)


SCANNERS = {
    "2mm": Scanner("2 mm scanner", 0.002, 0.002),
    "10mm": Scanner("10 mm scanner", 0.010, 0.010),
}


def _misdirection(rays: FloatArray, angles: FloatArray) -> FloatArray:
    """How far rays (n, 3) are off by errors (3,) of the axes (Lichti 2007), the scanner upright about y."""
    level = np.maximum(np.hypot(rays[:, 0], rays[:, 2]), 1e-9)
    elevation = np.arctan2(-rays[:, 1], level)
    sine, cosine = rays[:, 0] / level, rays[:, 2] / level
    sideways = np.column_stack([cosine, np.zeros_like(sine), -sine])
    upwards = np.column_stack([-sine * np.sin(elevation), -np.cos(elevation), -cosine * np.sin(elevation)])
    collimation, trunnion, index = angles
    return np.asarray((collimation + trunnion * np.sin(elevation))[:, None] * sideways + index * upwards)


UNIT_PER_M = 2.85e-3
"""Of disparity, an eighth of a pixel of a Kinect, as an error of the depth at 1 m (Khoshelham & Elberink)."""

_LEAST_M = 0.1  # to which a range is bent


def distorted(scan: RangeImage, seed: int, units: float = 2.0) -> RangeImage:
    """Return a pinhole scan with a bend of its own along the rays, root mean square `units` of disparity.

    Its noise is for who completes it to find out.

    The bend is a (rho^2 - 1/3) + b (rho^4 - 1/5) about a centre that is up to a fifth of the image off its
    middle, rho in half widths, a and b normal: lenses of camera and projector are round.
    """
    rng = np.random.default_rng([20267, seed])
    rows, columns = scan.shape
    row, column = np.mgrid[:rows, :columns]
    half = max(rows, columns) / 2
    centre = np.array([rows, columns]) / 2 + rng.uniform(-0.2, 0.2, 2) * max(rows, columns)
    rho = np.hypot(row - centre[0], column - centre[1]) / half
    bend = rng.normal() * (rho**2 - 1 / 3) + rng.normal() * (rho**4 - 1 / 5)
    bend *= units / np.sqrt(np.mean(np.square(bend)))
    ranges = scan.ranges.copy()
    held = ranges[scan.valid]
    ranges[scan.valid] = np.maximum(held + bend[scan.valid] * UNIT_PER_M * np.square(held), _LEAST_M)
    return replace(scan, ranges=ranges, truth=None, sigma_m=None)


DISPARITY_PER_M = 2e-3
"""Error of the depth at 1 m by a smooth error of the disparity, metres: 18 mm at 3 m."""

_NOISE_PER_M = 1.425e-3  # of a Kinect's depth at 1 m (Khoshelham & Elberink 2012)
_LENGTH = 0.12  # of the image's longer side: a smooth field's correlation


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What a sensor adds to true ranges."""

    name: str  # for tables
    # standard deviation of independent errors of ranges (n,), metres
    noise: Callable[[FloatArray], FloatArray]
    smooth: Callable[[FloatArray], FloatArray]  # factor of the smooth field at ranges (n,), metres
    # a smooth field (rows, columns) of unit mean square, by a generator and the image's shape
    field: Callable[[np.random.Generator, tuple[int, int]], FloatArray]
    is_camera: bool = False  # whether only cameras err so, not scanners

    def applied(self, scan: RangeImage, seed: int) -> RangeImage:
        """Return a scan without errors with these; it is for who uses it to find out how large they are."""
        rng = np.random.default_rng([20268, seed])
        held = scan.ranges[scan.valid]
        field = self.field(rng, scan.shape)[scan.valid]
        ranges = scan.ranges.copy()
        ranges[scan.valid] = held + self.smooth(held) * field + self.noise(held) * rng.normal(size=len(held))
        return replace(scan, ranges=np.maximum(ranges, 0.05), sigma_m=None)


def random_field(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """A Gaussian field (rows, columns) of unit mean square, as long as a seventh of the image."""
    margin = max(shape)
    white = rng.normal(size=(shape[0] + margin, shape[1] + margin))
    field = ndimage.gaussian_filter(white, _LENGTH * max(shape), mode="wrap", truncate=3.0)
    field /= np.sqrt(np.mean(np.square(field)))
    return np.asarray(field[: shape[0], : shape[1]])


def polynomial_field(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """A polynomial of third order over the image (rows, columns), of unit mean square there."""
    y, x = (np.linspace(-1, 1, n) for n in shape)
    basis = [np.outer(y**a, x**b) for a in range(4) for b in range(4 - a) if a + b]
    field = sum(rng.normal() * (one - one.mean()) / one.std() for one in basis)
    return np.asarray(field / np.sqrt(np.mean(np.square(field))))


def no_field(_rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """None."""
    return np.zeros(shape)


def _always(size: float) -> Callable[[FloatArray], FloatArray]:
    return lambda ranges: np.full_like(ranges, size)


def _by_square(size: float) -> Callable[[FloatArray], FloatArray]:
    return lambda ranges: size * np.square(ranges)


def _camera(name: str, field: Callable[[np.random.Generator, tuple[int, int]], FloatArray]) -> SensorErrors:
    noise, smooth = _by_square(_NOISE_PER_M), _by_square(DISPARITY_PER_M)
    return SensorErrors(name, noise, smooth, field, is_camera=True)


SENSORS: tuple[SensorErrors, ...] = (
    SensorErrors("2 mm", _always(2e-3), _always(0.0), no_field),
    SensorErrors("10 mm", _always(1e-2), _always(0.0), no_field),
    SensorErrors("2 mm, 1.5 mm smooth", _always(2e-3), _always(1.5e-3), random_field),
    _camera("depth camera, smooth", random_field),
    _camera("depth camera, polynomial", polynomial_field),
)
