# SPDX-License-Identifier: MIT
"""Parts: the connected parts of a labelled image, and the surface of each."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from skimage.measure import label as connected_parts

from completion.observation import Observation
from completion.segmentation.packed import unpack
from completion.segmentation.regions import SegmentationOptions
from scenes.checks import FloatArray
from scenes.surfaces import Surface


def split_parts(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation, options: SegmentationOptions
) -> tuple[NDArray[np.int32], list[Surface]]:
    """Number the connected parts that are large enough and nowhere only a seam; the surface of each."""
    parts = connected_parts(labels, connectivity=1, background=0).astype(np.int32)
    count, core, model, centre = _part_sums(parts, labels, observation.points, int(parts.max()) + 1)
    kept = (count >= options.min_pixels) & (core > 0)
    kept[0] = False
    order = np.flatnonzero(kept)
    order = order[np.argsort(-count[order], kind="stable")][: options.max_regions]
    number = np.zeros(len(count), np.int32)
    number[order] = np.arange(1, len(order) + 1)
    surfaces = [unpack(models[model[part] - 1], centre[part], observation.scan.origin) for part in order]
    return number[parts], surfaces


@njit(cache=True, nogil=True, error_model="numpy")
def _part_sums(
    parts: NDArray[np.int64], labels: NDArray[np.int32], points: FloatArray, n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Of each part: pixels, whether a pixel has it all around, its label, and the mean of every 8th point."""
    count, core = np.zeros(n, np.int64), np.zeros(n, np.int64)
    model, sampled, centre = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3))
    rows, columns = parts.shape
    for i in range(rows):
        for j in range(columns):
            part = parts[i, j]
            if part == 0:
                continue
            count[part] += 1
            model[part] = labels[i, j]
            if count[part] % 8 == 1:
                for k in range(3):
                    centre[part, k] += points[i, j, k]
                sampled[part] += 1
            if core[part] == 0 and 0 < i < rows - 1 and 0 < j < columns - 1:
                whole = True
                for k in range(i - 1, i + 2):
                    if parts[k, j - 1] != part or parts[k, j] != part or parts[k, j + 1] != part:
                        whole = False
                        break
                core[part] += whole
    for part in range(n):
        centre[part] /= max(sampled[part], 1)
    return count, core, model, centre
