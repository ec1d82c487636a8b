# SPDX-License-Identifier: MIT
"""Absorbing: warps of a surface, and edges that the sensor rounded, go back to the surfaces they are of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.refits.packed_surfaces import gap_to
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled

_WITHIN = 0.9  # of an island's pixels within tolerance of the surface around
_ENCLOSED = 0.5  # of its outline next to that surface
_FARTHEST = 2.0  # times the region's own ranges: planes that a ray meets later, or never, end there


def absorb(
    labels: NDArray[np.int32],
    models: FloatArray,
    surfaces: Sequence[Surface],
    observation: Observation,
    options: SegmentationOptions,
) -> NDArray[np.int32]:
    """Relabel islands that their surroundings explain as well as the sensor's systematic error allows.

    An island goes to the larger region that most of its outline touches where nearly all its pixels are
    within tolerance of that surface, where it does not tilt by more than a pixel's normal may, and where its
    mean distance is within `n_sigma` of what neighbouring ranges may stray by together. Noise alone would
    tell them apart; a sensor that bends walls does not let us. Labels (rows, columns) number regions from 1,
    largest first; `models` (m, 9) are their surfaces as compiled loops read them.
    """
    n = len(surfaces)
    contact, outline = contacts(labels, n)
    host = np.array([int(np.argmax(contact[i, :i])) if i else -1 for i in range(n)], np.int64)
    enclosed = np.array([i > 0 and contact[i, host[i]] >= _ENCLOSED * outline[i] for i in range(n)])
    sums = _distances(
        labels, models, np.where(enclosed, host, -1), observation.scan.ranges, observation.rays,
        observation.noise.numbers(), options.least_flatness_m, options.n_sigma,
    )  # fmt: skip
    goes_to = np.arange(n + 1)
    for i in np.flatnonzero(enclosed).tolist():
        count, within, mean, reach = sums[i, 0], sums[i, 1], sums[i, 2:5], sums[i, 5]
        if within < _WITHIN * count:
            continue
        middle = (observation.scan.origin + mean / count)[None]
        gap = abs(sums[i, 6] / count)
        stray = np.hypot(options.least_flatness_m, observation.noise.bias(np.array([reach / count]))[0])
        cosine = float(surfaces[i].normal(middle)[0] @ surfaces[host[i]].normal(middle)[0])
        if gap <= options.n_sigma * stray and cosine >= np.cos(np.radians(options.max_angle_deg)):
            goes_to[i + 1] = goes_to[host[i] + 1]
    return np.asarray(goes_to[labels], dtype=np.int32)


@compiled
def contacts(labels: NDArray[np.int32], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of neighbouring pixels between n regions (n, n), and between each region and any other (n,)."""
    contact, outline = np.zeros((n, n), np.int64), np.zeros(n, np.int64)
    rows, columns = labels.shape
    for i in range(rows):
        for j in range(columns):
            own = labels[i, j]
            for k, m in ((i + 1, j), (i, j + 1)):
                if k < rows and m < columns:
                    other = labels[k, m]
                    if own == other:
                        continue
                    if own > 0:
                        outline[own - 1] += 1
                    if other > 0:
                        outline[other - 1] += 1
                    if own > 0 and other > 0:
                        contact[own - 1, other - 1] += 1
                        contact[other - 1, own - 1] += 1
    return contact, outline


@compiled
def _distances(
    labels: NDArray[np.int32],
    models: FloatArray,
    host: NDArray[np.int64],
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    n_sigma: float,
) -> FloatArray:
    """For each region with a host: pixels, those within tolerance, sums of points, ranges and distances."""
    sums = np.zeros((len(host), 7))
    normal = np.zeros(3)
    for i in range(labels.shape[0]):
        for j in range(labels.shape[1]):
            own = labels[i, j] - 1
            if own < 0 or host[own] < 0:
                continue
            x, y, z = ray_at(rays, i, j)
            r = ranges[i, j]
            s = deviation_at(noise, r)
            gap, cosine = gap_to(models, host[own], x, y, z, r, normal)
            variance = s * s * cosine * cosine + flat * flat
            sums[own, 0] += 1.0
            sums[own, 1] += cosine > 0.0 and gap * gap <= n_sigma * n_sigma * variance
            sums[own, 2] += r * x
            sums[own, 3] += r * y
            sums[own, 4] += r * z
            sums[own, 5] += r
            sums[own, 6] += gap
    return sums


def sharpen_creases(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation
) -> NDArray[np.int32]:
    """Relabel cylinders that are no more than an edge as a camera that averages over windows sees it.

    Such a camera rounds every edge. The ranges to two planes next to a cylinder, the farther of them on a
    convex edge and the nearer in a corner, are averaged over its window; where they explain the cylinder's
    ranges as well as noise that is alike within a window allows, its pixels go to the nearer plane each.
    Sensors that measure every ray by itself round nothing: their cylinders stay. Labels and models as in
    `absorb`: (rows, columns) and (m, 9).
    """
    if observation.scan.projection.kind != "pinhole" or observation.noise.quadratic_per_m == 0:
        return labels
    result = labels.copy()
    contact, _ = contacts(labels, len(models))
    for i in np.flatnonzero(models[:, 0] == 1.0).tolist():
        beside = np.flatnonzero((contact[i] > 0) & (models[:, 0] == 0.0))
        if len(beside) > 1:
            _sharpen(i + 1, beside, result, models, observation)
    return result


def _sharpen(
    label: int, beside: NDArray[np.int64], labels: NDArray[np.int32], models: FloatArray, seen: Observation
) -> None:
    """Give one cylinder's pixels to two of the planes beside it where their crease explains them."""
    pixel = np.argwhere(labels == label)
    ranges = seen.scan.ranges[tuple(pixel.T)]
    width = seen.noise.window_pixels(float(np.median(ranges)))
    if width == 1:
        return
    low, high = np.maximum(pixel.min(axis=0) - width, 0), pixel.max(axis=0) + width + 1
    frame = (slice(low[0], high[0]), slice(low[1], high[1]))
    own: BoolArray = labels[frame] == label
    flat = np.arange(labels.size, dtype=np.int64).reshape(labels.shape)[frame]
    rays = seen.rays_at(flat.ravel()).reshape(*flat.shape, 3)
    reach = {int(j): _reach(models[j], rays, _FARTHEST * float(ranges.max())) for j in beside}
    measured, sigma = seen.scan.ranges[frame][own], seen.sigma_at(flat[own])
    allowed = 1 + 3 * np.sqrt(2 * width**2 / len(pixel))  # a window's ranges count as one
    found = [
        (float(np.mean(np.square((measured - crease[own]) / sigma))), pair)
        for pair, crease in _creases(reach, width)
    ]
    square, (one, other) = min(found)
    if square <= allowed:
        nearer = np.abs(measured - reach[one][own]) <= np.abs(measured - reach[other][own])
        labels[frame][own] = np.where(nearer, one, other) + 1


def _reach(model: FloatArray, rays: FloatArray, farthest: float) -> FloatArray:
    """Ranges (rows, columns) along the rays to a packed plane."""
    along = rays @ model[1:4]
    return np.asarray(model[7] / np.maximum(along, model[7] / farthest), dtype=np.float64)


def _creases(reach: dict[int, FloatArray], width: int) -> Iterator[tuple[tuple[int, int], FloatArray]]:
    """Averaged ranges to each pair of planes, as an edge and as a corner."""
    for one, other in combinations(reach, 2):
        for sharp in (np.maximum(reach[one], reach[other]), np.minimum(reach[one], reach[other])):
            yield (one, other), np.asarray(cv2.blur(sharp, (width, width)), dtype=np.float64)
