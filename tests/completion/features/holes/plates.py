# SPDX-License-Identifier: MIT
"""Plates with given holes, as tests measure them."""

from __future__ import annotations

import numpy as np

from completion.features.engine.template import Measurements
from scenes.checks import FloatArray

NOISE = 0.1


def plate(
    rng: np.random.Generator, holes: FloatArray, radius: float, size: tuple[float, float] = (80.0, 36.0)
) -> Measurements:
    """One point a square millimetre about the origin, but for holes with centres (n, 2)."""
    flat = rng.uniform(-0.5, 0.5, (int(size[0] * size[1]), 2)) * size
    flat = flat[(np.linalg.norm(flat[:, None] - holes, axis=2) > radius).all(axis=1)]
    space = np.column_stack([flat, np.zeros(len(flat))])
    return Measurements(space + NOISE * rng.normal(size=space.shape), noise=NOISE, spacing=0.5)


def without(measured: Measurements, lost: FloatArray, radius: float) -> Measurements:
    """The same with all points within a radius of some places (n, 2) lost."""
    gap = np.linalg.norm(measured.points[:, None, :2] - lost, axis=2)
    return Measurements(measured.points[(gap > radius).all(axis=1)], measured.noise, measured.spacing)


def row(n: int, pitch: float) -> FloatArray:
    """Centres (n, 2) of a row along x about the origin."""
    return np.column_stack([(np.arange(n) - (n - 1) / 2) * pitch, np.zeros(n)])
