# SPDX-License-Identifier: MIT
"""Images: along a row of like doors no pose is claimed that is as good as another, off by a door."""

import numpy as np
import pytest
import trimesh

from completion.registration.hypotheses import find_hypotheses
from completion.registration.motions import inverse
from completion.registration.pipeline import register_scans
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict, shifts_onto_itself, trust_of, with_images
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

CAMERA = PinholeSensor(fov_deg=75, width=320, height=240, max_range_m=12.0)
PERIOD_M = 3.0


def corridor_scan(eye, way, rng):
    """A corridor along x with door frames every three metres, seen along it."""
    room = trimesh.creation.box([40.0, 1.67, 2.95])
    room.apply_translation([0.0, 0.0, 1.475])
    room.invert()
    parts = [room]
    for at in np.arange(-19.0, 19.0, PERIOD_M):
        for side in (-1, 1):
            for shift in (-0.5, 0.5):
                frame = trimesh.creation.box([0.1, 0.08, 2.1])
                frame.apply_translation([at + shift, side * 0.795, 1.05])
                parts.append(frame)
    scene = Scene.from_mesh(trimesh.util.concatenate(parts), mode="room")
    pose = Pose.looking_at(np.array(eye), np.add(eye, way))
    return scan_scene(scene, pose, CAMERA, noise="gaussian-2mm", rng=rng, truth=False)


@pytest.fixture(scope="module")
def corridor():
    """Two scans that share a twentieth: off by one door they share most."""
    return [
        corridor_scan((-2.41, -0.13, 1.5), (1.0, -0.18, 0.03), 1),
        corridor_scan((1.03, -0.48, 1.61), (1.0, 0.03, -0.15), 2),
    ]


def test_a_row_of_like_doors_fits_itself_shifted_by_a_door(corridor):
    shifts = shifts_onto_itself(StationView.of(corridor[0]))
    steps = shifts[:, :, 3] @ corridor[0].world_from_sensor.rotation.T
    assert np.abs(steps[:, 1:]).max() < 0.02
    assert np.abs(np.abs(steps[:, 0]) - PERIOD_M).min() < 0.1
    for shift in shifts:  # with each its inverse
        assert np.abs(shifts - inverse(shift)).max(axis=(1, 2)).min() < 1e-9


def test_a_room_with_furniture_fits_itself_nowhere():
    pose = Pose.looking_at((1.2, 2.9, 1.5), (3.5, 1.0, 0.9))
    scan = scan_scene(builtin_scene("office"), pose, CAMERA, noise="gaussian-2mm", rng=0, truth=False)
    assert shifts_onto_itself(StationView.of(scan)).shape == (0, 3, 4)


@pytest.mark.long
def test_a_pose_along_like_doors_is_not_claimed(corridor):
    a, b = (StationView.of(scan) for scan in corridor)
    hypotheses = find_hypotheses(a, b)
    flagged = with_images(hypotheses, a, b)
    assert flagged[: len(hypotheses)] == hypotheses
    assert any(hypothesis.is_image for hypothesis in flagged)
    assert trust_of(hypotheses) > 0.5
    assert trust_of(flagged) <= 0.5
    assert register_scans(corridor).pairs[0].verdict is not Verdict.REGISTERED


@pytest.mark.long
def test_the_truth_is_among_the_alternatives(corridor):
    (pair,) = register_scans(corridor).pairs
    true = (corridor[0].world_from_sensor.inverse() @ corridor[1].world_from_sensor).matrix[:3]
    assert pair.verdict is Verdict.AMBIGUOUS
    assert min(np.linalg.norm(motion[:, 3] - true[:, 3]) for motion in pair.alternatives) < 0.05


@pytest.mark.long
def test_a_third_scan_of_the_corridor_makes_no_claim_of_images(corridor):
    """What a pair cannot know, groups that are placed by that pair do not know either."""
    third = corridor_scan((-2.2, 0.2, 1.4), (1.0, -0.1, 0.0), 3)
    scans = [*corridor, third]
    registered = register_scans(scans)
    for network in registered.groups:
        first, *others = network.group.poses
        for k in others:
            true = (scans[first].world_from_sensor.inverse() @ scans[k].world_from_sensor).matrix[:3]
            assert np.linalg.norm(network.group.poses[k][:, 3] - true[:, 3]) < 0.1
