# SPDX-License-Identifier: MIT
"""Models: surfaces in a frame of their own, linearised about where they are; shapes are told by few numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.checks import BoolArray, FloatArray, IntArray

POSE = ("turn_x", "turn_y", "turn_z", "x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """What a shape says of points in its frame.

    Attributes
    ----------
    distance : (n,) float
        Signed distances.
    slope : (n, 3) float
        Their derivatives by place.
    by_shape : (n, s) float
        Their derivatives by the numbers of the shape.
    face : (n,) int
        The face that each is beside, from 1.
    """

    distance: FloatArray
    slope: FloatArray
    by_shape: FloatArray
    face: IntArray


Profile = Callable[[FloatArray, FloatArray], Section]
"""From points (n, 3) in the frame and the numbers of the shape (s,) to distances and derivatives."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A surface somewhere: its parameters are three turns and three shifts in its own frame, and its shape.

    Attributes
    ----------
    profile : callable
        What the shape is.
    turn : (3, 3) float
        Rows: axes of its frame.
    origin : (3,) float
        Of its frame.
    shape : (s,) float
        Its numbers.
    is_free : (6 + s,) bool
        Which parameters may move: not those that do nothing, nor those that are given.
    ties : (6 + s, m) float, optional
        Steps of all parameters by those of the m that move; by default each moves by itself.
    """

    profile: Profile
    turn: FloatArray
    origin: FloatArray
    shape: FloatArray
    is_free: BoolArray
    ties: FloatArray | None = None

    @property
    def basis(self) -> FloatArray:
        """Steps of all parameters (6 + s, m) by those of the m that move."""
        return np.eye(len(self.is_free))[:, self.is_free] if self.ties is None else self.ties

    def local(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in its frame."""
        return np.asarray((points - self.origin) @ self.turn.T)

    def section(self, points: FloatArray) -> Section:
        """Return what its shape says of points (n, 3)."""
        return self.profile(self.local(points), self.shape)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (n,) of points (n, 3)."""
        return self.section(points).distance

    def linearised(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances (n,) of points (n, 3), and their derivatives (n, m) by what moves."""
        local = self.local(points)
        at = self.profile(local, self.shape)
        every = np.hstack([np.cross(local, at.slope), -at.slope, at.by_shape])
        return at.distance, every @ self.basis

    def moved(self, step: FloatArray) -> Model:
        """Return it after a step (m,)."""
        every = self.basis @ step
        turned = Rotation.from_rotvec(every[:3]).as_matrix() @ self.turn
        return replace(
            self, turn=turned, origin=self.origin + every[3:6] @ self.turn, shape=self.shape + every[6:]
        )

    def scaled(self, factor: float, powers: IntArray, centre: FloatArray) -> Model:
        """Return it in units of which `factor` make an old one, about a new origin (3,) in the old unit.

        Numbers of the shape (s,) go with so many powers of the unit.
        """
        moved = (self.origin - centre) * factor
        return replace(self, origin=moved, shape=self.shape * factor ** powers.astype(np.float64))
