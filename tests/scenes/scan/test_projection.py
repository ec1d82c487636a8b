# SPDX-License-Identifier: MIT
"""Every pixel sees the points on its own ray, and no projection sees beyond its borders."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.checks import FloatArray, InputError
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from tests.helpers.strategies import EPS, law, seeds

PINHOLE = PinholeProjection(40, 30, 38.0, 37.0, 18.25, 15.75)
NEGATIVE_FY = PinholeProjection(40, 30, 38.0, -37.0, 18.25, 15.75)
PANORAMA = SphericalProjection.regular(72, 25, 360.0, (-60.0, 40.0))
PROJECTIONS: dict[str, Projection] = {
    "pinhole": PINHOLE,
    "negative fy": NEGATIVE_FY,
    "negative fx": PinholeProjection(40, 30, -38.0, 37.0, 18.25, 15.75),
    "one pixel": PinholeProjection(1, 1, 5.0, 5.0, 0.0, 0.0),
    "panorama": PANORAMA,
    "odd panorama": SphericalProjection.regular(73, 2, 360.0, (-60.0, 40.0)),
    "rows upwards": SphericalProjection(PANORAMA.azimuths, PANORAMA.elevations[::-1]),
    "columns leftwards": SphericalProjection(PANORAMA.azimuths[::-1], PANORAMA.elevations),
    "azimuths across pi": SphericalProjection(np.linspace(2.5, 4.5, 30), np.linspace(0.5, -0.5, 20)),
    "azimuths across -pi, leftwards": SphericalProjection(
        np.linspace(-2.5, -4.5, 30), np.linspace(-0.5, 0.5, 20)
    ),
    "azimuths several turns on": SphericalProjection(
        np.linspace(-1, 1, 30) + 6 * np.pi, np.linspace(0.5, -0.5, 20)
    ),
    "uneven": SphericalProjection(
        np.linspace(-1, 1, 30) ** 3 + np.linspace(-1, 1, 30), np.array([0.5, 0.1, -1])
    ),
    "poles": SphericalProjection.regular(24, 13, 360.0, (-90.0, 90.0)),
    "one row": SphericalProjection(np.linspace(-1, 1, 30), np.array([0.2])),
    "one column": SphericalProjection(np.array([3.1]), np.linspace(-1, 1, 30)),
}


def pixel_grid(projection: Projection) -> FloatArray:
    rows, columns = projection.shape
    return np.stack(np.mgrid[:rows, :columns], axis=-1).reshape(-1, 2).astype(np.float64)


@pytest.mark.parametrize("name", PROJECTIONS)
@pytest.mark.parametrize("distance", [1e-3, 1.0, 1e4])
def test_pixels_of_rays_are_the_pixel_grid(name: str, distance: float) -> None:
    projection = PROJECTIONS[name]
    rays = projection.directions()
    assert isinstance(projection, Projection)
    assert rays.shape == (*projection.shape, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=8 * EPS)
    pixels = projection.pixels(rays.reshape(-1, 3) * distance)
    # A rounded angle shifts a pixel by eps * 25 rad / pixel_angle.
    np.testing.assert_allclose(pixels, pixel_grid(projection), atol=1e-10, rtol=0)


@pytest.mark.parametrize("name", PROJECTIONS)
@given(seed=seeds)
@law
def test_a_pixel_that_sees_a_point_is_in_the_image(name: str, seed: int) -> None:
    projection = PROJECTIONS[name]
    points = np.random.default_rng(seed).normal(size=(300, 3))
    points[::7] = np.round(points[::7])  # axes and corners, where angles are +-pi or 0
    pixels = projection.pixels(points[np.abs(points).max(axis=1) > 0])
    seen = np.isfinite(pixels).all(axis=1)
    nearest = np.rint(pixels[seen])
    assert (nearest >= 0).all()
    assert (nearest < projection.shape).all()


@law
@given(seeds)
def test_pinhole_pixels_follow_the_formula(seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-1, 1, (200, 3)) * [0.5, 0.5, 1]
    pixels = PINHOLE.pixels(points)
    for point, (row, column) in zip(points.tolist(), pixels.tolist(), strict=True):
        x, y, z = point
        if z <= 0:
            assert np.isnan([row, column]).all()
            continue
        expected = 37 * y / z + 15.75, 38 * x / z + 18.25
        if -0.5 <= expected[0] < 29.5 and -0.5 <= expected[1] < 39.5:
            np.testing.assert_allclose((row, column), expected, atol=1e-12, rtol=0)
        else:
            assert np.isnan([row, column]).all()


def test_a_negative_fy_is_used_as_given() -> None:
    upwards, downwards = NEGATIVE_FY.directions(), PINHOLE.directions()
    np.testing.assert_allclose(upwards, downwards * [1, -1, 1], atol=EPS)
    row, column = NEGATIVE_FY.pixels(np.array([[0.0, -0.2, 2.0]]))[0]
    np.testing.assert_allclose((row, column), (15.75 + 3.7, 18.25), atol=1e-13)


@pytest.mark.parametrize(("width", "height"), [(640, 480), (480, 640), (7, 7)])
@pytest.mark.parametrize("fov_deg", [0.5, 60.0, 120.0, 179.0])
def test_the_field_of_view_spans_the_longer_side(width: int, height: int, fov_deg: float) -> None:
    camera = PinholeProjection.from_fov(width, height, fov_deg)
    assert camera.shape == (height, width)
    half = np.tan(np.radians(fov_deg) / 2)
    inside, outside = half * (1 - 1e-9), half * (1 + 1e-9)
    axis = 0 if width >= height else 1
    for tangent, seen in ((inside, True), (-inside, True), (outside, False), (-outside, False)):
        point = np.array([[0.0, 0.0, 3.0]])
        point[0, axis] = 3 * tangent
        assert bool(np.isfinite(camera.pixels(point)).all()) is seen
    middle = camera.pixels(np.array([[0.0, 0.0, 1.0]]))[0]
    assert middle.tolist() == [(height - 1) / 2, (width - 1) / 2]


def test_pinhole_borders_lie_half_a_pixel_out() -> None:
    def at(row: float, column: float) -> FloatArray:
        return np.array([[(column - 18.25) / 38, (row - 15.75) / 37, 1.0]]) * 8

    tiny = 1e-9
    for row, column in ((-0.5 + tiny, 3.0), (29.5 - tiny, 3.0), (3.0, -0.5 + tiny), (3.0, 39.5 - tiny)):
        np.testing.assert_allclose(PINHOLE.pixels(at(row, column))[0], (row, column), atol=1e-12)
    for row, column in ((-0.5 - tiny, 3.0), (29.5 + tiny, 3.0), (3.0, -0.5 - tiny), (3.0, 39.5 + tiny)):
        assert np.isnan(PINHOLE.pixels(at(row, column))).all()


def test_points_at_or_behind_the_pinhole_are_not_seen() -> None:
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, -1], [0, 0, 5e-324], [np.nan, 0, 1], [0, 0, np.nan]])
    assert np.isnan(PINHOLE.pixels(points)).all()


def test_pixel_angles_are_those_between_neighbours() -> None:
    rays = PinholeProjection(3, 3, 500.0, 400.0, 1.0, 1.0).directions()
    between = np.arccos(np.clip(rays[1, 1] @ rays[0, 1], -1, 1))
    np.testing.assert_allclose(between, 1 / 400, rtol=1e-5)
    assert PinholeProjection(3, 3, 500.0, -400.0, 1.0, 1.0).pixel_angle == 1 / 400
    np.testing.assert_allclose(PANORAMA.pixel_angle, np.radians(5), rtol=1e-12)
    np.testing.assert_allclose(
        SphericalProjection.regular(720, 11, 360.0, (-5, 5)).pixel_angle, np.radians(1), rtol=1e-12
    )
    assert SphericalProjection(np.zeros(1), np.zeros(1)).pixel_angle == np.pi


@pytest.mark.parametrize(
    ("point", "azimuth_deg", "elevation_deg"),
    [
        ((0, 0, 2), 0, 0),
        ((2, 0, 0), 90, 0),
        ((-2, 0, 0), -90, 0),
        ((3, 0, -3), 135, 0),
        ((0, -2, 2), 0, 45),
        ((0, 2, 2), 0, -45),
    ],
)
def test_azimuths_grow_to_the_right_and_elevations_upwards(
    point: FloatArray, azimuth_deg: float, elevation_deg: float
) -> None:
    scanner = SphericalProjection.regular(360, 181, 360.0, (-90.0, 90.0))
    row, column = scanner.pixels(np.array([point], float))[0]
    np.testing.assert_allclose((row, column), (90 - elevation_deg, 179.5 + azimuth_deg), atol=1e-10)


@pytest.mark.parametrize("columns", [1, -1])
@pytest.mark.parametrize("width", [7, 72, 360, 1001])
@given(azimuth=st.floats(-10, 10), elevation=st.floats(-0.9, 0.9))
@law
def test_a_full_turn_has_no_seam(columns: int, width: int, azimuth: float, elevation: float) -> None:
    regular = SphericalProjection.regular(width, 31, 360.0, (-60.0, 60.0))
    scanner = SphericalProjection(regular.azimuths[::columns], regular.elevations)
    across = np.cos(elevation)
    point = np.array([[across * np.sin(azimuth), -np.sin(elevation), across * np.cos(azimuth)]])
    pixel = scanner.pixels(point)
    assert np.isfinite(pixel).all()
    row, column = np.rint(pixel[0]).astype(int)
    off = (scanner.azimuths[column] - azimuth + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) <= np.pi / width + 1e-9
    assert abs(scanner.elevations[row] - elevation) <= np.radians(2) + 1e-9


def test_straight_behind_is_seen_whatever_the_sign_of_zero() -> None:
    behind = np.array([[0.0, 0.0, -1.0], [-0.0, 0.0, -1.0]])
    for width in range(2, 400):
        assert np.isfinite(SphericalProjection.regular(width, 3, 360.0, (-9, 9)).pixels(behind)).all()


@pytest.mark.parametrize("name", ["azimuths across pi", "azimuths across -pi, leftwards"])
def test_spherical_borders_lie_half_a_step_out(name: str) -> None:
    scanner = PROJECTIONS[name]
    assert isinstance(scanner, SphericalProjection)
    for angles, axis in ((scanner.elevations, 0), (scanner.azimuths, 1)):
        half = (angles[1] - angles[0]) / 2
        for end, outward, index in ((angles[0], -half, 0), (angles[-1], half, len(angles) - 1)):
            for share, seen in ((0.999, True), (1.001, False)):
                azimuth, elevation = scanner.azimuths[4], scanner.elevations[4]
                if axis == 0:
                    elevation = end + share * outward
                else:
                    azimuth = end + share * outward
                ray = SphericalProjection(np.array([azimuth]), np.array([elevation])).directions()[0]
                pixel = scanner.pixels(5 * ray)[0]
                assert bool(np.isfinite(pixel[axis])) is seen
                if seen:
                    assert pixel[axis] == index


def test_a_single_row_sees_half_a_pixel_angle_up_and_down() -> None:
    scanner = SphericalProjection(np.radians(np.arange(-10.0, 11.0)), np.zeros(1))
    points = np.array([[0, -np.tan(np.radians(e)), 1] for e in (0.0, 0.49, -0.49, 0.51, -0.51, 60)])
    assert np.isfinite(scanner.pixels(points)[:, 0]).tolist() == [True, True, True, False, False, False]


def test_a_regular_grid_runs_from_the_top_left() -> None:
    scanner = SphericalProjection.regular(4, 3, 180.0, (-30.0, 10.0))
    np.testing.assert_allclose(np.degrees(scanner.azimuths), [-67.5, -22.5, 22.5, 67.5], atol=1e-12)
    np.testing.assert_allclose(np.degrees(scanner.elevations), [10, -10, -30], atol=1e-12)
    assert scanner.shape == (3, 4)


def test_angles_are_copied_and_read_only() -> None:
    azimuths = np.array([0.0, 1.0])
    scanner = SphericalProjection(azimuths, np.array([0.0]))
    azimuths[0] = 0.5
    assert scanner.azimuths.tolist() == [0, 1]
    with pytest.raises(ValueError, match="read-only"):
        scanner.azimuths[0] = 1


@pytest.mark.parametrize("number", [0.0, np.nan, np.inf, 1e-9, 1e12, -1e12])
def test_focal_lengths_are_those_of_a_camera(number: float) -> None:
    with pytest.raises(InputError, match=r"focal lengths must be in .*, got fx, fy, cx, cy = "):
        PinholeProjection(4, 4, number, 5.0, 1.5, 1.5)
    with pytest.raises(InputError, match="focal lengths must be in"):
        PinholeProjection(4, 4, 5.0, number, 1.5, 1.5)


def test_a_principal_point_is_finite() -> None:
    assert PinholeProjection(4, 4, 5.0, 5.0, 0.0, -7.0).cy == -7
    with pytest.raises(InputError, match="cx, cy"):
        PinholeProjection(4, 4, 5.0, 5.0, np.nan, 1.5)


@pytest.mark.parametrize("fov_deg", [0.0, -5.0, 180.0, 360.0, np.nan])
def test_a_pinhole_sees_less_than_half_the_world(fov_deg: float) -> None:
    with pytest.raises(InputError, match=f"must lie between 0 and 180 deg, got {fov_deg}"):
        PinholeProjection.from_fov(4, 4, fov_deg)


@pytest.mark.parametrize(("width", "height"), [(0, 4), (4, 0), (-1, 4)])
def test_an_image_has_a_pixel(width: int, height: int) -> None:
    expected = f"an image needs at least one pixel, got {width} x {height}"
    with pytest.raises(InputError, match=expected):
        PinholeProjection(width, height, 5.0, 5.0, 1.5, 1.5)
    with pytest.raises(InputError, match=expected):
        SphericalProjection.regular(width, height, 90.0, (-10, 10))


@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.zeros(0), np.array([0, np.nan]), np.array(1.0)])
def test_angles_are_finite_sequences(bad: FloatArray) -> None:
    with pytest.raises(InputError, match=r"expected finite azimuths with shape \(n,\), got shape \("):
        SphericalProjection(bad, np.zeros(1))
    with pytest.raises(InputError, match="expected finite elevations"):
        SphericalProjection(np.zeros(1), bad)


def test_angles_are_strictly_monotonic() -> None:
    for angles in ([0, 1, 0.5], [0, 0], [3.0, 3.1, -3.1]):
        with pytest.raises(InputError, match="azimuths must be strictly monotonic; unwrap them first"):
            SphericalProjection(np.array(angles), np.zeros(1))
        with pytest.raises(InputError, match="elevations must be strictly monotonic"):
            SphericalProjection(np.zeros(1), np.array(angles))


def test_azimuths_span_at_most_a_turn() -> None:
    SphericalProjection(np.linspace(-np.pi, np.pi, 5), np.zeros(1))
    with pytest.raises(InputError, match=r"azimuths span 361\.0 deg; a scan covers at most 360"):
        SphericalProjection(np.radians([0.0, 361.0]), np.zeros(1))
