# SPDX-License-Identifier: MIT
"""Rigid motions: `world_from_sensor` takes sensor coordinates to world coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used

from scenes.checks import (
    FloatArray,
    InputError,
    Value,
    check_direction,
    check_places,
    check_point,
    frozen_copy,
)
from scenes.limits import ORTHONORMAL_TOLERANCE, UNIT_TOLERANCE

_UP, _STEEP = np.array([0.0, 0.0, 1.0]), 1e-6  # of a sensor, and sines of angles to it that count as none
_ROUNDING = 1e-12  # of a rotation


def rotation_of(quaternion: object, what: str) -> FloatArray:
    """Return the rotation (3, 3) of a quaternion (4,) x, y, z, w, whose length is 1 to a tenth.

    `what` says whose it is. Raises InputError: not four finite numbers, or of another length.

    Examples
    --------
    >>> rotation_of([0.0, 0.0, 1.0, 0.0], "pose 1").round().astype(int).tolist()
    [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]
    """
    parts = np.asarray(quaternion, dtype=np.float64)
    length = float(np.linalg.norm(parts)) if parts.shape == (4,) else np.nan
    if not abs(length - 1) < UNIT_TOLERANCE:
        raise InputError(
            f"{what} has the quaternion {parts.tolist()} of length {length:.3g}, which is no rotation"
        )
    return np.asarray(scipy.spatial.transform.Rotation.from_quat(parts).as_matrix(), dtype=np.float64)


def stated_rotation(quaternion: object, what: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the rotation (3, 3) of a quaternion x y z w in a file, upright with a warning where all are 0.

    Raises InputError: as `rotation_of`.
    """
    if np.asarray(quaternion, dtype=np.float64).any():
        return rotation_of(quaternion, what), ()
    doubt = f"{what} has the quaternion 0, 0, 0, 0, which is no rotation: it was taken as upright"
    return np.eye(3), (doubt,)


def quaternion_of(rotation: FloatArray) -> list[float]:
    """Return the quaternion x, y, z, w of a rotation (3, 3), of length 1."""
    return [float(part) for part in scipy.spatial.transform.Rotation.from_matrix(rotation).as_quat()]


def _scale_of(rotation: FloatArray) -> str:
    """Say how a matrix that is no rotation is scaled or sheared."""
    if not np.isfinite(rotation).all():
        return ""
    scales = np.linalg.svd(rotation, compute_uv=False)
    if scales[0] - scales[2] <= 1e-3 * scales[0]:
        return f": it is scaled by {scales[1]:.6g}; divide its rotation by that"
    return (
        f": it is scaled by {scales[2]:.4g} to {scales[0]:.4g} along its axes; remove scale and shear first"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Pose(Value):
    """A rigid motion as a 4x4 matrix, here always `world_from_sensor`.

    The sensor frame is x right, y down, z forward; the world is right-handed with z up. Metres.

    Parameters
    ----------
    matrix : (4, 4) float
        Last row 0 0 0 1; the upper left 3x3 orthonormal to 1e-5 with determinant +1. It is
        projected to the nearest rotation, so that chains of poses do not drift.

    Raises
    ------
    InputError
        Wrong shape, not finite or beyond any place, not rigid (scaled, sheared) or left-handed.

    Examples
    --------
    >>> pose = Pose.looking_at((0, 0, 1), (5, 0, 1))
    >>> pose.apply(np.array([[0.0, 0.0, 5.0]])).round(6).tolist()
    [[5.0, 0.0, 1.0]]
    >>> bool(np.allclose((pose @ pose.inverse()).matrix, np.eye(4)))
    True
    """

    matrix: FloatArray

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, dtype=np.float64)
        if matrix.shape != (4, 4):
            raise InputError(f"expected a pose with shape (4, 4), got {matrix.shape}")
        if not np.isfinite(matrix).all():
            raise InputError("pose has entries that are not finite")
        if not np.allclose(matrix[3], [0, 0, 0, 1], atol=ORTHONORMAL_TOLERANCE):
            raise InputError(
                f"last row of a pose must be 0 0 0 1, got {matrix[3].tolist()}; is it transposed?"
            )
        check_places("poses", matrix[:3, 3][None])
        rotation = matrix[:3, :3]
        with np.errstate(over="ignore", invalid="ignore"):
            error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
        if not error <= ORTHONORMAL_TOLERANCE:
            raise InputError(f"pose is not rigid: |R'R - 1| = {error:.3g}{_scale_of(rotation)}")
        if np.linalg.det(rotation) < 0:
            raise InputError("pose is left-handed (determinant -1); it mirrors the scene")
        if error > _ROUNDING:
            u, _, vt = np.linalg.svd(rotation)
            matrix[:3, :3] = u @ vt
        matrix[3] = [0, 0, 0, 1]
        object.__setattr__(self, "matrix", frozen_copy(matrix))

    @classmethod
    def identity(cls) -> Pose:
        """Return the pose that moves nothing."""
        return cls(np.eye(4))

    @classmethod
    def from_parts(cls, rotation: FloatArray, translation: FloatArray) -> Pose:
        """Return the pose with this (3, 3) rotation and (3,) translation in metres."""
        shapes = np.shape(rotation), np.shape(translation)
        if shapes != ((3, 3), (3,)):
            raise InputError(
                f"expected a rotation (3, 3) and a translation (3,), got {shapes[0]} and {shapes[1]}"
            )
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = translation
        return cls(matrix)

    @classmethod
    def looking_at(cls, eye: object, target: object, up: object = (0.0, 0.0, 1.0)) -> Pose:
        """Return the sensor pose at `eye` whose z axis meets `target`, image y as far down as can be."""
        position = check_point("eye", eye)
        forward = check_direction("target - eye", check_point("target", target) - position)
        upward = check_direction("up", up)
        right = np.cross(forward, upward)
        if np.linalg.norm(right) < _STEEP:  # looking straight up or down: any right will do, take a fixed one
            right = np.cross(forward, np.eye(3)[int(np.argmin(np.abs(upward)))])
        right /= np.linalg.norm(right)
        return cls.from_parts(np.column_stack([right, np.cross(forward, right), forward]), position)

    @property
    def rotation(self) -> FloatArray:
        """The (3, 3) rotation."""
        return self.matrix[:3, :3]

    @property
    def translation(self) -> FloatArray:
        """The (3,) translation: where the sensor stands, in metres."""
        return self.matrix[:3, 3]

    def __matmul__(self, other: Pose) -> Pose:
        """Chain two poses: (a @ b).apply(x) = a.apply(b.apply(x))."""
        return Pose(self.matrix @ other.matrix)

    def inverse(self) -> Pose:
        """Return the pose that undoes this one."""
        return Pose.from_parts(self.rotation.T, -self.rotation.T @ self.translation)

    def apply(self, points: FloatArray) -> FloatArray:
        """Move points of shape (..., 3), metres."""
        moved = self.rotate(points)
        moved += self.translation
        return moved

    def rotate(self, vectors: FloatArray) -> FloatArray:
        """Turn directions of shape (..., 3)."""
        turned: FloatArray = vectors @ np.ascontiguousarray(self.rotation.T)  # twice as fast as the view
        return turned


def rotations_towards(directions: FloatArray) -> FloatArray:
    """Return the rotations (n, 3, 3) of `Pose.looking_at` along directions (n, 3), all at once, to the bit.

    Examples
    --------
    >>> ways = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    >>> each = [Pose.looking_at((0, 0, 0), way).rotation for way in ways]
    >>> bool((rotations_towards(ways) == np.array(each)).all())
    True
    """
    forward = directions / _lengths(directions)
    right = np.cross(forward, _UP)
    steep = _lengths(right)[:, 0] < _STEEP
    right[steep] = np.cross(forward[steep], np.eye(3)[0])
    right /= _lengths(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=2)
    off = np.abs(axes.transpose(0, 2, 1) @ axes - np.eye(3)).max(axis=(1, 2), initial=0)
    for k in np.flatnonzero(off > _ROUNDING / 2):  # which a pose makes rigid
        axes[k] = Pose.looking_at(np.zeros(3), directions[k]).rotation
    return axes


def _lengths(vectors: FloatArray) -> FloatArray:
    """Lengths (n, 1), each as that of one vector alone is rounded."""
    return np.array([float(np.linalg.norm(vector)) for vector in vectors]).reshape(-1, 1)
