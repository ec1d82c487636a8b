# SPDX-License-Identifier: MIT
"""The study of docs/results/paper-study.md: planners keep their order, the page its tables."""

import importlib.util
import re

import numpy as np
import pytest
from PIL import Image

from benchmarks.suites import paper_study
from scenes.world.builtin import builtin_scene
from tests.helpers.data_paths import ROOT


@pytest.fixture(scope="module")
def score():
    return paper_study


@pytest.fixture(scope="module")
def plot():
    spec = importlib.util.spec_from_file_location("plot_paper_study", ROOT / "examples/plot_paper_study.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def problem(score):
    sensor = score.load_sensor("generic60cone")
    return score.Problem.of(builtin_scene("two_occluders"), sensor, 0.5, n_starts=1)


@pytest.fixture(scope="module")
def results(score, problem):
    small = {"POLISH_STEPS": 500, "N_RUNS": 3, "MOST_VIEWS": 60}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in small.items():
            patch.setattr(score, name, value)
        return score.measure(problem, score.STUDIES, (75,))


@pytest.mark.long
def test_who_knows_the_room_needs_no_more_views(score, results):
    offline, greedy, blind = (results[name, 75] for name in ("offline", "greedy", "random"))
    for share in score.SHARES:
        assert offline.at_least[share] <= offline.views(share) <= greedy.views(share) <= blind.views(share)
    assert offline.views(0.95) <= results["online", 75].views(0.95)


@pytest.mark.long
def test_shares_only_grow_and_never_pass_all(results):
    for result in results.values():
        for run in result.runs:
            assert (np.diff(run) >= -1e-12).all()
            assert 0 < run[0] <= run[-1] <= 1 + 1e-9


@pytest.mark.long
def test_the_explorer_is_measured_as_all_others_are(score, problem, results):
    (poses,), (run,) = results["online", 75].poses, results["online", 75].runs
    candidates = problem.candidates
    place = [np.linalg.norm(candidates.positions - pose.translation, axis=1).argmin() for pose in poses]
    way = [(candidates.directions @ pose.rotation[:, 2]).argmax() for pose in poses]
    numbers = [int(i * candidates.n_directions + j) for i, j in zip(place, way, strict=True)]
    assert score.curve(problem.instance(75), numbers) == pytest.approx(run, abs=1e-9)


def test_tripods_stand_on_the_floor_alone(score):
    caster = builtin_scene("two_occluders").ray_caster(1)  # the low box covers x 1.5..2.9, y 1.5..2.5
    places = np.array(
        [[1.0, 2.0, 1.6], [2.0, 2.0, 1.6], [1.45, 2.0, 1.6], [2.95, 2.55, 1.6], [3.1, 2.0, 2.2]]
    )
    assert score.stands_on_floor(caster, places).tolist() == [True, False, False, False, True]


def test_cells_say_what_was_not_reached(score):
    runs = [np.array([0.5, 0.96, 0.995]), np.array([0.6, 0.9, 0.95, 1.0]), np.array([0.7, 0.9, 0.96, 0.97])]
    result = score.Result(runs)
    assert [result.cell(share) for share in score.SHARES] == ["3 (3)", "4 (1 never)", "no: 99.5 % after 4"]
    assert score.Result(runs[1:2]).cell(1.0) == "4"
    assert score.Result(runs[1:2], at_least={1.0: 3}).cell(1.0) == "4 (\u2265 3)"
    assert [score.shown(share) for share in (0.99999, 1.0)] == ["99.9", "100"]


def test_the_tail_is_counted_to_where_a_planner_ends(score):
    runs = {(name, angle): score.Result([np.array([0.5, 0.95, 0.99, 0.995])])
            for name in ("online", "offline") for angle in score.ANGLES}  # fmt: skip
    rows = score.tail(runs, (score.ONLINE, score.OFFLINE)).splitlines()
    assert rows[2] == "| every part seen | 2 | 2 | 1 | 2 | 2 | 1 |"
    assert len(rows) == 2 + len(score.ANGLES)


def test_labels_are_pushed_apart_in_order(plot):
    assert plot.apart({1: 0.0, 2: 0.9, 3: 0.1}, 0.25) == pytest.approx({1: 0.0, 3: 0.25, 2: 0.9})


@pytest.mark.long
def test_pictures_and_page_are_made(plot, score, problem, results, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(plot, "SENSORS", {"generic60cone": "a cone"})
    monkeypatch.setattr(plot, "MAP_ANGLE", 75)
    monkeypatch.setattr(plot, "measure", lambda *_: results)
    plot.main(["--docs", str(tmp_path), "--spacing", "1"])
    assert "minutes of processor time" in capsys.readouterr().out
    for name in (plot.VIEWS, plot.STATIONS):
        with Image.open(tmp_path / "pictures" / name) as picture:
            assert min(picture.size) > 500
            assert len(np.unique(np.asarray(picture.convert("L")))) > 10
    page, given = ((folder / plot.PAGE).read_text("utf-8") for folder in (tmp_path, plot.DOCS))
    assert score.table(results, score.STUDIES) in page
    tables = re.compile(r"<!-- (\w+, generic60cone) -->.*?<!-- end of \1 -->", re.DOTALL)
    assert tables.sub("", page) == tables.sub("", given)


@pytest.mark.parametrize("page", ["", "<!-- a -->\n1\n<!-- end of a -->" * 2])
def test_tables_go_between_their_marks_alone(plot, page):
    filled = plot.put("x <!-- a -->\n1\n<!-- end of a --> y", "a", "2")
    assert filled == plot.put(filled, "a", "2") == "x <!-- a -->\n\n2\n\n<!-- end of a --> y"
    with pytest.raises(ValueError, match=f"the page has {page.count('end')} places marked a, expected 1"):
        plot.put(page, "a", "2")


def test_the_page_shows_both_pictures_and_a_row_for_every_share(plot, score):
    page = (plot.DOCS / plot.PAGE).read_text("utf-8")
    for name in (plot.VIEWS, plot.STATIONS):
        assert f"](../pictures/{name})" in page
        assert (plot.DOCS / "pictures" / name).stat().st_size < 250_000
    for requirement in score.ANGLES.values():
        for share in score.SHARES:
            assert page.count(f"| {requirement} | {100 * share:g} % |") == len(score.SENSORS)
    for views, bound in re.findall(r"\| (\d+) \(\u2265 (\d+)\) \|", page):
        assert int(bound) <= int(views)
