# SPDX-License-Identifier: MIT
"""Bad input: every class at every reader is refused or warned of, in bounded memory, as the page says."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.robustness.bad_files.case import CLASSES
from tests.robustness.bad_files.table import counted, shown
from tests.robustness.bad_files.trial import ROOT, Tried, all_cases, tried_apart

MOST_BYTES = 200e6  # for a bomb, beyond what the process held before


@pytest.fixture(scope="module")
def tried() -> list[Tried]:
    return tried_apart()


def test_every_case_has_its_own_name_and_class() -> None:
    cases = all_cases()
    assert len({case.title for case in cases}) == len(cases)
    assert {case.kind for case in cases} == set(CLASSES)


def test_nothing_crashes_hangs_or_passes_in_silence(tried: list[Tried]) -> None:
    expected = {case.title: case.expected for case in all_cases()}
    wrong = [one for one in tried if one.outcome not in expected[one.title]]
    assert wrong == []
    assert {one.title for one in tried} == set(expected)


def test_bombs_are_refused_in_bounded_memory(tried: list[Tried]) -> None:
    bombs = [one for one in tried if ", class 6:" in one.title]
    assert len(bombs) > 50
    assert [one for one in bombs if one.grown > MOST_BYTES] == []


def test_the_page_shows_what_was_counted(tried: list[Tried]) -> None:
    assert shown() == counted(all_cases(), tried).strip(), "run: python -m tests.robustness.bad_files --write"


WATCHED = """
import json, sys
sys.path.insert(0, {root!r})
from pathlib import Path
from tests.robustness.bad_files.trial import all_cases
from tempfile import TemporaryDirectory
import scenes.io.clouds.e57, scenes.io.clouds.las, pye57
cases = [case for case in all_cases() if case.kind == 7]
folders = [TemporaryDirectory() for _ in cases]  # deleted with the process
paths = [case.write(Path(folder.name)) for case, folder in zip(cases, folders)]
opened = []
sys.addaudithook(lambda event, given: event == "open" and opened.append(str(given[0])))
for case, path in zip(cases, paths):
    try:
        case.read(path)
    except ValueError:
        pass
outside = [one for one in opened if any(word in one for word in ("secret", "hostname", "room"))]
print(json.dumps([len(cases), outside]))
"""


def test_nothing_outside_is_opened() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WATCHED.format(root=str(ROOT))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    n_cases, opened = json.loads(done.stdout)
    assert n_cases > 25
    assert opened == []


def test_the_page_lists_every_limit() -> None:
    from scenes.io.checks.limits import LIMIT_NAMES

    text = Path(ROOT, "docs", "guides", "bad-input.md").read_text("utf-8")
    assert [name for name in LIMIT_NAMES if f"| `{name}` |" not in text] == []
