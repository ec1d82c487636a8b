# SPDX-License-Identifier: MIT
"""What every surface offers, the reference directions of charts, and openings in surfaces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from scenes.checks import FloatArray, InputError, Value, check_direction, check_points, frozen_copy
from scenes.pose import Pose


@runtime_checkable
class Surface(Protocol):
    """What every surface offers. Points (n, 3) and charts (n, 2) in metres; charts are isometric."""

    kind: ClassVar[str]

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed orthogonal distance (n,), positive on the side the normal points to."""

    def normal(self, points: FloatArray) -> FloatArray:
        """Unit normals (n, 3) at the surface points nearest to `points`."""

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2) of the surface points nearest to `points`."""

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """World points (n, 3) of chart coordinates."""

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) to the first hit from the side the normal points to, inf where there is none."""

    def transform(self, pose: Pose) -> Surface:
        """Return the surface moved by `pose`; its chart moves along."""

    @property
    def period(self) -> float:
        """Length after which the first chart coordinate is back at the same point; else inf."""


def perpendicular(direction: FloatArray) -> FloatArray:
    """Return a unit vector (3,) at right angles to `direction`, the same one for the same direction."""
    x, y, z = (float(component) for component in direction)
    smallest = int(np.argmin([abs(x), abs(y), abs(z)]))
    across = ((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[smallest]  # direction x unit vector of that axis
    return np.array(across) / math.hypot(*across)


def reference_direction(axis: FloatArray, wished: object | None) -> FloatArray:
    """Return the unit vector (3,) at right angles to a unit `axis` (3,) that is nearest to `wished`.

    Raises InputError: a wish along the axis, or none that has a direction.
    """
    if wished is None:
        return perpendicular(axis)
    direction = check_direction("the chart's reference direction", wished)
    across = direction - axis * (axis @ direction)
    across = across - axis * (axis @ across)  # twice is enough, also for nearly parallel directions
    length = float(np.linalg.norm(across))
    if length < 1e-9:
        raise InputError(
            "the chart's reference direction is parallel to the normal or axis; give another one"
        )
    return across / length


def cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the vector product (3,) of two vectors (3,), as `np.cross` does in ten times the time."""
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


@dataclass(frozen=True, slots=True, eq=False)
class Opening(Value):
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

    def transform(self, pose: Pose) -> Opening:
        """Return the opening moved by `pose`."""
        return Opening(self.surface, pose.apply(self.outline))

    transformed = transform  # earlier name
