# SPDX-License-Identifier: MIT
"""Supervision: workers are watched from outside, so that what kills or stops them is found and counted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from tests.robustness.fuzzing.mutation import Mutant
from tests.robustness.fuzzing.worker import FIELDS, PROGRESS, progress_of

HANG_S = 10.0
"""How long a reader may take for a file."""
START_S = 120.0
"""How long a worker may take to begin: imports, compilation, seeds."""
KINDS = (
    *("crash", "hang", "memory", "outside the promise", "broken invariant", "unclear message"),
    *("opened elsewhere", "noise", "seed"),
)


@dataclass
class Tally:
    """What came of all files of one reader."""

    target: str
    tried: int = 0
    read: int = 0
    refused: int = 0
    peak_mb: float = 0.0
    seconds: float = 0.0
    found: Counter[str] = field(default_factory=Counter)
    findings: list[dict[str, Any]] = field(default_factory=list)

    def add(self, record: dict[str, Any]) -> None:
        """Count a finding; keep the first of each kind and place."""
        self.found[record["kind"]] += 1
        known = {(one["kind"], one["place"]) for one in self.findings}
        if (record["kind"], record["place"]) not in known:
            self.findings.append({"target": self.target, **record})


def supervise(
    target: str, n_files: int, seed: int, seconds: float, tell: Callable[[str], None] = lambda _: None
) -> Tally:
    """Try `n_files` mutants on a reader, or as many as the time allows.

    Parameters
    ----------
    target : str
        A name of `TARGETS`.
    n_files : int
        Mutants, numbered from 0: the same ones for the same `seed`.
    seed : int
        Of all that is drawn.
    seconds : float
        When to stop.
    tell : function
        Is given a line now and then.
    """
    tally, begun = Tally(target), time.monotonic()
    with tempfile.TemporaryDirectory(dir=_fast_folder()) as name:
        folder, start, restarts = Path(name), 0, 0
        while start < n_files and time.monotonic() < begun + seconds and restarts < 200:
            progress = _fresh_progress(folder)
            start = _watch(
                _start(target, folder, seed, start, n_files), progress, tally, begun + seconds, folder
            )
            tally.tried += int(progress[PROGRESS["tried"]])
            tally.read += int(progress[PROGRESS["read"]])
            tally.refused += int(progress[PROGRESS["refused"]])
            tally.peak_mb = max(tally.peak_mb, int(progress[PROGRESS["peak_kb"]]) / 1024)
            restarts += 1
    tally.seconds = time.monotonic() - begun
    tell(f"{target}: {tally.tried} tried in {tally.seconds:.0f} s, findings {dict(tally.found)}")
    return tally


def _fast_folder() -> str | None:
    """A folder in memory where the system has one: files are written thousands of times a second."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


def _fresh_progress(folder: Path) -> Any:
    np.zeros(len(FIELDS), np.int64).tofile(folder / "progress")
    return progress_of(folder / "progress")


def _start(target: str, folder: Path, seed: int, start: int, stop: int) -> subprocess.Popen[bytes]:
    # what libraries print to the standard error is kept apart: it shows in a file only
    command = [
        sys.executable,
        "-m",
        "tests.robustness.fuzzing.worker",
        target,
        str(folder),
        *map(str, (seed, start, stop)),
    ]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    with (folder / "printed").open("wb") as printed, (folder / "found").open("wb") as found:
        return subprocess.Popen(command, stdout=found, stderr=printed, env={**os.environ, **threads})


def _watch(
    worker: subprocess.Popen[bytes], progress: Any, tally: Tally, deadline: float, folder: Path
) -> int:
    """Wait for a worker; return the number of the file to go on with."""
    begun = time.monotonic()
    verdict = ""
    while worker.poll() is None and not verdict:
        time.sleep(0.05)
        now = time.monotonic()
        if not progress[PROGRESS["ready"]]:
            verdict = "slow start" if now > begun + START_S else ""
        elif (
            now * 1000 - int(progress[PROGRESS["started_ms"]]) > HANG_S * 1000
            and progress[PROGRESS["started_ms"]]
        ):
            verdict = "hang"
        elif now > deadline:
            verdict = "time"
    if worker.poll() is None:
        worker.kill()
    code = worker.wait()
    for line in (folder / "found").read_text(encoding="utf-8").splitlines():
        if line.startswith("{") and line.endswith("}"):
            tally.add(json.loads(line))
    index = int(progress[PROGRESS["index"]])
    if verdict in ("time", "slow start"):
        if verdict == "slow start":
            tally.add({"index": -1, "kind": "crash", "text": "the worker did not begin", "place": "start"})
        return 1 << 62
    if verdict == "hang" or code != 0:
        kind = verdict or "crash"
        progress[PROGRESS["tried"]] += 1
        tally.add(_record(kind, code, index, folder))
        return index + 1
    return index


def _record(kind: str, code: int, index: int, folder: Path) -> dict[str, Any]:
    """What is known of a file that ended or stopped its worker."""
    printed = (folder / "printed").read_text(encoding="utf-8", errors="replace").strip()
    lines = [line for line in printed.splitlines() if line.strip()]
    frames = [line.strip() for line in lines if line.strip().startswith("File")]
    name = signal.Signals(-code).name if kind == "crash" and code < 0 else f"exit {code}"
    text = f"{name}: {lines[-1][:200] if lines else ''} {' '.join(frames[:2])[:300]}"
    return {
        "index": index,
        "kind": kind,
        "text": text,
        "place": f"{name} {frames[0] if frames else ''}"[:200],
    }


def mutant_of(target: str, n_seeds: int, seed: int, record: dict[str, Any]) -> Mutant:
    """Return the mutant of a finding."""
    if "steps" in record:
        return Mutant(record["seed"], tuple(record["steps"]))
    return Mutant.draw(n_seeds, Random(f"{seed} {target} {record['index']}"))
