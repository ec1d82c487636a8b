# SPDX-License-Identifier: MIT
"""Scanners with errors of their own: every one is off by other amounts, alike in all that it measures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import SphericalSensor
from nbv.scanning.view import View
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
