# SPDX-License-Identifier: MIT
"""The law that a command without enough memory ends, and leaves its old output intact.

    python examples/check_limits.py [COMMAND ...] [--steps N] [--max-memory]

Runs each command undisturbed, then under ever larger limits on its address space (RLIMIT_AS, `ulimit -v`),
or with ever larger `--max-memory`, until it succeeds, over the outputs of the first run. Prints a table of
what became of it, and exits with 1 where a run changed the outputs that were there, or hung with
`--max-memory`.
"""

import argparse
import hashlib
import os
import re
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
MB = 1_000_000
LEAST_MB, TIMEOUT_S = 100, 600
LINE = re.compile(r"unseen( [a-z]+)?: .+\n")
SENSOR = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 96\nheight = 96\n'
STUDY = """
seeds = 1
sampling = {spacing_m = 0.4, subdivisions = 0}
scenes = [{scene = "builtin:two_occluders"}]
sensors = [{sensor = "small.toml"}]
requirements = [{max_incidence_deg = 60}]
planners = [{method = "nbv", views = 2}]
"""


@dataclass(frozen=True)
class Ending:
    """How a run ended."""

    code: int  # exit code, negative for a signal; None-like 999 for one that hung
    said: str  # its standard error
    peak_bytes: int  # largest resident memory

    @property
    def kind(self) -> str:
        """What became of it: done, one line of ours, a failure in a library's words, or hung."""
        if self.code == 0:
            return "done"
        if self.code == 1 and LINE.fullmatch(self.said):
            return "one line"
        return "hung" if self.code == 999 else f"failed with {self.code}"


def commands(folder: Path) -> dict[str, list[str]]:
    """Return a small run of each command, what it reads having been made in `folder`."""
    (folder / "small.toml").write_text(SENSOR)
    (folder / "study.toml").write_text(STUDY)
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    Image.fromarray(noise).save(folder / "noise.png")
    np.savetxt(folder / "plane.xyz", np.random.default_rng(0).normal(size=(500, 3)) * [1, 1, 0.01])
    room, stands = "builtin:two_occluders", ["--at", "1,1,1.5", "--look", "3,3,1"]
    scan = ["scan", room, *stands, "--sensor", "small.toml", "-o", "scan.npz"]
    return {
        "scan": scan,
        "info": ["info", "scan.npz", "-o", "info.json"],
        "fit": ["fit", "plane.xyz", "--shape", "plane", "-o", "fit.json"],
        "texture": ["texture", "noise.png", "--grow", "32x32", "--window", "7", "-o", "texture.png"],
        "complete": ["complete", "scan.npz", "-o", "completed"],
        "plan": ["plan", room, "--sensor", "small.toml", "--views", "2", "-o", "plan"],
        "cover": ["plan", room, "--method", "cover", "--sensor", "small.toml", "--polish-steps", "100",
                  "-o", "cover"],
        "coverage": ["coverage", room, "--plan", "plan/plan.json", "-o", "report"],
        "study": ["study", "study.toml", "-o", "study"],
        "demo": ["demo", "-o", "demo"],
    }  # fmt: skip


def run(
    arguments: Sequence[str], folder: Path, *, limit: int | None = None, max_memory: int | None = None
) -> Ending:
    """Run `unseen` in `folder`, under a limit on its address space, or with a budget, in bytes."""
    budget = [] if max_memory is None else ["--max-memory", str(max_memory)]
    command = [sys.executable, "-m", "nbv.cli", *arguments, "--quiet", *budget]

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_AS, (limit, limit))

    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with (folder / "stderr.txt").open("w+") as said:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=said, preexec_fn=limited
        )
        begin, peak = time.monotonic(), 0
        while process.poll() is None and time.monotonic() < begin + TIMEOUT_S:
            peak = max(peak, peak_bytes(process.pid))
            time.sleep(0.01)
        code = process.poll()
        if code is None:
            process.kill()
            process.wait()
        said.seek(0)
        return Ending(999 if code is None else code, said.read(), peak)


def peak_bytes(pid: int) -> int:
    """Return the largest resident memory that a process, or a child of its, has had; 0 where it has gone.

    What `wait4` tells includes that of whoever forked it.
    """
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        marks = [line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if "VmHWM" in line]
    except OSError:
        return 0
    own = int(marks[0].split()[1]) * 1024 if marks else 0
    return max([own, *(peak_bytes(int(child)) for child in children)])


def digests(folder: Path) -> dict[str, str]:
    """Return what the files of a folder hold, hidden ones and the log apart."""
    files = [file for file in folder.rglob("*") if file.is_file() and file.name != "stderr.txt"]
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if not any(part.startswith(".") for part in file.relative_to(folder).parts)
    }


def limits(n_steps: int) -> Iterator[int]:
    """Yield limits in bytes that grow by a constant factor, from 100 MB to 4 GB."""
    yield from (LEAST_MB * MB * 40 ** np.linspace(0, 1, n_steps)).astype(int).tolist()


def sweep(name: str, arguments: Sequence[str], folder: Path, n_steps: int, is_budget: bool) -> bool:
    """Run one command under all limits and print a line of the table; return whether all was well."""
    whole = run(arguments, folder)
    if whole.kind != "done":
        raise SystemExit(f"{name} fails undisturbed: {whole}")
    before, kinds, enough, largest = digests(folder), Counter[str](), None, 0.0
    for limit in limits(n_steps):
        ending = run(arguments, folder, **{"max_memory" if is_budget else "limit": limit})
        kinds[ending.kind] += 1
        if digests(folder).keys() != before.keys() or (ending.code and digests(folder) != before):
            kinds["outputs changed"] += 1
        largest = max(largest, ending.peak_bytes / limit)
        if ending.code == 0:
            enough = limit
            break
    said = ", ".join(f"{count} x {kind}" for kind, count in sorted(kinds.items()))
    room = "never" if enough is None else f"{enough / MB:.0f} MB"
    share = f", peak at most {100 * largest:.0f} % of the limit" if is_budget else ""
    print(f"{name:9} undisturbed {whole.peak_bytes / MB:5.0f} MB resident; done with {room:8} {said}{share}",
          flush=True)  # fmt: skip
    return not kinds.keys() & ({"hung", "outputs changed"} if is_budget else {"outputs changed"})


def main() -> int:
    """Sweep the commands; 1 where any ended otherwise than promised."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", nargs="*")
    parser.add_argument("--steps", type=int, default=18)
    parser.add_argument("--max-memory", action="store_true", help="limit by the option, not by the system")
    given = parser.parse_args()
    folder = Path(mkdtemp())
    known = commands(folder)
    for needed in ("scan", "plan"):  # others read what these write
        run(known[needed], folder)
    chosen = given.command or list(known)
    swept = [sweep(name, known[name], folder, given.steps, given.max_memory) for name in chosen]
    return int(not all(swept))


if __name__ == "__main__":
    raise SystemExit(main())
