# SPDX-License-Identifier: MIT
"""Mutated files: every reader reads or refuses them (docs/how-it-works/robustness.md)."""

from functools import cache
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.robustness.fuzzing.case import Case
from tests.robustness.fuzzing.e57_pages import paged, payload
from tests.robustness.fuzzing.mutation import Mutant, mutate_case
from tests.robustness.fuzzing.report import findings, table
from tests.robustness.fuzzing.supervision import Tally, supervise
from tests.robustness.fuzzing.targets import TARGETS
from tests.robustness.fuzzing.trial import attempt, judge

_steps = st.lists(st.integers(0, 2**48 - 1), min_size=1, max_size=4)


@cache
def seeds_of(reader: str) -> list[Case]:
    return TARGETS[reader].seeds()


@pytest.mark.parametrize("reader", TARGETS)
def test_every_seed_is_read(reader: str, tmp_path: Path) -> None:
    for case in seeds_of(reader):
        assert attempt(TARGETS[reader], case, tmp_path).kind == "read"


@pytest.mark.parametrize("reader", TARGETS)
def test_what_is_mutated_is_read_or_refused(reader: str, tmp_path: Path) -> None:
    seeds = seeds_of(reader)

    @settings(
        derandomize=True,
        deadline=None,
        max_examples=TARGETS[reader].n_examples,
        suppress_health_check=list(HealthCheck),
        database=None,
    )
    @given(st.integers(0, len(seeds) - 1), _steps)
    def holds(seed: int, steps: list[int]) -> None:
        outcome = attempt(TARGETS[reader], Mutant(seed, tuple(steps)).build(seeds), tmp_path)
        assert not outcome.is_finding, outcome

    holds()


def test_the_same_numbers_make_the_same_mutant() -> None:
    seeds = seeds_of("mesh gltf")
    mutants = [Mutant.draw(len(seeds), Random(f"0 mesh gltf {k}")) for k in range(20)]
    assert [one.build(seeds) for one in mutants] == [one.build(seeds) for one in mutants]
    assert len({one.build(seeds).pack() for one in mutants}) > 10


def test_cases_are_packed_and_unpacked() -> None:
    case = seeds_of("scan rgbd plain")[0]
    assert Case.unpack(case.pack()) == case
    assert Case.unpack(b"nonsense") is None
    assert mutate_case(Case({}, ""), Random(0)) == Case({}, "")


def test_pages_of_e57_are_put_together_as_they_were() -> None:
    data = seeds_of("scan e57")[0].files["s.e57"]
    assert paged(payload(data)) == data


@pytest.mark.parametrize("broken", ["raise ValueError('x')", "import os; os._exit(3)"])
def test_what_a_reader_breaks_is_found(broken: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader that raises anything is seen within the process, one that dies from outside."""
    if "exit" in broken:
        monkeypatch.setattr("tests.robustness.fuzzing.supervision._start", _start_of(broken))
        tally = supervise("poses", 1, 0, 60)
        assert tally.found["crash"] == 1
        assert "exit 3" in findings([tally])[0]
        assert "| poses | 1 | 0 | 0 | 1 |" in table([tally])
        return
    monkeypatch.setattr("tests.robustness.fuzzing.targets.read_poses", lambda _: exec(broken))
    case = seeds_of("poses")[0]
    outcome = judge(TARGETS["poses"], case.write(tmp_path))
    assert (outcome.kind, outcome.text) == ("outside the promise", "ValueError: x")
    assert table([Tally("poses")]).count("\n") == 3


def _start_of(broken: str):  # type: ignore[no-untyped-def]
    """A worker that does nothing but `broken`."""
    import subprocess
    import sys

    def start(target, folder, *numbers):  # type: ignore[no-untyped-def]
        for name in ("printed", "found"):
            (folder / name).touch()
        return subprocess.Popen([sys.executable, "-c", broken])

    return start
