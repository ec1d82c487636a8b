# SPDX-License-Identifier: MIT
"""Steps: the field of few steps that leaves nothing but ripple of a field of heights."""

from __future__ import annotations

import numpy as np
from scipy import fft

from completion.flattening.ripple import Ripple
from scenes.checks import FloatArray
from texture.engine.compiled import compiled

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
        price = np.stack([_FIRST * np.sqrt(energy) * share * ripple.strength for *_, share in _NEIGHBOURS])
    else:
        field = start
        for step, (a, b, _) in zip(steps, _NEIGHBOURS, strict=True):
            step[:] = np.roll(start, (-a, -b), (0, 1)) - start
        shares = np.array([share for *_, share in _NEIGHBOURS])[:, None, None]
        price = 2 * shares * ripple.strength**2 / (np.abs(steps) + paying)
    off, pulled, limit = np.zeros_like(steps), np.zeros(shape), price / penalty
    for _ in range(turns):
        _pull(steps, off, pulled)
        field = fft.irfft2((seen + penalty * fft.rfft2(pulled)) * solved, s=shape)
        _shrink(field, limit, steps, off)
    return field


@compiled
def _pull(steps: FloatArray, off: FloatArray, pulled: FloatArray) -> None:
    """The transpose of the differences to the neighbours, of steps less what they are off."""
    rows, columns = pulled.shape
    pulled[:] = 0.0
    for k in range(len(_NEIGHBOURS)):
        a, b = _NEIGHBOURS[k][0], _NEIGHBOURS[k][1]
        for i in range(rows):
            other = (i + a) % rows
            for j in range(columns):
                step = steps[k, i, j] - off[k, i, j]
                pulled[i, j] -= step
                pulled[other, (j + b) % columns] += step


@compiled
def _shrink(field: FloatArray, limit: FloatArray, steps: FloatArray, off: FloatArray) -> None:
    """Steps of a field that are worth their price, and by how much the field is off them, added up."""
    rows, columns = field.shape
    for k in range(len(_NEIGHBOURS)):
        a, b = _NEIGHBOURS[k][0], _NEIGHBOURS[k][1]
        for i in range(rows):
            other = (i + a) % rows
            for j in range(columns):
                value = off[k, i, j] + field[other, (j + b) % columns] - field[i, j]
                most = limit[k, i, j]
                off[k, i, j] = min(max(value, -most), most)
                steps[k, i, j] = value - off[k, i, j]
