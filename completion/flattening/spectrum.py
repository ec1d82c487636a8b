# SPDX-License-Identifier: MIT
"""Spectrum of a wall's ripple and noise, learned from the wall itself although there is relief on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from scenes.checks import BoolArray, FloatArray

_HOP = 8  # cells from one window to the next
_LONGEST = 24  # cells: waves that are longer are not told from slopes
_FALL = 4  # power of the wave length by which longer waves are taken to be stronger
_MOST_KNOWN = 0.7  # of a window


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Power (size, size // 2 + 1) of each wave in a window, as of white noise of that variance, m^2."""

    power: FloatArray

    def on(self, shape: tuple[int, int], fall: int = _FALL) -> FloatArray:
        """The power on the frequencies of a real transform of a field of `shape`.

        Waves that are longer than half the shortest window cannot be told from a slope there. They are taken
        to be the stronger the longer they are, by the power `fall` of their length: of them no step is
        inferred.
        """
        size = len(self.power)
        rows = fft.fftfreq(shape[0])[:, None] * size
        columns = fft.rfftfreq(shape[1])[None] * size
        waves = np.hypot(rows, columns)
        waves[0, 0] = 0.5 * min(np.abs(rows[1, 0]), columns[0, 1])
        stretch = np.maximum(1.0, size / _LONGEST / waves)
        rows, columns = rows * stretch, columns * stretch
        columns[0, 0] = size / _LONGEST
        log = np.log(self.power)
        at = [rows % size, columns]
        near = ndimage.map_coordinates(np.concatenate([log, log[:1]]), at, order=1, mode="nearest")
        power: FloatArray = np.exp(near) * np.minimum(stretch, 30) ** fall
        return power


def estimate_spectrum(heights: FloatArray, known: BoolArray, quantile: float, window: int) -> Spectrum:
    """The spectrum of heights (rows, columns) that hold relief in fewer than 1 - `quantile` of all windows.

    Of each wave the power in many windows is exponentially distributed where there is ripple and noise alone,
    larger where a step lies in the window. A low quantile sees the former: -log(1 - quantile) of its mean.
    """
    size = min(window, min(heights.shape) // 2 * 2)
    taper = np.hanning(size + 2)[1:-1]
    weight = np.outer(taper, taper)
    weight /= np.sqrt(np.sum(weight**2))
    rows, columns = (np.unique(np.r_[0 : n - size : _HOP, n - size]) for n in heights.shape)
    seen = ndimage.uniform_filter(known.astype(np.float64), size, mode="constant")
    half = size // 2
    corners = [(i, j) for i in rows for j in columns if seen[i + half, j + half] >= _MOST_KNOWN]
    if not corners:
        best = np.unravel_index(np.argmax(seen[rows + half][:, columns + half]), (len(rows), len(columns)))
        corners = [(rows[best[0]], columns[best[1]])]
    across = np.linspace(-1, 1, size)
    slopes = np.stack([np.ones((size, size)), *np.broadcast_arrays(across[:, None], across)]).reshape(3, -1)
    squared = weight.ravel() ** 2
    normal = np.linalg.inv((slopes * squared) @ slopes.T)
    powers = np.empty((len(corners), size, size // 2 + 1))
    for power, (i, j) in zip(powers, corners, strict=True):
        part = heights[i : i + size, j : j + size].ravel()
        part = part - (normal @ (slopes @ (squared * part))) @ slopes
        power[:] = np.abs(fft.rfft2(part.reshape(size, size) * weight)) ** 2
    found = np.quantile(powers, quantile, axis=0) / -np.log1p(-quantile)
    found = np.maximum(found, 1e-9 * found.max() + 1e-30)
    return Spectrum(found * _turning(powers / found, quantile))


def _turning(ratios: FloatArray, quantile: float) -> FloatArray:
    """By how much waves of each length are stronger in a usual window than those of a fixed direction.

    In rings, or in stripes that turn, each direction is strong in few windows and the quantile of each wave
    misses them all; but in every window some direction is strong. `ratios` (n, size, size // 2 + 1) is the
    power in each window over that of all. A usual window's strongest wave of a length is compared with the
    largest of as many exponential variates, the mean of its waves with one.
    """
    size = ratios.shape[1]
    rows, columns = np.fft.fftfreq(size)[:, None] * size, np.arange(size // 2 + 1)[None]
    length = np.rint(np.hypot(rows, columns)).astype(np.int64)
    gain = np.ones(length.shape)
    for k in range(1, int(length.max()) + 1):
        waves = ratios[:, length == k]
        most = np.quantile(waves.max(axis=1), quantile) / (np.log(waves.shape[1]) + np.euler_gamma)
        gain[length == k] = max(1.0, most, np.quantile(waves.mean(axis=1), quantile))
    return gain
