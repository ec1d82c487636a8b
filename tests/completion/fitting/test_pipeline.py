# SPDX-License-Identifier: MIT
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from completion.fitting.euclidean import fit_cylinder, fit_plane
from completion.fitting.result import FitError, inflated, surface_parameters
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane, surfaces_close

TRUE = Cylinder((0.3, -0.2, 1.0), (0.2, 0.1, 1.0), 0.06)


def arc(cylinder: Cylinder, n: int, degrees: float, rng: np.random.Generator, sigma: float = 0.0):
    half = np.radians(degrees) / 2 * cylinder.radius
    uv = np.column_stack([rng.uniform(-half, half, n), rng.uniform(-0.05, 0.05, n)])
    points = cylinder.from_uv(uv)
    return points + rng.normal(0, sigma, (n, 1)) * cylinder.normal(points)


def motion(seed: int) -> Pose:
    rng = np.random.default_rng(seed)
    eye, target = rng.normal(0, 3, (2, 3))
    return Pose.looking_at(eye, target + [0.1, 0.2, 0.3])


def test_plane_through_exact_points_is_exact():
    plane = Plane((1, 2, 3), (1, 1, 0.5))
    points = plane.from_uv(np.random.default_rng(0).uniform(-2, 2, (50, 2)))
    fit = fit_plane(points, towards=points[0] + plane.normal_direction)
    assert surfaces_close(plane, fit.surface, angle=1e-12, length=1e-12)
    assert fit.rms < 1e-14


def test_plane_normal_points_to_the_given_side():
    points = np.random.default_rng(0).uniform(-1, 1, (20, 3)) * [1, 1, 0]
    for height in (2.0, -2.0):
        fit = fit_plane(points, towards=np.array([0, 0, height]))
        assert fit.surface.normal(points[:1])[0, 2] == pytest.approx(np.sign(height))


@pytest.mark.parametrize("degrees", [360, 180, 90, 30])
def test_cylinder_from_a_rough_start_is_exact_on_exact_points(degrees):
    points = arc(TRUE, 500, degrees, np.random.default_rng(1))
    start = Cylinder(TRUE.point + 0.005, TRUE.direction + np.array([0.05, -0.05, 0]), 0.08)
    fit = fit_cylinder(points, start)
    assert surfaces_close(TRUE, fit.surface, angle=1e-9, length=1e-9)
    assert fit.rms < 1e-12


def test_predicted_deviations_are_those_of_repeated_fits():
    """Standard deviations over 200 trials agree with the predicted ones within 4 standard errors."""
    rng = np.random.default_rng(2)
    sigma, n_trials = 1e-4, 200
    radii, predicted, heights = [], [], []
    for _ in range(n_trials):
        fit = fit_cylinder(arc(TRUE, 400, 90, rng, sigma), TRUE)
        radii.append(fit.surface.radius)
        predicted.append(fit.parameter_deviations()["radius"])
        plane = fit_plane(
            np.column_stack([rng.uniform(-1, 1, (100, 2)), rng.normal(0, 0.01, 100)]), (0, 0, 9.0)
        )
        heights.append(plane.surface.distance(np.array([[2.0, 0.0, 0.0]]))[0])
        spread = plane.standard_deviation(np.array([[2.0, 0.0, 0.0]]))[0]
    standard_error = 1 / np.sqrt(2 * n_trials)
    assert np.std(radii) / np.mean(predicted) == pytest.approx(1, abs=4 * standard_error)
    assert abs(np.mean(radii) - TRUE.radius) < 4 * np.mean(predicted) / np.sqrt(n_trials)
    assert np.std(heights) / spread == pytest.approx(1, abs=6 * standard_error)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_fits_move_with_the_points(seed):
    pose = motion(seed)
    points = arc(TRUE, 300, 120, np.random.default_rng(seed), 1e-4)
    here, there = fit_cylinder(points, TRUE), fit_cylinder(pose.apply(points), TRUE.transform(pose))
    assert surfaces_close(here.surface.transform(pose), there.surface, angle=1e-9, length=1e-9)
    assert there.rms == pytest.approx(here.rms, rel=1e-9)
    flat, moved = fit_plane(points), fit_plane(pose.apply(points))
    assert moved.rms == pytest.approx(flat.rms, rel=1e-9)


def test_independent_residuals_are_not_inflated_and_correlated_ones_are():
    rng = np.random.default_rng(3)
    uv = np.stack(np.meshgrid(np.linspace(0, 1, 100), np.linspace(0, 1, 100)), -1).reshape(-1, 2)
    rough = np.column_stack([uv, rng.normal(0, 1e-3, len(uv))])
    warped = np.column_stack(
        [uv, rng.normal(0, 2e-4, len(uv)) + 1e-3 * np.sin(7 * uv[:, 0]) * np.sin(6 * uv[:, 1])]
    )
    for points, low, high in ((rough, 1.0, 1.6), (warped, 20.0, 1e4)):
        fit = fit_plane(points)
        growth = inflated(fit, points, 0.1).covariance[0, 0] / fit.covariance[0, 0]
        assert low <= growth <= high


ALONG = np.arange(9.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_plane(np.zeros((2, 3))), "a plane needs 3 points, got 2"),
        (lambda: fit_plane(np.outer(ALONG, [1, 2, 3])), "9 points lie on one line: singular values"),
        (lambda: fit_cylinder(np.eye(3), TRUE), "a cylinder with covariance needs 6 points, got 3"),
        (
            lambda: fit_cylinder(TRUE.point + np.outer(ALONG, TRUE.direction), TRUE),
            "lie on the cylinder's axis",
        ),
        (
            lambda: fit_cylinder(TRUE.from_uv(np.column_stack([0 * ALONG, ALONG])), TRUE),
            "determine no cylinder",
        ),
    ],
)
def test_degenerate_points_raise_and_say_why(call, message):
    with pytest.raises(FitError, match=message):
        call()


def test_points_that_are_not_finite_are_refused():
    points = np.ones((5, 3))
    points[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"1 of 5 points are not finite \(first at row 3\)"):
        fit_plane(points)


def test_parameters_have_the_names_that_files_use():
    assert list(surface_parameters(TRUE)) == ["point", "direction", "radius", "concave"]
    assert list(surface_parameters(Plane((0, 0, 0), (0, 0, 1)))) == ["point", "normal"]
    with pytest.raises(TypeError, match="no parameters are known for a str"):
        surface_parameters("sphere")  # type: ignore[arg-type]
