# SPDX-License-Identifier: MIT
"""Points that determine nothing are refused, and the message says why in numbers."""

import numpy as np
import pytest

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from completion.fitting.robust import consensus_surface, fit_robust
from completion.fitting.selection import select, weigh
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cylinder, Torus
from tests.helpers.long_cases import first_in_gate

ALONG = np.linspace(-1, 1, 30)
LINE = np.outer(ALONG, [1, 2, 3]) + [5, 6, 7]
POST = Cylinder((0.3, -0.2, 1.0), (0.2, 0.1, 1.0), 0.06)
SHAPES = ["plane", "sphere", "cylinder", "cone", "elliptic-cylinder", "torus"]
RNG = np.random.default_rng(0)
FLAT = RNG.uniform(-1, 1, (50, 3)) * [1, 1, 0]
BLOB = RNG.normal(size=(400, 3))


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("plane", "a plane needs 3 points, got 2"),
        ("sphere", "a sphere needs 4 points, got 2"),
        ("cylinder", "a cylinder with covariance needs 6 points, got 2"),
        ("cone", "a cone needs 6 points, got 2"),
        ("elliptic-cylinder", "an elliptic cylinder needs 7 points, got 2"),
        ("torus", "a torus needs 7 points, got 2"),
        ("auto", "a plane needs 3 points, got 2"),
    ],
)
def test_too_few_points(shape, message) -> None:
    with pytest.raises(FitError, match=message):
        fit(np.eye(2, 3), shape)


@pytest.mark.parametrize("shape", [*SHAPES, "auto"])
def test_no_points_at_all(shape) -> None:
    with pytest.raises(FitError, match="got 0"):
        fit(np.zeros((0, 3)), shape)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("away", [0.0, 1e7])
def test_collinear_points(shape, away) -> None:
    with pytest.raises(FitError, match=r"30 points lie on one line: singular values \["):
        fit(LINE + away, shape)


@pytest.mark.parametrize("shape", SHAPES)
def test_points_that_are_all_equal(shape) -> None:
    with pytest.raises(FitError, match=r"30 points lie in one spot, at \[5.0, 6.0, 7.0\]"):
        fit(np.tile([5.0, 6, 7], (30, 1)), shape)


@pytest.mark.parametrize("shape", SHAPES[1:])
def test_points_in_one_plane_are_no_curved_surface(shape) -> None:
    with pytest.raises(FitError, match="50 points lie in one plane: singular values"):
        fit(FLAT, shape)


@pytest.mark.parametrize("shape", SHAPES)
def test_few_places_repeated_are_not_many_points(shape) -> None:
    places = np.random.default_rng(2).normal(size=(2, 3))
    with pytest.raises(FitError, match=r"200 points determine no .*: they lie in 2 places, \d are needed"):
        fit(np.repeat(places, 100, axis=0), shape)


@pytest.mark.parametrize("size", [1e-90, 1e90])
@pytest.mark.parametrize("shape", [*SHAPES, "auto"])
def test_extents_beyond_reckoning(shape, size) -> None:
    with pytest.raises(FitError, match=r"400 points extend over .* m; give coordinates in metres"):
        fit(BLOB * size, shape)


@pytest.mark.parametrize("metric", ["taubin", "algebraic"])
@pytest.mark.parametrize("shape", SHAPES[1:-1])
def test_closed_forms_refuse_a_plane_too(shape, metric) -> None:
    with pytest.raises(FitError, match="50 points lie in one plane: singular values"):
        fit(FLAT, shape, metric=metric)


def test_a_cone_that_does_not_open_has_its_apex_far_away() -> None:
    post = POST.from_uv(RNG.uniform(-0.1, 0.1, (200, 2)))
    estimate = fit(post, "cone")
    assert estimate.surface.half_angle < 1e-6  # type: ignore[attr-defined]
    assert estimate.parameter_deviations()["radius"] < 1e-12


def test_two_points_are_no_selection() -> None:
    with pytest.raises(FitError, match=r"no shape can be fitted with a degree of freedom to spare \(.*got 2"):
        select(np.eye(2, 3))


def test_one_line_on_a_cylinder() -> None:
    with pytest.raises(FitError, match="lie on one line"):
        fit(POST.from_uv(np.column_stack([0 * ALONG, ALONG])), "cylinder")


@pytest.mark.parametrize("shape", [*SHAPES, "auto"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite(shape, value) -> None:
    points = BLOB.copy()
    points[3, 1] = value
    with pytest.raises(FitError, match=r"1 of 400 points are not finite \(first at row 3\)"):
        fit(points, shape)


def test_a_spindle_is_refused_with_its_radii() -> None:
    about, around = RNG.uniform(-3, 3, 2000), RNG.uniform(-1.5, 1.5, 2000)
    reach = 0.4 + 1.0 * np.cos(around)
    spindle = np.column_stack([reach * np.cos(about), reach * np.sin(about), np.sin(around)])
    with pytest.raises(FitError, match=r"a tube of radius 1 m about a circle of 0\.4 m reaches its axis"):
        fit(spindle, "torus")


def test_a_torus_is_no_quadric() -> None:
    ring = Torus((1, 2, 3), (0, 0, 1), 1.0, 0.3).from_uv(RNG.uniform(-0.9, 0.9, (300, 2)))
    with pytest.raises(FitError, match="a torus is no quadric: 'taubin' cannot fit it; use the euclidean"):
        fit(ring, "torus", metric="taubin")


def test_wrong_arguments_are_named() -> None:
    with pytest.raises(InputError, match=r"shape must be auto or one of plane, sphere, .* got 'ellipsoid'"):
        fit(BLOB, "ellipsoid")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="metric must be euclidean, taubin or algebraic, got 'l1'"):
        fit(BLOB, "plane", metric="l1")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="robust fits and errors along rays are Euclidean; drop"):
        fit(BLOB, "cylinder", metric="taubin", robust=True)
    with pytest.raises(InputError, match=r"expected points with shape \(n, 3\), got \(3,\)"):
        fit(np.ones(3), "plane")


def test_a_blob_or_a_layer_of_noise_is_no_round_surface() -> None:
    layer = RNG.uniform(-1, 1, (2000, 3)) * [1, 1, 0] + RNG.normal(0, 1e-3, (2000, 1)) * [0, 0, 1]
    with pytest.raises(FitError, match=r"within the noise|no axis direction gives a start"):
        fit(layer, "elliptic-cylinder")
    for robust in (False, True):
        with pytest.raises(
            FitError, match=r"the radius .* m is within the noise, .* m \(a layer or a line\)"
        ):
            fit(BLOB, "cylinder", robust=robust)
    assert select(layer).shape == "plane"


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("shape", first_in_gate(2, SHAPES[1:]))
def test_noise_on_a_plane_is_no_curved_surface(shape, robust) -> None:
    """A cone of 89.9 deg, or a cylinder of 400 m, is what least squares makes of it."""
    reasons = (
        "as well|within the noise|agree on|spans|positive|no convergence|left no surface|gives a start"
        "|condition number|reaches its axis"
    )
    for seed in range(3):
        rng = np.random.default_rng(seed)
        layer = np.column_stack([rng.uniform(-1, 1, (3000, 2)), rng.normal(0, 1e-3, 3000)])
        with pytest.raises(FitError, match=reasons):
            fit(layer, shape, robust=robust)


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_a_bend_is_seen_as_soon_as_it_exceeds_the_noise(shape) -> None:
    """Sag d = 0.5 / R in noise s: chi squared is about n (d / s)^2 times a factor of the shape's form."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(-1, 1, (2, 2000))
    height = (u**2 + v**2 if shape == "sphere" else u**2) / 2
    noise = rng.normal(0, 1e-3, 2000)
    flat, bent = (np.column_stack([u, v, height / radius + noise]) for radius in (1e6, 500.0))
    assert fit(bent, shape).surface.radius == pytest.approx(500, rel=0.2)  # type: ignore[attr-defined]
    with pytest.raises(FitError, match=r"as well \(chi squared .* for \d more|no convergence"):
        fit(flat, shape)


def test_robust_fits_say_what_they_lack() -> None:
    with pytest.raises(FitError, match="a robust fit needs 24 points, got 9"):
        fit(BLOB[:9], "cylinder", robust=True)
    with pytest.raises(FitError, match="none of 600 sets of 2 oriented points spans a cylinder"):
        fit(FLAT, "cylinder", robust=True)
    with pytest.raises(FitError, match=r"only \d+ of 400 points agree on a sphere"):
        consensus_surface(BLOB, BLOB / np.linalg.norm(BLOB, axis=1, keepdims=True), "sphere", 1e-6)
    with pytest.raises(FitError, match=r"only \d+ of 400 points are near any cylinder"):
        fit_robust(BLOB / 100, "cylinder", Cylinder((1e6, 0, 0), (0, 0, 1), 1.0))


def test_a_selection_among_nothing_is_refused() -> None:
    with pytest.raises(FitError, match=r"no shape can be fitted .*\(plane: why\)"):
        weigh({}, {}, {"plane": "why"}, 1.0)
