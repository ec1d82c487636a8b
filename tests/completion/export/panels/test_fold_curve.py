# SPDX-License-Identifier: MIT
"""Fold curves: they lie on both surfaces, are parametrised by metres, and are straight between stations."""

import numpy as np
import pytest

from completion.export.panels.fold import RoundFold, SideFold, StraightFold, facet_lines, fold_curves
from completion.export.panels.limits import CHORD_M
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere

FLOOR = Plane((0, 0, 0.3), (0, 0, 1))
POST = Cylinder((0.4, 0.2, 0), (0, 0, 1), 0.25)
LEANING = Cylinder((0.4, 0.2, 0), (0.3, 0.1, 1), 0.25)
WALL = Plane((0.5, 0, 0), (-1, 0, 0))
SLOPING = Plane((0.5, 0, 0), (-1, 0, 0.05))
BOX = np.array([[-2.0, -2, -2], [2, 2, 2]])
PAIRS = [(FLOOR, WALL), (FLOOR, POST), (POST, FLOOR), (FLOOR, LEANING), (WALL, POST), (SLOPING, POST)]


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_curves_lie_on_both_surfaces(first, second):
    curves = fold_curves(first, second)
    assert curves
    for curve in curves:
        points = curve.at(np.linspace(*curve.span(BOX), 101))
        assert np.abs(first.distance(points)).max() < 1e-9
        assert np.abs(second.distance(points)).max() < 1e-9


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_chords_between_stations_are_near_the_curve(first, second):
    for curve in fold_curves(first, second):
        low, high = curve.span(BOX)
        stations = curve.stations(low, high)
        assert stations[[0, -1]] == pytest.approx([low, high])
        assert (np.diff(stations) > 0).all()
        middles = (curve.at(stations[1:]) + curve.at(stations[:-1])) / 2
        off = np.maximum(np.abs(first.distance(middles)), np.abs(second.distance(middles)))
        assert off.max() <= 1.05 * CHORD_M


def test_the_kind_of_a_curve_follows_from_how_a_plane_stands_to_the_axis():
    assert [type(curve) for curve in fold_curves(FLOOR, WALL)] == [StraightFold]
    assert [type(curve) for curve in fold_curves(FLOOR, POST)] == [RoundFold]
    assert [type(curve) for curve in fold_curves(WALL, POST)] == [SideFold, SideFold]


@pytest.mark.parametrize(
    "other",
    [
        Plane((0, 0, 1), (0, 0.1, 1)),  # less than 12 degrees
        Plane((0, 0, 1), (0, 0, 1)),
        Sphere((0, 0, 0), 1.0),
    ],
)
def test_nearly_parallel_planes_and_other_surfaces_have_none(other):
    assert fold_curves(FLOOR, other) == []


def test_a_wall_beside_a_post_does_not_meet_it():
    assert fold_curves(Plane((1.0, 0, 0), (-1, 0, 0)), POST) == []


def test_facets_go_round_a_whole_number_of_times():
    lines = facet_lines(POST, -POST.period / 2, POST.period / 2)
    assert np.ptp(np.diff(lines)) < 1e-12
    count = POST.period / np.diff(lines)[0]
    assert count == pytest.approx(round(count))
