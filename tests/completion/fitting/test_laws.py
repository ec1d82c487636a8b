# SPDX-License-Identifier: MIT
"""Laws of every fit: it moves and scales with the points, and forgets their order."""

import numpy as np
import pytest
from hypothesis import given, settings

from completion.fitting.pipeline import fit
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import (
    Cone,
    Cylinder,
    EllipticCylinder,
    Plane,
    Sphere,
    Surface,
    Torus,
    surfaces_close,
)
from tests.helpers.long_cases import first_in_gate
from tests.helpers.strategies import poses, seeds

SIGMA = 1e-3
SURFACES: dict[str, Surface] = {
    "plane": Plane((1, 2, 3), (1, 2, 3)),
    "sphere": Sphere((1, 2, 3), 0.7),
    "cylinder": Cylinder((1, 2, 3), (0.3, 0.2, 1), 0.7),
    "cone": Cone((1, 2, 3), (0.3, 0.2, 1), 0.7, 0.5),
    "elliptic-cylinder": EllipticCylinder((1, 2, 3), (0.3, 0.2, 1), (0.7, 0.4)),
    "torus": Torus((1, 2, 3), (0.3, 0.2, 1), 0.7, 0.4),
}
SHAPES = pytest.mark.parametrize("shape", SURFACES)
law = settings(derandomize=True, deadline=None, max_examples=5)


def sampled(shape: str, rng: np.random.Generator, n: int = 200, sigma: float = SIGMA) -> FloatArray:
    surface = SURFACES[shape]
    points = surface.from_uv(np.column_stack([rng.uniform(-0.8, 0.8, n), rng.uniform(-0.5, 0.5, n)]))
    return points + rng.normal(0, sigma, (n, 1)) * surface.normal(points)


def scaled(surface: Surface, factor: float) -> Surface:
    if isinstance(surface, Plane):
        return Plane(factor * surface.point, surface.normal_direction)
    if isinstance(surface, Sphere):
        return Sphere(factor * surface.centre, factor * surface.radius)
    if isinstance(surface, Cylinder):
        return Cylinder(factor * surface.point, surface.direction, factor * surface.radius)
    if isinstance(surface, Cone):
        radius = factor * surface.radius
        return Cone(factor * surface.point, surface.direction, radius, surface.half_angle)
    if isinstance(surface, Torus):
        radii = factor * surface.radius, factor * surface.tube_radius
        return Torus(factor * surface.centre, surface.direction, *radii)
    assert isinstance(surface, EllipticCylinder)
    radii = (factor * surface.radii[0], factor * surface.radii[1])
    return EllipticCylinder(factor * surface.point, surface.direction, radii, surface.zero_direction)


@SHAPES
@law
@given(pose=poses(), seed=seeds)
def test_fits_move_with_the_points(shape: str, pose: Pose, seed: int) -> None:
    points = sampled(shape, np.random.default_rng(seed))
    here, there = fit(points, shape), fit(pose.apply(points), shape)  # type: ignore[arg-type]
    assert surfaces_close(here.surface.transform(pose), there.surface, angle=1e-8, length=1e-8)
    assert there.rms == pytest.approx(here.rms, rel=1e-9)


@SHAPES
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_fits_scale_with_the_points(shape: str, factor: float) -> None:
    points = sampled(shape, np.random.default_rng(0))
    here, there = fit(points, shape), fit(factor * points, shape)  # type: ignore[arg-type]
    assert surfaces_close(scaled(here.surface, factor), there.surface, angle=1e-8, length=1e-8 * factor)
    assert there.rms == pytest.approx(factor * here.rms, rel=1e-9)
    radius = "radius" if "radius" in here.parameter_deviations() else None
    if radius:
        expected = factor * here.parameter_deviations()[radius]
        assert there.parameter_deviations()[radius] == pytest.approx(expected, rel=1e-6)


@SHAPES
@law
@given(seed=seeds)
def test_the_order_of_points_does_not_count(shape: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = sampled(shape, rng)
    here, there = fit(points, shape), fit(rng.permutation(points), shape)  # type: ignore[arg-type]
    assert surfaces_close(here.surface, there.surface, angle=1e-9, length=1e-9)


@SHAPES
def test_far_from_the_origin_fits_are_as_good_as_rounding(shape: str) -> None:
    """At 1e7 m coordinates are rounded to 1.9e-9 m, a millionth of the noise."""
    points = sampled(shape, np.random.default_rng(0))
    away = np.array([1e7, -1e7, 1e7])
    here, there = fit(points, shape), fit(points + away, shape)  # type: ignore[arg-type]
    moved = here.surface.transform(Pose.from_parts(np.eye(3), away))
    assert surfaces_close(moved, there.surface, angle=1e-6, length=1e-6)


@pytest.mark.parametrize("n_trials", [24, pytest.param(240, marks=pytest.mark.long)])
@pytest.mark.parametrize("shape", first_in_gate(3, SURFACES))
def test_predicted_deviations_are_those_of_repeated_fits(shape: str, n_trials: int) -> None:
    """The ratio of standard deviations within 4 / sqrt(2 n) of one, the mean unbiased."""
    rng = np.random.default_rng(3)
    probes = SURFACES[shape].from_uv(np.array([[0.6, 0.4], [-0.5, 0.2], [0.1, -0.4]]))
    errors, predicted = [], []
    for _ in range(n_trials):
        result = fit(sampled(shape, rng), shape)  # type: ignore[arg-type]
        errors.append(result.surface.distance(probes))
        predicted.append(result.standard_deviation(probes))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(predicted, axis=0)
    np.testing.assert_allclose(ratio, 1, atol=4 / np.sqrt(2 * n_trials))


@pytest.mark.parametrize("ratio", [1e2, 1e3])
@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_shallow_arcs_are_fitted_with_their_uncertainty(shape, ratio) -> None:
    """A patch 2 m wide of radius 100 m and 1 km; noise is a fiftieth of its sag."""
    rng = np.random.default_rng(0)
    true = Sphere((1, 2, 3), ratio) if shape == "sphere" else Cylinder((1, 2, 3), (0.3, 0.5, 0.8), ratio)
    exact = true.from_uv(rng.uniform(-1, 1, (3000, 2)))
    assert fit(exact, shape).surface.radius == pytest.approx(ratio, rel=1e-9)  # type: ignore[attr-defined]
    estimate = fit(exact + 0.01 / ratio * rng.normal(size=(3000, 1)) * true.normal(exact), shape)
    error = estimate.surface.radius - ratio  # type: ignore[attr-defined]
    assert abs(error) < 4 * estimate.parameter_deviations()["radius"] < 0.01 * ratio


@pytest.mark.parametrize("seed", range(6))
def test_cones_of_many_points_open_whichever_way_they_were_found(seed) -> None:
    rng = np.random.default_rng(seed)
    true = Cone(rng.normal(size=3), rng.normal(size=3), 1.0, 0.4)
    points = true.from_uv(np.column_stack([rng.uniform(-0.8, 0.8, 45_000), rng.uniform(-0.5, 0.5, 45_000)]))
    points += SIGMA * rng.normal(size=(len(points), 1)) * true.normal(points)
    assert surfaces_close(fit(points, "cone").surface, true, angle=1e-3, length=1e-3)
