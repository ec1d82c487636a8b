# SPDX-License-Identifier: MIT
"""The law that a change of structure changes no output: SHA-256 of what every command writes.

    python examples/check_golden_bytes.py --write golden.json        # before the change
    python examples/check_golden_bytes.py --against golden.json      # after it
    python examples/check_golden_bytes.py --against golden.json demo coverage

Run in the root of the checkout that is to be looked at. Every command is run once over small inputs; what it
prints and every file that it writes is hashed. A manifest holds times: its keys and its inputs' and outputs'
hashes are taken instead. Prints what differs, and exits with 1 where anything does. Runs on the real scans
under `UNSEEN_DATA` (default `../shared/data`) are left out where these are absent.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp

DATA = Path(os.environ.get("UNSEEN_DATA", "../shared/data")).resolve()
SENSOR = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 64\nheight = 64\n'
STUDY = """
title = "golden"
sampling = {spacing_m = 0.5, subdivisions = 0}
scenes = [{scene = "builtin:two_occluders"}]
sensors = [{sensor = "small.toml"}]
planners = [{method = "nbv", target = 0.5}, {method = "cover", target = 0.8, polish_steps = 100}]
"""
EDITS = [{"do": "accept", "surface": 1}, {"do": "reject", "surface": 2}]
ROOM, CHAIR = "builtin:two_occluders", "builtin:chair_before_wall"
LOOK = "--at 5.0,1.5,1.4 --look 2.0,2.0,0.6 --sensor middle.toml --noise gaussian-2mm"
OTHER = "--at 1.0,4.4,1.5 --look 3.0,2.0,0.6 --sensor middle.toml --noise gaussian-2mm"
SEAT = "--at 0.5,-2.2,1.5 --look 0.0,0.8,0.7 --sensor middle.toml --noise gaussian-2mm"
FORMATS = ("npz", "ply", "pcd", "ptx", "e57", "las", "laz", "xyz", "csv")

FIRST: dict[str, str] = {
    **{f"scan {suffix}": f"scan {CHAIR} {SEAT} -o scan/chair.{suffix}" for suffix in FORMATS},
    "scan one": f"scan {ROOM} {LOOK} -o scan/one.npz",
    "scan two": f"scan {ROOM} {OTHER} -o scan/two.npz",
    "scan folder": f"scan {ROOM} --poses poses.txt --sensor small.toml -o scan/folder",
    "plan nbv": f"plan {ROOM} --sensor small.toml --views 6 -o plan/nbv",
}
"""Runs whose outputs others read."""
RUNS: dict[str, str] = {
    "demo": "demo -o demo",
    "complete chair": "complete scan/chair.npz --export obj --export e57 -o done/chair",
    "complete e57": "complete scan/chair.e57 --texture off -o done/e57",
    "complete pcd": "complete scan/chair.pcd --texture off -o done/pcd",
    "complete points": "complete scan/chair.xyz --origin 0.5,-2.2,1.5 --texture off -o done/points",
    "complete two": "complete scan/one.npz scan/two.npz -o done/two",
    "complete plain": "complete scan/one.npz --texture off -o done/plain",
    "complete bold": "complete scan/one.npz --inference bold --texture off -o done/bold",
    "complete conservative": "complete scan/one.npz --inference conservative --texture off "
    "-o done/conservative",
    "plan cover": f"plan {ROOM} --method cover --sensor panorama --target 0.9 -o plan/cover",
    "plan object": "plan builtin:drum_and_post --mode object --sensor small.toml --views 4 -o plan/object",
    "plan infer": f"plan {ROOM} --infer --sensor middle.toml --views 3 -o plan/infer",
    "plan scans": "plan --scans scan/one.npz --views 1 --sensor small.toml -o plan/next",
    "coverage plan": f"coverage {ROOM} --plan plan/nbv/plan.json -o coverage/plan",
    "coverage scans": f"coverage {ROOM} --scans scan/one.npz --scans scan/two.npz -o coverage/scans",
    "coverage alone": "coverage --scans scan/one.npz -o coverage/alone",
    "texture mask": "texture brick.png --mask mask.png -o texture/filled.png",
    "texture surface": "texture brick.png --mask mask.png --surface -o texture/surface.png",
    "texture grow": "texture brick.png --grow 40x48 --order window -o texture/grown.png",
    **{
        f"fit {shape}": f"fit cylinder.xyz --shape {shape}"
        for shape in ("auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone")
    },
    "fit robust": "fit cylinder.xyz --shape cylinder --robust --json",
    "fit rays": "fit cylinder.xyz --shape cylinder --rays --origin 0,0,0",
    "study": "study study.toml -o study",
    "frame": f"complete {DATA}/range/open3d_redwood#1 --texture off -o real/frame",
}
LAST: dict[str, str] = {
    "complete edited": "complete scan/one.npz --edits edits.json --texture off -o done/edited",
    **{f"info {suffix}": f"info scan/chair.{suffix}" for suffix in FORMATS},
    "info folder": "info done/chair --json",
    "info plan": "info plan/nbv --json",
    "info mesh": "info done/chair/completed.glb",
    "info json": "info done/chair/completion.json",
    "info scene": f"info {ROOM}",
}
"""Runs that read what the others wrote."""


def prepare(place: Path) -> None:
    """Write what the runs read; arrays by numpy alone, so that no code of ours has a hand in it."""
    import cv2
    import numpy as np
    from skimage import data

    for folder in ("scan", "texture"):
        (place / folder).mkdir(exist_ok=True)
    (place / "small.toml").write_text(SENSOR)
    (place / "middle.toml").write_text(SENSOR.replace("64", "144").replace('"small"', '"middle"'))
    (place / "study.toml").write_text(STUDY)
    (place / "poses.txt").write_text("5 1.5 1.4 0.5 -0.5 0.5 -0.5\n1 4.4 1.5 -0.7071068 0 0 0.7071068\n")
    cv2.imwrite(str(place / "brick.png"), data.brick()[:96, :96])
    mask = np.zeros((96, 96), np.uint8)
    mask[40:56, 30:52] = 255
    cv2.imwrite(str(place / "mask.png"), mask)
    rng = np.random.default_rng(7)
    angle, height = rng.uniform(0, 2, 900), rng.uniform(0, 1, 900)
    points = np.stack([0.3 * np.cos(angle) + 2, 0.3 * np.sin(angle), height], axis=1)
    np.savetxt(place / "cylinder.xyz", points + rng.normal(0, 1e-3, points.shape), "%.6f")


def outputs(place: Path, words: list[str], printed: bytes, complaint: bytes, code: int) -> dict[str, str]:
    """Return the hash of what a run printed and of each file that it wrote."""
    found = {"exit": str(code), "stdout": digest(printed), "stderr": digest(complaint)}
    if "-o" in words:
        out = place / words[words.index("-o") + 1]
        files = sorted(path for path in out.rglob("*") if path.is_file()) if out.is_dir() else [out]
        files += [out.with_name(out.name + ".manifest.json")] if not out.is_dir() else []
        for file in files:
            data = file.read_bytes() if file.exists() else b""
            data = steady(data) if data and file.name.endswith("manifest.json") else data
            found[str(file.relative_to(place))] = digest(data)
    return found


def steady(manifest: bytes) -> bytes:
    """Return what of a manifest does not change from run to run: no times, no memory."""
    record = json.loads(manifest)
    return json.dumps(
        {key: value for key, value in record.items() if key in ("inputs", "outputs", "seed")}
    ).encode()


def digest(data: bytes) -> str:
    """Return a digest; times in what is printed do not count."""
    if len(data) < 20_000:
        data = re.sub(rb"\d+(\.\d+)? s\b|\"(finished|seconds)\": [^,}\n]*", b"", data)
    return sha256(data).hexdigest()[:16]


def take(place: Path, root: Path, names: list[str]) -> dict[str, dict[str, str]]:
    """Run the commands and return their outputs' hashes by name."""
    here = {**os.environ, "PYTHONPATH": str(root), "COLUMNS": "100", "UNSEEN_QUIET": "1"}

    def one(item: tuple[str, list[str]]) -> tuple[str, dict[str, str]]:
        name, words = item
        command = [sys.executable, "-P", "-m", "nbv.cli", *words, "--threads", "1"]
        done = subprocess.run(command, cwd=place, env=here, capture_output=True, check=False)
        print(
            f"{name}: exit {done.returncode} {done.stderr.decode()[-300:] if done.returncode else ''}",
            flush=True,
        )
        return name, outputs(place, words, done.stdout, done.stderr, done.returncode)

    found: dict[str, dict[str, str]] = {}
    for stage in (FIRST, RUNS, LAST):
        plain = place / "done/plain/completion.json"
        if stage is LAST and plain.exists():
            (place / "edits.json").write_text(json.dumps({**json.loads(plain.read_text()), "edits": EDITS}))
        wanted = {
            name: words.split()
            for name, words in stage.items()
            if not names or stage is FIRST or name.split()[0] in names
        }
        if not DATA.exists():
            wanted.pop("frame", None)
        with ThreadPoolExecutor(2) as pool:
            found.update(pool.map(one, wanted.items()))
    return found


def main() -> None:
    """Run, compare, and say what differs."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--write")
    arguments.add_argument("--against")
    arguments.add_argument("--keep", help="leave the outputs in this folder")
    arguments.add_argument("names", nargs="*", help="commands; all when none is named")
    chosen = arguments.parse_args()
    place = Path(chosen.keep).resolve() if chosen.keep else Path(mkdtemp())
    place.mkdir(parents=True, exist_ok=True)
    prepare(place)
    found = take(place, Path.cwd(), chosen.names)
    if chosen.write:
        Path(chosen.write).write_text(json.dumps(found, indent=1))
    different = 0
    if chosen.against:
        before = json.loads(Path(chosen.against).read_text())
        for name, hashes in found.items():
            for what in sorted({*hashes, *before.get(name, {})}):
                if hashes.get(what) != before.get(name, {}).get(what):
                    different += 1
                    print(f"differs: {name}: {what}")
        print(f"{sum(map(len, found.values()))} outputs of {len(found)} runs, {different} differ")
    if not chosen.keep:
        shutil.rmtree(place)
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
