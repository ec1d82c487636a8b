# SPDX-License-Identifier: MIT
"""The plane: distance, normal, ray hit and its metric chart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scenes.checks import FloatArray, Value, check_direction, check_point, frozen_copy
from scenes.pose import Pose
from scenes.surfaces.surface import cross, reference_direction


@dataclass(frozen=True, slots=True, eq=False)
class Plane(Value):
    """The plane through `point` with unit `normal`; chart origin `point`, u along `u_direction`.

    Parameters
    ----------
    point : (3,) float
        On the plane, metres.
    normal : (3,) float
        To the side it is seen from; made a unit vector, kept as `normal_direction`.
    u_direction : (3,) float, optional
        First chart axis; its part across the normal counts. Any, but always the same, when not given.

    Raises
    ------
    InputError
        Numbers that are not finite, a direction without length, an axis along the normal.

    Examples
    --------
    >>> wall = Plane(point=(4, 0, 0), normal=(-1, 0, 0))
    >>> wall.distance(np.array([[3.0, 7.0, 1.0]])).tolist()
    [1.0]
    """

    point: FloatArray
    normal_direction: FloatArray
    u_direction: FloatArray

    kind: ClassVar[str] = "plane"

    def __init__(self, point: object, normal: object, u_direction: object | None = None) -> None:
        direction = check_direction("normal", normal)
        object.__setattr__(self, "point", frozen_copy(check_point("point", point)))
        object.__setattr__(self, "normal_direction", frozen_copy(direction))
        object.__setattr__(self, "u_direction", frozen_copy(reference_direction(direction, u_direction)))

    @property
    def v_direction(self) -> FloatArray:
        """Unit vector of the second chart axis; (u, v, normal) is right-handed."""
        return cross(self.normal_direction, self.u_direction)

    @property
    def period(self) -> float:
        """A plane's chart never returns: inf."""
        return float("inf")

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,), positive on the normal's side."""
        along: FloatArray = (points - self.point) @ self.normal_direction
        return along

    def normal(self, points: FloatArray) -> FloatArray:
        """The unit normal (n, 3), once for each of the points (n, 3)."""
        return np.broadcast_to(self.normal_direction, points.shape).copy()

    def to_uv(self, points: FloatArray) -> FloatArray:
        """Chart coordinates (n, 2) of the feet of `points`."""
        offset = points - self.point
        return np.stack([offset @ self.u_direction, offset @ self.v_direction], axis=-1)

    def from_uv(self, uv: FloatArray) -> FloatArray:
        """Points (n, 3) of chart coordinates (n, 2)."""
        placed: FloatArray = self.point + uv[..., :1] * self.u_direction + uv[..., 1:] * self.v_direction
        return placed

    def ray_ranges(self, origins: FloatArray, directions: FloatArray) -> FloatArray:
        """Range (n,) along unit `directions`, inf for rays that leave or come from behind."""
        approach = -(directions @ self.normal_direction)
        height = self.distance(origins)
        hit = (approach > 1e-12) & (height >= 0)
        return np.where(hit, height / np.where(hit, approach, 1.0), np.inf)

    def transform(self, pose: Pose) -> Plane:
        """Return the plane moved by `pose`."""
        return Plane(
            pose.apply(self.point), pose.rotate(self.normal_direction), pose.rotate(self.u_direction)
        )

    transformed = transform  # earlier name

    def flip(self) -> Plane:
        """Return the same plane seen from its other side."""
        return Plane(self.point, -self.normal_direction, self.u_direction)

    flipped = flip  # earlier name
