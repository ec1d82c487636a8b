# SPDX-License-Identifier: MIT
"""Moments of tiles are those of the whole; quadrics from them, and what cannot be read from those."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from completion.fitting.moments import EXPONENTS, moments
from completion.fitting.pipeline import Quadric, fit, fit_quadric, read_surface
from completion.fitting.result import FitError
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Sphere, surfaces_close
from tests.helpers.strategies import law, seeds

DUCT = EllipticCylinder((0.3, -0.2, 1.0), (0.2, 0.1, 1.0), (0.09, 0.06))


def test_moments_are_the_sums_they_say() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) + 3
    sums = moments(points, (1, 2, 3))
    offset = points - [1, 2, 3]
    slow = [float(np.prod(offset ** np.array(e), axis=1).sum()) for e in EXPONENTS]
    assert len(slow) == 35
    np.testing.assert_allclose(sums.sums, slow, rtol=1e-12, atol=1e-11)
    assert sums.n == 50
    np.testing.assert_allclose(sums.mean(), points.mean(axis=0), rtol=1e-14)


@law
@given(seeds, st.integers(1, 99))
def test_merged_moments_are_those_of_the_union(seed: int, cut: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(100, 3)) + rng.uniform(-3, 3, 3)
    merged = moments(points[:cut]).merge(moments(points[cut:]))
    union = moments(points, merged.centre)
    size = np.abs(points - merged.centre).max() + 8  # what the shifts pass through
    order = np.array([sum(e) for e in EXPONENTS])
    assert (np.abs(merged.sums - union.sums) <= 1e-13 * 100 * size**order).all()


@law
@given(seeds, st.integers(50, 350))
def test_a_quadric_from_tiles_is_that_of_the_union(seed: int, cut: int) -> None:
    rng = np.random.default_rng(seed)
    uv = np.column_stack([rng.uniform(-0.1, 0.1, 400), rng.uniform(-0.1, 0.1, 400)])
    points = DUCT.from_uv(uv) + rng.normal(0, 1e-4, (400, 3))
    whole = fit_quadric(moments(points), "taubin").coefficients
    tiles = fit_quadric(moments(points[:cut]).merge(moments(points[cut:])), "taubin").coefficients
    assert abs(abs(float(whole @ tiles)) - 1) < 1e-9


@pytest.mark.parametrize("metric", ["taubin", "algebraic"])
@pytest.mark.parametrize(
    ("shape", "surface"),
    [
        ("sphere", Sphere((1, 2, 3), 0.7)),
        ("cylinder", Cylinder((1, 2, 3), (0.3, 0.2, 1), 0.7)),
        ("cone", Cone((1, 2, 3), (0.3, 0.2, 1), 0.7, 0.5)),
        ("elliptic-cylinder", EllipticCylinder((1, 2, 3), (0.3, 0.2, 1), (0.7, 0.4))),
    ],
)
def test_exact_points_give_the_exact_surface_by_every_metric(metric, shape, surface) -> None:
    rng = np.random.default_rng(1)
    points = surface.from_uv(np.column_stack([rng.uniform(-0.8, 0.8, 300), rng.uniform(-0.5, 0.5, 300)]))
    estimate = fit(points, shape, metric=metric)
    assert surfaces_close(surface, estimate.surface, angle=1e-6, length=1e-6)
    assert estimate.metric == metric
    assert np.isnan(estimate.covariance).all()
    assert estimate.rms < 1e-7


def test_signs_that_are_wrong_are_named() -> None:
    hyperbolic = Quadric(np.zeros(3), 1.0, np.array([1.0, -1, 0, 0, 0, 0, 0, 0, 0, -1]))
    with pytest.raises(FitError, match=r"not an elliptic cylinder: squared radii \[.*-.*\] m2"):
        read_surface(hyperbolic, "elliptic-cylinder")
    with pytest.raises(FitError, match="not a cone: eigenvalues"):
        read_surface(Quadric(np.zeros(3), 1.0, np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0, -1])), "cone")
    with pytest.raises(FitError, match="not a sphere: squared radius -1"):
        read_surface(Quadric(np.zeros(3), 1.0, np.array([1.0, 1, 1, 0, 0, 0, 0, 0, 0, 1])), "sphere")
    with pytest.raises(FitError, match="a quadric of 10 coefficients needs 9 points, got 5"):
        fit_quadric(moments(np.eye(5, 3)), "taubin")
    with pytest.raises(FitError, match="20 points lie in one spot"):
        fit_quadric(moments(np.ones((20, 3))), "taubin")


def test_a_short_noisy_arc_is_no_elliptic_cylinder_to_the_algebraic_quadric() -> None:
    """The row 60 deg / 0.5 mm of the comparison: not elliptic in every trial."""
    rng = np.random.default_rng(2)
    angle, radius = rng.uniform(-np.pi / 6, np.pi / 6, 10_000), 60 + rng.normal(0, 0.5, 10_000)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-50, 50, 10_000)])
    with pytest.raises(FitError, match="not an elliptic cylinder"):
        fit(points, "cylinder", metric="algebraic")
    assert fit(points, "cylinder").surface.radius == pytest.approx(60, abs=4 * 0.119)  # type: ignore[attr-defined]
