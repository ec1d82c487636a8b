# SPDX-License-Identifier: MIT
"""Trial: every case tried in a process apart, which reports a line each, so that its end is known."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from completion.fitting.result import FitError
from scenes.checks import InputError
from tests.helpers.data_paths import ROOT
from tests.robustness.bad_files import documents, meshes, points, scans
from tests.robustness.bad_files.case import Case, Outcome

MOST_SECONDS, ALL_SECONDS = 5.0, 300.0  # of the processor for one case, of the clock for all


@dataclass(frozen=True, slots=True)
class Tried:
    """What came of a case: outcome, what was said, seconds of the processor, bytes the process grew by."""

    title: str
    outcome: Outcome
    said: str
    seconds: float
    grown: int


def all_cases() -> list[Case]:
    """Every case, their titles all different."""
    return [case for part in (meshes, scans, points, documents) for case in part.cases()]


def try_case(case: Case) -> Tried:
    """Write and read one file."""
    with TemporaryDirectory() as folder:
        path = case.write(Path(folder))
        before, start = _peak(), time.process_time()
        try:
            warnings = case.read(path)
            outcome: Outcome = "warned" if warnings else "read" if "read" in case.expected else "silent"
            said = "; ".join(warnings)
        except (InputError, FitError) as error:
            outcome, said = "refused", str(error)
            if "\n" in said or (isinstance(error, InputError) and Path(path).name not in said):
                outcome, said = "crashed", f"does not name the file in one line: {said}"
        except Exception as error:
            outcome, said = "crashed", f"{type(error).__name__}: {error}"
        seconds = time.process_time() - start
        return Tried(
            case.title, "hung" if seconds > MOST_SECONDS else outcome, said, seconds, _peak() - before
        )


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def try_all(words: str = "") -> None:
    """Try all cases whose title holds `words`, and print a line of JSON before and after each."""
    for case in all_cases():
        if words in case.title:
            _tell({"trying": case.title})
            tried = try_case(case)
            _tell(asdict(tried))


def _tell(held: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(held) + "\n")
    sys.stdout.flush()


def tried_apart() -> list[Tried]:
    """Try all cases in another process; what it was at when it died has crashed, or hung."""
    command = [sys.executable, "-W", "error", "-m", "tests.robustness.bad_files"]
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=ALL_SECONDS, check=False
        )
        output, end, rest = done.stdout, "crashed", done.stderr
    except subprocess.TimeoutExpired as error:
        output, end, rest = (error.stdout or b"").decode(), "hung", ""
    lines = [json.loads(line) for line in output.splitlines()]
    found = [Tried(**line) for line in lines if "outcome" in line]
    if lines and "trying" in lines[-1]:
        found.append(Tried(lines[-1]["trying"], end, rest[-300:], 0.0, 0))  # type: ignore[arg-type]
    return found
