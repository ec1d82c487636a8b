# SPDX-License-Identifier: MIT
"""The law that a run which is killed at any moment loses nothing and goes on to the undisturbed run's bytes.

    python examples/check_interruption.py [--moments 50] [--seed 0] [plan] [cover] [study] [completion]

Each kind of run is done once undisturbed. Then, for each random moment of the time that takes: a folder holds
the result of an earlier run with another seed; the run is started over it and killed (SIGKILL) at the moment;
what is seen in the folder then must be whole, all of it of the earlier run or all of it of this one (plans of
a study come one by one); and the run is started again, which must end with the bytes of the undisturbed one
in all files but the manifest, which holds times. Prints a line a kind; exits with 1 where a law fails.
"""

import argparse
import json
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

SENSOR = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 64\nheight = 64\n'
STUDY = """
title = "2 scenes, 3 planners"
sampling = {spacing_m = 0.4, subdivisions = 0}
scenes = [{scene = "builtin:two_occluders"}, {scene = "builtin:drum_and_post"}]
sensors = [{sensor = "small.toml"}]
planners = [
    {method = "nbv", target = 0.5},
    {method = "cover", target = 0.9, polish_steps = 200},
    {method = "random", target = 0.7, views = 30},
]
"""
LOOKS = {"one": ((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), "two": ((1.0, 4.4, 1.5), (3.0, 2.0, 0.6))}


def prepare(place: Path) -> dict[str, list[str]]:
    """Write what the runs read, and return their commands by kind."""
    (place / "small.toml").write_text(SENSOR)
    (place / "study.toml").write_text(STUDY)
    room = builtin_scene("two_occluders")
    for name, (eye, target) in LOOKS.items():
        view = View(Pose.looking_at(eye, target), PinholeSensor(fov_deg=70, width=96, height=72))
        write_scan(scan_scene(room, view, noise="gaussian-2mm", rng=0, name=name), place / f"{name}.npz")
    candidates = ["--candidates", str(place / "candidates.npz")]
    plan = ["plan", "builtin:two_occluders", "--sensor", str(place / "small.toml"), *candidates]
    steps = [np.arange(0.5, size, 1.0) for size in (6.0, 5.0)]
    positions = np.stack(np.meshgrid(*steps, [1.5]), axis=-1).reshape(-1, 3)
    directions = np.array([[x, y, -0.3] for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y])
    np.savez(place / "candidates.npz", positions=positions, directions=directions)
    return {
        "plan": [*plan, "--views", "12"],
        "cover": [*plan, "--method", "cover"],
        "study": ["study", str(place / "study.toml")],
        "completion": ["complete", *(str(place / f"{name}.npz") for name in LOOKS)],
    }


def started(words: list[str], out: Path, seed: int) -> subprocess.Popen[bytes]:
    """Start a run."""
    command = [sys.executable, "-m", "nbv.cli", *words, "-o", str(out), "-q", "--seed", str(seed)]
    return subprocess.Popen(command)


def run(words: list[str], out: Path, seed: int) -> float:
    """Run to the end and return the seconds it took."""
    begin = time.monotonic()
    if started(words, out, seed).wait() != 0:
        raise RuntimeError(f"{words} failed")
    return time.monotonic() - begin


def killed(words: list[str], out: Path, moment: float) -> bool:
    """Run, killed after `moment` seconds; False where it had ended by then."""
    process = started(words, out, 0)
    time.sleep(moment)
    process.send_signal(signal.SIGKILL)
    return process.wait() != 0


def seen(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all files that a user sees, but the manifest."""
    files = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    shown = (file for file in files if not any(part.startswith(".") for part in file.parts))
    return {file.as_posix(): (folder / file).read_bytes() for file in shown if file.name != "manifest.json"}


def is_sealed(folder: Path, own: set[str]) -> bool:
    """Tell whether the manifest names what is seen, but for `own`, with the right hashes."""
    files = seen(folder)
    outputs = json.loads((folder / "manifest.json").read_text())["outputs"]
    named = {entry["name"]: entry["sha256"] for entry in outputs if entry["name"] not in own}
    return all(sha256(files[name]).hexdigest() == digest for name, digest in named.items())


def state(found: dict[str, bytes], earlier: dict[str, bytes], wanted: dict[str, bytes]) -> str:
    """Say of which run a folder's files are; plans of a study may be of either, whole."""
    plans = {name for name in found if name.startswith("plans/")}
    if any(found[name] not in (earlier.get(name), wanted.get(name)) for name in plans):
        return "BROKEN"
    rest = {name: data for name, data in found.items() if name not in plans}
    for word, run_ in (("earlier", earlier), ("new", wanted)):
        if rest == {name: data for name, data in run_.items() if not name.startswith("plans/")}:
            return word
    return "BROKEN"


def check(kind: str, words: list[str], place: Path, n_moments: int, rng: random.Random) -> bool:
    """Kill a kind of run at random moments and print what was found."""
    undisturbed, before = place / f"{kind}-undisturbed", place / f"{kind}-earlier"
    seconds = min(run(words, undisturbed, 0), run(words, before, 1))
    wanted, earlier = seen(undisturbed), seen(before)
    states: Counter[str] = Counter()
    n_same = n_sealed = 0
    steps = []
    for number in range(n_moments):
        out = place / f"{kind}-{number}"
        shutil.copytree(before, out)
        while not killed(words, out, rng.uniform(0.0, seconds)):  # it had ended: the machine is faster now
            shutil.rmtree(out)
            shutil.copytree(before, out)
            seconds *= 0.9
        states[state(seen(out), earlier, wanted)] += 1
        n_sealed += is_sealed(out, {name for name in wanted if name.startswith("plans/")})
        steps.append(len(list(out.glob(".journal/*.npz"))))
        run(words, out, 0)
        n_same += wanted.items() <= seen(out).items() and not list(out.glob(".*"))
        shutil.rmtree(out)
    words_of_states = ", ".join(f"{n} {word}" for word, n in sorted(states.items()))
    print(
        f"{kind}: {seconds:.1f} s undisturbed; killed at {n_moments} moments, "
        f"{min(steps)} to {max(steps)} steps remembered; in the folder then: "
        f"{words_of_states}; {n_sealed} sealed by the manifest; "
        f"run again: {n_same} of {n_moments} with the bytes of the undisturbed run",
        flush=True,
    )
    return n_same == n_sealed == n_moments and not states["BROKEN"]


def main() -> int:
    """Check the kinds of runs that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--moments", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    place = Path(mkdtemp())
    commands = prepare(place)
    held = [
        check(kind, commands[kind], place, given.moments, random.Random(f"{given.seed} {kind}"))
        for kind in given.kinds or commands
    ]
    shutil.rmtree(place)
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
