# SPDX-License-Identifier: MIT
"""Observation: a scan prepared for completion, its range noise, and its beams with the surface each met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import gammaincinv

from completion.observe.tiles import cut_tiles
from scenes.checks import BoolArray, FloatArray
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
        """Expected error (n,) of single ranges (n,) to a flat wall, metres: noise and typical bias."""
        return self.sigma(ranges) + self.bias(ranges) / 2


def estimate_noise(scan: RangeImage, rays: FloatArray) -> RangeNoise:
    """Estimate the range noise from the roughness of a scan's tiles along its unit rays (rows, columns, 3).

    By range: tiles that hold an edge are rougher than the noise, so each range bin takes the lower quartile,
    corrected to the mean of flat tiles. Depths that come in steps add a twelfth of the step's square, which
    tiles inside one step cannot show. The variances are fitted by a constant and a fourth-power term, both at
    least zero.
    """
    tiles = cut_tiles(scan.ranges, rays, np.ones(scan.shape), 0.0, _TILE)
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
    points, rays : (rows, columns, 3) float
        Measured points (NaN where nothing came back) and unit viewing rays.
    sigma : (rows, columns) float
        What each range may stray by from a flat surface (`RangeNoise.deviation`), metres.
    noise : RangeNoise
        The model behind `sigma`.
    """

    scan: RangeImage
    points: FloatArray
    rays: FloatArray
    sigma: FloatArray
    noise: RangeNoise

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.constant_m > 0 or self.noise.quadratic_per_m > 0

    @property
    def valid(self) -> BoolArray:
        """Where something came back, (rows, columns)."""
        return self.scan.valid


def observe(scan: RangeImage, reference_from_world: Pose, sigma_m: float | None = None) -> Observation:
    """Prepare `scan` in the frame that `reference_from_world` leads to.

    Parameters
    ----------
    scan : RangeImage
        The scan as read.
    reference_from_world : Pose
        Motion into the working frame.
    sigma_m : float, optional
        Range noise in metres; when None, the scan's own `sigma_m` or, without one, an estimate from the
        scan: the roughness of small tiles, most of which are flat.
    """
    moved = scan.transformed(reference_from_world)
    rays = moved.rays()
    reach = np.where(moved.valid, moved.ranges, np.nan)
    points: FloatArray = moved.origin + reach[..., None] * rays
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved, rays) if known is None else RangeNoise(float(known), 0.0)
    return Observation(moved, points, rays, noise.deviation(reach), noise)


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Measured beams from one place, with the number, from 1, of the surface that each met; 0 for none."""

    origin: FloatArray  # (3,) where they start, metres
    label: NDArray[np.int32]  # (n,) surface of each
    ranges: FloatArray  # (n,) metres
    sigma: FloatArray  # (n,) their standard deviations, metres
    rays: FloatArray  # (n, 3) unit directions

    @classmethod
    def of(cls, observation: Observation, label: NDArray[np.int32]) -> Beams:
        """All beams of a scan, from labels (rows, columns)."""
        scan, rays = observation.scan, observation.rays.reshape(-1, 3)
        return cls(scan.origin, label.ravel(), scan.ranges.ravel(), observation.sigma.ravel(), rays)

    @classmethod
    def at(cls, observation: Observation, pixel: NDArray[np.int64]) -> Beams:
        """The beams of flat pixels (n,), all of one surface, the first."""
        scan, rays = observation.scan, observation.rays.reshape(-1, 3)[pixel]
        ones, ranges = np.ones(len(pixel), np.int32), scan.ranges.ravel()[pixel]
        return cls(scan.origin, ones, ranges, observation.sigma.ravel()[pixel], rays)

    def thinned(self, step: int) -> Beams:
        """Every step-th beam."""
        return self._only(slice(None, None, step))

    def of_surfaces(self, numbers: NDArray[np.int64]) -> Beams:
        """Return all beams that met the surfaces of these numbers (k,), from 1."""
        return self._only(np.flatnonzero(np.isin(self.label, numbers)))

    def _only(self, chosen: slice | NDArray[np.int64]) -> Beams:
        return Beams(
            self.origin, self.label[chosen], self.ranges[chosen], self.sigma[chosen], self.rays[chosen]
        )
