# SPDX-License-Identifier: MIT
"""Candidate viewpoints: lattice, sphere, files."""

import numpy as np
import pytest

from nbv.scanning.sensor import PinholeSensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.viewpoints import (
    Candidates,
    load_candidates,
    room_lattice,
    sensor_directions,
    viewing_sphere,
)
from scenes.checks import InputError

BOX = np.array([[-0.1, 0.0, 0.0], [0.1, 0.3, 0.2]])


def test_lattice_keeps_its_clearance_and_its_number():
    room = np.array([[1.0, 2.0, 3.0], [7.0, 7.0, 5.7]])
    lattice = room_lattice(room)
    assert lattice.shape == (11 * 9 * 4, 3)
    assert (lattice.min(axis=0) >= room[0] + 0.3).all()
    assert (lattice.max(axis=0) <= room[1] - 0.3).all()
    assert len(room_lattice(room * 10)) < 700
    assert len(room_lattice(room, heights_m=(9.0,))) == 99  # too high: half the height of the room instead


@pytest.mark.parametrize(
    "sensor", [load_sensor("generic60"), PinholeSensor(40, 80, 40), load_sensor("panorama")]
)
def test_every_pose_of_the_sphere_holds_the_whole_object(sensor):
    candidates = viewing_sphere(BOX, sensor, 50)
    corners = np.stack(np.meshgrid(*BOX.T), axis=-1).reshape(-1, 3)
    assert candidates.n_poses == 50
    for number in range(50):
        pose = candidates.pose(number)
        assert sensor.sees(pose.inverse().apply(corners)).all()
        distance = np.linalg.norm(corners - pose.translation, axis=1)
        assert distance.min() >= sensor.min_range_m
    middle = candidates.positions.mean(axis=0)
    assert np.allclose(middle, BOX.mean(axis=0), atol=0.02)


def test_an_object_beyond_the_range_is_refused():
    with pytest.raises(InputError, match="does not fit into short"):
        viewing_sphere(BOX * 10, PinholeSensor(max_range_m=1.0, name="short"))


def test_poses_are_numbered_position_by_position():
    candidates = Candidates(np.array([[0.0, 0, 0], [5.0, 0, 0]]), np.array([[1.0, 0, 0], [0, 2.0, 0]]))
    pose = candidates.pose(3)
    assert pose.translation.tolist() == [5, 0, 0]
    assert np.allclose(pose.rotation[:, 2], [0, 1, 0])
    assert np.allclose(candidates.rotations()[1], pose.rotation)
    assert candidates.at(np.array([1])).n_poses == 2
    own = Candidates(candidates.positions, candidates.directions[:, None])
    assert own.n_poses == 2
    assert np.allclose(own.pose(1).rotation, own.rotations()[1, 0])


def test_directions_go_all_round_for_a_camera_alone():
    assert sensor_directions(load_sensor("generic60")).shape == (42, 3)
    assert sensor_directions(load_sensor("panorama"), 2).shape == (1, 3)


def test_candidates_are_read_from_a_file(tmp_path):
    file = tmp_path / "c.npz"
    np.savez(file, positions=np.ones((2, 3)), directions=np.eye(3), half_angle_deg=30.0)
    candidates = load_candidates(file)
    assert candidates.n_poses == 6
    assert candidates.half_angle_deg == 30.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"positions": np.ones((2, 3))}, "has no 'directions'; it holds positions"),
        ({"positions": np.ones((2, 2)), "directions": np.eye(3)}, r"positions with shape \(n, 3\)"),
        ({"positions": np.ones((2, 3)), "directions": np.ones((4, 2))}, r"expected directions \(d, 3\)"),
        ({"positions": np.ones((2, 3)), "directions": np.zeros((1, 3))}, "finite and not zero"),
        ({"positions": np.ones((0, 3)), "directions": np.eye(3)}, "holds no candidates"),
        (
            {"positions": np.ones((2, 3)), "directions": np.eye(3), "patch_points": np.eye(3)},
            "belong together",
        ),
        ({"positions": np.ones((2, 3)), "directions": np.eye(3), "half_angle_deg": 95.0}, "got 95"),
        ({"positions": np.ones((2, 3)), "directions": np.eye(3), "half_angle_deg": np.ones(3)}, "c.npz"),
    ],
)
def test_unusable_files_are_refused(tmp_path, content, message):
    file = tmp_path / "c.npz"
    np.savez(file, **content)
    with pytest.raises(InputError, match=message):
        load_candidates(file)


def test_broken_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_candidates(tmp_path / "absent.npz")
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(InputError, match=r"cannot be read as an \.npz file"):
        load_candidates(tmp_path / "broken.npz")
    np.save(tmp_path / "array.npy", np.eye(3))
    with pytest.raises(InputError, match=r"cannot be read as an \.npz file"):
        load_candidates(tmp_path / "array.npy")
