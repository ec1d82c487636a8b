# SPDX-License-Identifier: MIT
"""Opening: a window or a door opening in a surface."""

from __future__ import annotations

from dataclasses import dataclass

from scenes.checks import FloatArray, check_points, frozen_copy
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """An opening in a surface that one sees through: a window, a door opening.

    Parameters
    ----------
    surface : int
        Id of the surface it is in.
    outline : (n, 3) float
        Its corners in order, world coordinates, metres.
    """

    surface: int
    outline: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "outline", frozen_copy(check_points("outline", self.outline)))

    def transformed(self, pose: Pose) -> Opening:
        """Return the opening moved by `pose`."""
        return Opening(self.surface, pose.apply(self.outline))
