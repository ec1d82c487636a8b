# SPDX-License-Identifier: MIT
"""The ROS 2 node without ROS: stand-in messages with the fields of the real ones, from simulated scans."""

import importlib.util
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from nbv import PinholeSensor, PlannerOptions, measure_coverage, sample_surface, scan_scene
from nbv.scanning.sensor import View
from scenes import InputError, Pose, Scene
from tests.helpers.data_paths import ROOT

CAMERA = PinholeSensor.from_intrinsics(96, 72, fx=80, fy=80, cx=47.5, cy=35.5, range_m=(0.2, 6.0))


@pytest.fixture(scope="module")
def node():
    spec = importlib.util.spec_from_file_location("ros2_next_view", ROOT / "examples/ros2_next_view.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pose_message(pose):
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat()
    px, py, pz = pose.translation
    return SimpleNamespace(
        position=SimpleNamespace(x=px, y=py, z=pz), orientation=SimpleNamespace(x=x, y=y, z=z, w=w)
    )


def info_message(**changes):
    camera = CAMERA.projection
    k = [camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1]
    return SimpleNamespace(
        **{"width": camera.width, "height": camera.height, "k": k, "d": [0.0] * 5} | changes
    )


def image_message(depth, encoding="32FC1", *, padding=0, big=False):
    number = np.dtype({"32FC1": "f4", "16UC1": "u2"}[encoding]).newbyteorder(">" if big else "<")
    values = depth if encoding == "32FC1" else np.nan_to_num(np.round(depth * 1000))
    rows = np.ascontiguousarray(values.astype(number)).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=99)
    height, width = depth.shape
    return SimpleNamespace(
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=big,
        step=rows.shape[1],
        data=rows.tobytes(),
    )


def photograph(scene, pose):
    """The three messages of a depth camera at a pose."""
    scan = scan_scene(scene, pose, CAMERA, rng=0)
    return image_message(scan.points_in_sensor()[..., 2]), info_message(), pose_message(pose)


@pytest.mark.parametrize(("encoding", "within_m"), [("32FC1", 1e-6), ("16UC1", 0.0005)])
@pytest.mark.parametrize("big", [False, True])
def test_depths_are_read_whatever_their_bytes(node, encoding, within_m, big):
    depth = np.random.default_rng(0).uniform(0.3, 5.0, (6, 5))
    depth[2, 3] = np.nan
    read = node.depth_of(image_message(depth, encoding, padding=3, big=big))
    np.testing.assert_allclose(read, depth, atol=within_m)


def test_what_is_no_depth_image_is_refused(node):
    image = image_message(np.ones((6, 5)))
    image.encoding = "rgb8"
    with pytest.raises(InputError, match="got 'rgb8'"):
        node.depth_of(image)
    image = image_message(np.ones((6, 5)))
    image.data = image.data[:-1]
    with pytest.raises(InputError, match="119 bytes in rows of 20 are not 6 x 5 depths"):
        node.depth_of(image)
    planner = node.NextView(np.array([[0, 0, 0], [1, 1, 1]]))
    with pytest.raises(InputError, match="rectified"):
        planner.sensor_of(info_message(d=[0.1, 0, 0, 0, 0]))
    with pytest.raises(InputError, match=r"the image is \(6, 5\), its camera \(72, 96\)"):
        planner.scan_of(image_message(np.ones((6, 5))), info_message(), pose_message(Pose.identity()))


def test_images_become_scans_in_the_world(node):
    scene = Scene.from_mesh(trimesh.creation.box(bounds=[[0, 0, 0], [6, 5, 2.7]]), mode="room")
    pose = Pose.looking_at((1.0, 1.2, 1.4), (4, 3, 1))
    planner = node.NextView(np.array([[0, 0, 0], [6, 5, 2.7]]), range_m=(0.3, 4.0))
    truth = scan_scene(scene, pose, CAMERA, rng=0)
    image, info, at = photograph(scene, pose)
    scan = planner.scan_of(image, info, at)
    near = truth.points_in_sensor()[..., 2] <= 4.0
    np.testing.assert_array_equal(scan.valid, near)
    np.testing.assert_allclose(scan.points()[near], truth.points()[near], atol=1e-5)
    back = node.pose_of(node.write_pose(pose, pose_message(Pose.identity())))
    np.testing.assert_allclose(back.matrix, pose.matrix, atol=1e-12)


def test_following_the_answers_sees_an_object_from_all_sides(node):
    thing = trimesh.creation.box(extents=(0.6, 0.4, 0.5))
    thing.apply_translation((0, 0, 0.25))
    scene = Scene.from_mesh(thing, mode="object")
    planner = node.NextView(
        scene.mesh.bounds(), around=True, range_m=(0.2, 6.0), options=PlannerOptions(on_floor=False)
    )
    poses = [planner.candidates(CAMERA).pose(0)]
    for _ in range(4):
        decision = planner.take(*photograph(scene, poses[-1]))
        if decision.view is None:
            break
        poses.append(decision.view.pose)
    samples = sample_surface(scene.mesh, 0.05)
    seen = [
        measure_coverage(scene, [View(pose, CAMERA) for pose in poses[:n]], samples=samples).met
        for n in (1, len(poses))
    ]
    assert seen[0] < 0.5 < 0.8 < seen[1]


def test_in_a_room_the_camera_goes_where_space_is_known_to_be_free(node):
    scene = Scene.from_mesh(trimesh.creation.box(bounds=[[0, 0, 0], [6, 5, 2.7]]), mode="room")
    planner = node.NextView(np.array([[0, 0, 0], [6, 5, 2.7]]), range_m=(0.2, 6.0))
    first = Pose.looking_at((1.0, 1.2, 1.4), (4, 3, 1))
    decision = planner.take(*photograph(scene, first))
    assert decision.view.gain_m2 > 1.0
    place = decision.view.pose.translation
    assert planner.state.voxels.is_free(place[None], planner.options.clearance_m)[0]
    before = planner.state.attempts.sum()
    planner.take(*photograph(scene, first))  # not yet where it was sent
    assert planner.state.attempts.sum() == before
    planner.take(*photograph(scene, decision.view.pose))
    assert planner.state.attempts.sum() > before
