# SPDX-License-Identifier: MIT
"""Observation: a scan prepared for completion, and its beams with the surface each met."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from completion.observe.mixed_pixels import find_mixed
from completion.observe.range_noise import RangeNoise, estimate_noise
from completion.observe.rays import Noise, Rays, pick_points, pick_rays, rays_of
from completion.observe.shadow import NO_SHADOW, Shadow, find_shadow, shadow_of
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A scan in the frame that completion works in.

    Attributes
    ----------
    scan : RangeImage
        The scan, its pose relative to the working frame.
    noise : RangeNoise
        Its range noise.
    rays : Rays
        Its rays, for compiled loops.
    pose_error_m : float
        How far its pose may be off, metres; 0 of a single scan.
    shadow : Shadow
        Where a second device stands that must see a place too.
    """

    scan: RangeImage
    noise: RangeNoise
    rays: Rays
    pose_error_m: float = 0.0
    shadow: Shadow = NO_SHADOW

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.is_known

    @property
    def valid(self) -> BoolArray:
        """Where something came back, (rows, columns)."""
        return self.scan.valid

    def points_at(self, pixels: IntArray) -> FloatArray:
        """Measured points (n, 3) of flat pixels (n,), metres; NaN where nothing came back."""
        out = np.empty((len(pixels), 3))
        pick_points(self.rays, self.scan.ranges, np.asarray(pixels, dtype=np.int64), out)
        return out

    def rays_at(self, pixels: IntArray) -> FloatArray:
        """Unit viewing rays (n, 3) of flat pixels (n,)."""
        out = np.empty((len(pixels), 3))
        pick_rays(self.rays, np.asarray(pixels, dtype=np.int64), out)
        return out

    def sigma_at(self, pixels: IntArray) -> FloatArray:
        """What ranges of flat pixels (n,) may stray by from a flat surface, metres; 0 for no return."""
        return self.noise.deviation(self.scan.ranges.ravel()[pixels])


def observe(
    scan: RangeImage,
    world_from_reference: Pose,
    sigma_m: float | None = None,
    projector_m: float | None = None,
) -> Observation:
    """Prepare `scan` in the frame that `world_from_reference` leads out of.

    Parameters
    ----------
    scan : RangeImage
        The scan as read.
    world_from_reference : Pose
        Motion out of the working frame; that of a scan at this very pose is its sensor frame, to the bit.
    sigma_m : float, optional
        Range noise in metres; when None, the scan's own `sigma_m` or, without one, an estimate from the
        scan: the roughness of small tiles, most of which are flat.
    projector_m : float, optional
        Where a triangulating camera's projector stands on its x axis, metres, to the right when positive; 0
        for none; when None, it is read off the scan (`find_shadow`).
    """
    pose, own = Pose.identity(), scan.world_from_sensor
    if not np.array_equal(own.matrix, world_from_reference.matrix):
        pose = world_from_reference.inverse() @ own
    moved = scan.restated(world_from_sensor=pose)
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved) if known is None else RangeNoise(float(known), 0.0)
    shadow = find_shadow(moved) if projector_m is None else shadow_of(projector_m)
    mixed = find_mixed(moved.ranges, noise.numbers())
    if mixed.any():
        moved = _without(moved, mixed)
    return Observation(moved, noise, rays_of(moved), shadow=shadow)


def _without(scan: RangeImage, mixed: BoolArray) -> RangeImage:
    """The scan without some pixels (rows, columns), and with a word about it."""
    share = int(np.count_nonzero(mixed)) / int(np.count_nonzero(scan.valid))
    text = (
        f"{share:.1%} of its ranges lie between two surfaces, since beams are wider than a pixel or the "
        "image was interpolated; they are left out"
    )
    ranges = np.where(mixed, np.inf, scan.ranges)
    return replace(scan, ranges=ranges, warnings=(*scan.warnings, text))


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Measured beams from one place, with the number, from 1, of the surface that each met; 0 for none."""

    rays: Rays  # of the scan
    noise: Noise  # of its ranges
    ranges: FloatArray  # (rows, columns) metres
    pixel: NDArray[np.int32]  # (n,) flat pixel of each
    label: NDArray[np.int32]  # (n,) surface of each

    @classmethod
    def of(cls, observation: Observation, label: NDArray[np.int32]) -> Beams:
        """All beams of a scan, from labels (rows, columns)."""
        return cls._chosen(observation, np.arange(label.size, dtype=np.int32), label.ravel())

    @classmethod
    def at(cls, observation: Observation, pixel: NDArray[np.int32]) -> Beams:
        """The beams of flat pixels (n,), all of one surface, the first."""
        return cls._chosen(observation, pixel, np.ones(len(pixel), np.int32))

    @classmethod
    def _chosen(cls, seen: Observation, pixel: NDArray[np.int32], label: NDArray[np.int32]) -> Beams:
        return cls(seen.rays, seen.noise.numbers(), seen.scan.ranges, pixel, label)

    def thinned(self, step: int) -> Beams:
        """Every step-th beam."""
        return replace(self, pixel=self.pixel[::step], label=self.label[::step])

    def of_surfaces(self, numbers: NDArray[np.int64]) -> Beams:
        """Return all beams that met the surfaces of these numbers (k,), from 1."""
        chosen = np.flatnonzero(np.isin(self.label, numbers))
        return replace(self, pixel=self.pixel[chosen], label=self.label[chosen])
