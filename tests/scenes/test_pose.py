# SPDX-License-Identifier: MIT
"""Poses form a group of rigid motions, and what is not rigid is refused."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import assume, given

from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from tests.helpers.strategies import EPS, ROUNDING_M, directions, law, poses, seeds, vectors


def assert_same_pose(first: Pose, second: Pose) -> None:
    np.testing.assert_allclose(first.matrix, second.matrix, atol=ROUNDING_M, rtol=0)


def draw_points(seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(-10, 10, (2, 5, 3))


@law
@given(poses(), poses(), poses())
def test_poses_are_a_group(a: Pose, b: Pose, c: Pose) -> None:
    assert_same_pose((a @ b) @ c, a @ (b @ c))
    assert_same_pose(a @ Pose.identity(), a)
    assert_same_pose(Pose.identity() @ a, a)
    assert_same_pose(a @ a.inverse(), Pose.identity())
    assert_same_pose(a.inverse() @ a, Pose.identity())
    assert_same_pose((a @ b).inverse(), b.inverse() @ a.inverse())


@law
@given(poses(), poses(), seeds)
def test_a_chain_applies_its_last_pose_first(a: Pose, b: Pose, seed: int) -> None:
    points = draw_points(seed)
    np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=ROUNDING_M, rtol=0)
    np.testing.assert_allclose((a @ b).rotate(points), a.rotate(b.rotate(points)), atol=ROUNDING_M, rtol=0)
    np.testing.assert_allclose(a.inverse().apply(a.apply(points)), points, atol=ROUNDING_M, rtol=0)


@law
@given(poses(), seeds)
def test_a_pose_agrees_with_homogeneous_coordinates(pose: Pose, seed: int) -> None:
    points = draw_points(seed)
    homogeneous = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    by_matrix = np.einsum("ij,...j->...i", pose.matrix, homogeneous)[..., :3]
    np.testing.assert_allclose(pose.apply(points), by_matrix, atol=ROUNDING_M, rtol=0)
    np.testing.assert_allclose(
        pose.rotate(points), pose.apply(points) - pose.translation, atol=ROUNDING_M, rtol=0
    )


@law
@given(poses(), seeds)
def test_distances_and_handedness_are_preserved(pose: Pose, seed: int) -> None:
    first, second = draw_points(seed)
    moved = np.linalg.norm(pose.apply(first) - pose.apply(second), axis=-1)
    np.testing.assert_allclose(moved, np.linalg.norm(first - second, axis=-1), atol=ROUNDING_M, rtol=0)
    turned = np.cross(pose.rotate(first), pose.rotate(second))
    np.testing.assert_allclose(turned, pose.rotate(np.cross(first, second)), atol=100 * ROUNDING_M, rtol=0)


@law
@given(vectors, vectors, directions)
def test_looking_at_meets_its_target_with_the_image_upright(
    eye: FloatArray, target: FloatArray, up: FloatArray
) -> None:
    distance = float(np.linalg.norm(target - eye))
    assume(distance > 0.1)
    forward, up = (target - eye) / distance, up / np.linalg.norm(up)
    slant = float(np.linalg.norm(np.cross(forward, up)))
    assume(slant > 1e-3)
    pose = Pose.looking_at(eye, target, up)
    tolerance = 1e4 * EPS  # the image's x axis is a cross product no shorter than 1e-3
    np.testing.assert_allclose(pose.apply(np.array([0, 0, distance])), target, atol=50 * tolerance, rtol=0)
    np.testing.assert_allclose(pose.translation, eye, atol=0, rtol=0)
    right, down, _ = pose.rotation.T
    assert abs(right @ up) < tolerance
    assert abs(down @ up + slant) < tolerance  # no direction across the view lies lower than -slant


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 1, 1), (-1, 2, 5)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("tilt", [0.0, 1e-9])
def test_looking_straight_along_up_has_a_fixed_image(
    up: tuple[float, float, float], sign: float, tilt: float
) -> None:
    eye, target = np.array([1.0, 2.0, 3.0]), np.array([1.0 + tilt, 2.0, 3.0]) + sign * np.array(up)
    pose = Pose.looking_at(eye, target, up)
    distance = np.linalg.norm(target - eye)
    np.testing.assert_allclose(pose.apply(np.array([0, 0, distance])), target, atol=1e-14, rtol=0)
    upright = Pose.looking_at(eye, eye + sign * np.array(up), up)
    np.testing.assert_allclose(pose.matrix, upright.matrix, atol=1e-8, rtol=0)


def test_looking_at_refuses_what_gives_no_direction() -> None:
    with pytest.raises(InputError, match=r"target - eye has length 0\.0"):
        Pose.looking_at((1, 2, 3), (1, 2, 3))
    with pytest.raises(InputError, match=r"up has length 0\.0"):
        Pose.looking_at((1, 2, 3), (1, 2, 4), up=(0, 0, 0))
    with pytest.raises(InputError, match=r"expected eye with shape \(3,\), got \(2,\)"):
        Pose.looking_at((1, 2), (1, 2, 4))
    with pytest.raises(InputError, match=r"target is \[nan, 2.0, 4.0\]"):
        Pose.looking_at((1, 2, 3), (np.nan, 2, 4))


def test_from_parts_checks_both_shapes() -> None:
    with pytest.raises(InputError, match=r"got \(3, 3\) and \(1, 3\)"):
        Pose.from_parts(np.eye(3), np.zeros((1, 3)))
    with pytest.raises(InputError, match=r"got \(3,\) and \(3,\)"):
        Pose.from_parts(np.ones(3), np.zeros(3))


def changed(index: object, value: object) -> FloatArray:
    matrix = Pose.looking_at((1, 2, 3), (4, 4, 3.5)).matrix.copy()
    matrix[index] = value  # type: ignore[index]
    return matrix


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), r"expected a pose with shape \(4, 4\), got \(3, 3\)"),
        (np.eye(4)[None], r"got \(1, 4, 4\)"),
        (changed((0, 3), np.nan), "entries that are not finite"),
        (changed((2, 2), np.inf), "entries that are not finite"),
        (changed(slice(None), Pose.looking_at((1, 2, 3), (4, 4, 3.5)).matrix.T), "is it transposed?"),
        (changed((3, 3), 2.0), "last row of a pose must be 0 0 0 1"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), r"not rigid: \|R'R - 1\| = 3: it is scaled by 2; divide"),
        (np.diag([1.0, 1.0, 1.0 + 1e-4, 1.0]), "not rigid"),
        (np.eye(4) + np.outer([1, 0, 0, 0], [0, 1e-4, 0, 0]), "not rigid"),
        (np.zeros((4, 4)) + np.diag([0, 0, 0, 1.0]), "not rigid"),
        (np.diag([1.0, -1.0, 1.0, 1.0]), "left-handed"),
        (np.eye(4)[[1, 0, 2, 3]], "left-handed"),
    ],
)
def test_what_is_not_rigid_is_refused(matrix: FloatArray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Pose(matrix)


@law
@given(poses(), seeds)
def test_rotations_rounded_in_files_are_made_rigid(pose: Pose, seed: int) -> None:
    rounded = pose.matrix + np.random.default_rng(seed).uniform(-1e-6, 1e-6, (4, 4)) * (np.arange(4) < 3)
    rounded[3] = pose.matrix[3]
    mended = Pose(rounded)
    product = mended.rotation.T @ mended.rotation
    np.testing.assert_allclose(product, np.eye(3), atol=16 * EPS, rtol=0)
    np.testing.assert_allclose(mended.matrix, pose.matrix, atol=4e-6, rtol=0)


def test_a_long_chain_stays_rigid() -> None:
    step = Pose.looking_at((0.1, 0.2, 0.3), (0.5, 0.7, 0.4))
    chain = Pose.identity()
    for _ in range(2000):
        chain = chain @ step
    np.testing.assert_allclose(chain.rotation.T @ chain.rotation, np.eye(3), atol=1e-11, rtol=0)


def test_a_pose_is_frozen_and_its_arrays_read_only() -> None:
    matrix = np.eye(4)
    pose = Pose(matrix)
    matrix[0, 3] = 5.0
    assert pose.translation.tolist() == [0, 0, 0]
    for array in (pose.matrix, pose.rotation, pose.translation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        pose.matrix = matrix  # type: ignore[misc]
