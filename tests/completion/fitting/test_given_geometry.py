# SPDX-License-Identifier: MIT
"""Given values are held to the last digit, and the rest is the constrained least-squares answer of scipy."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, EllipticCylinder, Plane, Sphere, Torus, surfaces_close
from scenes.surfaces.surface import perpendicular
from tests.completion.fitting.test_laws import SIGMA, SURFACES, sampled
from tests.helpers.long_cases import first_in_gate

AXIS = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
TILTED = AXIS + 0.004 * perpendicular(AXIS)
CASES = [
    ("plane", {"axis": (1.01, 2, 3)}),
    ("sphere", {"radius": 0.701}),
    ("cylinder", {"radius": 0.701}),
    ("cylinder", {"axis": TILTED}),
    ("cylinder", {"radius": 0.701, "axis": TILTED}),
    ("cylinder", {"radius": 0.701, "axis": -5 * TILTED}),
    ("cone", {"axis": TILTED}),
    ("cone", {"axis": -TILTED}),
    ("elliptic-cylinder", {"axis": TILTED}),
    ("torus", {"radius": 0.701}),
    ("torus", {"axis": TILTED}),
    ("torus", {"radius": 0.701, "axis": TILTED}),
]
EACH = pytest.mark.parametrize(("shape", "given"), CASES)


def reference(shape, points, given):
    """Least squares over a plain parametrisation, the given values put in: no chart of ours takes part."""
    true = SURFACES[shape]
    axis = given.get("axis", AXIS if shape != "plane" else true.normal_direction)
    axis = np.asarray(axis) / np.linalg.norm(axis)
    first = perpendicular(axis)
    second = np.cross(axis, first)

    def made(x):
        turned = axis if "axis" in given else axis + x[3] * first + x[4] * second
        place = (true.centre if shape in ("sphere", "torus") else true.point) + x[:3]
        size = given.get("radius", 0.7 + x[5])
        if shape == "plane":
            return Plane(place, turned)
        if shape == "sphere":
            return Sphere(place, size)
        if shape == "cylinder":
            return Cylinder(place, turned, size)
        if shape == "cone":
            sign = np.sign(turned @ AXIS)
            return Cone(place, sign * turned, 0.7 + x[5], 0.5 + x[6])
        if shape == "torus":
            return Torus(place, turned, size, 0.4 + x[6])
        ahead = perpendicular(AXIS) + x[7] * np.cross(AXIS, perpendicular(AXIS))
        return EllipticCylinder(place, turned, (0.7 + x[5], 0.4 + x[6]), ahead)

    estimate = least_squares(
        lambda x: made(x).distance(points), np.zeros(8), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return made(estimate.x), 2 * estimate.cost


@EACH
def test_given_values_hold_and_the_rest_is_the_constrained_optimum(shape, given):
    points = sampled(shape, np.random.default_rng(0), 500)
    estimate = fit(points, shape, **given)
    surface, parameters = estimate.surface, estimate.parameters()
    if "radius" in given:
        assert surface.radius == given["radius"]
    if "axis" in given:
        held = np.asarray(parameters["normal" if shape == "plane" else "direction"])
        unit = np.asarray(given["axis"]) / np.linalg.norm(given["axis"])
        assert np.abs(held - np.sign(held @ unit) * unit).max() < 1e-15
    expected, cost = reference(shape, points, given)
    assert surfaces_close(surface, expected, angle=1e-6, length=1e-6)
    residual = surface.distance(points)
    assert residual @ residual <= cost * (1 + 1e-9)
    n_held = 2 * ("axis" in given) + ("radius" in given)
    assert estimate.degrees_of_freedom == 500 - len(estimate.covariance) + n_held
    assert estimate.rms == pytest.approx(np.sqrt(cost / estimate.degrees_of_freedom), rel=1e-9)


@EACH
def test_what_is_held_has_no_variance_and_the_rest_less_than_before(shape, given):
    points = sampled(shape, np.random.default_rng(1), 500)
    estimate, free = fit(points, shape, **given), fit(points, shape)
    deviations = estimate.parameter_deviations()
    for name in estimate.held:
        assert deviations[name] == 0.0
    assert set(estimate.held) == {
        {"axis": "normal" if shape == "plane" else "direction"}.get(name, name) for name in given
    }
    scale = (estimate.rms / free.rms) ** 2
    assert (np.diag(estimate.covariance) <= np.diag(free.covariance) * scale * 1.3 + 1e-18).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("shape", "given"),
    first_in_gate(
        1,
        [
            ("cylinder", {"radius": 0.7}),
            ("cylinder", {"radius": 0.7, "axis": AXIS}),
            ("torus", {"radius": 0.7, "axis": AXIS}),
            ("sphere", {"radius": 0.7}),
            ("plane", {"axis": (1, 2, 3)}),
        ],
    ),
)
def test_predicted_deviations_are_those_of_repeated_fits(shape, given):
    rng = np.random.default_rng(3)
    probes = SURFACES[shape].from_uv(np.array([[0.6, 0.4], [-0.5, 0.2], [0.1, -0.4]]))
    fits = [fit(sampled(shape, rng), shape, **given) for _ in range(60)]
    off = [estimate.surface.distance(probes) for estimate in fits]
    predicted = [estimate.standard_deviation(probes) for estimate in fits]
    ratio = np.sqrt(np.mean(np.square(off), axis=0)) / np.mean(predicted, axis=0)
    np.testing.assert_allclose(ratio, 1, atol=4 / np.sqrt(2 * 60))


@EACH
def test_robust_fits_hold_them_among_outliers(shape, given):
    rng = np.random.default_rng(5)
    good = sampled(shape, rng, 1_000)
    bad = rng.uniform(good.min(axis=0) - 0.1, good.max(axis=0) + 0.1, (300, 3))
    exact = {"radius": 0.7, "axis": (1, 2, 3) if shape == "plane" else AXIS}
    given = {name: exact[name] for name in given}
    estimate = fit(np.concatenate([good, bad]), shape, robust=True, **given)
    assert surfaces_close(SURFACES[shape], estimate.surface, angle=0.01, length=0.01)
    assert estimate.rms == pytest.approx(SIGMA, rel=0.15)
    assert all(estimate.parameter_deviations()[name] == 0.0 for name in estimate.held)
    assert "radius" not in given or estimate.surface.radius == 0.7


def test_along_rays_they_hold_too():
    points = sampled("cylinder", np.random.default_rng(6), 400)
    rays = points - np.array([5.0, 3.0, 4.0])
    estimate = fit(points, "cylinder", rays=rays, radius=0.7, axis=AXIS)
    assert estimate.surface.radius == 0.7
    assert estimate.held == ("direction", "radius")
    assert np.linalg.matrix_rank(estimate.covariance) == 2


def test_a_short_noisy_arc_is_placed_by_its_radius():
    """10 deg of a bore: free, its radius is anything; given, its axis is known to tenths of a millimetre."""
    rng = np.random.default_rng(0)
    angle, height = np.radians(rng.uniform(-5, 5, 400)), rng.uniform(-0.02, 0.02, 400)
    reach = 0.06 + rng.normal(0, 2e-5, 400)
    points = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), height])
    estimate = fit(points, "cylinder", radius=0.06, axis=(0, 0, 1))
    assert np.hypot(*estimate.surface.point[:2]) < 5 * estimate.parameter_deviations()["point"] < 1e-3
    assert estimate.surface.point[0] < 0.01  # on the side to which it bends


@pytest.mark.parametrize("start", [None, Cylinder((1.1, 2, 3), (0.25, 0.2, 1), 0.75)])
def test_fits_with_given_values_move_with_the_points(start):
    points = sampled("cylinder", np.random.default_rng(2))
    turn, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    pose = Pose.from_parts(turn * np.sign(np.linalg.det(turn)), np.array([5.0, -3, 2]))
    here = fit(points, "cylinder", radius=0.7, axis=AXIS, start=start)
    moved = None if start is None else start.transform(pose)
    there = fit(pose.apply(points), "cylinder", radius=0.7, axis=pose.rotate(AXIS), start=moved)
    assert surfaces_close(here.surface.transform(pose), there.surface, angle=1e-12, length=1e-9)


@pytest.mark.parametrize(
    ("shape", "given", "message"),
    [
        ("auto", {"radius": 1.0}, "a given radius or axis is that of a shape; name it in place of auto"),
        ("plane", {"radius": 1.0}, "a plane has no one radius to be given"),
        ("cone", {"radius": 1.0}, "a cone has no one radius to be given; its axis can be given"),
        ("elliptic-cylinder", {"radius": 1.0}, "an elliptic cylinder has no one radius"),
        ("sphere", {"axis": (0, 0, 1)}, "a sphere has no axis to be given"),
        ("cylinder", {"radius": 0.0}, "radius must be a positive number of metres, got 0"),
        ("cylinder", {"radius": np.nan}, "radius must be a positive number of metres, got nan"),
        ("cylinder", {"radius": "1"}, "radius must be a number of metres, got '1'"),
        ("cylinder", {"axis": (0, 0, 0)}, r"axis has length 0\.0"),
        ("cylinder", {"axis": (0, 1)}, "axis"),
        ("cylinder", {"radius": 1.0, "metric": "taubin"}, "given values are held by Euclidean fits alone"),
    ],
)
def test_what_cannot_be_given_is_refused_in_one_line(shape, given, message):
    with pytest.raises(InputError, match=message) as caught:
        fit(sampled("cylinder", np.random.default_rng(0)), shape, **given)
    assert "\n" not in str(caught.value)


def test_values_that_the_points_contradict_are_told_by_the_residual_or_refused():
    points = sampled("cylinder", np.random.default_rng(0))
    assert fit(points, "cylinder", radius=0.8).rms > 5 * SIGMA
    with pytest.raises(FitError, match=r"none of .* starts is near|reaches its axis"):
        fit(sampled("torus", np.random.default_rng(0)), "torus", radius=0.01)
