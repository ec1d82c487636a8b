# SPDX-License-Identifier: MIT
"""Steps: the field of few steps that leaves nothing but ripple of a field of heights."""

from __future__ import annotations

import numpy as np
from scipy import fft

from completion.flattening.ripple import Ripple
from scenes.checks import FloatArray

_NEIGHBOURS = ((0, 1, 0.41), (1, 0, 0.41), (1, 1, 0.29), (1, -1, 0.29))
"""Rows and columns to a neighbour, and its share in the length of a border (Cauchy-Crofton)."""
_FIRST = 0.9  # of the root of a step's energy: the first, convex price of a step for each cell of its border


def find_steps(
    heights: FloatArray, ripple: Ripple, start: FloatArray | None = None, turns: int = 20
) -> FloatArray:
    """The field of steps (rows, columns) of heights on a canvas, metres.

    It minimises half the whitened square of what it leaves, and a price of its steps that grows with the
    logarithm of their size, so that it is constant between them: a sum of absolute steps, weighed anew each
    round by 1 / (step + e) (Candes, Wakin & Boyd 2008), where e is the step that pays for its border. Each
    round is solved by alternating directions (Goldstein & Osher 2009), exact in the waves of the canvas.
    """
    shape = heights.shape
    energy = ripple.step_energy()
    paying = np.sqrt(2 / energy) * ripple.strength
    inverse = 1 / ripple.power
    seen = inverse * fft.rfft2(heights)
    rows, columns = fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1])[None]
    both = sum(2 - 2 * np.cos(2 * np.pi * (a * rows + b * columns)) for a, b, _ in _NEIGHBOURS)
    penalty = 0.5 * _FIRST * energy / np.sqrt(2)
    solved = 1 / (inverse + penalty * both + 1e-12 * inverse.max())
    steps = np.zeros((len(_NEIGHBOURS), *shape))
    if start is None:
        field = np.zeros(shape)
        price = [_FIRST * np.sqrt(energy) * share * ripple.strength for *_, share in _NEIGHBOURS]
    else:
        field = start
        steps = np.stack([_difference(start, a, b) for a, b, _ in _NEIGHBOURS])
        price = _prices(steps, paying, ripple.strength)
    off = np.zeros((len(_NEIGHBOURS), *shape))
    for _ in range(turns):
        pulled = sum(_back(steps[k] - off[k], a, b) for k, (a, b, _) in enumerate(_NEIGHBOURS))
        field = fft.irfft2((seen + penalty * fft.rfft2(pulled)) * solved, s=shape)
        for k, (a, b, _) in enumerate(_NEIGHBOURS):
            off[k] += _difference(field, a, b)
            limit = price[k] / penalty
            steps[k] = off[k] - np.clip(off[k], -limit, limit)
            off[k] -= steps[k]
    return field


def _prices(steps: FloatArray, paying: FloatArray, strength: FloatArray) -> list[FloatArray]:
    """The price of a metre of each step, the lower the larger the step was."""
    shares = (share for *_, share in _NEIGHBOURS)
    return [
        2 * share * strength**2 / (np.abs(step) + paying) for step, share in zip(steps, shares, strict=True)
    ]


def _difference(field: FloatArray, rows: int, columns: int) -> FloatArray:
    """To the neighbour that many rows and columns on."""
    return np.roll(field, (-rows, -columns), (0, 1)) - field


def _back(step: FloatArray, rows: int, columns: int) -> FloatArray:
    """The transpose of that."""
    return np.roll(step, (rows, columns), (0, 1)) - step
