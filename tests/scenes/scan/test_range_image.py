# SPDX-License-Identifier: MIT
"""A range image: what came back, where it lies in the world, and which pixel sees what."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from scenes.checks import InputError
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage, ScanTruth
from tests.helpers.strategies import ROUNDING_M, law, poses

PROJECTIONS: dict[str, Projection] = {
    "pinhole": PinholeProjection(12, 9, 10.5, 11.0, 5.5, 4.25),
    "panorama": SphericalProjection.regular(16, 7, 360.0, (-50.0, 40.0)),
}
POSE = Pose.looking_at((4.0, -3.0, 1.5), (1.0, 2.0, 0.5))


def scan_of(projection: Projection, pose: Pose = POSE, *, off_rays_m: float = 0.0) -> RangeImage:
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 9, projection.shape)
    ranges[rng.random(projection.shape) < 0.2] = np.inf
    if not off_rays_m:
        return RangeImage(ranges, projection, pose)
    points = np.where(np.isfinite(ranges), ranges, np.nan)[..., None] * projection.directions()
    return RangeImage.from_points(points + rng.normal(0, off_rays_m, points.shape), projection, pose)


@pytest.mark.parametrize("nothing", [0.0, -0.0, -2.0, np.nan, np.inf, -np.inf])
def test_whatever_is_no_range_becomes_inf(nothing: float) -> None:
    projection = PROJECTIONS["pinhole"]
    ranges = np.full(projection.shape, 3.0)
    ranges[2, 3] = nothing
    scan = RangeImage(ranges, projection, POSE)
    assert scan.ranges[2, 3] == np.inf
    assert np.argwhere(~scan.valid).tolist() == [[2, 3]]
    assert np.argwhere(np.isnan(scan.points()).all(axis=-1)).tolist() == [[2, 3]]
    assert np.isfinite(scan.rays()).all()


@pytest.mark.parametrize("kind", PROJECTIONS)
@given(pose=poses())
@law
def test_points_lie_on_their_rays_at_their_ranges(kind: str, pose: Pose) -> None:
    scan = scan_of(PROJECTIONS[kind], pose)
    offset = scan.points()[scan.valid] - scan.origin
    expected = scan.ranges[scan.valid][:, None] * scan.rays()[scan.valid]
    np.testing.assert_allclose(offset, expected, atol=ROUNDING_M, rtol=0)
    assert np.isnan(scan.points()[~scan.valid]).all()
    assert (scan.origin == pose.translation).all()


@pytest.mark.parametrize("kind", PROJECTIONS)
@given(pose=poses())
@law
def test_pixels_of_points_are_the_pixels_they_came_from(kind: str, pose: Pose) -> None:
    scan = scan_of(PROJECTIONS[kind], pose)
    pixels = scan.pixels(scan.points()[scan.valid])
    # Points rounded by ROUNDING_M at 1 m and more move by that over the pixel angle (10 pixels / radian).
    np.testing.assert_allclose(pixels, np.argwhere(scan.valid), atol=20 * ROUNDING_M, rtol=0)


@pytest.mark.parametrize("kind", PROJECTIONS)
@given(pose=poses())
@law
def test_moving_a_scan_moves_its_points_rigidly(kind: str, pose: Pose) -> None:
    for scan in (scan_of(PROJECTIONS[kind]), scan_of(PROJECTIONS[kind], off_rays_m=0.01)):
        moved = scan.transform(pose)
        np.testing.assert_allclose(moved.points(), pose.apply(scan.points()), atol=ROUNDING_M, rtol=0)
        np.testing.assert_allclose(moved.rays(), pose.rotate(scan.rays()), atol=ROUNDING_M, rtol=0)
        assert (moved.ranges == scan.ranges).all()
        points = scan.points()[scan.valid]
        np.testing.assert_allclose(
            moved.pixels(pose.apply(points)), scan.pixels(points), atol=40 * ROUNDING_M, rtol=0
        )


@pytest.mark.parametrize("kind", PROJECTIONS)
def test_measured_points_beside_their_rays_are_kept(kind: str) -> None:
    projection = PROJECTIONS[kind]
    scan = scan_of(projection, off_rays_m=0.02)
    assert scan.sensor_points is not None
    assert (scan.points_in_sensor()[scan.valid] == scan.sensor_points[scan.valid]).all()
    on_rays = scan.ranges[scan.valid][:, None] * projection.directions()[scan.valid]
    assert np.abs(on_rays - scan.sensor_points[scan.valid]).max() > 0.01
    np.testing.assert_allclose(np.linalg.norm(scan.rays(), axis=-1), 1, atol=1e-15)
    reached = scan.origin + scan.ranges[scan.valid][:, None] * scan.rays()[scan.valid]
    np.testing.assert_allclose(reached, scan.points()[scan.valid], atol=ROUNDING_M, rtol=0)


def test_points_and_ranges_agree_on_what_came_back() -> None:
    projection = PinholeProjection(3, 2, 2.0, 2.0, 1.0, 0.5)
    points = np.full((2, 3, 3), 1.0)
    points[0, 0, 1], points[0, 1], points[0, 2, 2] = np.nan, 0.0, -np.inf
    scan = RangeImage.from_points(points, projection, POSE)
    assert scan.valid.tolist() == [[False, False, False], [True, True, True]]
    assert np.isnan(scan.points()[0]).all()
    np.testing.assert_allclose(scan.ranges[1], np.sqrt(3), atol=1e-15)
    ranges = np.full((2, 3), np.sqrt(3))
    points[0, 1] = [0, 1, -np.sqrt(2)]
    ranges[1, 1] = 0.0
    both = RangeImage(ranges, projection, POSE, sensor_points=points)
    assert both.valid.tolist() == [[False, True, False], [True, False, True]]
    assert np.isnan(both.points_in_sensor()[1, 1]).all()
    assert np.isfinite(both.rays()).all()


def test_measured_points_are_as_far_away_as_their_ranges_say() -> None:
    projection = PinholeProjection(3, 2, 2.0, 2.0, 1.0, 0.5)
    points = np.full((2, 3, 3), 1.0)
    with pytest.raises(InputError, match="6 of 6 measured points are not as far away as their ranges say"):
        RangeImage(np.full((2, 3), 2.0), projection, POSE, sensor_points=points)
    RangeImage(np.full((2, 3), np.float32(np.sqrt(3))), projection, POSE, sensor_points=points)


def test_intensities_of_returns_are_finite() -> None:
    projection = PinholeProjection(3, 2, 2.0, 2.0, 1.0, 0.5)
    ranges, light = np.full((2, 3), 2.0), np.ones((2, 3))
    ranges[0, 0], light[0, 0] = np.inf, np.nan
    assert RangeImage(ranges, projection, POSE, intensity=light).intensity is not None
    light[1, 1] = 1e300
    with pytest.raises(InputError, match="intensities of returns are not finite"):
        RangeImage(ranges, projection, POSE, intensity=light)


def test_a_scan_without_returns_is_a_scan() -> None:
    for projection in PROJECTIONS.values():
        scan = RangeImage(np.full(projection.shape, np.nan), projection, POSE)
        assert not scan.valid.any()
        assert scan.shape == projection.shape
        assert np.isnan(scan.points()).all()


def test_arrays_are_copied_and_read_only() -> None:
    projection = PROJECTIONS["pinhole"]
    ranges, colour = np.full(projection.shape, 3.0), np.zeros((*projection.shape, 3), np.float32)
    points = 3.0 * projection.directions()
    face = np.zeros(projection.shape, np.int32)
    truth = ScanTruth(face, face, ranges, ranges)
    scan = RangeImage(ranges, projection, POSE, colour=colour, sensor_points=points, truth=truth)
    ranges[:], colour[:], points[:], face[:] = 7, 1, 7, 7
    assert scan.colour is not None
    assert scan.sensor_points is not None
    assert (scan.ranges.max(), scan.colour.max(), truth.face.max(), truth.ranges.max()) == (3, 0, 0, 3)
    assert np.abs(scan.sensor_points).max() <= 3
    arrays = [scan.ranges, scan.colour, scan.sensor_points]
    for array in [*arrays, truth.face, truth.surface, truth.ranges, truth.incidence]:
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_other_fields_travel_along() -> None:
    scan = replace(scan_of(PROJECTIONS["pinhole"]), sigma_m=0.002, noise="constant", name="hall")
    moved = scan.transform(Pose.identity())
    assert (moved.sigma_m, moved.noise, moved.name) == (0.002, "constant", "hall")


def test_arrays_of_another_shape_are_refused() -> None:
    projection = PinholeProjection(4, 3, 5.0, 5.0, 1.5, 1.0)
    ranges = np.ones((3, 4))
    with pytest.raises(InputError, match=r"ranges have shape \(4, 3\), the projection \(3, 4\)"):
        RangeImage(ranges.T, projection, POSE)
    with pytest.raises(InputError, match=r"colour has shape \(3, 4\), expected \(3, 4, 3\)"):
        RangeImage(ranges, projection, POSE, colour=ranges.astype(np.float32))
    colour = np.full((*ranges.shape, 3), 200, np.float32)
    with pytest.raises(
        InputError, match=r"colour is to be in 0\.\.1, got 200\.\.200; divide it by its largest"
    ):
        RangeImage(ranges, projection, POSE, colour=colour)
    colour[:] = np.nan
    with pytest.raises(InputError, match="colour of 12 of 12 returns is not finite; leave it out"):
        RangeImage(ranges, projection, POSE, colour=colour)
    nothing = np.full_like(ranges, np.inf)
    unseen = RangeImage(nothing, projection, POSE, colour=colour)
    assert unseen.colour is not None
    assert not unseen.colour.any()
    with pytest.raises(InputError, match=r"sensor_points has shape \(12, 3\), expected \(3, 4, 3\)"):
        RangeImage(ranges, projection, POSE, sensor_points=np.ones((12, 3)))
    with pytest.raises(InputError, match=r"intensity has shape \(4,\), expected \(3, 4\)"):
        RangeImage(ranges, projection, POSE, intensity=np.ones(4, np.float32))
    face = np.zeros((2, 2), np.int32)
    with pytest.raises(InputError, match=r"truth of surface has shape \(4,\), of ranges \(2, 2\)"):
        ScanTruth(face, face.ravel(), np.ones((2, 2)), np.ones((2, 2)))
    with pytest.raises(InputError, match=r"truth has shape \(2, 2\), expected \(3, 4\)"):
        RangeImage(ranges, projection, POSE, truth=ScanTruth(face, face, np.ones((2, 2)), np.ones((2, 2))))


def test_a_scan_without_truth_has_no_true_points() -> None:
    scan = RangeImage([[1.0]], PinholeProjection(1, 1, 1, 1, 0, 0), Pose.identity(), name="hall")
    for ask in (scan.true_points, scan.range_error):
        with pytest.raises(InputError, match="hall: has no truth; only simulated scans have"):
            ask()


def test_true_points_and_range_errors_are_nan_where_nothing_was_met_or_measured() -> None:
    ranges = np.array([[1.0, np.inf, 3.0]])
    truth = ScanTruth(np.array([[0, 0, -1]]), np.zeros((1, 3)), np.array([[1.5, 2.0, np.inf]]), ranges)
    scan = RangeImage(ranges, PinholeProjection(3, 1, 1, 1, 1, 0), Pose.identity(), truth=truth)
    np.testing.assert_array_equal(scan.range_error(), [[-0.5, np.nan, np.nan]])
    assert np.isfinite(scan.true_points()).all(axis=-1).tolist() == [[True, True, False]]


def test_ranges_beyond_any_scanner_are_no_return() -> None:
    scan = RangeImage([[1.0, 1e9], [1.1e9, 3.4e38]], PinholeProjection(2, 2, 1, 1, 0.5, 0.5), Pose.identity())
    assert scan.valid.tolist() == [[True, True], [False, False]]


@pytest.mark.parametrize("sigma", [np.nan, np.inf, -1e-3])
def test_a_sigma_that_is_no_length_is_refused(sigma: float) -> None:
    with pytest.raises(InputError, match="sigma_m must be 0 or more"):
        RangeImage([[1.0]], PinholeProjection(1, 1, 1, 1, 0, 0), Pose.identity(), sigma_m=sigma)
