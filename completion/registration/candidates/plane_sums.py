# SPDX-License-Identifier: MIT
"""Plane sums: the planes of a scan as sums over their pixels, from which any motion's misfit is told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.observe.observation import Observation
from completion.observe.tolerance import FLATNESS_M
from completion.segmentation.regions import Region
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_LEAST_COSINE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class PlaneSums:
    """The planes of a scan, in its frame.

    Attributes
    ----------
    normals : (k, 3) float
        Unit normals towards the sensor.
    heights : (k,) float
        n . x of each, below zero.
    areas : (k,) float
        What is seen of each, square metres.
    scatter : (k, 4, 4) float
        Sums of (x, 1) (x, 1)' over the pixels x, each over the variance of a facet's error there.
    n_pixels : int
        That brought something back in all.
    """

    normals: FloatArray
    heights: FloatArray
    areas: FloatArray
    scatter: FloatArray
    n_pixels: int

    @classmethod
    def of(cls, regions: Sequence[Region], seen: Observation, side: int) -> PlaneSums:
        """Return the planes among the regions of a scan, whose facets have `side` pixels, in their order."""
        planes = [(one.fit.surface, one.pixels) for one in regions if isinstance(one.fit.surface, Plane)]
        n, angle = len(planes), seen.scan.projection.pixel_angle
        normals, heights, areas, scatter = np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros((n, 4, 4))
        for k, (plane, pixels) in enumerate(planes):
            normal = plane.normal_direction
            height = float(normal @ plane.point)
            normals[k], heights[k] = (normal, height) if height <= 0 else (-normal, -height)
            points = seen.points_at(pixels.flat)
            distance = np.linalg.norm(points, axis=1)
            cosine = np.abs(points @ normal) / distance
            areas[k] = float((np.square(distance * angle) / np.maximum(cosine, _LEAST_COSINE)).sum())
            along = np.square(seen.noise.sigma(distance) / side) + np.square(seen.noise.bias(distance))
            weight = 1.0 / (along * np.square(cosine) + FLATNESS_M**2)
            whole = np.concatenate([points, np.ones((len(points), 1))], axis=1)
            scatter[k] = whole.T @ (weight[:, None] * whole)
        return cls(normals, heights, areas, scatter, int(seen.valid.sum()))
