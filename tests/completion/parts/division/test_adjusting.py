# SPDX-License-Identifier: MIT
"""The compiled steps against those of `completion.fitting.euclidean`."""

import numpy as np
import pytest

from completion.fitting.chart import axis_frame
from completion.fitting.euclidean import ScaledCloud, normal_equations, polish_chart
from completion.fitting.kinds import chart_of
from completion.parts.division.adjusting import n_within, row_of
from completion.parts.division.growing import refine_surface
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

_PLACE = np.array([0.3, -0.2, 5.0])
_AXIS = np.array([0.48, -0.6, 0.64])
_SURFACES = [
    Plane(_PLACE, _AXIS, axis_frame(_AXIS)[0]),
    Sphere(_PLACE, 0.02),
    Cylinder(_PLACE, _AXIS, 0.015),
    Cone(_PLACE, _AXIS, 0.015, 0.4),
    Torus(_PLACE, _AXIS, 0.03, 0.008),
]


def _near(surface, rng):
    """Points (400, 3) of a part of a surface, with noise of .05 mm, and one in twenty off it."""
    points = _PLACE + rng.uniform(-0.03, 0.03, (60_000, 3))
    points = points[(np.abs(surface.distance(points)) < 5e-5) & ((points - _PLACE)[:, 0] > 0)][:400]
    points += rng.normal(0, 5e-5, points.shape)
    points[::20] += rng.normal(0, 1e-2, points[::20].shape)
    return points


@pytest.mark.parametrize("surface", _SURFACES, ids=lambda surface: surface.kind)
def test_steps_are_those_of_the_fits(surface):
    rng, tolerance = np.random.default_rng(4), 4e-4
    points = _near(surface, rng)
    row = row_of(surface)[1]
    assert n_within(row_of(surface)[0], row, points, tolerance) == np.sum(
        np.abs(surface.distance(points)) <= tolerance
    )
    found, covariance = refine_surface(surface, points, tolerance)
    centre = points.mean(axis=0)
    scale = np.sqrt(np.mean(np.sum((points - centre) ** 2, axis=1)))
    weights = np.maximum(1 - (surface.distance(points) / (4.685 * tolerance)) ** 2, 0.0) ** 2
    cloud = ScaledCloud(points, centre, scale, weights)
    chart, normal, _ = polish_chart(chart_of(surface, centre, scale), cloud, surface.kind)
    if hasattr(chart, "turn_to_growth"):
        chart = chart.turn_to_growth()
        normal = normal_equations(chart, cloud)
    wanted = chart.surface(centre, scale, False)
    assert np.abs(found.distance(points) - wanted.distance(points)).max() < 0.01 * tolerance
    units = np.where(chart.lengths() > 0, 1.0, 1 / scale)
    expected = tolerance**2 * normal.inverse() * np.outer(units, units)
    deviations = np.sqrt(np.diag(expected))
    assert (
        np.abs(
            covariance / np.outer(deviations, deviations) - expected / np.outer(deviations, deviations)
        ).max()
        < 0.02
    )


def test_points_that_determine_nothing_give_nothing():
    line = _PLACE + np.linspace(0, 0.1, 50)[:, None] * _AXIS
    for surface in _SURFACES:
        assert refine_surface(surface, line, 1e-4) is None
        assert refine_surface(surface, line[:2], 1e-4) is None
