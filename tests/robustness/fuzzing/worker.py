# SPDX-License-Identifier: MIT
"""Worker: a process that tries one file after another on a reader, within limits, and tells where it is."""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import resource
import sys
import time
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

LIMIT_MB = 512
"""What a reader may need for a file of ours, all of which are small, beyond what it needs for nothing: up to
64 MiB may be unpacked by any ratio (`scenes.io.checks.limits`); as float64, with copies, eight times as
much."""
ROOM_MB = 4096
"""Address space beyond an idle start; whoever asks for more gets none."""
FIELDS = ("index", "started_ms", "tried", "read", "refused", "peak_kb", "ready")
PROGRESS = {name: k for k, name in enumerate(FIELDS)}


def progress_of(file: Path) -> Any:
    """Return the numbers that a worker shares with its supervisor, as an array in a file."""
    return np.memmap(file, np.int64, "r+", shape=(len(FIELDS),))


def _resident_kb(field: str) -> int:
    with open("/proc/self/status", encoding="ascii") as status:
        for line in status:
            if line.startswith(field):
                return int(line.split()[1])
    return 0


def _forget_peak() -> None:
    """Let the peak of memory begin anew."""
    with open("/proc/self/clear_refs", "w", encoding="ascii") as file:
        file.write("5")


def main() -> None:
    """Try files from number `start` on."""
    parser = argparse.ArgumentParser()
    for name in ("target", "folder"):
        parser.add_argument(name)
    for name in ("seed", "start", "stop"):
        parser.add_argument(name, type=int)
    options = parser.parse_args()
    faulthandler.enable()
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    run(options.target, Path(options.folder), options.seed, options.start, options.stop)


def run(name: str, folder: Path, seed: int, start: int, stop: int) -> None:
    """Try the files, one line of JSON on standard output for each finding."""
    from tests.robustness.fuzzing.mutation import Mutant
    from tests.robustness.fuzzing.targets import TARGETS
    from tests.robustness.fuzzing.trial import Outcome, Watch, attempt

    target, progress = TARGETS[name], progress_of(folder / "progress")
    seeds = target.seeds()
    for case in seeds:  # imports and compiles what is needed, and shows that the seeds are valid
        outcome = attempt(target, case, folder)
        if outcome.kind != "read":
            _tell({"index": -1, "kind": "seed", "text": f"{case.entry}: {outcome}", "place": "seed"})
    watch = Watch()
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    room = (_resident_kb("VmSize") << 10) + (ROOM_MB << 20)
    resource.setrlimit(resource.RLIMIT_AS, (room, room))
    del used
    progress[PROGRESS["ready"]] = 1
    for index in range(start, stop):
        progress[PROGRESS["index"]], progress[PROGRESS["started_ms"]] = index, time.monotonic_ns() // 10**6
        mutant = Mutant.draw(len(seeds), Random(f"{seed} {name} {index}"))
        case = mutant.build(seeds)
        progress[PROGRESS["started_ms"]] = time.monotonic_ns() // 10**6
        _forget_peak()
        before = _resident_kb("VmRSS")
        outcome = attempt(target, case, folder, watch)
        peak = _resident_kb("VmHWM") - before
        if peak > LIMIT_MB << 10 and not outcome.is_finding:
            outcome = Outcome(
                "memory", f"{peak >> 10} MB for {sum(map(len, case.files.values()))} bytes", "peak"
            )
        progress[PROGRESS["peak_kb"]] = max(int(progress[PROGRESS["peak_kb"]]), peak)
        progress[PROGRESS["tried"]] += 1
        if outcome.kind in ("read", "refused"):
            progress[PROGRESS[outcome.kind]] += 1
        else:
            steps = _shortest(target, mutant, seeds, outcome, folder, watch)
            record = {"index": index, "seed": steps.seed, "steps": steps.steps}
            _tell({**record, "kind": outcome.kind, "text": outcome.text, "place": outcome.place})
    progress[PROGRESS["index"]] = stop


def _shortest(target: Any, mutant: Any, seeds: Any, outcome: Any, folder: Path, watch: Any) -> Any:
    """The mutant without the mutations that are not needed for the finding."""
    from tests.robustness.fuzzing.trial import attempt

    for shorter in mutant.shorter() if outcome.kind != "memory" else ():
        found = attempt(target, shorter.build(seeds), folder, watch)
        if (found.kind, found.place) == (outcome.kind, outcome.place):
            return _shortest(target, shorter, seeds, outcome, folder, watch)
    return mutant


def _tell(record: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(record) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
