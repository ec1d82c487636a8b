# SPDX-License-Identifier: MIT
"""The law that an interrupted study ends with the bytes of an undisturbed one, at full size.

    python examples/check_interruption.py [FOLDER]

Runs a study of 2 scenes, 2 requirements, 3 planners and 5 seeds four times: undisturbed; killed (SIGKILL)
three times at random moments and started again; on a cluster of two processes; and on such a cluster of which
a worker is killed. It prints how many plans each kill left behind, compares all files but the manifest (which
holds times), and exits with 1 where any differ.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from nbv.cluster import DaskWorkers, cluster
from nbv.study.pipeline import run_study
from nbv.study.spec import read_study
from nbv.workers import Item, Result, Work

SENSOR = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 64\nheight = 64\n'
STUDY = """
title = "2 scenes, 2 requirements, 3 planners, 5 seeds"
seeds = 5
sampling = {spacing_m = 0.4, subdivisions = 0}
scenes = [{scene = "builtin:two_occluders"}, {scene = "builtin:drum_and_post"}]
sensors = [{sensor = "small.toml"}]
requirements = [{max_incidence_deg = 60}, {max_incidence_deg = 75}]
planners = [
    {method = "nbv", target = 0.8},
    {method = "cover", target = 0.95, polish_steps = 500},
    {method = "random", target = 0.8, views = 60},
]
"""
N_CASES, N_KILLS = 60, 3


class Assassin:
    """Workers of a cluster, one of which is killed after a third of the work."""

    def __init__(self, workers: DaskWorkers, pids: dict[str, int]) -> None:
        self.workers, self.pids = workers, pids

    def each(
        self, work: Work[Item, Result], items: Sequence[Item], keys: Sequence[str]
    ) -> Iterator[tuple[int, Result]]:
        """Yield what the workers yield."""
        for done, found in enumerate(self.workers.each(work, items, keys)):
            if done == len(items) // 3:
                os.kill(next(iter(self.pids.values())), signal.SIGKILL)
            yield found


def contents(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files but the manifest."""
    files = sorted(file for file in folder.rglob("*") if file.is_file() and file.name != "manifest.json")
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def command(study: Path, out: Path, *more: str) -> list[str]:
    """Return the command that runs the study."""
    return [sys.executable, "-m", "nbv.cli", "study", str(study), "-o", str(out), "-q", *more]


def killed(study: Path, out: Path, rng: random.Random) -> list[int]:
    """Run the study, killed three times; return how many plans were there at each kill."""
    left = []
    for moment in sorted(rng.sample(range(1, N_CASES), N_KILLS)):
        process = subprocess.Popen(command(study, out))
        while len(list(out.glob("plans/[!.]*.json"))) < moment and process.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.5))  # in the middle of something
        process.send_signal(signal.SIGKILL)
        process.wait()
        left.append(len(list(out.glob("plans/[!.]*.json"))))
    subprocess.run(command(study, out), check=True)
    return left


def main(folder: str | None = None) -> int:
    """Run the study four times and compare."""
    place = Path(folder or mkdtemp())
    place.mkdir(parents=True, exist_ok=True)
    study = place / "study.toml"
    study.write_text(STUDY)
    (place / "small.toml").write_text(SENSOR)
    outs: dict[str, Path] = {name: place / name for name in ("undisturbed", "killed", "cluster", "bereft")}
    for out in outs.values():
        shutil.rmtree(out, ignore_errors=True)
    begin = time.monotonic()
    subprocess.run(command(study, outs["undisturbed"]), check=True)
    print(f"undisturbed: {time.monotonic() - begin:.0f} s", flush=True)
    print(
        f"killed with {killed(study, outs['killed'], random.Random(0))} of {N_CASES} plans there", flush=True
    )
    subprocess.run(command(study, outs["cluster"], "--scheduler", "local:2"), check=True)
    with cluster("local:2", 1) as workers:
        pids: dict[str, Any] = workers.client.run(os.getpid)
        run_study(read_study(study), outs["bereft"] / "plans", workers=Assassin(workers, pids))
    subprocess.run(command(study, outs["bereft"]), check=True)
    wanted, same = contents(outs["undisturbed"]), True
    for name, out in outs.items():
        equal = contents(out) == wanted
        same &= equal
        print(f"{name}: {len(contents(out))} files, {'the same bytes' if equal else 'DIFFERENT'}", flush=True)
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
