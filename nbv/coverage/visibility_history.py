# SPDX-License-Identifier: MIT
"""Visibility history: which samples each view sees, and from which view on they meet the requirement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray

NEVER = 1 << 20
"""First view of samples that no view measures as required."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityHistory:
    """What views see of n samples, one after the other.

    What is seen of sample k stands from `start[k]` to `start[k + 1]`, (n + 1,): number (m,) of the view, from
    1 and ascending, 0 for what was scanned before, and cosine (m,) of incidence. `first_met` (n,) is the view
    after which a sample meets the requirement, `NEVER` where none does; `met` the share of the area that
    meets it before the first view and after each.
    """

    start: NDArray[np.int64]
    view: NDArray[np.int64]
    cosine: FloatArray
    first_met: NDArray[np.int64]
    met: tuple[float, ...]

    @classmethod
    def of(
        cls,
        seen: Sequence[tuple[int, NDArray[np.int64], FloatArray]],
        first_met: NDArray[np.int64],
        met: Sequence[float],
    ) -> VisibilityHistory:
        """Return the history of (view, samples seen (m,), their cosines (m,)), in the order of the views."""
        sample = np.concatenate([np.zeros(0, np.int64), *(index for _, index, _ in seen)])
        view = np.concatenate([np.zeros(0, np.int64), *(np.full(len(i), k, np.int64) for k, i, _ in seen)])
        cosine = np.concatenate([np.zeros(0), *(values for _, _, values in seen)])
        order = np.argsort(sample, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(sample, minlength=len(first_met)))])
        return cls(start, view[order], cosine[order], first_met.copy(), tuple(met))
