# SPDX-License-Identifier: MIT
"""Outcomes survive a round trip exactly; an interrupted evaluation ends in the same bytes; costs are told."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import benchmarks.completion.cases.task
from benchmarks.completion.cases.archive import Archive, from_record, to_record
from benchmarks.completion.cases.baselines import BASELINES
from benchmarks.completion.cases.cost import Cost, cost_line, cost_summary, measured
from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.cases.study import ablation_methods, ablations, without
from benchmarks.completion.cases.sweeps import SWEEPS
from benchmarks.completion.cases.task import Bench, Task
from benchmarks.completion.command import SweepName, evaluation
from completion import CompletionOptions
from nbv.scanning.effects.effects import NO_EFFECTS, named_effects
from scenes.checks import InputError
from scenes.run.atomic import json_text
from tests.helpers.sweep_examples import small_column

LEAST = replace(CompletionOptions(texture=False), max_sd_m=0.01)
METHODS = {"standard": CompletionOptions(texture=False), BASELINES[1].name: BASELINES[1]}


def task() -> Task:
    return Task(small_column(120), METHODS, "none", NO_EFFECTS, 0)


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and not file.name.endswith("manifest.json")
    }


def test_an_outcome_comes_back_as_it_was(tmp_path: Path) -> None:
    outcome, cost = Bench.of(task(), None).outcome("standard")
    archive, key = Archive(tmp_path / "outcomes"), task().key("standard")
    assert archive.find(key) is None
    archive.keep(key, outcome, cost)
    found = archive.find(key)
    assert found is not None
    assert found[1] == cost
    assert json_text(to_record(found[0])) == json_text(to_record(outcome))
    again = from_record(Outcome, json.loads(json_text(to_record(outcome), indent=None)))
    claims, before = again.score.claims, outcome.score.claims
    for name in ("claimed", "right", "squared_m4"):
        assert np.asarray(getattr(claims, name)).tobytes() == np.asarray(getattr(before, name)).tobytes()
    assert claims.surfaces[0].sd_m == before.surfaces[0].sd_m
    assert again.kinds == outcome.kinds
    assert np.isnan(again.measured)


def test_floats_come_back_to_the_last_bit() -> None:
    values = np.array([0.1, 1e-300, np.pi, -0.0, np.inf, -np.inf, np.nan])
    there = json.loads(json_text(to_record(values)))
    assert from_record(type_of("contour_m"), there).tobytes() == values.tobytes()
    empty = from_record(type_of("contour_m"), json.loads(json_text(to_record(np.zeros((0, 3), np.int8)))))
    assert (empty.shape, empty.dtype) == ((0, 3), np.int8)
    assert from_record(float | None, None) is None


def type_of(name: str):
    from typing import get_type_hints

    from benchmarks.completion.scores.findings import Findings

    return get_type_hints(Findings)[name]


def test_the_key_tells_apart_all_that_an_outcome_depends_on(tmp_path: Path) -> None:
    archive, base = Archive(tmp_path), task()
    others = [
        replace(base, seed=1),
        replace(base, effects=named_effects("gaussian-2mm")),
        replace(base, methods={"standard": LEAST}),
        replace(base, case=small_column(100)),
        replace(base, case=replace(base.case, scored=("floor",))),
        replace(base, measure=lambda _task, _cells: 0.0),
    ]
    paths = [archive.path(one.key("standard")) for one in [base, task(), *others]]
    assert paths[0] == paths[1]
    assert len(set(paths)) == len(paths) - 1
    assert "0x" not in json_text(base.key(BASELINES[1].name))  # nothing that changes from run to run


def test_a_file_that_is_no_outcome_is_refused(tmp_path: Path) -> None:
    archive, key = Archive(tmp_path), task().key("standard")
    archive.path(key).write_text('{"outcome": {}}')
    with pytest.raises(InputError, match="is no outcome of this evaluation; remove it"):
        archive.find(key)


@pytest.mark.long
def test_an_interrupted_evaluation_ends_in_the_same_bytes(tmp_path, monkeypatch) -> None:
    app = typer.Typer()
    app.command()(evaluation)
    monkeypatch.setattr("benchmarks.completion.command.office_cases", lambda _frames: [small_column(150)])
    monkeypatch.setattr(
        "benchmarks.completion.command.SWEEPS", {"arc": replace(SWEEPS["arc"], levels=(60.0,))}
    )
    monkeypatch.setattr(
        "benchmarks.completion.cases.sweeps.column_case", lambda level, seed: small_column(level, seed)
    )
    options = ["--scenes", "office", "--mode", "standard", "--no-baselines", "--leave-out", "full-turn"]
    options += ["--sweep", "arc", "--sweep-seeds", "1"]

    def run(folder: str, *extra: str):
        return CliRunner().invoke(app, [*options, *extra, "-o", str(tmp_path / folder)])

    whole = run("whole")
    assert whole.exit_code == 0, whole.output
    assert "standard without full-turn: " in whole.output
    assert "a case (median of " in whole.output
    costs = json.loads((tmp_path / "whole" / "manifest.json").read_text())["times"]["costs"]
    assert costs["standard"]["n"] == 2
    assert costs["standard"]["cpu_s"] > 0

    complete, calls = benchmarks.completion.cases.task.complete, []

    def fails_at_the_second(*given, **named):
        calls.append(1)
        if len(calls) == 2:
            raise MemoryError
        return complete(*given, **named)

    monkeypatch.setattr("benchmarks.completion.cases.task.complete", fails_at_the_second)
    assert run("parts", "--quiet").exit_code == 1
    assert len(files(tmp_path / "parts")) == 1
    assert run("parts", "--quiet").exit_code == 0
    assert len(calls) == 2 + 2  # three in all, one of them kept
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    page = (tmp_path / "whole" / "completion-evaluation.md").read_text()
    assert "leaving one cue out at a time" in page
    assert "| arc in view, deg | measured: arc in view, deg | cases |" in page
    assert (tmp_path / "whole" / "pictures" / "evaluation_sweep_arc.png").stat().st_size > 5000


def test_cues_that_are_left_out_have_names() -> None:
    assert set(ablation_methods(list(ablations()))) == {without(cue) for cue in ablations()}
    standard = CompletionOptions(mode="standard", texture=False)
    assert all(options != standard and options.mode == "standard" for options in ablations().values())
    with pytest.raises(InputError, match="'luck' is no cue that can be left out; there are "):
        ablation_methods(["luck"])
    assert {str(name) for name in SweepName} == set(SWEEPS)


def test_costs_are_of_the_work_alone() -> None:
    result, cost = measured(lambda: np.ones((64, 1 << 20)).sum())  # half a gigabyte
    assert result == 64 * 2**20
    assert cost.wall_s > 0
    small = measured(lambda: None)[1]
    if cost.peak_bytes is not None and small.peak_bytes is not None:
        assert cost.peak_bytes - small.peak_bytes > 0.9 * 64 * 8 * 2**20
    assert cost_summary([Cost(1.0, 2.0, None), Cost(3.0, 4.0, None)])["median_wall_s"] == 2.0
    assert cost_line("bold", cost_summary([Cost(1.0, 2.0, None)])).endswith("peak unknown")
