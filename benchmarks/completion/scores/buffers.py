# SPDX-License-Identifier: MIT
"""Buffers: inferred area and reference points matched within a distance, as building surveys are scored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.completion.truth.samples import Samples
from scenes.checks import BoolArray, FloatArray

BUFFERS_M = (0.01, 0.02, 0.05, 0.1, 0.2)


@dataclass(frozen=True, slots=True)
class BufferScore:
    """How inferred area and reference points agree within a buffer (after Khoshelham et al. 2018).

    Attributes
    ----------
    buffer_m : float
        Distance in metres within which they match.
    completeness : float
        Share of the reference points with inferred area in the buffer; NaN without points.
    correctness : float
        Share of the inferred area with a reference point in the buffer, of all of which anything is known;
        NaN where nothing is.
    accuracy_m : float
        Median distance across the inferred surface of the reference points in the buffer, metres; NaN
        without any.
    """

    buffer_m: float
    completeness: float
    correctness: float
    accuracy_m: float


def score_buffers(
    samples: Samples,
    counted: BoolArray,
    refuted: BoolArray,
    reference: FloatArray,
    buffers_m: Sequence[float] = BUFFERS_M,
) -> tuple[BufferScore, ...]:
    """Match inferred area with reference points within each buffer.

    Parameters
    ----------
    samples : Samples
        Inferred area.
    counted, refuted : (n,) bool
        Samples that count, and those that a beam of another scan goes through.
    reference : (m, 3) float
        Measured points that should have been inferred, metres.
    buffers_m : sequence of float
        Distances in metres.
    """
    to_reference = _nearest(samples.points, reference)[0]
    to_sample, which = _nearest(reference, samples.points)
    found = np.isfinite(to_sample)
    across = np.full(len(reference), np.inf)
    offset = reference[found] - samples.points[which[found]]
    across[found] = np.abs(np.einsum("ij,ij->i", offset, samples.normals[which[found]]))
    scores = []
    for buffer in buffers_m:
        near, matched = counted & (to_reference <= buffer), to_sample <= buffer
        known = float(samples.areas[near | (counted & refuted)].sum())
        scores.append(
            BufferScore(
                float(buffer),
                float(matched.mean()) if len(reference) else float("nan"),
                float(samples.areas[near].sum()) / known if known > 0 else float("nan"),
                float(np.median(across[matched])) if matched.any() else float("nan"),
            )
        )
    return tuple(scores)


def _nearest(points: FloatArray, others: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distance (n,) from each point to the nearest of the others, inf without any, and its number."""
    if not len(points) or not len(others):
        return np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    distance, number = cKDTree(others).query(points)
    return np.asarray(distance, dtype=np.float64), np.asarray(number, dtype=np.int64)
