# SPDX-License-Identifier: MIT
"""Beams that the room looks at: thinned evenly, in all columns by turns, and as far apart as they say."""

from __future__ import annotations

import numpy as np
import pytest

from completion.room.planes import Beams, RoomPlane, level_roles
from scenes.surfaces.catalogue import Plane
from tests.helpers.completion_examples import completed

UP = np.array([0.0, 0.0, 1.0])


def level(z_m, area_m2, normal=(0.0, 0.0, 1.0), at=(0.0, 0.0)):
    """A level piece that was measured to 1 mm."""
    middle = np.array([*at, z_m])
    return RoomPlane(
        surface=None,
        plane=Plane(middle, normal),
        points=middle[None],
        middle=middle,
        area_m2=area_m2,
        tilt_sd=1e-3,
        sd_m=1e-3,
        bias_m=1e-3,
        sigma_m=1e-3,
    )


def beams_to(points):
    """Beams from the origin, 1 mm exact."""
    points = np.array(points, dtype=np.float64)
    even = np.full(len(points), 1e-3)
    return Beams(np.zeros_like(points), points, even, even)


@pytest.fixture(scope="module")
def seen():
    return completed("two_occluders", pixels=120).observations[0]


def test_thinned_beams_look_into_all_columns(seen):
    """Beams of every eighth row and column would look into an eighth of them."""
    most = np.count_nonzero(seen.valid) // 64
    beams = Beams.of([seen], most)
    assert len(beams.point) == pytest.approx(most, rel=0.2)
    columns = np.unique(np.rint(seen.scan.pixels(beams.point)[:, 1]))
    assert len(columns) > 0.8 * seen.valid.shape[1]


def test_beams_say_how_far_the_next_one_is(seen):
    beams = Beams.of([seen], np.count_nonzero(seen.valid) // 64)
    ways = beams.point - beams.origin
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    cosines = np.clip(ways @ ways.T - 2 * np.eye(len(ways)), -1, 1)
    nearest = np.arccos(cosines.max(axis=1))
    assert np.median(nearest / beams.apart) == pytest.approx(1.0, abs=0.3)


def test_all_beams_are_taken_where_there_are_few(seen):
    assert len(Beams.of([seen], 10**9).point) == np.count_nonzero(seen.valid)


def test_a_floor_may_lie_close_below_a_scanner_and_a_table_may_not():
    """Robots carry scanners low; no table is as large as what they then see."""
    x, y = (side.ravel() for side in np.meshgrid(np.linspace(-3, 3, 40), np.linspace(-3, 3, 40)))
    beams = beams_to(np.column_stack([x, y, np.full(x.size, -0.35)]))
    near, far, table = level(-0.35, 1.0), level(-0.36, 9.0, at=(2.0, 0.0)), level(-0.35, 1.5)
    assert level_roles([near, far], beams, UP, 0.0) == ["floor", "floor"]
    assert level_roles([table], beams, UP, 0.0) == ["base"]
    assert level_roles([level(0.5, 9.0)], beams, UP, 0.0) == [""]  # above the scanner


def test_a_floor_may_lean_and_a_landing_has_steps_below():
    """A floor that leans by .8 degrees lies 14 cm lower 10 m away."""
    x = np.linspace(-10, 10, 400)
    lean = np.tan(np.radians(0.8))
    leaning = beams_to(np.column_stack([x, np.zeros_like(x), -1.5 - lean * x]))
    assert level_roles([level(-1.5, 3.0)], leaning, UP, 0.0) == ["floor"]
    stairs = beams_to(np.column_stack([x, np.zeros_like(x), np.where(x > 8, -2.0, -1.5)]))
    assert level_roles([level(-1.5, 3.0)], stairs, UP, 0.0) == [""]
