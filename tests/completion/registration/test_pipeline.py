# SPDX-License-Identifier: MIT
"""Registration from any start: rooms whose poses are found, strangers that are not joined, poses checked."""

from dataclasses import replace

import numpy as np
import pytest

from completion.registration.pipeline import check_poses, register_scans
from completion.registration.registered import registration_record
from completion.registration.station_view import unit_of
from completion.registration.verdict import Verdict
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

CAMERA = PinholeSensor(fov_deg=75, width=320, height=240, max_range_m=12.0)
PANORAMA = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=480, height=160
)
EYES = ((1.2, 2.9, 1.5), (2.2, 3.1, 1.4), (3.0, 2.8, 1.6))
TARGETS = ((3.5, 1.0, 0.9), (3.2, 0.8, 0.9), (1.8, 0.6, 0.8))
TURNED = Pose(
    np.array([[0.0, 0.6, 0.8, 7.0], [1.0, 0.0, 0.0, -3.0], [0.0, 0.8, -0.6, 2.0], [0.0, 0.0, 0.0, 1.0]])
)


def scans_of(name, eyes=EYES, targets=TARGETS):
    scene = builtin_scene(name)
    return [
        scan_scene(scene, Pose.looking_at(eye, target), CAMERA, noise="gaussian-2mm", rng=k, truth=False)
        for k, (eye, target) in enumerate(zip(eyes, targets, strict=True))
    ]


@pytest.fixture(scope="module")
def office():
    return scans_of("office")


@pytest.fixture(scope="module")
def level():
    """Two panoramas of the office, of level scanners."""
    scene = builtin_scene("office")
    poses = [Pose.looking_at(eye, (3.5, 1.0, eye[2])) for eye in EYES[:2]]
    return [scan_scene(scene, pose, PANORAMA, noise="gaussian-2mm", rng=k) for k, pose in enumerate(poses)]


@pytest.fixture(scope="module")
def lost(office):
    """The same scans, each in a world of its own."""
    return [scan.with_facts(world_from_sensor=TURNED) for scan in office]


@pytest.fixture(scope="module")
def registered(lost):
    return register_scans(lost, n_threads=1)


def errors_of(poses, scans):
    """Degrees and metres by which poses relative to the first scan are off."""
    errors = []
    for pose, scan in zip(poses, scans, strict=True):
        true = scans[0].world_from_sensor.inverse() @ scan.world_from_sensor
        off = (poses[0].inverse() @ pose).inverse() @ true
        angle = np.arccos(np.clip((np.trace(off.rotation) - 1) / 2, -1, 1))
        errors.append((np.degrees(angle), np.linalg.norm(off.translation)))
    return np.array(errors)


@pytest.mark.long
def test_scans_from_any_start_come_together(office, lost, registered):
    assert len(registered.groups) == 1
    errors = errors_of(registered.world_poses(lost), office)
    assert errors[:, 0].max() < 0.1
    assert errors[:, 1].max() < 0.005
    assert {pair.verdict for pair in registered.pairs} == {Verdict.REGISTERED}
    assert max(pair.violations for pair in registered.pairs) < 0.05


def test_the_truth_lies_within_the_covariance(office, lost, registered):
    poses = registered.world_poses(lost)
    for number in (1, 2):
        true = office[0].world_from_sensor.inverse() @ office[number].world_from_sensor
        held = poses[0].inverse() @ poses[number]
        apart = held.translation - true.translation
        covariance = registered.covariance_of(number)[3:, 3:]
        assert apart @ np.linalg.solve(covariance, apart) < 16.3  # chi-square of three at .001
    np.testing.assert_array_equal(registered.covariance_of(0), np.zeros((6, 6)))


@pytest.mark.long
def test_what_scans_say_of_their_poses_counts_for_nothing(office, registered):
    again = register_scans(office, n_threads=2)
    for pose, two in zip(
        registered.groups[0].group.poses.values(), again.groups[0].group.poses.values(), strict=True
    ):
        np.testing.assert_array_equal(pose, two)


@pytest.mark.long
def test_the_pose_of_a_to_b_is_the_inverse_of_b_to_a(level):
    there, back = register_scans(level), register_scans(level[::-1])
    turned = np.vstack([there.groups[0].group.poses[1], [0, 0, 0, 1]])
    other = np.vstack([back.groups[0].group.poses[1], [0, 0, 0, 1]])
    np.testing.assert_allclose(turned @ other, np.eye(4), atol=2e-3)


@pytest.mark.long
def test_the_order_of_scans_changes_no_pose(lost, registered):
    turned = register_scans([lost[2], lost[0], lost[1]])
    poses = [np.vstack([turned.pose_of(k), [0, 0, 0, 1]]) for k in (1, 2, 0)]
    for number in (1, 2):
        relative = np.linalg.inv(poses[0]) @ poses[number]
        np.testing.assert_allclose(relative[:3], registered.pose_of(number), atol=2e-3)


@pytest.mark.long
def test_a_scan_of_another_room_is_left_by_itself_and_changes_nothing(lost, registered):
    stranger = scans_of("two_occluders", ((0.8, 0.9, 1.5),), ((3.0, 2.5, 0.5),))
    several = register_scans([*lost, *stranger])
    assert list(several.groups[0].group.poses) == [0, 1, 2]
    assert several.group_of(3) is None
    assert several.pose_of(3) is None
    for pose, two in zip(
        several.groups[0].group.poses.values(), registered.groups[0].group.poses.values(), strict=True
    ):
        np.testing.assert_array_equal(pose, two)


def test_right_poses_are_upheld_and_wrong_ones_contradicted(office):
    assert {pair.verdict for pair in check_poses(office).pairs} == {Verdict.REGISTERED}
    shift = np.eye(4)
    shift[:3, 3] = 0.15, 0.1, 0.0
    moved = office[1].with_facts(world_from_sensor=Pose(shift) @ office[1].world_from_sensor)
    pairs = {pair.scans: pair for pair in check_poses([office[0], moved, office[2]]).pairs}
    assert pairs[0, 2].verdict is Verdict.REGISTERED
    assert pairs[0, 1].verdict is Verdict.AMBIGUOUS
    assert pairs[0, 1].violations > 0.05


@pytest.mark.long
def test_what_is_small_is_registered_as_what_is_large(office):
    """The same room a hundredth as large: its poses, their deviations and residuals are a hundredth."""
    small = [
        replace(scan, ranges=scan.ranges / 100, sigma_m=2e-5, world_from_sensor=TURNED) for scan in office[:2]
    ]
    assert unit_of(small) < 0.02 < unit_of(office[:2])
    held = register_scans(small)
    true = office[0].world_from_sensor.inverse() @ office[1].world_from_sensor
    np.testing.assert_allclose(held.pose_of(1)[:, 3], true.translation / 100, atol=1e-4)
    assert 0 < held.pose_deviation(1) < 1e-4
    np.testing.assert_allclose(held.pairs[0].alternatives[0][:, 3], true.translation / 100, atol=1e-4)
    places, offsets = held.residuals_of(held.groups[0])
    assert np.ptp(places, axis=0).max() < 0.1
    assert np.median(np.abs(offsets)) < 1e-4


@pytest.mark.long
def test_level_scanners_need_turns_about_the_vertical_alone(level):
    turn = np.array([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 2.0], [0.0, 0.0, 1.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
    scans = [level[0], level[1].with_facts(world_from_sensor=Pose(turn) @ level[1].world_from_sensor)]
    held = register_scans(scans, upright=True)
    errors = errors_of(held.world_poses(scans), level)
    assert errors[1, 0] < 0.1
    assert errors[1, 1] < 0.005


@pytest.mark.long
def test_a_right_start_is_not_made_worse(level):
    held = register_scans(level, started=True)
    errors = errors_of(held.world_poses(level), level)
    assert errors[1, 1] < 0.003


def test_the_record_says_all(lost, registered):
    record = registration_record(registered, lost, ["a", "b", "c"])
    assert [entry["group"] for entry in record["scans"]] == [0, 0, 0]
    assert np.shape(record["scans"][1]["covariance"]) == (6, 6)
    np.testing.assert_allclose(record["scans"][0]["world_from_sensor"], TURNED.matrix)
    assert [entry["verdict"] for entry in record["pairs"]] == ["registered"] * 3


def test_one_scan_and_no_probability_are_refused(lost):
    with pytest.raises(InputError, match="at least two scans"):
        register_scans(lost[:1])
    with pytest.raises(InputError, match="between 0 and 1"):
        register_scans(lost, level=1.5)
    with pytest.raises(InputError, match="at least two scans"):
        check_poses(lost[:1])


def test_an_empty_scan_has_no_pose(lost):
    empty = replace(lost[1], ranges=np.full(lost[1].shape, np.inf))
    held = register_scans([lost[0], empty])
    assert held.groups == ()
    assert held.pairs[0].verdict is Verdict.NO_OVERLAP
