# SPDX-License-Identifier: MIT
"""Level and upright: one angle for planes and axes, and its uncertainty."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from completion.fitting.result import SurfaceFit
from scenes.inclination import LEVEL_COSINE, LIMIT_DEG, Inclination
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere

UP = np.array([0.0, 0.0, 1.0])


def tilted(degrees, turn=0.0):
    """A direction that many degrees off up."""
    angle, turn = np.radians(degrees), np.radians(turn)
    return np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])


@given(st.floats(0, 90), st.floats(0, 360), st.sampled_from([-1.0, 1.0]))
def test_planes_rise_as_their_normals_tilt_and_axes_the_other_way(degrees, turn, sign):
    direction = sign * tilted(degrees, turn)
    plane, axis = Inclination.of_plane(direction, UP), Inclination.of_axis(direction, UP)
    assert plane.angle_deg == pytest.approx(degrees, abs=1e-6)
    assert axis.angle_deg == pytest.approx(90 - degrees, abs=1e-6)
    assert plane.is_level == axis.is_upright
    assert plane.is_upright == axis.is_level
    assert not (plane.is_level and plane.is_upright)


@pytest.mark.parametrize(
    ("degrees", "normal_sd", "up_sd", "level"),
    [
        (9.9, 0.0, 0.0, True),
        (10.1, 0.0, 0.0, False),
        (10.1, 0.2, 0.0, True),
        (10.1, 0.0, 0.2, True),
        (14.9, 3.0, 4.0, True),
        (15.1, 3.0, 4.0, False),
        (19.9, 50.0, 0.0, True),
        (20.1, 50.0, 0.0, False),
        (10.1, np.nan, 0.0, False),
    ],
)
def test_the_limit_widens_by_a_standard_deviation_and_at_most_doubles(degrees, normal_sd, up_sd, level):
    covariance = np.diag([1.0, 0.0, 0.0]) * np.radians(normal_sd) ** 2
    assert Inclination.of_plane(tilted(degrees), UP, covariance, up_sd).is_level == level


def test_fits_know_their_inclination_and_its_deviation():
    slope_sd = np.radians(0.5)
    plane = SurfaceFit(Plane((1, 2, 3), tilted(10.3)), 0.001, np.diag([1e-6, slope_sd**2, 1e-12]), 100)
    assert plane.inclination(UP).sd_deg == pytest.approx(0.5)
    assert plane.inclination(UP).is_level
    axis_sd = np.radians(2.0)
    covariance = np.diag([1e-8, 1e-8, axis_sd**2, axis_sd**2, 1e-8])
    column = SurfaceFit(Cylinder((0, 0, 0), tilted(20.0), 0.1), 0.001, covariance, 100)
    assert column.inclination(UP).angle_deg == pytest.approx(70.0)
    assert column.inclination(UP).sd_deg == pytest.approx(2.0)
    assert not column.inclination(UP).is_upright
    ball = SurfaceFit(Sphere((0, 0, 0), 1.0), 0.001, np.eye(4), 100).inclination(UP)
    assert not ball.is_level
    assert not ball.is_upright


def test_the_cosine_of_many_normals_is_that_of_the_limit():
    assert pytest.approx(np.cos(np.radians(LIMIT_DEG))) == LEVEL_COSINE
