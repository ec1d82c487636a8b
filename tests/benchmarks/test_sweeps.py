# SPDX-License-Identifier: MIT
"""Sweep scenes hide what they say; radii, noise and mixed pixels are what they are called."""

import numpy as np
import pytest

from benchmarks.cases.sweeps import table_case, wall_case
from benchmarks.metrics.completion import radius_errors
from benchmarks.suites.completion import SWEEPS, Bench, Task
from benchmarks.suites.summary import sweep_record, sweep_table
from completion import CompletionOptions
from nbv.scanning.effects import NO_EFFECTS
from nbv.scanning.sensor import PinholeSensor, View
from scenes.surfaces.catalogue import Cylinder
from tests.helpers.sweep_examples import small_column, with_few_pixels

METHODS = {"standard": CompletionOptions(texture=False)}


def measured(name: str, level: float, seed: int) -> dict[str, float]:
    """What each case at a level of a sweep measures."""
    values = {}
    cases, _, effects, measure = SWEEPS[name].at(level, seed)
    assert measure is not None
    for kind, whole in cases.items():
        case = with_few_pixels(whole)
        task = Task(case, METHODS, "none", effects, 0, measure)
        values[kind] = measure(task, case.cells(case.scans(NO_EFFECTS, 0)))
    return values


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("percent", [10, 40, 70])
def test_boards_hide_the_share_that_is_asked_for(percent: float, seed: int) -> None:
    for share in measured("occlusion", percent, seed).values():
        assert share == pytest.approx(percent, abs=2)  # a row of cells is 1.7 % of a narrow table


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("arc", [40, 100, 160])
def test_boards_leave_the_arc_that_is_asked_for(arc: float, seed: int) -> None:
    (seen,) = measured("arc", arc, seed).values()
    assert seen == pytest.approx(arc, abs=np.degrees(2 * 0.01 / 0.15))  # a cell on either side


def test_without_boards_one_sees_less_than_half_of_a_column() -> None:
    (seen,) = measured("arc", 180, 0).values()
    assert seen == pytest.approx(2 * np.degrees(np.arccos(1 / 18)), abs=np.degrees(2 * 0.01 / 0.15))


def test_scenes_come_from_their_seed() -> None:
    for case in (wall_case, table_case):
        assert case(0.3, 1).fingerprint == case(0.3, 1).fingerprint
        assert case(0.3, 1).fingerprint != case(0.3, 2).fingerprint != case(0.4, 2).fingerprint


def test_noise_is_what_the_level_says() -> None:
    for level, sigma in ((0, 0.0), (5, 0.005)):
        cases, _, effects, _ = SWEEPS["noise"].at(level, 0)
        scan = with_few_pixels(cases["rooms"]).scans(effects, 0)[0]
        assert scan.truth is not None
        stray = (scan.ranges - scan.truth.ranges)[scan.valid]
        assert stray.std() == pytest.approx(sigma, rel=4 / np.sqrt(2 * stray.size))


@pytest.mark.long
def test_wider_beams_mix_more_pixels() -> None:
    shares = []
    for level in (0, 1, 4):
        cases, name, effects, measure = SWEEPS["mixed-pixels"].at(level, 1)
        assert measure is not None
        task = Task(with_few_pixels(cases["rooms"]), METHODS, name, effects, 1000)
        shares.append(measure(task, ()))
    assert shares[0] == 0
    assert 0 < shares[1] < shares[2] < 30


@pytest.mark.long
def test_radii_of_cylinders_are_compared_and_missed_ones_are_infinite() -> None:
    case = small_column(120)
    scans = case.scans(NO_EFFECTS, 0)
    index = case.scene.surface_names.index("column")
    true = case.scene.surfaces[index]
    assert isinstance(true, Cylinder)
    wide = Cylinder(true.point, true.direction, true.radius + 0.003)
    floor = case.scene.surfaces[0]
    assert floor is not None
    continues = np.array([0, index, index], np.int32)
    assert radius_errors(case.model, scans, [floor, wide, true], continues).tolist() == pytest.approx([0.003])
    assert radius_errors(case.model, scans, [floor], continues[:1]).tolist() == [np.inf]
    assert len(radius_errors(case.model, scans, [floor], continues[:1], min_pixels=10**6)) == 0
    exact = Bench.of(Task(case, METHODS, "none", NO_EFFECTS, 0), None).outcome("standard")
    assert exact.radius_m.tolist() == pytest.approx([0], abs=1e-4)


@pytest.mark.long
def test_a_sweep_is_a_table() -> None:
    sweep = SWEEPS["arc"]
    results = []
    for level in sweep.levels[3:5]:
        task = Task(small_column(level), METHODS, "none", NO_EFFECTS, 0, lambda _task, _cells: 99.0)
        results.append(("column", level, Bench.of(task).outcome("standard")))
    record = sweep_record(sweep, results)
    table = sweep_table(record, "column").splitlines()
    assert len(table) == 4
    assert {row.count("|") for row in table} == {table[0].count("|")}
    assert table[2].startswith("| 100 | 99.0 (99.0..99.0) | 1 |")


def test_views_of_sweeps_see_all_that_is_scored() -> None:
    large = PinholeSensor(fov_deg=62.7, width=160, height=120)
    for seed in range(4):
        for build in (wall_case, table_case):
            case = build(0.3, seed)
            assert case.views[0].sensor.projection.shape[1] == 480
            view = View(case.views[0].world_from_sensor, large)
            (index,) = np.flatnonzero(case.model.scored)
            corners = case.scene.mesh.corners[case.scene.mesh.face_surface == index].reshape(-1, 3)
            assert large.sees(view.world_from_sensor.inverse().apply(corners)).all()
