# SPDX-License-Identifier: MIT
"""A paved yard with rough walls and trees, up to 40 m long, as a laser scanner's rays meet it."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

_EYE = np.array([0.0, 0.0, 1.6])
_WALLS = ((0, 40.0), (0, -7.0), (1, 5.0), (1, -9.0))  # axis, place, metres
_TREES = (
    (12.0, 1.0, 3.0),
    (22.0, -4.0, 4.0),
    (31.0, 2.0, 3.5),
    (-4.0, -5.0, 2.5),
)  # x, y, height of the crown
_CROWN_M, _STONE_M = 1.8, 0.3


def yard_ranges(rays: FloatArray, rng: np.random.Generator) -> FloatArray:
    """True ranges (...) along unit rays (..., 3): walls to 1 mm, stones 3 mm apart in height, leaves."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(rays[..., 2] < 0, -_EYE[2] / rays[..., 2], np.inf)
        place = rays[..., :2] * ground[..., None]
        stone = np.floor(np.nan_to_num(place, posinf=0, neginf=0) / _STONE_M).astype(np.int64) % 64
        height = rng.normal(0, 0.003, (64, 64))[stone[..., 0], stone[..., 1]]
        ranges = np.where(np.isfinite(ground), (height - _EYE[2]) / rays[..., 2], np.inf)
        for axis, at in _WALLS:
            away = (at - _EYE[axis]) / rays[..., axis]
            rough = rng.normal(0, 0.001, ranges.shape) / np.abs(rays[..., axis])
            high = rays[..., 2] * away < 9.0
            ranges = np.minimum(ranges, np.where((away > 0) & high, away + rough, np.inf))
    for x, y, z in _TREES:
        middle = np.array([x, y, z]) - _EYE
        along = rays @ middle
        half = np.sqrt(np.maximum(_CROWN_M**2 - (middle @ middle - along**2), 0.0))
        met = (half > 0) & (rng.random(ranges.shape) < 0.7)
        leaf = along + half * rng.uniform(-1, 1, ranges.shape)
        ranges = np.minimum(ranges, np.where(met & (along > 0), leaf, np.inf))
    return ranges


def yard_scan(
    constant_m: float, linear: float = 0.0, *, step_deg: float = 0.36, quantum_m: float = 0.0, seed: int = 0
) -> RangeImage:
    """A panorama whose ranges have the deviation sqrt(constant^2 + (linear r)^2) and steps of `quantum_m`."""
    rng = np.random.default_rng(seed)
    shape = int(360 / step_deg), int(110 / step_deg)
    grid = SphericalProjection.regular(*shape, 360.0, (-55.0, 55.0))
    pose = Pose.looking_at(_EYE, _EYE + [1.0, 0.0, 0.0])
    ranges = yard_ranges(pose.rotate(grid.directions()), rng)
    sigma = np.hypot(constant_m, linear * np.where(np.isfinite(ranges), ranges, 0.0))
    measured = ranges + rng.normal(0, 1, ranges.shape) * sigma
    if quantum_m:
        measured = np.round(measured / quantum_m) * quantum_m
    return RangeImage(measured, grid, pose)
