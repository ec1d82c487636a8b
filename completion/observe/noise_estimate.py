# SPDX-License-Identifier: MIT
"""Noise of ranges: its model, and its estimate from a scan whose noise nobody knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.special import gammaincinv

from completion.observe.tiles import cut_tiles
from scenes.checks import FloatArray
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
        noise: FloatArray = np.hypot(self.constant_m, self.quadratic_per_m * np.square(ranges))
        return noise

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
    """Estimate the range noise from the roughness of a scan's tiles along the rays, by range.

    Tiles that hold an edge are rougher than the noise, so each range bin takes the lower quartile, corrected
    to the mean of flat tiles. Depths that come in steps add a twelfth of the step's square, which tiles
    inside one step cannot show. The variances are fitted by a constant and a fourth-power term, both at
    least zero.

    Parameters
    ----------
    scan : RangeImage
        The scan.
    rays : (rows, columns, 3) float
        Its unit viewing rays.
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
