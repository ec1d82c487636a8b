# SPDX-License-Identifier: MIT
"""Glimpse: what a position sees of what is worth seeing, in all directions at once."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ViewEvaluation:
    """What a position sees of the targets, in any direction.

    Attributes
    ----------
    offsets : (n, 3) float
        From the position, metres along the world's axes.
    worth_m2 : (n,) float
        What each is worth from there.
    voxel : (n,) int64
        Voxel of each.
    is_unknown : (n,) bool
        Unknown faces, or badly seen surface.
    side : (n,) int64
        Side 0..5 (+x, +y, +z, -x, -y, -z) by which a ray that meets nothing known leaves the volume; -1 for
        what is known to be there.
    """

    offsets: FloatArray
    worth_m2: FloatArray
    voxel: NDArray[np.int64]
    is_unknown: BoolArray
    side: NDArray[np.int64]

    def some(self, chosen: BoolArray) -> ViewEvaluation:
        """Return those that are chosen (n,)."""
        return ViewEvaluation(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def joined(self, other: ViewEvaluation) -> ViewEvaluation:
        """Return both together."""
        parts = [
            np.concatenate([getattr(self, field.name), getattr(other, field.name)]) for field in fields(self)
        ]
        return ViewEvaluation(*parts)
