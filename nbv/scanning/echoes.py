# SPDX-License-Identifier: MIT
"""Echoes: what comes back along beams with width, before an instrument has erred about it.

What the rays of a beam meet, sorted by range, falls apart where two neighbours are farther from each other
than the range resolution. Each part is one echo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import Footprint, Intensity, Returns, sub_rays
from nbv.scanning.world import BYTES_A_RAY, World
from scenes.checks import FloatArray, IntArray
from scenes.run.memory import in_blocks
from texture.engine.compiled import compiled, inlined

_RAYS = 32_768  # at a time: what is known of them fits into a core's cache
FIRST, STRONGEST, LAST, MEAN, ALL = range(5)  # in the order of `nbv.scanning.beam.Returns`


@dataclass(frozen=True, slots=True, eq=False)
class Echo:
    """Echoes of n beams, (n,) each; a beam without one has range inf and cosine 0.

    Ranges are metres, `cosine` is |cosine| of incidence, the mean over the footprint where there is one, and
    `incidence` its angle in radians. `reflectivity` is the share of light that the surface scatters, `n_rays`
    how many rays of the beam the echo is made of.
    """

    ranges: FloatArray
    cosine: FloatArray
    incidence: FloatArray
    reflectivity: FloatArray | float
    n_rays: NDArray[np.uint8]

    @classmethod
    def of(cls, channels: FloatArray) -> Echo:
        """Return the echoes of range, cosine, reflectivity and number of rays (4, n)."""
        ranges, cosine, reflectivity, count = channels
        return cls(ranges, cosine, np.arccos(np.minimum(cosine, 1.0)), reflectivity, count.astype(np.uint8))


def footprint_echoes(
    world: World,
    beams: tuple[FloatArray, FloatArray],
    footprint: Footprint,
    intensity: Intensity,
    rng: np.random.Generator,
) -> tuple[Echo, IntArray, Echo]:
    """Return the echoes of beams: their origins (n, 3) or (1, 3) and unit directions (n, 3), world frame.

    One uniform number is drawn for every beam: the rotation of its pattern of rays.

    Returns
    -------
    tuple of Echo, (m,) int, Echo
        The reported echo of each of n beams (its first if all echoes are reported); the beam of each of the
        m further echoes, ascending; the further echoes, near to far within a beam.
    """
    (origins, directions), which = beams, get_args(Returns).index(footprint.returns)
    n, n_rays = len(directions), footprint.n_rays_cast
    out, turns = np.empty((4, n)), 2 * np.pi * rng.random(n)
    chunk = max(_RAYS // n_rays, 1)
    further = [np.empty((5, 0))] * -(-n // chunk)

    def look(part: slice) -> None:
        starts, along = sub_rays(directions[part], footprint, turns[part])
        starts += origins if len(origins) == 1 else np.repeat(origins[part], n_rays, axis=0)
        hits, seen = world.cast(starts, along)
        rho = world.reflectivity(hits, intensity)
        ranges, cosine = hits.ranges, hits.incidence_cosine
        if world.partner is not None:
            ranges = np.where(seen, ranges, np.inf)
        ranges, cosine, rho = (array.reshape(-1, n_rays) for array in (ranges, cosine, rho))
        merged = np.empty((4, len(ranges)))
        more = np.empty((5, ranges.size if which == ALL else 0))
        n_more = merge_returns(ranges, cosine, rho, which, footprint.range_resolution_m, merged, more)
        out[:, part] = merged
        if n_more:
            further[part.start // chunk] = more[:, :n_more] + [[part.start], [0], [0], [0], [0]]

    in_blocks(n, look, world.n_threads, block=chunk, bytes_a_block=BYTES_A_RAY * _RAYS)
    beam, *channels = np.concatenate(further, axis=1)
    return Echo.of(out), beam.astype(np.int64), Echo.of(np.array(channels))


@inlined
def _sort(ranges: FloatArray, order: IntArray) -> None:
    """Write the order (n,) of ascending ranges (n,), by insertion: they are few."""
    for k in range(ranges.size):
        place = k
        while place > 0 and ranges[order[place - 1]] > ranges[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k


@compiled
def merge_returns(
    ranges: FloatArray,
    cosine: FloatArray,
    reflectivity: FloatArray,
    which: int,
    resolution: float,
    out: FloatArray,
    more: FloatArray,
) -> int:
    """Write range, cosine, reflectivity and ray count of the chosen return of each beam to `out` (4, n).

    Of all returns the first is chosen; the others of a beam go to `more` (5, m), the beam before the same
    four. Return how many these are.
    """
    n_more, order = 0, np.empty(ranges.shape[1], np.int64)
    for beam in range(ranges.shape[0]):
        _sort(ranges[beam], order)
        best_light, chosen = -1.0, (np.inf, 0.0, 0.0, 0.0)
        light = reach = slope = white = 0.0
        count = 0
        last = -np.inf
        for k in range(order.size + 1):
            r = ranges[beam, order[k]] if k < order.size else np.inf
            apart = r - last > resolution and which != MEAN
            if count and (apart or r == np.inf):
                found = (reach / light, slope / light, white / light, float(count))
                if which == LAST or (which == STRONGEST and light > best_light) or best_light < 0:
                    best_light, chosen = light, found
                elif which == ALL:
                    more[0, n_more] = beam
                    for channel in range(4):
                        more[channel + 1, n_more] = found[channel]
                    n_more += 1
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
    return n_more
