# SPDX-License-Identifier: MIT
"""Adjustment: planes that scans share, estimated with the poses, and kept where both answers agree."""

import numpy as np
import pytest

from completion.registration.motions import compose, inverse, perturb
from completion.registration.network import ScanGroup, _if_alike, adjust_poses, settle_group
from completion.registration.refinement import links_of
from completion.registration.station_view import PlaneSums, StationView
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

CAMERA = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=480, height=160
)
EYES = ((1.2, 2.9, 1.5), (2.2, 3.1, 1.4), (3.0, 2.8, 1.6), (2.0, 2.0, 1.3))
GATE_M = 0.05


@pytest.fixture(scope="module")
def office():
    """Four stations with 5 mm of noise, as registration sees them, and their true poses to the first."""
    scene = builtin_scene("office")
    scans = [
        scan_scene(
            scene, Pose.looking_at(eye, (3.5, 1.0, eye[2])), CAMERA, noise="gaussian-5mm", rng=k, truth=False
        )
        for k, eye in enumerate(EYES)
    ]
    first = scans[0].world_from_sensor.inverse()
    return [StationView.of(scan) for scan in scans], [
        (first @ scan.world_from_sensor).matrix[:3] for scan in scans
    ]


def errors_of(poses, true):
    return np.array([np.linalg.norm(pose[:, 3] - two[:, 3]) for pose, two in zip(poses, true, strict=True)])


def test_sums_tell_the_misfit_of_their_pixels(office):
    """A plane fits the pixels that its sums are of: the least eigenvalue is that of noise."""
    planes = office[0][0].planes
    assert isinstance(planes, PlaneSums)
    for normal, height, scatter in zip(planes.normals, planes.heights, planes.scatter, strict=True):
        plane = np.append(normal, -height)
        assert plane @ scatter @ plane < 20 * scatter[3, 3] * 0.005**2
        np.testing.assert_allclose(scatter, scatter.T)


def test_planes_bring_poses_nearer_to_the_truth(office):
    views, true = office
    start = ScanGroup(
        {k: perturb(pose, np.full(6, 0.004 * (k > 0)), pose[:, 3]) for k, pose in enumerate(true)}
    )
    safe = settle_group(start, views)
    better = settle_group(start, views, by_planes=True)
    off, less = (errors_of([network.group.poses[k] for k in range(4)], true) for network in (safe, better))
    assert np.square(less).sum() < np.square(off).sum()
    np.testing.assert_array_equal(better.covariance, safe.covariance)
    np.testing.assert_allclose(better.group.poses[0], np.eye(4)[:3], atol=1e-14)


def test_the_frame_of_the_group_changes_nothing(office):
    """The group's frame is that of its first scan wherever that stands."""
    views, true = office
    turned = np.array([[0.0, 0.6, 0.8, 7.0], [1.0, 0.0, 0.0, -3.0], [0.0, 0.8, -0.6, 2.0]])
    links = links_of(range(4), true, views, GATE_M)
    poses = adjust_poses(true, views, links)
    away = [compose(turned, pose) for pose in true]
    again = adjust_poses(away, views, links_of(range(4), away, views, GATE_M))
    for pose, two in zip(poses, again, strict=True):
        np.testing.assert_allclose(compose(inverse(turned), two), pose, atol=1e-6)


def test_poses_that_suppose_more_are_kept_only_where_chance_explains_the_difference():
    still, near, far = np.eye(4)[:3], np.eye(4)[:3].copy(), np.eye(4)[:3].copy()
    near[0, 3], far[0, 3] = 0.001, 0.01
    matrix = np.eye(12) / 0.002**2
    assert _if_alike([still, near], [still, still], matrix)[1] is near
    assert _if_alike([still, far], [still, still], matrix)[1] is still
