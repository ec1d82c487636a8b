# SPDX-License-Identifier: MIT
"""Uneven ground between walls, as a laser scanner's rays meet it, with a step, a ramp or a door if asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

_EYE = np.array([0.0, 0.0, 1.7])
_WAVES, _LEAST_WAVE_M, _MOST_WAVE_M = 12, 1.5, 8.0
_ROUNDS = 12  # until a ray has found the ground
_DOOR = (0.6, 2.1, 2.0)  # where a leaf begins and ends along its wall, and its height, metres
GROUND, BEYOND, WALL, LEAF = 0, 1, 2, 3


@dataclass(frozen=True, kw_only=True, slots=True)
class Yard:
    """A yard by its seed.

    Attributes
    ----------
    relief_m : float
        Greatest height of the ground above its lowest place, metres; waves of 1.5 to 8 m.
    step_m : float
        By which the ground is higher beyond a line 4 m before the scanner, metres.
    ramp_deg : float
        By which it climbs from there on.
    leaf_m : float
        By which a door leaf lies back in a wall, metres.
    size_m : float
        From wall to wall, metres.
    noise_m : float
        Deviation of the ranges, metres.
    """

    seed: int
    relief_m: float = 0.0
    step_m: float = 0.0
    ramp_deg: float = 0.0
    leaf_m: float = 0.0
    size_m: float = 12.0
    noise_m: float = 0.005

    def scan(self, step_deg: float = 0.3) -> tuple[RangeImage, IntArray]:
        """The scan, and what each of its pixels is of: ground, ground beyond the line, wall or leaf."""
        rng = np.random.default_rng(self.seed)
        grid = SphericalProjection.regular(int(360 / step_deg), int(100 / step_deg), 360.0, (-60.0, 40.0))
        turn = rng.uniform(0, 2 * np.pi)
        pose = Pose.looking_at(_EYE, _EYE + [np.cos(turn), np.sin(turn), 0.0])
        rays = pose.rotate(grid.directions())
        ranges, what = self._ground(rays, rng)
        half, place = self.size_m / 2, rng.uniform(-0.2, 0.2, 4) * self.size_m
        for side in range(4):
            axis, sign = side // 2, 1.0 if side % 2 else -1.0
            with np.errstate(divide="ignore", invalid="ignore"):
                away = (sign * half + place[side]) / rays[..., axis]
                leaf = away + sign * self.leaf_m / rays[..., axis]
            along, high = (rays * leaf[..., None])[..., 1 - axis], _EYE[2] + rays[..., 2] * leaf
            is_leaf = (side == 0) & (self.leaf_m > 0) & (high < _DOOR[2])
            is_leaf = is_leaf & (along > _DOOR[0]) & (along < _DOOR[1])
            hit = np.where(is_leaf, leaf, away)
            nearer = (hit > 0) & (hit < ranges)
            ranges = np.where(nearer, hit, ranges)
            what = np.where(nearer, np.where(is_leaf, LEAF, WALL), what)
        ranges = ranges + rng.normal(0, self.noise_m, ranges.shape)
        return RangeImage(np.where(np.isfinite(ranges), ranges, np.inf), grid, pose), what

    def _ground(self, rays: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, IntArray]:
        wave = np.exp(rng.uniform(np.log(_LEAST_WAVE_M), np.log(_MOST_WAVE_M), _WAVES))
        angle, phase = rng.uniform(0, 2 * np.pi, (2, _WAVES))
        turn = 2 * np.pi / wave * np.array([np.cos(angle), np.sin(angle)])

        def waves(x: FloatArray, y: FloatArray) -> FloatArray:
            return sum(
                wave[k] ** 0.5 * np.sin(turn[0, k] * x + turn[1, k] * y + phase[k]) for k in range(_WAVES)
            )

        x, y = np.meshgrid(*(np.linspace(-self.size_m / 2, self.size_m / 2, 200),) * 2)
        scale = self.relief_m / np.ptp(waves(x, y))
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(rays[..., 2] < -0.02, -_EYE[2] / rays[..., 2], np.inf)
        down = np.isfinite(reach)
        some, found = rays[down], reach[down]
        for _ in range(_ROUNDS):
            x, y = some[:, 0] * found, some[:, 1] * found
            beyond = np.maximum(x - 4.0, 0.0)
            height = scale * waves(x, y) + np.where(x > 4.0, self.step_m, 0.0)
            height += np.tan(np.radians(self.ramp_deg)) * beyond
            found = found + 0.7 * ((height - _EYE[2]) / some[:, 2] - found)
        reach[down] = found
        is_other = (self.step_m > 0) | (self.ramp_deg > 0)
        return reach, np.where(down & is_other & (rays[..., 0] * reach > 4.0), BEYOND, GROUND)
