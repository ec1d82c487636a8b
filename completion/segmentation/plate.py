# SPDX-License-Identifier: MIT
"""Plate: a plane piece, or several together, by some of its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.observe.observation import Observation
from completion.observe.pixel_set import PixelSet
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_SAMPLE = 1000  # points of a piece that are looked at


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """Some points of a plane piece, or of several together."""

    plane: Plane
    n_pixels: int
    points: FloatArray  # (n, 3)
    noise: FloatArray  # (n,) standard deviation along the normal, metres
    bias: float  # what the sensor bends flat walls by at its range, metres

    @property
    def size(self) -> float:
        """Root mean square distance of its points from their middle, metres."""
        return float(np.sqrt(self.points.var(axis=0).sum()))

    def relief(self, plane: Surface) -> float:
        """How far it strays from a plane, rms beyond noise and what the sensor bends walls by, metres."""
        square = np.mean(np.square(plane.distance(self.points)) - np.square(self.noise)) - self.bias**2
        return float(np.sqrt(max(square, 0.0)))


def plate_of(plane: Plane, pixels: PixelSet, observation: Observation) -> Plate:
    """Return a piece by its plane and its pixels."""
    flat = pixels.flat[np.linspace(0, len(pixels) - 1, min(_SAMPLE, len(pixels))).astype(np.int64)]
    ranges = observation.scan.ranges.ravel()[flat]
    cosine = np.abs(observation.rays_at(flat) @ plane.normal_direction)
    noise = observation.noise.sigma(ranges) * cosine
    bias = float(observation.noise.bias(np.array([np.median(ranges)]))[0])
    return Plate(plane, len(pixels), observation.points_at(flat), noise, bias)


def together(plates: Sequence[Plate]) -> Plate:
    """Return several plates as one, each by as many points as its pixels are worth, on their common plane."""
    most = max(one.n_pixels / len(one.points) for one in plates)
    steps = [max(1, round(most * len(one.points) / one.n_pixels)) for one in plates]
    points = np.concatenate([one.points[::step] for one, step in zip(plates, steps, strict=True)])
    noise = np.concatenate([one.noise[::step] for one, step in zip(plates, steps, strict=True)])
    centre = points.mean(axis=0)
    normal = np.linalg.eigh((points - centre).T @ (points - centre))[1][:, 0]
    facing = float(normal @ max(plates, key=lambda one: one.n_pixels).plane.normal_direction)
    weights = [one.n_pixels for one in plates]
    return Plate(
        plane=Plane(centre, normal if facing >= 0 else -normal),
        n_pixels=sum(weights),
        points=points,
        noise=noise,
        bias=float(np.average([one.bias for one in plates], weights=weights)),
    )
