# SPDX-License-Identifier: MIT
"""Observation: a scan prepared for completion, its range noise, and its beams with the surface each met."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import gammaincinv

from completion.observe.rays import Noise, Rays, deviations, pick_points, pick_rays, rays_of
from completion.observe.tiles import cut_tiles
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_N_RANGE_BINS = 12
_TILE = 7
_WINDOW = 9
_FREEDOM = _TILE**2 - 3  # of a plane in a tile
_QUARTILE = float(2 * gammaincinv(_FREEDOM / 2, 0.25) / _FREEDOM)  # of a flat tile's variance (chi square)


@dataclass(frozen=True, slots=True, eq=False)
class RangeNoise:
    """Standard deviation of the range as a function of range: sqrt(constant^2 + (quadratic r^2)^2), metres.

    The form serves terrestrial scanners (constant) and triangulating cameras, whose error grows with the
    square of the distance (Khoshelham & Elberink 2012).
    """

    constant_m: float
    quadratic_per_m: float

    def sigma(self, ranges: FloatArray) -> FloatArray:
        """Standard deviation (n,) of single ranges (n,), metres."""
        return np.asarray(np.hypot(self.constant_m, self.quadratic_per_m * np.square(ranges)))

    def bias(self, ranges: FloatArray) -> FloatArray:
        """Common error (n,) of neighbouring ranges (n,) to a flat wall, metres.

        Triangulating cameras bend flat walls by as much as their noise or twice as much, since both come
        from errors of the disparity: on walls before five such cameras, means over blocks of 10 x 10 pixels
        scatter by 1.1 to 2 standard deviations of the noise.
        """
        return np.asarray(2.0 * self.quadratic_per_m * np.square(ranges), dtype=np.float64)

    def window_pixels(self, reach: float) -> int:
        """Pixels along the side of the window whose average a range at this distance is; 1 for a single ray.

        Cameras whose error grows with the square of the distance find a disparity by matching windows, about
        9 pixels wide (Konolige & Mihelich 2011): on tables before four such cameras the residuals'
        autocorrelation falls in a line to nothing at 8 to 9 pixels.
        """
        return _WINDOW if self.quadratic_per_m * reach**2 > self.constant_m else 1

    def deviation(self, ranges: FloatArray) -> FloatArray:
        """Expected error (n,) of single ranges (n,) to a flat wall, metres: noise and typical bias.

        0 where nothing came back.
        """
        return deviations(self.numbers(), ranges)

    def numbers(self, bulge: float = 0.0) -> Noise:
        """Return the expected error of single ranges to a flat wall for compiled loops: noise, typical bias.

        And `bulge` times the range, by which what is not quite flat strays.
        """
        return Noise(self.constant_m, bulge, self.quadratic_per_m)


def estimate_noise(scan: RangeImage) -> RangeNoise:
    """Estimate the range noise from the roughness of a scan's tiles.

    By range: tiles that hold an edge are rougher than the noise, so each range bin takes the lower quartile,
    corrected to the mean of flat tiles. Depths that come in steps add a twelfth of the step's square, which
    tiles inside one step cannot show. The variances are fitted by a constant and a fourth-power term, both at
    least zero.
    """
    tiles = cut_tiles(scan.ranges, rays_of(scan), Noise(1.0, 0.0, 0.0), 0.0, _TILE)
    usable = np.isfinite(tiles.misfit)
    if usable.sum() * _TILE**2 < 100:
        return RangeNoise(0.0, 0.0)
    ranges, square = np.linalg.norm(tiles.centre[usable], axis=-1), tiles.misfit[usable]
    edges = np.quantile(ranges, np.linspace(0, 1, _N_RANGE_BINS + 1))
    which = np.clip(np.searchsorted(edges, ranges, side="right") - 1, 0, _N_RANGE_BINS - 1)
    bins = [b for b in range(_N_RANGE_BINS) if (which == b).sum() >= 5]
    if not bins:
        return RangeNoise(0.0, 0.0)
    middle = np.array([np.median(ranges[which == b]) for b in bins])
    step = _steps(scan, edges)[bins]
    variance = np.array([np.quantile(square[which == b], 0.25) for b in bins]) / _QUARTILE + step**2 / 12
    weight = 1.0 / np.maximum(variance, 1e-16)  # relative errors: near bins count as much as far ones
    basis = np.stack([np.ones_like(middle), middle**4], axis=1)
    terms, _ = nnls(basis * weight[:, None], variance * weight)
    return RangeNoise(float(np.sqrt(terms[0])), float(np.sqrt(terms[1])))


def _steps(scan: RangeImage, edges: FloatArray) -> FloatArray:
    """Typical step of the depths whose ranges lie between consecutive edges."""
    ranges = scan.ranges[scan.valid]
    pinhole = scan.projection.kind == "pinhole"
    depth = scan.points_in_sensor()[scan.valid][:, 2] if pinhole else ranges
    which = np.clip(np.searchsorted(edges, ranges, side="right") - 1, 0, len(edges) - 2)
    return np.array([_quantisation_step(depth[which == b]) for b in range(len(edges) - 1)])


def _quantisation_step(depth: FloatArray) -> float:
    """Typical distance between the values that `depth` takes, 0 where hardly any value comes twice."""
    values, count = np.unique(depth, return_counts=True)
    if len(values) < 2 or len(depth) < 4 * len(values):
        return 0.0
    common = values[count >= np.median(count) / 4]
    return float(np.median(np.diff(common))) if len(common) > 1 else 0.0


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
    """

    scan: RangeImage
    noise: RangeNoise
    rays: Rays

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.constant_m > 0 or self.noise.quadratic_per_m > 0

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


def observe(scan: RangeImage, world_from_reference: Pose, sigma_m: float | None = None) -> Observation:
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
    """
    pose, own = Pose.identity(), scan.world_from_sensor
    if not np.array_equal(own.matrix, world_from_reference.matrix):
        pose = world_from_reference.inverse() @ own
    moved = scan.restated(world_from_sensor=pose)
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved) if known is None else RangeNoise(float(known), 0.0)
    return Observation(moved, noise, rays_of(moved))


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
