# SPDX-License-Identifier: MIT
"""Inclination: which way is up, and the angle of planes and axes with the horizontal: level, upright."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from scenes.checks import FloatArray, InputError, Value, check_direction, check_number, freeze_arrays
from scenes.pose import Pose

SignedAxis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[SignedAxis, ...] = ("x", "y", "z", "-x", "-y", "-z")

LIMIT_DEG = 10.0
"""Largest angle, degrees, from the horizontal or the vertical of what is called level or upright.

The benchmark counts a normal as right within the same angle. Planes of more than 0.1 m2 in pcl/office1.pcd
and open3d_redwood#1, whose up was estimated, lie within 9.5 deg of level or upright.
"""
LEVEL_COSINE = float(np.cos(np.radians(LIMIT_DEG)))
"""|cosine| between up and the normals of level planes, for many normals at once whose errors are unknown."""


def axis_direction(axis: str) -> FloatArray:
    """Return the unit vector (3,) of an axis like "-y".

    Raises InputError: another one.
    """
    if axis not in AXES:
        raise InputError(f"up must be auto, {', '.join(AXES)}, got {axis!r}")
    sign = -1.0 if axis.startswith("-") else 1.0
    return np.asarray(sign * np.eye(3)["xyz".index(axis[-1])] + 0.0)  # no negative zeros


@dataclass(frozen=True, slots=True, eq=False)
class Up(Value):
    """Which way is up, and how well it is known; nothing is turned by it but drawings.

    Attributes
    ----------
    direction : (3,) float
        Unit vector, world coordinates.
    sd_deg : float
        Its standard deviation, degrees: of its angle in the direction in which it is known worst.
    is_decided : bool
        Whether no direction far from it is nearly as probable.
    is_estimated : bool
        Whether scans showed it; else a person said it, or it is so by convention.

    Raises
    ------
    InputError
        No direction: zero, not finite, not three numbers; a negative deviation.
    """

    direction: FloatArray
    sd_deg: float = 0.0
    is_decided: bool = True
    is_estimated: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "direction", check_direction("up", self.direction))
        check_number("the deviation of up, degrees", self.sd_deg)
        freeze_arrays(self)

    def within(self, world_from_frame: Pose) -> Up:
        """Return the same with its direction in another frame's coordinates."""
        return replace(self, direction=self.direction @ world_from_frame.rotation)

    @classmethod
    def along(cls, axis: SignedAxis) -> Up | None:
        """Return what an axis like "-y" says; None of "auto", which says nothing.

        Raises InputError: another one.
        """
        return None if axis == "auto" else cls(axis_direction(axis))

    @property
    def is_z(self) -> bool:
        """Whether it is exactly z, so that nothing is to be turned."""
        return bool(self.direction[2] == 1.0)

    @property
    def word(self) -> str:
        """What to tell of it where nothing is turned by it but drawings (`describe`)."""
        return self.describe("coordinates stay as they are, roles and drawings go by it")

    def describe(self, consequence: str) -> str:
        """Return what to tell of an estimated direction; "" of what was said, or is decided and z as usual.

        Parameters
        ----------
        consequence : str
            What follows for coordinates, as "coordinates stay as they are".
        """
        if not self.is_estimated or (self.is_decided and self.is_z):
            return ""
        x, y, z = self.direction + 0.0
        sentence = f"({x:.2f}, {y:.2f}, {z:.2f}) in the files' axes, sd {self.sd_deg:.1f} deg"
        if not self.is_decided:
            return (
                f"up is undecided: {sentence}, is taken, but another direction is as probable; "
                f"{consequence}; say it by --up"
            )
        return (
            f"z is not up in the files, as it seems: up is {sentence}; {consequence}; --up z says otherwise"
        )

    @property
    def drawing_from_world(self) -> Pose:
        """The turn that makes it z, for drawings: the shortest, after a half turn about x if it is far."""
        return _turn_to_z(self.direction)

    def to_json(self) -> dict[str, object]:
        """What records hold of it: `up`, `up_sd_deg`, and whether it is decided."""
        return {"up": self.direction.tolist(), "up_sd_deg": self.sd_deg, "up_is_decided": self.is_decided}


def _turn_to_z(up: FloatArray) -> Pose:
    z = np.array([0.0, 0.0, 1.0])
    if up @ z < -0.5:
        half = Pose(np.diag([1.0, -1.0, -1.0, 1.0]))
        return _turn_to_z(half.apply(up[None])[0]) @ half
    axis, cosine = np.cross(up, z), float(up @ z)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return Pose.from_parts(np.eye(3) + skew + skew @ skew / (1 + cosine), np.zeros(3))


@dataclass(frozen=True, slots=True)
class Inclination(Value):
    """Angle of a plane or an axis with the horizontal, and how well it is known.

    Attributes
    ----------
    angle_deg : float
        Degrees, 0 (level) to 90 (upright); NaN of a surface that has neither a normal nor an axis.
    sd_deg : float
        Its standard deviation, degrees.
    """

    angle_deg: float
    sd_deg: float = 0.0

    @classmethod
    def of_plane(
        cls, normal: FloatArray, up: FloatArray, covariance: FloatArray | None = None, up_sd_deg: float = 0.0
    ) -> Inclination:
        """Return that of a plane.

        Parameters
        ----------
        normal, up : (3,) float
            Unit vectors in one frame; their signs do not matter.
        covariance : (3, 3) float, optional
            Of the normal; not finite, or None, where it is unknown.
        up_sd_deg : float
            Standard deviation of `up`, degrees.
        """
        angle = np.arctan2(np.linalg.norm(np.cross(normal, up)), abs(float(normal @ up)))
        return cls(float(np.degrees(angle)), float(np.hypot(_direction_sd_deg(covariance), up_sd_deg)))

    @classmethod
    def of_axis(
        cls, axis: FloatArray, up: FloatArray, covariance: FloatArray | None = None, up_sd_deg: float = 0.0
    ) -> Inclination:
        """Return that of an axis (3,), such as a cylinder's; parameters as of `of_plane`."""
        across = cls.of_plane(axis, up, covariance, up_sd_deg)
        return cls(90.0 - across.angle_deg, across.sd_deg)

    @property
    def limit_deg(self) -> float:
        """`LIMIT_DEG` widened by one standard deviation, degrees; at most to twice as much."""
        return LIMIT_DEG + min(self.sd_deg, LIMIT_DEG)

    @property
    def is_level(self) -> bool:
        """Whether it lies within the limit of the horizontal."""
        return self.angle_deg <= self.limit_deg

    @property
    def is_upright(self) -> bool:
        """Whether it stands within the limit of the vertical."""
        return 90.0 - self.angle_deg <= self.limit_deg


def _direction_sd_deg(covariance: FloatArray | None) -> float:
    """Standard deviation of a direction across itself, where it is greatest, degrees; 0 where unknown."""
    if covariance is None or not np.isfinite(covariance).all():
        return 0.0
    return float(np.degrees(np.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))))
