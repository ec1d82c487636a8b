# SPDX-License-Identifier: MIT
"""Models: surfaces in a frame of their own, of few numbers, linearised about where they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

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


def rotation(vector: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) that turns about a vector (3,) by its length (Rodrigues)."""
    angle = float(np.sqrt(vector @ vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.asarray(np.eye(3) + cross)
    share, rest = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
    return np.asarray(np.eye(3) + share * cross + rest * (cross @ cross))


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
        (x, y, z), (u, v, w) = local.T, at.slope.T
        turned = [y * w - z * v, z * u - x * w, x * v - y * u]
        every = np.vstack([*turned, -u, -v, -w, at.by_shape.T])
        return at.distance, (self.basis.T @ every).T

    def moved(self, step: FloatArray) -> Model:
        """Return it after a step (m,)."""
        every = self.basis @ step
        turned = rotation(every[:3]) @ self.turn
        return replace(
            self, turn=turned, origin=self.origin + every[3:6] @ self.turn, shape=self.shape + every[6:]
        )
