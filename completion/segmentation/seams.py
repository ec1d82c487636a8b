# SPDX-License-Identifier: MIT
"""Seams: the measured places at which pieces of a scan touch."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.pixel_set import PixelSet
from scenes.checks import FloatArray

_WIDTH = 4  # pixels that lie between two pieces that touch at most
_LEAST_CONTACT = 8  # pairs of pixels by which pieces touch


def find_seams(pixels: Sequence[PixelSet], observation: Observation) -> dict[tuple[int, int], FloatArray]:
    """Return the measured points (n, 3) at which each two pieces, by their indices, touch or nearly so."""
    rows, columns = observation.scan.shape
    labels = np.zeros((rows, columns), np.int32)
    for k, own in enumerate(pixels, start=1):
        labels.ravel()[own.flat] = k
    away, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    label_of = np.zeros(int(nearest.max()) + 1, np.int32)
    label_of[nearest[labels > 0]] = labels[labels > 0]
    grown = np.where(away <= (_WIDTH + 1) / 2, label_of[nearest], 0)
    flat = np.arange(rows * columns).reshape(rows, columns)
    below, right = (slice(1, None), slice(None)), (slice(None), slice(1, None))
    keys, places = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for here, there in (((slice(-1), slice(None)), below), ((slice(None), slice(-1)), right)):
        first, second = grown[here], grown[there]
        at = (first != second) & (first > 0) & (second > 0)
        one, other = first[at].astype(np.int64), second[at].astype(np.int64)
        keys.append((np.minimum(one, other) - 1) * len(pixels) + np.maximum(one, other) - 1)
        places.append(flat[here][at])
    return _by_pair(np.concatenate(keys), np.concatenate(places), len(pixels), observation)


def _by_pair(
    key: NDArray[np.int64], place: NDArray[np.int64], n: int, observation: Observation
) -> dict[tuple[int, int], FloatArray]:
    """The points of the pixels `place` (n,) whose keys, first * n + second, are those of one pair."""
    order = np.lexsort([place, key])
    key, place = key[order], place[order]
    numbers, starts = np.unique(key, return_index=True)
    if not len(numbers):
        return {}
    found = {}
    for number, some in zip(numbers.tolist(), np.split(place, starts[1:]), strict=True):
        if len(some) >= _LEAST_CONTACT:
            some = some[observation.valid.ravel()[some]]
            found[divmod(number, n)] = observation.points_at(some)
    return found
