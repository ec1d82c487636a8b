# SPDX-License-Identifier: MIT
"""Whether the wheel works: built, installed in a clean environment of each Python, and tested there.

    python examples/check_distribution.py [--quick] PYTHON...

Builds wheel and sdist, and for each interpreter that is named installs the wheel without extras, completes a
scan with it and compares the bytes with those of the first interpreter; then installs it with all extras and
runs the sdist's tests against it, away from the sources (`--quick` leaves them out). Exits with 1 where
anything fails.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TOOLS = ("pytest>=8.3,<10", "pytest-xdist>=3.6,<4", "hypothesis>=6.120,<7")
SCAN = ("scan", "builtin:chair_before_wall", "--at", "0.3,-1.6,1.1", "--look", "0,1,0.8")
PACKAGES = ("scenes", "texture", "completion", "nbv")


def run(*command: object, cwd: Path, env: dict[str, str] | None = None) -> None:
    """Run a command; raise where it fails."""
    subprocess.run([str(part) for part in command], cwd=cwd, check=True, env=env)


def build(place: Path) -> tuple[Path, Path]:
    """Build wheel and sdist from a copy of what the repository holds."""
    run(sys.executable, "-m", "build", "--outdir", place / "dist", ROOT, cwd=place)
    return next(place.glob("dist/*.whl")), next(place.glob("dist/*.tar.gz"))


def environment(python: str, place: Path) -> Path:
    """Make a clean environment and return its folder of programs."""
    run(python, "-m", "venv", place, cwd=place.parent)
    return place / ("Scripts" if os.name == "nt" else "bin")


def completed(programs: Path, place: Path) -> str:
    """Complete a scan by the installed command, without extras; return the hash of what came out."""
    place.mkdir()
    run(programs / "unseen", *SCAN, "--noise", "gaussian-2mm", "-o", place / "scan.npz", "-q", cwd=place)
    run(programs / "unseen", "complete", "scan.npz", "-o", "completed", "-q", cwd=place)
    parts = [place / "completed" / name for name in ("completion.json", "hypothesised.ply", "observed.ply")]
    return hashlib.sha256(b"".join(part.read_bytes() for part in parts)).hexdigest()


def tested(programs: Path, wheel: Path, sdist: Path, place: Path) -> None:
    """Run the sdist's tests against the installed wheel."""
    run(programs / "python", "-m", "pip", "install", "-q", f"{wheel}[all]", *TOOLS, cwd=place)
    with tarfile.open(sdist) as archive:
        archive.extractall(place, filter="data")
    source = place / sdist.name.removesuffix(".tar.gz")
    for package in PACKAGES:
        shutil.rmtree(source / package)
    data = {f"UNSEEN_{name.upper()}": str(ROOT.parent / "shared" / name) for name in ("data", "bench")}
    elsewhere = "--ignore=tests/docs/test_docs.py"  # its links lead into the sources
    run(programs / "python", "-m", "pytest", "-n", "2", "--dist", "loadfile", elsewhere, cwd=source,
        env={**data, **os.environ})  # fmt: skip


def main(pythons: list[str], *, quick: bool) -> int:
    """Check each interpreter and tell."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        wheel, sdist = build(place)
        print(f"{wheel.name} {wheel.stat().st_size:,} bytes, {sdist.name} {sdist.stat().st_size:,} bytes")
        hashes = {}
        for number, python in enumerate(pythons):
            programs = environment(python, place / f"environment-{number}")
            run(programs / "python", "-m", "pip", "install", "-q", wheel, cwd=place)
            hashes[python] = completed(programs, place / f"core-{number}")
            print(f"{python}: completes without extras, {hashes[python][:12]}", flush=True)
            if not quick:
                work = place / f"tests-{number}"
                work.mkdir()
                tested(programs, wheel, sdist, work)
                print(f"{python}: the wheel passes the tests", flush=True)
        same = len(set(hashes.values())) <= 1
        print("the same bytes on each" if same else "DIFFERENT bytes")
        return 0 if same else 1


if __name__ == "__main__":
    named = [argument for argument in sys.argv[1:] if argument != "--quick"]
    sys.exit(main(named or [sys.executable], quick="--quick" in sys.argv))
