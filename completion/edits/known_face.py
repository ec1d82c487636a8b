# SPDX-License-Identifier: MIT
"""Known face: a rectangle of a plane that a feature fitted whole has, such as the reveal of a window."""

from __future__ import annotations

from dataclasses import dataclass

from completion.merging.merged_surface import MergedSurface
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class KnownFace:
    """A face whose place and outline are known from the feature that it is of; working frame.

    Attributes
    ----------
    surface : MergedSurface
        The plane, its normal to the side that is free, its chart along the outline with the origin in the
        middle; and what was measured of it, which may be nothing.
    size : (2,) float
        Along u and v, metres.
    feature : int
        Which feature it is of, from 1.
    """

    surface: MergedSurface
    size: FloatArray
    feature: int
