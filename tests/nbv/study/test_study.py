# SPDX-License-Identifier: MIT
"""Studies: what a file may say, what each planner does, and that nothing is lost when a run dies."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.cover.pipeline import CoverOptions
from nbv.plan.baselines import farthest_poses
from nbv.plan.plan import read_plan
from nbv.plan.planning import plan_views
from nbv.plan.problem import RemoteVisibility, SharedArrays
from nbv.run.manifest import versions
from nbv.run.plan_options import Method
from nbv.run.workers import ThisProcess, _check_versions, cluster
from nbv.scanning.sensor import PinholeSensor
from nbv.study.archive import RecordArchive
from nbv.study.case import cases_of, run_case
from nbv.study.pipeline import COLUMNS, SHARES, check_results, groups_of, outcome_of, run_study, write_results
from nbv.study.scans import sets_of
from nbv.study.spec import ScanStudySpec, read_study
from nbv.visibility.candidates import scene_candidates
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.visibility import visible_from_positions
from scenes.checks import InputError
from scenes.run.atomic import hold_lock, lock_file
from scenes.world.builtin import builtin_scene
from tests.helpers.data_paths import ROOT
from tests.helpers.study_examples import SMALL, contents, write_study

SENSOR = PinholeSensor(fov_deg=70, width=48, height=48)


def study(*arguments):
    return CliRunner().invoke(app, ["study", *(str(argument) for argument in arguments)])


def rows_of(table):
    return list(csv.DictReader(table.read_text("utf-8").splitlines()))


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, file):
    out = tmp_path_factory.mktemp("undisturbed")
    result = study(file, "-o", out, "--json")
    assert result.exit_code == 0, result.stderr
    return out, json.loads(result.stdout)


@pytest.mark.parametrize("method", [name for name in get_args(Method) if f'"{name}"' not in SMALL])
def test_every_method_of_planning_is_one_of_a_study(method, tmp_path):
    text = SMALL.replace('method = "random"', f'method = "{method}"')
    assert method in {entry.method for entry in read_study(write_study(tmp_path, text)).planners}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('method = "random"', 'method = "randm"', r"planners\[1\]\.method: .*'nbv'.*'random'"),
        ("target = 0.5", "target = 1.5", r"planners\[1\]\.target: .*less than or equal to 1"),
        ("target = 0.5", "targt = 0.5", r"planners\[1\]\.targt: there is no such entry"),
        ("target = 0.5", "infer = true", r"planners\[1\]: infer goes with method nbv or cover, not random"),
        ("target = 0.5", "overlap = 0.3", r"planners\[1\]: overlap and polish_steps go with method cover"),
        ("max_incidence_deg = 75", "max_incidence_deg = 0", r"requirements\[0\]\.max_incidence_deg: "),
        ("spacing_m = 0.5", "spacing_m = nan", r"sampling\.spacing_m: .*finite"),
        ("seeds = 2", "seeds = 0", "seeds must be a list, or a number of them from 1 to 100,000"),
        ("seeds = 2", "seeds = 1000000000", "a number of them from 1 to 100,000"),
        ("seeds = 2", "seeds = 90000", "360,000 plans; a study has at most 100,000"),
        ("seeds = 2", "seeds = [1, 1]", "seeds must differ"),
        ("seeds = 2", "seeds = [-1]", r"seeds\[0\]: "),
        ("builtin:drum_and_post", "builtin:two_occluders", "two scenes are called 'two_occluders'"),
        ('title = "Small"', "title = Small", "is not TOML"),
        ("builtin:drum_and_post", "no_such.glb", "no_such.glb"),
        ("builtin:drum_and_post", "builtin:no_such", "no_such"),
        ('"tiny.toml"', '"no_such"', "no_such"),
        ("max_incidence_deg = 75", "max_sd_m = 0.01", "errors are known"),
    ],
)
def test_what_a_study_file_may_not_say(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said):
        cases_of(read_study(write_study(tmp_path, SMALL.replace(old, new))))


def test_the_page_on_studies_shows_one_that_can_be_read(tmp_path):
    blocks = re.findall(
        r"```toml\n(.*?)```", (ROOT / "docs" / "guides" / "studies.md").read_text("utf-8"), re.DOTALL
    )
    (tmp_path / "study.toml").write_text(blocks[0])
    spec = read_study(tmp_path / "study.toml")
    assert spec.scenes[0].scene == str(tmp_path / "hall.glb")
    assert [planner.label for planner in spec.planners] == ["nbv with completion", "cover"]


@pytest.mark.parametrize(
    "study_file", sorted((ROOT / "examples" / "studies").glob("*.toml")), ids=lambda f: f.stem
)
def test_ready_made_studies_open(study_file):
    spec = read_study(study_file)
    if isinstance(spec, ScanStudySpec):
        cases, varied = sets_of(spec, study_file.parent), (spec.scenes, spec.sensors, spec.poses)
    else:
        cases, varied = cases_of(spec), (spec.scenes, spec.sensors, spec.requirements, spec.planners)
    assert len(cases) == np.prod([len(part) for part in (*varied, spec.seeds)])
    assert f"`{study_file.name}`" in (ROOT / "docs" / "guides" / "studies.md").read_text("utf-8")


def test_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_study(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b'title = "\xe9"')
    with pytest.raises(InputError, match="is no UTF-8 text: its byte 9"):
        read_study(tmp_path / "latin.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * ((1 << 20) + 1))
    with pytest.raises(InputError, match="exceed the limit toml_bytes=1,048,576"):
        read_study(tmp_path / "large.toml")
    (tmp_path / "empty.toml").write_text("\n")
    with pytest.raises(InputError, match=r"scenes: Field required \(and 1 more\)"):
        read_study(tmp_path / "empty.toml")


def test_cases_are_the_product_and_their_keys_tell_what_matters(file):
    spec = read_study(file)
    cases = cases_of(spec)
    assert len(cases) == 2 * 1 * 1 * 2 * 2
    assert len({case.key for case in cases}) == len({case.name for case in cases}) == len(cases)
    assert [case.key for case in cases_of(spec)] == [case.key for case in cases]
    later = cases_of(spec, 1)
    assert later[0].key == cases[1].key
    assert later[1].key not in {case.key for case in cases}
    renamed = spec.model_copy(update={"planners": tuple(p.model_copy(update={"name": p.method.upper()})
                                                        for p in spec.planners)})  # fmt: skip
    assert [case.key for case in cases_of(renamed)] == [case.key for case in cases]
    assert cases_of(renamed)[0].labels()["planner"] == "GREEDY"


ROOM = builtin_scene("two_occluders")
SAMPLES = sample_surface(ROOM.mesh, 0.5)
CANDIDATES = scene_candidates(ROOM, SENSOR, subdivisions=0)
COARSE = {"samples": SAMPLES, "candidates": CANDIDATES, "requirement": Requirement(max_incidence_deg=75)}


def planned(method, rng=0, **given):
    return plan_views(ROOM, SENSOR, method=method, rng=rng, **{**COARSE, **given})


@pytest.mark.long
def test_baselines_plan_until_the_target_and_the_informed_need_fewer_views():
    plans = {name: planned(name, target=0.9) for name in ("greedy", "visibility", "farthest", "random")}
    for plan in plans.values():
        assert plan.coverage.met_of_reachable >= 0.9 - 1e-9
        met = [view.met_fraction for view in plan.views]
        assert (np.diff(met) >= 0).all()
        assert met[-2] < 0.9 * plan.coverage.reachable
        assert plan.stopped_because.startswith("target met")
    assert len(plans["greedy"].views) <= len(plans["visibility"].views) < len(plans["random"].views)


@pytest.mark.long
def test_greedy_takes_the_view_that_meets_most():
    first = planned("greedy", views=1).views[0]
    gains = [planned("random", rng=seed, views=1).views[0].gain_m2 for seed in range(20)]
    assert first.gain_m2 >= max(gains)


def test_baselines_that_choose_blindly_follow_their_seed():
    poses = farthest_poses(CANDIDATES, int(np.random.default_rng(3).integers(CANDIDATES.n_poses)), 4)
    views = planned("farthest", rng=3, views=4).views
    for view, number in zip(views, poses, strict=True):
        assert np.array_equal(view.world_from_sensor.matrix, CANDIDATES.pose(number).matrix)
    one, same, other = (planned("random", rng=seed, views=3).to_json() for seed in (1, 1, 2))
    assert one == same
    assert one["views"] != other["views"]
    assert "the limit of 3 views" in one["stopped_because"]


def test_baselines_refuse_what_they_cannot():
    with pytest.raises(InputError, match="nbv or cover, not of random"):
        planned("random", infer=True)
    with pytest.raises(InputError, match="method must be one of nbv, cover, online:frontier"):
        planned("best")


def test_results_hold_every_case_and_every_view(undisturbed, file):
    out, summary = undisturbed
    rows = rows_of(out / "results.csv")
    curves = rows_of(out / "curves.csv")
    assert summary["cases"] == len(rows) == 8
    assert list(rows[0]) == list(COLUMNS)
    assert sum(int(row["views"]) for row in rows) == len(curves) == summary["views"]
    for row in rows:
        plan = read_plan(out / "plans" / f"{row['case']}.json")
        assert len(plan.views) == int(row["views"])
        assert float(row["met"]) == pytest.approx(plan.views[-1].met_fraction)
        assert float(row["met_of_reachable"]) == pytest.approx(plan.coverage.met / plan.coverage.reachable)
        assert float(row["met_of_reachable"]) >= (0.9 if row["planner"] == "greedy" else 0.5) - 1e-9
    page = (out / "report.html").read_text()
    assert "Views that are needed" in page
    assert "views to 50 %" in page  # what all planners of the study aim at
    assert "two_occluders" in page
    assert (out / "plots" / "coverage-2.png").stat().st_size > 5000
    told = json.loads((out / "manifest.json").read_text())
    assert set(told["times"]["costs"]) == {row["case"] for row in rows}
    assert all(cost["seconds"] > 0 for cost in told["times"]["costs"].values())
    assert {item["input"] for item in told["inputs"]} >= {str(file), "builtin:two_occluders"}


def test_results_tell_settings_in_numbers_and_the_length_of_the_tour(undisturbed):
    for row in rows_of(undisturbed[0] / "results.csv"):
        assert float(row["max_incidence_deg"]) == 75
        assert float(row["target"]) == (0.9 if row["planner"] == "greedy" else 0.5)
        assert (row["k"], row["max_range_m"], float(row["spacing_m"])) == ("1", "", 0.5)
        assert 0 < float(row["met_standard_error"]) < 0.1
        assert float(row["tour_m"]) > 0 or int(row["legs_without_way"]) == int(row["views"]) - 1


def test_a_scene_may_have_a_spacing_of_its_own(tmp_path):
    text = SMALL.replace('builtin:drum_and_post"', 'builtin:drum_and_post"\nspacing_m = 0.3')
    cases, before = (
        cases_of(read_study(write_study(tmp_path, text))),
        cases_of(read_study(write_study(tmp_path, SMALL))),
    )
    assert [one.key == other.key for one, other in zip(cases, before, strict=True)] == [True] * 4 + [
        False
    ] * 4
    assert {case.settings()["spacing_m"] for case in cases} == {0.3, 0.5}
    assert run_case(cases[-1])["n_samples"] > 2 * run_case(before[-1])["n_samples"]
    for wrong in ("0", "-1", "nan", "inf", '"wide"'):
        bad = text.replace("spacing_m = 0.3", f"spacing_m = {wrong}")
        with pytest.raises(InputError, match=r"scenes\[1\]\.spacing_m: "):
            read_study(write_study(tmp_path, bad))


def test_views_to_a_share_are_counted_and_never_is_said(file):
    case = cases_of(read_study(file))[0]
    record = run_case(case)
    outcome = outcome_of(case, record)
    for share in SHARES:
        views = outcome.views_to(share)
        if views is not None:
            assert outcome.of_reachable[views] >= share - 1e-9
            assert outcome.of_reachable[views - 1] < share
    assert outcome.views_to(0.9) is not None
    assert outcome.views_to(1.0) is None
    group = groups_of([outcome, replace(outcome, met=outcome.met[:1], gain_m2=outcome.gain_m2[:1])])[0]
    assert group.views_to(0.9).tolist() == [outcome.views_to(0.9), np.inf]
    assert group.curves().shape == (2, len(outcome.met) + 1)
    assert (group.curves()[1, 1:] == group.curves()[1, 1]).all()


def test_parquet_holds_what_csv_holds(undisturbed, tmp_path, file):
    parquet = pytest.importorskip("pyarrow.parquet")
    out, _ = undisturbed
    cases = cases_of(read_study(file))
    archive = RecordArchive(out / "plans")
    outcomes = [outcome_of(case, archive.read(case)) for case in cases]
    results, curves = write_results(outcomes, tmp_path, "parquet")
    once = results.read_bytes(), curves.read_bytes()
    write_results(outcomes, tmp_path, "parquet")
    assert (results.read_bytes(), curves.read_bytes()) == once
    table = parquet.read_table(results).to_pylist()
    for row, text in zip(table, rows_of(out / "results.csv"), strict=True):
        assert {name: "" if value is None else str(value) for name, value in row.items()} == dict(text)


def test_parquet_without_pyarrow_names_the_cure(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r'pip install "unseen\[parquet\]"'):
        check_results("parquet")
    check_results("csv")


def test_a_case_that_cannot_be_planned_says_why_and_stops_no_other(tmp_path):
    (tmp_path / "tile.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    walled = SMALL.replace('builtin:drum_and_post"', 'tile.obj"\nmode = "room"').replace(
        "seeds = 2", "seeds = 1"
    )
    result = study(write_study(tmp_path, walled), "-o", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["failed"] == 2
    rows = rows_of(tmp_path / "out" / "results.csv")
    assert [row["views"] == "" for row in rows] == [False, False, True, True]
    assert "nowhere to stand in tile: 0.0 m2 of floor" in rows[2]["error"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "2 cases could not be planned" in page
    assert "nowhere to stand in tile: 0.0 m2 of floor" in page


@pytest.mark.long
def test_damaged_and_foreign_plans_are_made_again(undisturbed, tmp_path, file):
    out, _ = undisturbed
    assert study(file, "-o", tmp_path, "-q").exit_code == 0
    plans = sorted((tmp_path / "plans").iterdir())
    plans[0].unlink()
    plans[1].write_bytes(plans[1].read_bytes()[:-40])
    plans[2].write_text("[]")
    plans[3].write_bytes(plans[4].read_bytes())
    (tmp_path / "plans" / ".half.123.tmp.json").write_text("{")
    assert study(file, "-o", tmp_path, "-q").exit_code == 0
    assert contents(tmp_path) == contents(out)


@pytest.mark.long
def test_two_runs_cannot_write_to_one_folder(tmp_path, file):
    with hold_lock(tmp_path):
        result = study(file, "-o", tmp_path)
    assert result.exit_code == 1
    assert "another run writes there" in result.stderr
    assert not list(tmp_path.iterdir())
    lock_file(tmp_path).touch()
    with hold_lock(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@pytest.mark.parametrize("kills", [(3,), pytest.param((1, 3, 6), marks=pytest.mark.long)])
def test_a_study_that_is_killed_again_and_again_ends_with_the_same_bytes(undisturbed, tmp_path, file, kills):
    out, _ = undisturbed
    command = [sys.executable, "-m", "nbv.cli", "study", str(file), "-o", str(tmp_path), "-q"]
    for n_plans in kills:
        process = subprocess.Popen(command, cwd=ROOT)
        begin = time.monotonic()
        while len(list(tmp_path.glob("plans/[!.]*.json"))) < n_plans and time.monotonic() < begin + 60:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        assert not (tmp_path / "report.html").exists()
    assert study(file, "-o", tmp_path, "-q").exit_code == 0  # here, where reports are drawn as small as `out`
    assert contents(tmp_path) == contents(out)


@pytest.mark.long
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)], ids=["SIGINT", "SIGTERM"]
)
def test_a_signal_ends_a_study_in_one_line_and_leaves_whole_files(undisturbed, tmp_path, number):
    out, _ = undisturbed
    long = write_study(tmp_path, SMALL.replace("seeds = 2", "seeds = 200"))
    command = [sys.executable, "-m", "nbv.cli", "study", str(long), "-o", str(tmp_path / "out")]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    begin = time.monotonic()
    while not list(tmp_path.glob("out/plans/[!.]*.json")) and time.monotonic() < begin + 60:
        time.sleep(0.01)
    process.send_signal(number)
    said = process.communicate(timeout=60)
    assert said == ("", f"unseen study: ended by {number.name}; every file is whole: run it again to go on\n")
    assert process.returncode == 128 + number
    left, whole = contents(tmp_path / "out"), contents(out)
    assert left.keys() & whole.keys()
    assert all(name.startswith("plans/") and json.loads(data)["views"] for name, data in left.items())
    assert all(whole.get(name, data) == data for name, data in left.items())


VISIBILITY = (ROOM.mesh, CANDIDATES.positions[:80], SAMPLES, Requirement().visibility(SENSOR))


def local_visibility():
    _, positions, samples, limits = VISIBILITY
    return visible_from_positions(ROOM.ray_caster(), positions, samples, limits)


def assert_same(one, other):
    assert one.shape == other.shape
    for part in ("indptr", "indices", "data"):
        assert np.array_equal(getattr(one, part), getattr(other, part))


def test_workers_that_cast_do_not_serve_the_online_planner(tmp_path):
    remote = RemoteVisibility(ThisProcess(1), tmp_path)
    with pytest.raises(InputError, match="they do not serve method nbv"):
        plan_views(builtin_scene("two_occluders"), remote=remote)


@pytest.mark.long
def test_visibility_by_workers_is_that_of_this_process(tmp_path):
    told = []
    remote = RemoteVisibility(ThisProcess(1), tmp_path / "shared")
    seen = remote.from_positions(*VISIBILITY, progress=lambda *state: told.append(state))
    assert_same(seen, local_visibility())
    assert told[-1] == ("visibility", 80, 80)
    files = sorted((tmp_path / "shared").iterdir())
    remote.from_positions(*VISIBILITY)
    assert sorted((tmp_path / "shared").iterdir()) == files
    one, other = (
        planned("cover", budgets=CoverOptions(polish_steps=0), remote=given).to_json()
        for given in (None, remote)
    )
    assert one == other


def test_workers_that_do_not_see_the_folder_say_so(tmp_path):
    shared = SharedArrays.write(tmp_path, {"points": np.arange(3.0)})
    assert np.array_equal(shared.map_arrays()["points"], [0, 1, 2])
    with pytest.raises(InputError, match="under the same path"):
        replace(shared, folder=str(tmp_path / "elsewhere")).map_arrays()
    file = next(tmp_path.iterdir())
    file.write_bytes(file.read_bytes()[:-8])
    with pytest.raises(InputError, match="under the same path"):
        shared.map_arrays()


def test_a_scheduler_goes_with_planners_that_know_the_scene():
    result = CliRunner().invoke(app, ["plan", "builtin:two_occluders", "--scheduler", "local:2"])
    assert result.exit_code == 2
    assert "--method cover" in result.stderr


class Assassin:
    """Workers of a cluster of which one is killed once the first piece of work is done."""

    def __init__(self, workers):
        self.workers, self.killed = workers, 0

    def each(self, work, items, keys):
        for number, result in self.workers.each(work, items, keys):
            if not self.killed:
                self.killed = next(iter(self.workers.client.run(os.getpid).values()))
                os.kill(self.killed, signal.SIGKILL)
            yield number, result


@pytest.mark.long
def test_a_cluster_that_loses_a_worker_loses_nothing(undisturbed, tmp_path, file):
    pytest.importorskip("distributed")
    out, _ = undisturbed
    with cluster("local:2", 1) as workers:
        assassin = Assassin(workers)
        run_study(read_study(file), tmp_path / "plans", workers=assassin)
        seen = RemoteVisibility(workers, tmp_path / "shared").from_positions(*VISIBILITY)
    assert assassin.killed
    assert_same(seen, local_visibility())
    assert contents(tmp_path / "plans") == contents(out / "plans")


def test_clusters_that_cannot_be_used_are_refused_with_the_cure(monkeypatch):
    distributed = pytest.importorskip("distributed")
    assert distributed
    with pytest.raises(InputError, match="local:4"), cluster("local:x"):
        pass
    monkeypatch.setattr("nbv.run.workers._WAIT_S", 0.5)
    with pytest.raises(InputError, match="no scheduler answers there"), cluster("tcp://127.0.0.1:9"):
        pass

    class Client:
        def run(self, function):
            assert function is versions
            return {"tcp://a": {**versions(), "numpy": "0.1"}}

    with pytest.raises(InputError, match=r"worker tcp://a has numpy 0\.1"):
        _check_versions(Client(), "tcp://x")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r'pip install "unseen\[cluster\]"'), cluster("local:1"):
        pass
