# SPDX-License-Identifier: MIT
"""Ripples: systematic errors of depth sensors, smooth, in stripes, in rings, in steps of disparity."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from scenes.checks import FloatArray

TUNING_RIPPLES = ("smooth", "stripes", "smooth_long")
HELD_OUT_RIPPLES = ("smooth", "stripes", "two_lengths", "warped_stripes", "rows", "rings", "uneven", "steps")
STATIONARY = ("smooth", "smooth_long", "stripes", "two_lengths", "warped_stripes", "rows", "rings")


def ripple_of(
    kind: str, shape: tuple[int, int], cell: float, sd: float, rng: np.random.Generator
) -> FloatArray:
    """A ripple of sd `sd` metres on cells of `cell` metres; see the kinds above."""
    y, x = np.meshgrid(*(cell * np.arange(n) for n in shape), indexing="ij")
    turn, period = rng.uniform(0, np.pi), np.exp(rng.uniform(np.log(0.07), np.log(0.4)))
    across = np.cos(turn) * x + np.sin(turn) * y
    if kind == "smooth":
        ripple = smooth(shape, rng.uniform(0.06, 0.2) / cell, rng)
    elif kind == "smooth_long":
        ripple = smooth(shape, rng.uniform(0.2, 0.5) / cell, rng)
    elif kind == "two_lengths":
        ripple = smooth(shape, rng.uniform(0.25, 0.5) / cell, rng)
        ripple = ripple + rng.uniform(0.3, 0.6) * smooth(shape, rng.uniform(0.05, 0.08) / cell, rng)
    elif kind == "stripes":
        ripple = np.sin(2 * np.pi * across / period + rng.uniform(0, 6))
        ripple = ripple + 0.3 * smooth(shape, 0.3 / cell, rng)
    elif kind == "warped_stripes":  # period and strength drift, with a harmonic
        phase = 2 * np.pi * across / period + 1.0 * smooth(shape, 0.6 / cell, rng)
        ripple = np.sin(phase) + 0.3 * np.sin(2 * phase)
        ripple = ripple * (1 + 0.25 * smooth(shape, 0.5 / cell, rng))
    elif kind == "rows":  # an offset of each row or column of the sensor, slowly varying along it
        size = (rng.uniform(0.02, 0.05) / cell, rng.uniform(0.5, 1.5) / cell)
        ripple = smooth(shape, size if rng.random() < 0.5 else size[::-1], rng)
        ripple = ripple + 0.5 * smooth(shape, 0.3 / cell, rng)
    elif kind == "rings":  # about the optical axis
        centre = rng.uniform(0.2, 0.8, 2) * [x.max(), y.max()]
        ripple = np.sin(2 * np.pi * np.hypot(x - centre[0], y - centre[1]) / period + rng.uniform(0, 6))
        ripple = ripple + 0.5 * smooth(shape, 0.3 / cell, rng)
    elif kind == "uneven":  # three times as strong on one side
        away = np.cos(turn) * x / x.max() + np.sin(turn) * y / y.max()
        ripple = smooth(shape, rng.uniform(0.08, 0.2) / cell, rng) * np.exp(1.1 * away / np.ptp(away))
    elif kind == "steps":  # disparity rounded to steps, softened by the noise of many pixels
        quantum = 2.5
        slope = rng.uniform(1.0, 4.0) * across + smooth(shape, 0.3 / cell, rng)
        rounded = quantum * np.round((slope + 0.25 * rng.normal(size=shape)) / quantum)
        ripple = ndimage.gaussian_filter(rounded - slope, 1.0) + 0.5 * smooth(shape, 0.3 / cell, rng)
    else:
        raise ValueError(f"no ripple is called {kind!r}")
    away = ripple - ripple.mean()
    return sd * away / np.sqrt(np.mean(away**2))


def smooth(
    shape: tuple[int, int], length: float | tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """A Gaussian random field of unit sd with correlation exp(-d^2 / 2 length^2), lengths in cells."""
    sigma = np.broadcast_to(np.asarray(length, dtype=float) / np.sqrt(2), 2)
    pad = [int(np.ceil(4 * s)) for s in sigma]
    wide = rng.normal(size=(shape[0] + 2 * pad[0], shape[1] + 2 * pad[1]))
    field = ndimage.gaussian_filter(wide, sigma, mode="wrap")
    gain = np.sqrt(4 * np.pi * sigma[0] * sigma[1])
    out: FloatArray = gain * field[pad[0] : pad[0] + shape[0], pad[1] : pad[1] + shape[1]]
    return out
