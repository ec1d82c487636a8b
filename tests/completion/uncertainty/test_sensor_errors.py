# SPDX-License-Identifier: MIT
"""Sensors' systematic errors do to fits what moving the points does, and nothing where unknown."""

from dataclasses import replace

import numpy as np
import pytest

from completion.fitting.euclidean import fit_plane
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import PixelSet, ScanPixels, observe
from completion.observe.range_noise import RangeNoise
from completion.observe.sensor_modes import displacements
from completion.uncertainty.pipeline import shift_by_sensors
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

HERE = Pose.identity()
CAMERA = PinholeProjection.from_fov(64, 48, 60)
SCANNER = SphericalProjection.regular(72, 40, 60.0, (-30.0, 30.0))
KINECT = RangeNoise(0.001, 1e-3, farthest_m=4.0)
WALL = Plane(np.array([0.0, 0, 3.0]), np.array([0.3, -0.1, -1.0]))


def wall_seen(projection, noise, pose=HERE):
    """A wall before a sensor: the surface, and the observation with this noise."""
    rays = projection.directions()
    ranges = WALL.ray_ranges(np.zeros(3), rays.reshape(-1, 3)).reshape(projection.shape)
    seen = observe(RangeImage(ranges, projection, pose, sigma_m=0.001), Pose.identity())
    seen = replace(seen, noise=noise)
    fit = fit_plane(seen.scan.points().reshape(-1, 3), pose.translation)
    held = PixelSet.of(np.ones(projection.shape, dtype=np.bool_))
    return MergedSurface(fit, ScanPixels.of([held]), 1), seen


def stated_by(merged, observations):
    """The deviations of a surface's parameters with its sensors' errors."""
    shift = shift_by_sensors(merged, observations)
    return replace(merged.fit, covariance=merged.fit.covariance + shift @ shift.T).parameter_deviations()


@pytest.mark.parametrize(
    ("projection", "noise", "n_modes"), [(CAMERA, KINECT, 7), (SCANNER, RangeNoise(0.002, 0.0), 3)]
)
def test_the_covariance_is_what_moving_the_points_does(projection, noise, n_modes):
    merged, seen = wall_seen(projection, noise)
    pixels = np.arange(projection.shape[0] * projection.shape[1])
    points = seen.points_at(pixels)
    moves = displacements(seen, points)
    assert np.count_nonzero(np.abs(moves).max(axis=(1, 2))) == n_modes
    weight = 1 / np.square(seen.sigma_at(pixels))
    gradient = merged.fit.gradient(points)
    wanted = np.zeros((3, 3))
    for move in 1e-3 * moves:  # small, so that all is linear
        height = merged.fit.surface.distance(points + move)
        shift = np.linalg.lstsq(gradient * np.sqrt(weight)[:, None], height * np.sqrt(weight), rcond=None)[0]
        wanted += np.outer(shift, shift) * 1e6
    shift = shift_by_sensors(merged, [seen])
    added = shift @ shift.T
    np.testing.assert_allclose(added, wanted, rtol=0.05, atol=0.01 * np.abs(wanted).max())


def test_a_camera_bends_by_its_bias_and_scanners_turn_by_hundredths_of_a_degree():
    camera, seen = wall_seen(CAMERA, KINECT)
    stated = stated_by(camera, [seen])
    assert 0.04 < np.degrees(stated["normal"]) < 1.0
    nearer = RangeNoise(0.001, 2e-3, farthest_m=4.0)
    twice = stated_by(camera, [replace(seen, noise=nearer)])
    assert twice["normal"] > 1.7 * stated["normal"]
    scanner, seen = wall_seen(SCANNER, RangeNoise(0.002, 0.0))
    stated = stated_by(scanner, [seen])
    assert 0.005 < np.degrees(stated["normal"]) < 0.1


@pytest.mark.parametrize(
    ("projection", "noise"),
    [(CAMERA, RangeNoise(0.002, 0.0)), (CAMERA, RangeNoise(0.002, 1e-5, farthest_m=5.0)),
     (CAMERA, RangeNoise(0.0, 0.0)), (SCANNER, RangeNoise(0.0, 0.0))],
)  # fmt: skip
def test_nothing_is_added_where_nothing_is_known(projection, noise):
    merged, seen = wall_seen(projection, noise)
    assert not shift_by_sensors(merged, [seen]).any()


def test_rigid_motion_changes_nothing():
    turn = Pose.looking_at(np.array([1.0, 2, 3]), np.array([4.0, 1, 2]))
    deviations = []
    for pose in (Pose.identity(), turn):
        merged, seen = wall_seen(CAMERA, KINECT, pose)
        deviations.append(stated_by(merged, [seen]))
    assert deviations[0] == pytest.approx(deviations[1], rel=1e-6)


def test_a_surface_of_several_scans_shares_the_sensors_errors():
    merged, seen = wall_seen(CAMERA, KINECT)
    held = PixelSet.of(np.ones(CAMERA.shape, dtype=np.bool_))
    twice = MergedSurface(merged.fit, ScanPixels.of([held, held]), 1)
    one, two = (shift_by_sensors(what, [seen] * n) for what, n in ((merged, 1), (twice, 2)))
    np.testing.assert_allclose(one, two, rtol=0.02, atol=5e-3 * np.abs(one).max())


def test_a_camera_and_a_scanner_share_nothing():
    camera, seen = wall_seen(CAMERA, KINECT)
    scanner, other = wall_seen(SCANNER, RangeNoise(0.002, 0.0))
    assert not (shift_by_sensors(camera, [seen]) * shift_by_sensors(scanner, [other])).any()
