# SPDX-License-Identifier: MIT
"""Solids: stairs and columns found with their measures, whichever way is up; refused on plain surfaces."""

import numpy as np
import pytest

from benchmarks.cases.solids import solid_room
from completion.features.engine.template import FeatureStatus, Measurements
from completion.features.pipeline import find_features
from completion.features.solids import find_solids
from completion.features.upright_structure import levels
from scenes.checks import InputError
from tests.completion.features.solids.solid_points import column_points, stairs_points

SIGMA = 0.004


def best_fit(points, kind, given=None, **options):
    measured = Measurements(points, SIGMA, 0.03)
    return find_solids(measured, [kind], given or {}, rng=np.random.default_rng(0), **options)[0]


def test_a_flight_is_measured_among_outliers():
    fit = best_fit(stairs_points(np.random.default_rng(1)), "stairs")
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count"] == 6
    for name, true in (("going", 0.28), ("rise", 0.17), ("heading", 0.6)):
        assert abs(fit.value(name) - true) < 4 * fit.deviation(name)
        assert fit.deviation(name) < 0.003
    assert fit.geometry["width"] == pytest.approx(1.0, abs=0.08)
    np.testing.assert_allclose(fit.geometry["axis"], [np.cos(0.6), np.sin(0.6), 0], atol=0.01)
    first, last = fit.geometry["centres"][[0, -1]]
    np.testing.assert_allclose(
        last - first, 5 * np.array([*(0.28 * fit.geometry["axis"][:2]), 0.17]), atol=0.01
    )


@pytest.mark.long
def test_a_tread_that_is_hidden_is_unseen_and_counted():
    points = stairs_points(np.random.default_rng(2), outliers=0.0)
    along = points @ [np.cos(0.6), np.sin(0.6), 0]
    hidden = (along > 0.55) & (along < 0.85)  # the third tread and the risers at both of its ends
    fit = best_fit(points[~hidden], "stairs")
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count"] == 6
    assert "tread 3" in fit.unseen


def test_what_is_known_of_stairs_is_held():
    fit = best_fit(stairs_points(np.random.default_rng(3)), "stairs", {"rise": 0.17, "count": 6})
    assert fit.value("rise") == 0.17
    assert fit.held == ("rise",)
    assert len([name for name in fit.faces if name.startswith("tread")]) == 6


def test_a_column_is_measured_from_one_side():
    fit = best_fit(column_points(np.random.default_rng(4)), "column")
    assert fit.status is FeatureStatus.FOUND
    assert len(fit.unseen) == 1  # the side at the back
    for name, true in (("width", 0.6), ("radius", 0.2)):
        assert abs(fit.value(name) - true) < 4 * fit.deviation(name)
    np.testing.assert_allclose(fit.geometry["centres"][0], [1.0, 2.0, 0.3], atol=0.01)
    np.testing.assert_allclose(fit.geometry["axis"], [0, 0, 1], atol=1e-12)


@pytest.mark.long
def test_up_may_be_any_direction():
    points = column_points(np.random.default_rng(5), outliers=0.0)
    lying = points[:, [2, 0, 1]]  # z becomes x
    fit = best_fit(lying, "column", up=(1.0, 0.0, 0.0))
    assert fit.status is FeatureStatus.FOUND
    np.testing.assert_allclose(fit.geometry["centres"][0], [0.3, 1.0, 2.0], atol=0.01)


@pytest.mark.parametrize("kind", ["stairs", "column"])
def test_plain_surfaces_are_neither(kind):
    rng = np.random.default_rng(6)
    floor = np.column_stack([rng.uniform(-1, 1, (800, 2)), np.zeros(800)])
    wall = np.column_stack([np.ones(800), rng.uniform(-1, 1, 800), rng.uniform(0, 2, 800)])
    pole = rng.uniform(0, 2 * np.pi, 800)
    shaft = np.column_stack([0.3 * np.cos(pole), 0.3 * np.sin(pole), rng.uniform(0, 2, 800)])
    for surfaces in ([floor], [floor, wall], [shaft]):
        points = np.concatenate(surfaces)
        fit = best_fit(points + rng.normal(0, SIGMA, points.shape), kind)
        assert fit.status is not FeatureStatus.FOUND
        assert fit.reason


def test_levels_are_where_heights_gather():
    rng = np.random.default_rng(7)
    heights = np.concatenate([rng.normal(level, 0.004, 200) for level in (0.0, 0.17, 0.51)])
    np.testing.assert_allclose(levels(heights, 0.01, 30), [0.0, 0.17, 0.51], atol=0.003)
    assert len(levels(np.zeros(0), 0.01, 3)) == 0


def test_other_kinds_and_directions_are_refused():
    with pytest.raises(InputError, match="no solid sphere"):
        best_fit(np.zeros((20, 3)), "sphere")
    with pytest.raises(InputError, match="up is a direction"):
        best_fit(np.zeros((20, 3)), "stairs", up=(0, 0, 0))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["stairs", "column"])
def test_it_is_found_in_a_scanned_room(kind):
    scan, true = solid_room(0, kind)
    few = scan.thin(300_000) if kind == "column" else scan
    fit = find_features([few], [kind], rng=0).fits[0]
    assert fit.status is FeatureStatus.FOUND
    for name, value in true.items():
        assert fit.value(name) == pytest.approx(value, abs=4e-3)


@pytest.mark.long
def test_boxes_in_a_scanned_room_are_no_column_and_no_stairs():
    scan, _ = solid_room(0, "boxes")
    fits = find_features([scan.thin(150_000)], ["stairs", "column"], rng=0).found
    assert not fits


def test_points_with_another_up_axis_are_searched_along_it():
    """Rolled so that y is up: the flight is found with --up y, and not as if z were up."""
    points = stairs_points(np.random.default_rng(1))
    rolled = Measurements(points[:, [0, 2, 1]] * [1.0, 1.0, -1.0], SIGMA, 0.03)
    upright = find_features(rolled, ["stairs"], up=(0.0, 1.0, 0.0), rng=0).fits[0]
    assert upright.status is FeatureStatus.FOUND
    assert upright.geometry["count"] == 6
    lying = find_features(rolled, ["stairs"], rng=0).fits[0]
    assert lying.status is not FeatureStatus.FOUND or lying.geometry["count"] != 6
