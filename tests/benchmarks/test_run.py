"""The runner resumes, its pages keep what others wrote, and a method of others takes part."""

import json
import re
from dataclasses import dataclass

import numpy as np
import pytest
from typer.main import get_command

from benchmarks import run
from benchmarks.metrics.completion import Outcome
from benchmarks.store import STORE, Store, each, from_record, measured, to_record
from benchmarks.suites.completion import Task, evaluate
from nbv.scanning.effects import NO_EFFECTS
from scenes.checks import InputError
from tests.helpers.data_paths import ROOT, requires_data
from tests.helpers.sweep_examples import small_column

run.load_suites()
CALLS: list[int] = []


@dataclass(frozen=True)
class Figure:
    seed: int
    values: np.ndarray
    share: float | None


def figure(seed: int, scale: float) -> list[Figure]:
    CALLS.append(seed)
    return [Figure(seed, scale * np.arange(3.0), None if seed else float("nan"))]


@pytest.fixture
def store(tmp_path):
    CALLS.clear()
    token = STORE.set(Store(tmp_path / "kept"))
    yield STORE.get()
    STORE.reset(token)


def test_a_run_that_was_interrupted_measures_only_what_is_missing(store):
    results = each(figure, range(4), 2.0)
    next(results), next(results)
    again = list(each(figure, range(4), 2.0))
    assert CALLS == [0, 1, 2, 3]
    assert [found.seed for (found,) in again] == [0, 1, 2, 3]
    assert np.array_equal(again[1][0].values, [0.0, 2.0, 4.0])
    assert np.isnan(again[0][0].share)
    assert again[1][0].share is None


def test_other_arguments_and_other_functions_have_results_of_their_own(store):
    list(each(figure, range(2), 2.0))
    list(each(figure, range(2), 3.0))
    assert CALLS == [0, 1, 0, 1]
    assert len(list(store.folder.iterdir())) == 4


def test_a_file_that_holds_no_result_is_named(store):
    list(each(figure, range(1), 2.0))
    (path,) = store.folder.iterdir()
    path.write_text("{}")
    with pytest.raises(InputError, match=re.escape(f"{path}: holds no result of this benchmark; remove it")):
        list(each(figure, range(1), 2.0))


def test_time_and_memory_stand_beside_a_result(store):
    list(each(figure, range(2), 2.0))
    assert [len(costs) for costs in store.costs.values()] == [2]
    held = json.loads(next(store.folder.iterdir()).read_text())
    assert set(held) == {"key", "result", "cost"}
    assert measured(lambda: 3)[0] == 3


def test_records_turn_back_into_what_they_were():
    kind = dict[str, tuple[float, ...]]
    value = {"a": (1.5, float("inf")), "b": ()}
    assert from_record(kind, json.loads(json.dumps(to_record(value)))) == value


def test_a_section_is_replaced_and_the_rest_of_the_page_stays(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Title\n\nOwn words.\n")
    run.write_section(page, "pairs", "first")
    run.write_section(page, "joint", "second")
    run.write_section(page, "pairs", "third")
    text = page.read_text()
    assert "Own words." in text
    assert "first" not in text
    assert text.index("third") < text.index("second")


def test_each_suite_has_a_line_for_the_list(capsys):
    run.listed()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(run.SUITES) > 40
    assert all(line.endswith((".", ":", ",")) for line in lines)


QUOTED = re.compile(r"python -m benchmarks run ([a-z0-9-]+(?: [^`\n;]*)?)`")


@pytest.mark.parametrize("page", sorted((ROOT / "docs/results").glob("*.md")), ids=lambda page: page.stem)
def test_commands_that_results_quote_exist(page):
    suites = get_command(run.app).commands["run"].commands
    for name, *words in map(str.split, QUOTED.findall(page.read_text("utf-8"))):
        suites[name].make_context(name, words)  # raises for an unknown option


@pytest.mark.long
@requires_data
@pytest.mark.parametrize("name", list(run.SUITES))
def test_every_suite_runs_as_small_as_it_can_be(name, capsys):
    run.app(["smallest", name], standalone_mode=False)
    first, *lines = capsys.readouterr().out.strip().splitlines()
    assert first.split()[0] == name
    assert lines


def test_an_unknown_suite_is_refused_by_its_name():
    with pytest.raises(InputError, match=r"there is no suite nothing; there are .*completion, "):
        run.app(["smallest", "nothing"], standalone_mode=False)


def hull_of_guide():
    """The function of the guide, and all that its Python blocks define."""
    text = (ROOT / "docs/guides/benchmark.md").read_text("utf-8")
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.S):
        if "random_case" not in block:  # a whole room takes too long here
            exec(block, names)
    return names


@pytest.mark.long
def test_the_example_of_the_guide_is_scored_beside_others(store):
    names = hull_of_guide()
    case = small_column(100.0, 3)
    tasks = [Task(case, {"hull": names["hull"]}, "none", NO_EFFECTS, 0)]
    (outcome,) = evaluate(tasks, store)
    areas = outcome.score.areas.pooled()
    assert isinstance(outcome, Outcome)
    assert areas.hidden > 0
    assert areas.claimed > 0
    assert 0 <= areas.iou[1] < 0.2  # a hull is no column
    (again,) = evaluate(tasks, store)
    assert again.score.claims.violation_m2 == outcome.score.claims.violation_m2


def test_the_suite_of_the_guide_prints_its_table(store):
    names = hull_of_guide()
    assert list(names["halves"](cases=2)) == ["| seed | half |", "|---|---|", "| 0 | 0.0 |", "| 1 | 0.5 |"]
    run.SUITES.pop("halves"), run.SMALLEST.pop("halves")
