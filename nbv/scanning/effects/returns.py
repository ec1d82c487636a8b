# SPDX-License-Identifier: MIT
"""Returns: the rays of one beam merged into echoes, by compiled code."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray
from texture.engine.compiled import compiled

FIRST, STRONGEST, LAST, MEAN = range(4)  # in the order of `nbv.scanning.effects.footprint.Returns`


@compiled
def merge_returns(
    ranges: FloatArray,
    cosine: FloatArray,
    reflectivity: FloatArray,
    which: int,
    resolution: float,
    out: FloatArray,
) -> None:
    """Write range, cosine, reflectivity and ray count of the chosen return of each beam to `out` (4, n)."""
    for beam in range(ranges.shape[0]):
        order = np.argsort(ranges[beam])
        best_light, chosen = -1.0, (np.inf, 0.0, 0.0, 0.0)
        light = reach = slope = white = 0.0
        count = 0
        last = -np.inf
        for k in range(order.size + 1):
            r = ranges[beam, order[k]] if k < order.size else np.inf
            apart = r - last > resolution and which != MEAN
            if count and (apart or r == np.inf):
                better = which == LAST or (which == STRONGEST and light > best_light) or best_light < 0
                if better:
                    best_light = light
                    chosen = (reach / light, slope / light, white / light, float(count))
                light = reach = slope = white = 0.0
                count = 0
            if r == np.inf:
                break
            cos, rho = cosine[beam, order[k]], reflectivity[beam, order[k]]
            weight = max(rho * cos, 1e-12) / (r * r + 1e-12)
            light += weight
            reach += weight * r
            slope += weight * cos
            white += weight * rho
            count += 1
            last = r
        for channel in range(4):
            out[channel, beam] = chosen[channel]
