# SPDX-License-Identifier: MIT
"""Guided fuzzing: atheris keeps what reaches new code of a reader and goes on from there.

`python -m tests.robustness.fuzzing.guided READER FOLDER SECONDS`; files are cases as `Case.pack` writes them.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random
from typing import Any

INSTRUMENTED = (
    "scenes.io",
    "scenes.io.scene_files",
    "scenes.io.scan_files",
    "scenes.io.point_files",
    "scenes.io.describe",
)
"""Modules whose branches are counted; none that numba compiles."""


def run_guided(reader: str, folder: Path, seconds: float) -> dict[str, Any]:
    """Fuzz a reader in a process of its own.

    Parameters
    ----------
    reader : str
        A name of `TARGETS`.
    folder : Path
        Where files are kept that end the process or break the promise.
    seconds : float
        How long.

    Returns
    -------
    dict
        "reader", "runs", "covered" (branches reached), "corpus" (files kept) and "finding", "" where none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable,
        "-m",
        "tests.robustness.fuzzing.guided",
        reader,
        str(folder),
        str(int(seconds)),
    ]
    done = subprocess.run(command, capture_output=True, check=False)
    lines = done.stderr.decode(errors="replace").splitlines()
    told = [line for line in lines if " cov: " in line]
    words = told[-1].split() if told else []
    found = [line for line in lines if line.startswith(("FINDING", "==", "ERROR"))]
    return {
        "reader": reader,
        "runs": int(words[0][1:]) if words else 0,
        "covered": int(words[words.index("cov:") + 1]) if words else 0,
        "corpus": words[words.index("corp:") + 1] if words and "corp:" in words else "",
        "finding": "" if done.returncode == 0 else " ".join(found[:2]) or f"exit {done.returncode}",
    }


def is_installed() -> bool:
    """Tell whether atheris is there."""
    return importlib.util.find_spec("atheris") is not None


def main(reader: str, folder: str, seconds: str) -> None:
    """Fuzz a reader in this process until something is found or the time is over."""
    import atheris  # of the extra `fuzz`, on Linux alone

    with atheris.instrument_imports(include=list(INSTRUMENTED)):
        from tests.robustness.fuzzing.targets import TARGETS
    from tests.robustness.fuzzing.case import Case
    from tests.robustness.fuzzing.mutation import mutate_case
    from tests.robustness.fuzzing.trial import attempt

    target, room = TARGETS[reader], tempfile.mkdtemp()
    seeds = target.seeds()
    corpus = Path(tempfile.mkdtemp())
    for number, case in enumerate(seeds):
        (corpus / f"seed{number}").write_bytes(case.pack())

    def test_one(data: bytes) -> None:
        case = Case.unpack(data)
        if case is None:
            return
        outcome = attempt(target, case, Path(room))
        if outcome.is_finding:
            print("FINDING", json.dumps([outcome.kind, outcome.text, outcome.place]), file=sys.stderr)
            raise RuntimeError(outcome.kind)

    def mutate(data: bytes, max_size: int, seed: int) -> bytes:
        case, rng = Case.unpack(data), Random(seed)
        changed = mutate_case(case or rng.choice(seeds), rng, seeds).pack()
        return changed if len(changed) <= max_size else data

    options = [f"-max_total_time={seconds}", "-timeout=10", "-rss_limit_mb=3000", "-max_len=1000000"]
    atheris.Setup(
        ["guided", str(corpus), f"-artifact_prefix={folder}/", *options], test_one, custom_mutator=mutate
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main(*sys.argv[1:4])
