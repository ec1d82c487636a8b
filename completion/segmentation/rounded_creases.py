# SPDX-License-Identifier: MIT
"""Creases: small cylinders that the sensor made of an edge between two planes go back to the planes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.segmentation.absorbing import contacts
from scenes.checks import BoolArray, FloatArray

_FARTHEST = 2.0  # times the region's own ranges: planes that a ray meets later, or never, end there


def sharpen_creases(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation
) -> NDArray[np.int32]:
    """Relabel cylinders that are no more than an edge as a camera that averages over windows sees it.

    Such a camera rounds every edge. The ranges to two planes next to a cylinder, the farther of them on a
    convex edge and the nearer in a corner, are averaged over its window; where they explain the cylinder's
    ranges as well as noise that is alike within a window allows, its pixels go to the nearer plane each.
    Sensors that measure every ray by itself round nothing: their cylinders stay.

    Parameters
    ----------
    labels : (rows, columns) int32
        Regions from 1; 0 for none.
    models : (m, 9) float
        Their surfaces as compiled loops read them.
    observation : Observation
        The scan.
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
    reach = {int(j): _reach(models[j], seen.rays[frame], _FARTHEST * float(ranges.max())) for j in beside}
    measured, sigma = seen.scan.ranges[frame][own], seen.sigma[frame][own]
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
