# SPDX-License-Identifier: MIT
"""Projections estimated from organised points: exact on exact grids, robust, refused where none fits."""

import numpy as np
import pytest

from scenes.checks import FloatArray, InputError
from scenes.io.formats.grid_fit import fit_grid, fit_pinhole, fit_spherical, organised_scan
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from tests.helpers.scan_examples import PROJECTIONS, example_scan


def organised(kind: str) -> FloatArray:
    return example_scan(PROJECTIONS[kind]).points_in_sensor().copy()


@pytest.mark.parametrize("kind", PROJECTIONS)
def test_exact_grids_are_recovered(kind: str) -> None:
    fit = fit_grid(organised(kind))
    assert fit.projection.kind == PROJECTIONS[kind].kind
    assert fit.residual_px < 1e-6
    np.testing.assert_allclose(fit.projection.directions(), PROJECTIONS[kind].directions(), atol=1e-9)


def test_a_tenth_of_wild_points_does_not_move_the_pinhole() -> None:
    points = organised("pinhole")
    rng = np.random.default_rng(1)
    wild = rng.random(points.shape[:2]) < 0.1
    points[wild] = rng.normal(0, 1, (int(wild.sum()), 3)) + [0, 0, 4]
    fit = fit_pinhole(points)
    assert fit is not None
    np.testing.assert_allclose(fit.projection.directions(), PROJECTIONS["pinhole"].directions(), atol=1e-6)


def test_a_tenth_of_wild_points_does_not_move_the_panorama() -> None:
    points = organised("panorama")
    rng = np.random.default_rng(1)
    wild = rng.random(points.shape[:2]) < 0.1
    points[wild] = rng.normal(0, 3, (int(wild.sum()), 3))
    fit = fit_spherical(points)
    assert fit is not None
    np.testing.assert_allclose(fit.projection.directions(), PROJECTIONS["panorama"].directions(), atol=1e-9)


def test_empty_rows_and_columns_continue_the_grid() -> None:
    points = organised("panorama")
    points[[0, 1, 7, -1]] = np.nan
    points[:, [0, 20, 21, -1]] = np.nan
    fit = fit_spherical(points)
    assert fit is not None
    np.testing.assert_allclose(fit.projection.directions(), PROJECTIONS["panorama"].directions(), atol=1e-9)


def test_jitter_leaves_the_angles_strictly_monotonic() -> None:
    wanted = SphericalProjection.regular(90, 40, 90.0, (-30.0, 30.0))
    rng = np.random.default_rng(2)
    jitter = np.radians(1.0)  # as large as a column step
    points = 3 * wanted.directions() + 3 * rng.normal(0, jitter, (40, 90, 3))
    points[::2] = np.nan
    fit = fit_spherical(points)
    assert fit is not None
    assert isinstance(fit.projection, SphericalProjection)
    assert (np.diff(fit.projection.azimuths) > 0).all()
    assert 0.3 < fit.residual_px < 3


def test_points_in_no_order_are_refused_with_both_residuals() -> None:
    points = np.random.default_rng(3).normal(0, 1, (20, 30, 3)) + [0, 0, 5]
    with pytest.raises(
        InputError, match=r"fit no known projection \(median residual: pinhole .* px, spherical"
    ):
        fit_grid(points)


def test_a_single_row_is_refused() -> None:
    with pytest.raises(
        InputError, match="15 points in a grid of 1 x 15 are too few to estimate its projection"
    ):
        fit_grid(np.ones((1, 15, 3)) * np.arange(1, 16)[None, :, None])


def test_points_on_their_rays_become_ranges_alone() -> None:
    points = organised("pinhole")
    on_rays = organised_scan(points, fit_grid(points).projection, Pose.identity(), None, "on")
    assert on_rays.sensor_points is None
    points += np.random.default_rng(4).normal(0, 1e-4, points.shape)
    off_rays = organised_scan(points, fit_grid(points).projection, Pose.identity(), None, "off")
    assert off_rays.sensor_points is not None
    np.testing.assert_array_equal(off_rays.sensor_points, points)


def test_a_narrow_pinhole_is_not_taken_for_a_panorama() -> None:
    camera = PinholeProjection(40, 30, 2000.0, 2000.0, 19.5, 14.5)
    assert fit_grid(5 * camera.directions()).projection.kind == "pinhole"
