# SPDX-License-Identifier: MIT
"""Profiles: distances by closed forms, derivatives by differences, tangent where faces meet."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.features.junctions.models import Mixture, Model, edge, elbow, tangent_arcs

RNG = np.random.default_rng(0)
CASES = [
    (tangent_arcs, [0.3, -0.5]),
    (tangent_arcs, [0.4, 0.0]),
    (edge, [0.4]),
    (elbow, [0.7, 1.0, 0.4]),
]


@pytest.mark.parametrize(("profile", "shape"), CASES)
def test_derivatives_are_those_of_differences(profile, shape):
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    k = 6 + len(shape)
    model = Model(profile, turn, np.array([0.1, -0.2, 0.05]), np.array(shape), np.ones(k, dtype=bool))
    points = RNG.normal(0, 1, (60, 3))
    _, slopes = model.linearise(points)
    for number, step in enumerate(1e-6 * np.eye(k)):
        ahead, back = model.move(step).distance(points), model.move(-step).distance(points)
        np.testing.assert_allclose(slopes[:, number], (ahead - back) / 2e-6, atol=1e-7)


def test_arcs_are_circles_on_their_sides():
    points = RNG.uniform(-1, 1, (200, 3))
    section = tangent_arcs(points, np.array([0.5, -0.25]))
    first = np.hypot(points[:, 0] + 2, points[:, 1]) - 2
    second = 4 - np.hypot(points[:, 0] - 4, points[:, 1])
    np.testing.assert_allclose(section.distance, np.where(points[:, 1] > 0, first, second), atol=1e-12)
    np.testing.assert_array_equal(section.face, np.where(points[:, 1] > 0, 1, 2))


def test_an_elbow_is_a_torus_between_two_cylinders():
    half, bend, tube = 0.6, 3.0, 0.8
    points = RNG.uniform(-5, 5, (500, 3))
    section = elbow(points, np.array([half, bend, tube]))
    x, y, z = points.T
    torus = np.hypot(np.hypot(x, y) - bend, z) - tube
    turn = np.arctan2(y, x)
    inside = np.abs(turn) < half
    np.testing.assert_allclose(section.distance[inside], torus[inside], atol=1e-12)
    end, way = bend * np.array([np.cos(half), np.sin(half), 0]), np.array([-np.sin(half), np.cos(half), 0])
    straight = np.linalg.norm(np.cross(points - end, way), axis=1) - tube
    arm = section.face == 2
    np.testing.assert_allclose(section.distance[arm], straight[arm], atol=1e-12)


@pytest.mark.parametrize(("profile", "shape"), CASES[:2])
def test_both_sides_touch_with_one_normal(profile, shape):
    along = np.linspace(-1, 1, 5)
    beside = [np.column_stack([np.zeros(5), np.full(5, y), along]) for y in (1e-9, -1e-9)]
    first, second = (profile(points, np.array(shape)) for points in beside)
    np.testing.assert_allclose(first.distance, second.distance, atol=1e-12)
    np.testing.assert_allclose(first.slope, second.slope, atol=1e-8)


def test_noise_and_outliers_are_told_apart():
    rng = np.random.default_rng(1)
    distances = np.where(
        rng.uniform(size=20_000) < 0.3, rng.uniform(-5, 5, 20_000), rng.normal(0, 0.2, 20_000)
    )
    mixture = Mixture.of(distances, 10.0, 0.5, 1e-6)
    assert mixture.sigma == pytest.approx(0.2, rel=0.03)
    assert mixture.share == pytest.approx(0.3, abs=0.02)
    grid = np.linspace(-5, 5, 20_001)
    density = np.exp(mixture.log_densities(grid))
    assert np.trapezoid(density, grid) == pytest.approx(1, abs=1e-3)
