# SPDX-License-Identifier: MIT
"""Alike residuals: by how much those of neighbouring pixels vary together, from means over blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numba import int64
from numpy.typing import NDArray

from completion.observe.observation import Beams
from completion.observe.rays import Noise, Rays, deviation_at, ray_at
from completion.observe.refits.packed_surfaces import gap_to, pack
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled, inlined

_BLOCK = 10  # pixels: neighbours within so many have residuals alike
_LEAST_BLOCKS = 8


def block_sums(surfaces: Sequence[Surface | None], beams: Iterable[Beams], flatness_m: float) -> FloatArray:
    """Return of each surface (n, 4): n * mean^2 of each block's residuals, blocks; squares, pixels.

    The beams of each scan are in the order of its pixels. None has no residuals.
    """
    sums = np.zeros((len(surfaces), 4))
    for beam in beams:
        trim()
        origin = np.array(beam.rays.origin)
        models = np.array(
            [np.full(9, np.nan) if surface is None else pack(surface, origin) for surface in surfaces]
        ).reshape(len(surfaces), 9)
        some = beam.pixel, beam.label, models, beam.ranges, beam.rays, beam.noise
        _add_blocks(*some, flatness_m, _BLOCK, sums)
    return sums


def residual_correlation(sums: FloatArray) -> FloatArray:
    """By how much the residuals' means over blocks vary more than independent ones would, at least 1 (n,).

    From `block_sums` (n, 4). Surfaces with too few blocks to tell take what holds for all together.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = (sums[:, 0] / sums[:, 1]) / (sums[:, 2] / sums[:, 3])
        total = sums.sum(axis=0)
        together = (total[0] / total[1]) / (total[2] / total[3])
    own = np.where(sums[:, 1] >= _LEAST_BLOCKS, excess, together if total[1] >= _LEAST_BLOCKS else 1.0)
    return np.fmax(own, 1.0)


@compiled
def _add_blocks(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    models: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    side: int,
    sums: FloatArray,
) -> None:
    """Add up `block_sums` of some pixels, a band of blocks after the other."""
    columns, n = ranges.shape[1], models.shape[0]
    total, count = np.zeros(n), np.zeros(n, np.int64)
    present, normal = np.empty(side * side, np.int64), np.zeros(3)
    begin = np.empty((columns - 1) // side + 3, np.int64)
    ordered = np.empty(side * columns, np.int64)
    first = int64(0)
    while first < pixels.size:
        band = pixels[first] // columns // side
        last = _sort_band(pixels, labels, first, band, columns, side, begin, ordered)
        for block in range(band % 2, begin.size - 2, 2):  # like the dark squares of a chessboard
            n_present = 0
            for k in ordered[begin[block] : begin[block + 1]]:
                label, i, j = labels[k] - 1, pixels[k] // columns, pixels[k] % columns
                x, y, z = ray_at(rays, i, j)
                gap, cosine = gap_to(models, label, x, y, z, ranges[i, j], normal)
                if not cosine > 0.0:
                    continue
                sigma = deviation_at(noise, ranges[i, j])
                residual = gap / np.sqrt(sigma * sigma * cosine * cosine + flat * flat + 1e-30)
                if count[label] == 0:
                    present[n_present] = label
                    n_present += 1
                count[label] += 1
                total[label] += residual
                sums[label, 2] += residual * residual
                sums[label, 3] += 1.0
            for index in range(n_present):
                label = present[index]
                if 2 * count[label] >= side * side:
                    sums[label, 0] += total[label] * total[label] / count[label]
                    sums[label, 1] += 1.0
                total[label], count[label] = 0.0, 0
        first = last


@inlined
def _sort_band(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    first: int,
    band: int,
    columns: int,
    side: int,
    begin: NDArray[np.int64],
    ordered: NDArray[np.int64],
) -> int:
    """Write which labelled pixels of a band of rows lie in its blocks, and where each block's begin.

    They start at `first` and keep their order. Returned is where the next band starts.
    """
    begin[:] = 0
    last, limit = first, (band + 1) * side * columns
    while last < pixels.size and pixels[last] < limit:
        if labels[last] > 0:
            begin[pixels[last] % columns // side + 2] += 1
        last += 1
    for block in range(2, begin.size):
        begin[block] += begin[block - 1]
    for k in range(first, last):
        if labels[k] > 0:
            block = pixels[k] % columns // side
            ordered[begin[block + 1]] = k
            begin[block + 1] += 1
    return last
