# SPDX-License-Identifier: MIT
"""Segmentation: a range image as regions on planes and cylinders, by seeded growing and refitting."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.fitting.euclidean import fit_plane
from completion.fitting.result import FitError
from completion.growing import Region, SegmentationOptions, grow, grow_cylinder, is_curved, refit
from completion.observation import Observation
from scenes.checks import BoolArray, FloatArray


def segment(observation: Observation, options: SegmentationOptions) -> list[Region]:
    """Cut a scan into regions on planes and cylinders, largest flat patch first.

    A seed is the middle of the largest patch that is as flat as the noise allows. A plane grows from it
    over connected pixels within tolerance and is refitted until it stands still; where the residuals say
    that the patch is curved, a cylinder grows from the same place and the one that explains more pixels
    stays. Pixels in reach of two surfaces go to the nearer one (after Besl & Jain 1988).
    """
    tolerance = tolerance_image(observation, options)
    flat = np.isfinite(observation.roughness) & (observation.roughness <= np.maximum(tolerance * 0.8, 1e-9))
    free = observation.valid.copy()
    regions: list[Region] = []
    tried = np.zeros_like(free)
    while len(regions) < options.max_regions:
        seed = _seed(flat & free & ~tried, observation.window, options.min_pixels)
        if seed is None:
            break
        region = _region_from(seed, free, observation, tolerance, options)
        if region is None:
            tried |= seed
            continue
        regions.append(region)
        free &= ~region.mask
        tried |= seed
    return _shared_out(regions, observation, tolerance, options)


def tolerance_image(observation: Observation, options: SegmentationOptions) -> FloatArray:
    """How far from a surface each pixel may lie and still belong to it, metres."""
    return np.asarray(options.n_sigma * np.hypot(observation.sigma, options.flatness_m), dtype=np.float64)


def _seed(candidates: BoolArray, window: int, min_pixels: int) -> BoolArray | None:
    """Pixels of a square patch in the middle of the largest candidate area, None when nothing is left."""
    padded = cv2.copyMakeBorder(candidates.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    depth = cv2.distanceTransform(padded, cv2.DIST_C, 3)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    reach = int(depth[row, column]) - 1
    if depth[row, column] < 1 or (2 * reach + 1) ** 2 < min(9, min_pixels):
        return None
    reach = min(reach, 2 * window)
    patch = np.zeros_like(candidates)
    patch[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1] = True
    return patch & candidates


def _region_from(
    seed: BoolArray,
    free: BoolArray,
    observation: Observation,
    tolerance: FloatArray,
    options: SegmentationOptions,
) -> Region | None:
    try:
        start = fit_plane(observation.points[seed], observation.scan.origin)
    except FitError:
        return None
    plane = grow(start, seed, free, observation, tolerance, options)
    cylinder = None
    if plane is None or is_curved(plane, observation):
        cylinder = grow_cylinder(seed if plane is None else plane.mask, free, observation, tolerance, options)
    if plane is None or (cylinder is not None and cylinder.n_pixels > 1.1 * plane.n_pixels):
        return cylinder
    return plane


def _shared_out(
    regions: list[Region], observation: Observation, tolerance: FloatArray, options: SegmentationOptions
) -> list[Region]:
    """Give pixels on the seams to the surface they fit best, drop regions left too small, refit the rest."""
    if not regions:
        return []
    labels = _nearest_surface(regions, observation, tolerance)
    result = []
    for index, region in enumerate(regions, start=1):
        mask = _largest_part(labels == index)
        if mask.sum() < options.min_pixels:
            continue
        try:
            result.append(Region(refit(region.fit, mask, observation), mask))
        except FitError:
            continue
    return result


def _nearest_surface(
    regions: list[Region], observation: Observation, tolerance: FloatArray
) -> NDArray[np.int32]:
    """Number, from 1, of the region whose surface each pixel in or near it fits best; 0 for none."""
    best = np.full(tolerance.shape, np.inf)
    chosen = np.zeros(tolerance.shape, np.int32)
    reach = np.ones((2 * (observation.window // 2) + 1,) * 2, np.uint8)
    for index, region in enumerate(regions, start=1):
        nearby = (cv2.dilate(region.mask.astype(np.uint8), reach) > 0) & observation.valid
        distance = np.full(tolerance.shape, np.inf)
        distance[nearby] = np.abs(region.fit.surface.distance(observation.points[nearby])) / tolerance[nearby]
        better = (distance <= 1.0) & (distance < best)
        best[better], chosen[better] = distance[better], index
    return chosen


def _largest_part(mask: BoolArray) -> BoolArray:
    n_parts, part = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    if n_parts <= 2:
        return mask
    sizes = np.bincount(part.ravel())
    sizes[0] = 0
    return np.asarray(part == int(np.argmax(sizes)), dtype=np.bool_)
