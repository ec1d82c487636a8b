# SPDX-License-Identifier: MIT
"""Correlation: by how much neighbouring residuals are alike, and covariances of fits hence too small."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.packed_surfaces import gap_to, pack
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled

_BLOCK = 10  # pixels: neighbours within so many have residuals alike
_LEAST_BLOCKS = 8


def residual_correlation(
    surfaces: Sequence[Surface | None],
    observations: Sequence[Observation],
    labels: Sequence[NDArray[np.int32]],
    flatness_m: float,
) -> FloatArray:
    """By how much the residuals' means over blocks vary more than independent ones would, at least 1 (n,).

    Surfaces with too few blocks to tell take what holds for all together.
    """
    n = len(surfaces)
    sums = np.zeros((n, 4))
    for observation, label in zip(observations, labels, strict=True):
        scan = observation.scan
        models = np.array(
            [np.full(9, np.nan) if surface is None else pack(surface, scan.origin) for surface in surfaces]
        ).reshape(n, 9)
        _block_means(
            label, models, scan.ranges, observation.rays, observation.sigma, flatness_m, _BLOCK, sums
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = (sums[:, 0] / sums[:, 1]) / (sums[:, 2] / sums[:, 3])
        total = sums.sum(axis=0)
        together = (total[0] / total[1]) / (total[2] / total[3])
    own = np.where(sums[:, 1] >= _LEAST_BLOCKS, excess, together if total[1] >= _LEAST_BLOCKS else 1.0)
    return np.fmax(own, 1.0)


@compiled
def _block_means(
    labels: NDArray[np.int32],
    models: FloatArray,
    ranges: FloatArray,
    rays: FloatArray,
    sigma: FloatArray,
    flat: float,
    side: int,
    sums: FloatArray,
) -> None:
    """Add up, by label: n * mean^2 of each block's residuals, blocks; squares, pixels."""
    rows, columns = labels.shape
    n = models.shape[0]
    total, count = np.zeros(n), np.zeros(n, np.int64)
    present = np.empty(side * side, np.int64)
    normal = np.zeros(3)
    for top in range(0, rows, side):
        for left in range(top % (2 * side), columns, 2 * side):  # like the dark squares of a chessboard
            n_present = 0
            for i in range(top, min(top + side, rows)):
                for j in range(left, min(left + side, columns)):
                    label = labels[i, j] - 1
                    if label < 0:
                        continue
                    x, y, z = rays[i, j, 0], rays[i, j, 1], rays[i, j, 2]
                    gap, cosine = gap_to(models, label, x, y, z, ranges[i, j], normal)
                    if not cosine > 0.0:
                        continue
                    residual = gap / np.sqrt(sigma[i, j] ** 2 * cosine * cosine + flat * flat + 1e-30)
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
