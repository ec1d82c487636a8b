# SPDX-License-Identifier: MIT
"""Observation: a scan prepared for completion, with points, rays and the noise read off the scan itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.range_image import RangeImage

_N_RANGE_BINS = 12


@dataclass(frozen=True, slots=True, eq=False)
class RangeNoise:
    """Standard deviation of the range as a function of range: sqrt(constant^2 + (quadratic r^2)^2), metres.

    The form serves terrestrial scanners (constant) and triangulating cameras, whose error grows with the
    square of the distance (Khoshelham & Elberink 2012).
    """

    constant_m: float
    quadratic_per_m: float

    def sigma(self, ranges: FloatArray) -> FloatArray:
        """Standard deviation of single ranges, metres."""
        noise: FloatArray = np.hypot(self.constant_m, self.quadratic_per_m * np.square(ranges))
        return noise

    def deviation(self, ranges: FloatArray) -> FloatArray:
        """What ranges to a flat wall may stray by, metres: the noise, and the quadratic term once more.

        Triangulating cameras bend flat walls by about as much as their noise, since both come from errors
        of the disparity.
        """
        return self.sigma(ranges) + self.quadratic_per_m * np.square(ranges)


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
    normals : (rows, columns, 3) float
        Local unit normals towards the sensor, NaN where the neighbourhood is no surface.
    roughness : (rows, columns) float
        RMS distance of the neighbourhood from its own plane, metres; inf where there is none.
    normal_sd : (rows, columns) float
        Expected error of the normals, radians.
    noise : RangeNoise
        The model behind `sigma`.
    window : int
        Side of the neighbourhood in pixels, odd.
    """

    scan: RangeImage
    points: FloatArray
    rays: FloatArray
    sigma: FloatArray
    normals: FloatArray
    roughness: FloatArray
    normal_sd: FloatArray
    noise: RangeNoise
    window: int

    @property
    def is_noisy(self) -> bool:
        """Whether the ranges carry noise at all."""
        return self.noise.constant_m > 0 or self.noise.quadratic_per_m > 0

    @property
    def valid(self) -> BoolArray:
        """Where something came back."""
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
        scan: the roughness of small neighbourhoods, most of which are flat.
    """
    moved = scan.transformed(reference_from_world)
    points, rays = moved.points(), moved.rays()
    known = scan.sigma_m if sigma_m is None else sigma_m
    noise = estimate_noise(moved, points) if known is None else RangeNoise(float(known), 0.0)
    sigma = noise.deviation(np.where(moved.valid, moved.ranges, np.nan))
    window = _window_for(moved, sigma)
    normals, roughness = local_planes(points, rays, window)
    footprint = moved.ranges * moved.projection.pixel_angle
    normal_sd = sigma / (footprint * window)  # as if the noise were one step across the window
    return Observation(moved, points, rays, sigma, normals, roughness, normal_sd, noise, window)


def estimate_noise(scan: RangeImage, points: FloatArray, window: int = 7) -> RangeNoise:
    """Estimate the range noise from the scan: lower-middle roughness of neighbourhoods, by range.

    Neighbourhoods that hold an edge are rougher than the noise, so each range bin takes the 40th
    percentile. Depths that come in steps add a twelfth of the step's square, which neighbourhoods inside
    one step cannot show. The variances are fitted by a constant and a fourth-power term, both at least zero.
    """
    _, roughness = local_planes(points, scan.rays(), window)
    usable = np.isfinite(roughness) & scan.valid
    if usable.sum() < 100:
        return RangeNoise(0.0, 0.0)
    ranges, rough = scan.ranges[usable], roughness[usable]
    depth = scan.points_in_sensor()[usable, 2] if scan.projection.kind == "pinhole" else ranges
    edges = np.quantile(ranges, np.linspace(0, 1, _N_RANGE_BINS + 1))
    which = np.clip(np.searchsorted(edges, ranges, side="right") - 1, 0, _N_RANGE_BINS - 1)
    bins = [b for b in range(_N_RANGE_BINS) if (which == b).sum() >= 20]
    middle = np.array([np.median(ranges[which == b]) for b in bins])
    step = np.array([_quantisation_step(depth[which == b]) for b in bins])
    variance = np.array([np.quantile(rough[which == b], 0.4) ** 2 for b in bins]) + step**2 / 12
    weight = 1.0 / np.maximum(variance, 1e-16)  # relative errors: near bins count as much as far ones
    basis = np.stack([np.ones_like(middle), middle**4], axis=1)
    terms, _ = nnls(basis * weight[:, None], variance * weight)
    return RangeNoise(float(np.sqrt(terms[0])), float(np.sqrt(terms[1])))


def _quantisation_step(depth: FloatArray) -> float:
    """Typical distance between the values that `depth` takes, 0 where hardly any value comes twice."""
    values, count = np.unique(depth, return_counts=True)
    if len(values) < 2 or len(depth) < 4 * len(values):
        return 0.0
    common = values[count >= np.median(count) / 4]
    return float(np.median(np.diff(common))) if len(common) > 1 else 0.0


def local_planes(points: FloatArray, rays: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    """Fit a plane to the neighbourhood of every pixel.

    Parameters
    ----------
    points, rays : (rows, columns, 3) float
        Points, NaN where there is none, and viewing rays.
    window : int
        Side of the square neighbourhood in pixels.

    Returns
    -------
    normals : (rows, columns, 3) float
        Unit normals towards the sensor, NaN where fewer than half of the pixels hold a point.
    roughness : (rows, columns) float
        RMS distance from the plane, metres; inf there.
    """
    valid = np.asarray(np.isfinite(points).all(axis=-1), dtype=np.bool_)
    if not valid.any():
        return np.full_like(points, np.nan), np.full(valid.shape, np.inf)
    centre = np.median(points[valid], axis=0)
    offset = np.where(valid[..., None], points - centre, 0.0)

    def windowed(image: NDArray[Any]) -> FloatArray:
        summed = cv2.boxFilter(
            image.astype(np.float64),
            cv2.CV_64F,
            (window, window),
            normalize=False,
            borderType=cv2.BORDER_CONSTANT,
        )
        return np.asarray(summed, dtype=np.float64)

    count = windowed(valid)
    enough = valid & (count >= max(6, window * window // 2))
    n = np.maximum(count, 1.0)
    mean = np.stack([windowed(offset[..., i]) for i in range(3)], axis=-1) / n[..., None]
    covariance = np.empty((*valid.shape, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            product = windowed(offset[..., i] * offset[..., j]) / n - mean[..., i] * mean[..., j]
            covariance[..., i, j] = covariance[..., j, i] = product
    normals, roughness = np.full_like(points, np.nan), np.full(valid.shape, np.inf)
    values, vectors = np.linalg.eigh(covariance[enough])
    normal = vectors[..., 0]
    normal *= -np.sign(np.einsum("ij,ij->i", normal, rays[enough]) + 1e-300)[:, None]
    normals[enough] = normal
    freedom = count[enough] / np.maximum(count[enough] - 3, 1)
    roughness[enough] = np.sqrt(np.maximum(values[:, 0], 0.0) * freedom)
    return normals, roughness


def _window_for(scan: RangeImage, sigma: FloatArray) -> int:
    """Smallest window whose normals are good to about 3 degrees at the scan's median range."""
    if not scan.valid.any():
        return 5
    spacing = float(np.median(scan.ranges[scan.valid])) * scan.projection.pixel_angle
    noise = float(np.median(sigma[scan.valid]))
    for window in (5, 7, 9, 11, 13):
        slope_sd = noise * np.sqrt(12.0) / (window**2 * spacing)  # of a plane through window^2 points
        if slope_sd < np.radians(3.0):
            return window
    return 15
