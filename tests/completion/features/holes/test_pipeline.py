# SPDX-License-Identifier: MIT
"""Hole patterns: what is found of rows, grids and bolt circles, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.cases.plates import mesh
from completion.features import pipeline
from completion.features.engine.template import (
    FeatureStatus,
    Measurements,
    PixelBeams,
    SideState,
    TemplateFit,
)
from completion.features.holes.patterns import KINDS
from completion.features.holes.pipeline import find_holes
from completion.features.pipeline import find_features
from scenes.checks import FloatArray, InputError
from tests.completion.features.holes.plates import plate, row, without

RADIUS, PITCH = 4.0, 15.0
_LONG = (110.0, 36.0)  # of a plate
_BUDGET = 10**7


def best_fit(measured: Measurements, kind: str, **given: float) -> TemplateFit:
    """The best fit of a kind."""
    return find_holes(measured, [kind], given, rng=np.random.default_rng(0), budget=_BUDGET)[0]


@cache
def four() -> tuple[Measurements, TemplateFit]:
    """A row of four, and its fit."""
    measured = plate(np.random.default_rng(8), row(4, PITCH), RADIUS)
    return measured, best_fit(measured, "hole-row")


def off(fit: TemplateFit, centres: FloatArray) -> float:
    """How far true centres (n, 2) of the plate z = 0 are from the fit's, root mean square."""
    space = np.column_stack([centres, np.zeros(len(centres))])
    gap = np.linalg.norm(np.asarray(fit.geometry["centres"])[:, None] - space, axis=2)
    return float(np.sqrt((gap.min(axis=0) ** 2).mean()))


def test_a_row_is_found_and_counted() -> None:
    _, fit = four()
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count"] == 4
    assert off(fit, row(4, PITCH)) < 0.2
    for name, true in (("pitch", PITCH), ("radius", RADIUS)):
        assert abs(fit.value(name) - true) < 4 * fit.deviation(name)
        assert 0 < fit.deviation(name) < 0.1
    assert all(side.is_seen for side in fit.sides)


@pytest.mark.long
def test_a_grid_and_a_bolt_circle_are_found_and_counted() -> None:
    i, j = np.indices((3, 2)).reshape(2, -1)
    grid = np.column_stack([(i - 1) * 16.0, (j - 0.5) * 20.0])
    fit = best_fit(plate(np.random.default_rng(2), grid, RADIUS), "hole-grid")
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count"] == 6
    assert sorted([fit.value("pitch"), fit.value("pitch_2")]) == pytest.approx([16.0, 20.0], abs=0.2)
    turn = 2 * np.pi * np.arange(6) / 6
    circle = 16 * np.column_stack([np.cos(turn), np.sin(turn)])
    fit = best_fit(plate(np.random.default_rng(3), circle, RADIUS, (50.0, 50.0)), "bolt-circle")
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count"] == 6
    assert abs(fit.value("circle_radius") - 16) < 4 * fit.deviation("circle_radius")


def test_a_blank_plate_and_lost_patches_are_refused() -> None:
    blank = plate(np.random.default_rng(4), np.zeros((0, 2)), RADIUS)
    lost = np.random.default_rng(5).uniform(-0.5, 0.5, (10, 2)) * (80, 36)
    for fit in find_holes(without(blank, lost, 3.5), KINDS, {}, rng=np.random.default_rng(0), budget=_BUDGET):
        assert fit.status is not FeatureStatus.FOUND
        assert fit.reason
    assert best_fit(Measurements(blank.points[:50], 0.1, 0.5), "hole-row").status is FeatureStatus.NONE


@pytest.mark.long
def test_a_hole_that_was_lost_is_unseen_and_one_that_is_filled_is_contradicted() -> None:
    centres = row(6, PITCH)
    whole = plate(np.random.default_rng(6), centres, RADIUS, _LONG)
    fit = best_fit(without(whole, centres[2:3], 7.5), "hole-row")
    assert (fit.status, fit.geometry["count"], fit.unseen) == (FeatureStatus.FOUND, 6, ("hole 3",))
    assert "hole 3 is unseen" in fit.reason
    gap = plate(np.random.default_rng(7), np.delete(centres, 2, axis=0), RADIUS, _LONG)
    fit = best_fit(gap, "hole-row")
    assert fit.status is FeatureStatus.FOUND
    absent = [k for k, side in enumerate(fit.sides) if side.state is SideState.CONTRADICTED]
    assert len(absent) == 1
    assert np.asarray(fit.geometry["centres"])[absent[0], :2] == pytest.approx(centres[2], abs=0.5)
    assert f"hole {absent[0] + 1} is absent" in fit.reason


@pytest.mark.long
def test_what_an_end_that_was_lost_leaves_open_is_told() -> None:
    _, fit = four()
    assert fit.geometry["count_range"] == (4, 4)
    centres = row(5, PITCH)
    whole = plate(np.random.default_rng(6), centres, RADIUS)
    fit = best_fit(without(whole, centres[:1], 7.5), "hole-row")
    assert fit.status is FeatureStatus.FOUND
    assert fit.geometry["count_range"] == (4, 5)
    assert "4 to 5 holes" in fit.reason


def test_two_whole_holes_find_those_of_which_a_part_is_left() -> None:
    centres = row(4, PITCH)
    whole = plate(np.random.default_rng(9), centres, RADIUS)
    fit = best_fit(without(whole, centres[[0, 2]] + (0.0, 4.0), 5.0), "hole-row")
    assert fit.status is not FeatureStatus.NONE
    assert fit.geometry["count"] == 4
    assert off(fit, centres) < 0.4


@pytest.mark.long
def test_large_holes_with_many_points_on_their_rims_are_found_as_they_are() -> None:
    centres = row(4, 45.0)
    fit = best_fit(plate(np.random.default_rng(10), centres, 14.0, (220.0, 60.0)), "hole-row")
    assert (fit.status, fit.geometry["count"]) == (FeatureStatus.FOUND, 4)
    assert abs(fit.value("radius") - 14) < 0.2
    assert off(fit, centres) < 0.2


@pytest.mark.long
def test_moved_or_in_another_unit_the_same_is_found() -> None:
    measured, before = four()
    turn, shift = Rotation.from_rotvec([0.3, -1.1, 0.7]), np.array([400.0, -900.0, 120.0])
    moved = replace(measured, points=turn.apply(measured.points) + shift)
    after = best_fit(moved, "hole-row")
    assert after.geometry["count"] == before.geometry["count"] == 4
    places = turn.apply(np.asarray(before.geometry["centres"])) + shift
    gap = np.linalg.norm(np.asarray(after.geometry["centres"])[:, None] - places, axis=2).min(axis=0)
    assert gap.max() < 0.15
    small = best_fit(measured.scale(1e-3), "hole-row")
    assert small.value("pitch") == pytest.approx(before.value("pitch") * 1e-3, rel=1e-3)
    assert small.evidence == pytest.approx(before.evidence, abs=1.0)


@pytest.mark.long
def test_a_mesh_tells_circles_exactly() -> None:
    corners, faces = mesh(row(4, PITCH) + (60.0, 40.0), RADIUS)
    fit = best_fit(Measurements(corners, noise=0.0, spacing=1.0, faces=faces), "hole-row")
    assert (fit.status, fit.geometry["count"]) == (FeatureStatus.FOUND, 4)
    assert fit.value("pitch") == pytest.approx(PITCH, abs=1e-9)
    assert fit.value("radius") == pytest.approx(RADIUS, abs=1e-9)
    assert len(fit.assignment) == len(corners)


@pytest.mark.long
def test_where_beams_go_on_beside_a_row_but_not_through_it_it_was_lost() -> None:
    holes = plate(np.random.default_rng(13), row(4, PITCH), RADIUS)
    holes = without(holes, np.array([[-36.0, 12.0]]), 2.5)
    eye = np.array([5.0, -10.0, 300.0])

    def status(gaps: FloatArray) -> TemplateFit:
        below = np.column_stack([gaps, np.zeros(len(gaps))])
        targets = np.concatenate([holes.points, eye + (below - eye) * 1.5])
        ray = targets - eye
        length = np.linalg.norm(ray, axis=1)
        beams = PixelBeams(np.tile(eye, (len(ray), 1)), ray / length[:, None], length)
        return best_fit(replace(holes, points=targets, beams=beams), "hole-row")

    beside = np.random.default_rng(14).uniform(-1.5, 1.5, (20, 2)) + (-36.0, 12.0)
    lost = status(beside)
    assert (lost.status, "lost data" in lost.reason) == (FeatureStatus.NONE, True)
    through = (row(4, PITCH)[:, None] + 0.5 * beside[None, :10] + (18.0, -6.0)).reshape(-1, 2)
    assert status(np.concatenate([beside, through])).status is FeatureStatus.FOUND


@pytest.mark.long
def test_the_order_of_points_matters_little_and_the_seed_decides() -> None:
    measured, first = four()
    second = best_fit(measured, "hole-row")
    assert first.x.tobytes() == second.x.tobytes()
    mixed = np.random.default_rng(10).permutation(len(measured.points))
    other = best_fit(replace(measured, points=measured.points[mixed]), "hole-row")
    assert other.value("pitch") == pytest.approx(first.value("pitch"), abs=3 * first.deviation("pitch"))
    np.testing.assert_array_equal(other.assignment, first.assignment[mixed])


def test_a_row_ends_before_a_patch_in_which_nobody_saw_a_hole() -> None:
    centres = row(6, 16.0)
    whole = plate(np.random.default_rng(15), centres[:4], RADIUS, _LONG)
    fit = best_fit(without(whole, centres[4:], 9.0), "hole-row")
    assert (fit.status, fit.geometry["count"]) == (FeatureStatus.FOUND, 4)
    least, most = np.asarray(fit.geometry["count_range"])
    assert least == 4 < most


def test_given_values_are_held() -> None:
    measured = plate(np.random.default_rng(11), row(5, PITCH), RADIUS)
    fit = best_fit(measured, "hole-row", pitch=15.05, radius=4.02, count=4)
    assert (fit.value("pitch"), fit.value("radius"), fit.geometry["count"]) == (15.05, 4.02, 4)
    assert fit.deviation("pitch") == fit.deviation("radius") == 0.0
    assert set(fit.held) == {"pitch", "radius"}


def test_unknown_kinds_and_impossible_values_are_refused() -> None:
    blank = plate(np.random.default_rng(12), np.zeros((0, 2)), RADIUS)
    with pytest.raises(InputError, match="no pattern of holes called door"):
        best_fit(blank, "door")
    with pytest.raises(InputError, match=r"pitch is given as -1"):
        best_fit(blank, "hole-row", pitch=-1)


def test_patterns_of_three_kinds_share_one_survey_of_the_plates(monkeypatch) -> None:
    searched = []

    def find(_measured, kinds, _given, **_options):
        searched.append(tuple(kinds))
        return []

    for kind in KINDS:
        monkeypatch.setitem(pipeline._FINDERS, kind, find)
    points = np.random.default_rng(0).uniform(size=(100, 3))
    measured = Measurements(points, 0.001, 0.1)
    find_features(measured, KINDS, rng=0)
    find_features(measured, KINDS, given={"hole-row": {"count": 6.0}}, rng=0)
    assert searched == [tuple(KINDS), ("hole-row",), tuple(kind for kind in KINDS if kind != "hole-row")]
