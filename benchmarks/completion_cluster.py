# SPDX-License-Identifier: MIT
"""Completing stations by workers: the whole command alone and with `--scheduler local:N`, from files.

The stations of `benchmarks.stations`, without texture. For each: wall seconds, CPU seconds of all processes,
what went through the machine's own network meanwhile (dask's traffic, and that of whatever else there is),
the most bytes that the journal had, and a digest of all outputs but the manifest. The largest process is the
largest so far.

    python -m benchmarks.completion_cluster [STATIONS] [MEGAPIXELS] [WORKERS,...]
"""

from __future__ import annotations

import hashlib
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.stations import take_scans
from scenes.io.scan_files import write_scan

_POLL_S = 0.2


def sent() -> int:
    """Return the bytes that went through the loopback interface so far; 0 where that is not told."""
    try:
        lines = Path("/proc/net/dev").read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split(":")[1].split()[0]) for line in lines if line.strip().startswith("lo:"))


def measure(scans: list[str], out: Path, options: list[str]) -> str:
    """Complete once; return a line of what it took."""
    before, bytes_before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), sent(), time.perf_counter()
    command = [sys.executable, "-m", "nbv.cli", "complete", *scans, "--no-texture", "-q", "-o", str(out)]
    process, journal = subprocess.Popen([*command, "--threads", "1", *options]), 0
    while process.poll() is None:
        time.sleep(_POLL_S)
        journal = max(journal, sum(size_of(file) for file in out.glob(".journal/**/*.npz")))
    if process.returncode != 0:
        raise RuntimeError(f"{options} failed")
    seconds, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    digest = hashlib.sha256()
    for file in sorted(out.iterdir()):
        if file.name != "manifest.json":
            digest.update(file.read_bytes())
    return (
        f"{seconds:7.1f} {spent:7.1f} {after.ru_maxrss / 1024:10.0f} {(sent() - bytes_before) / 1e6:8.2f} "
        f"{journal / 1e6:10.1f}  {digest.hexdigest()[:8]}"
    )


def size_of(file: Path) -> int:
    """Return the bytes of a file, 0 where it is gone."""
    try:
        return file.stat().st_size
    except OSError:
        return 0


def main() -> None:
    """Complete alone and with so many workers; print a line each."""
    defaults = ["8", "1.0", "1,2"]
    words = [*sys.argv[1:4], *defaults[len(sys.argv[1:4]) :]]
    n_stations, megapixels = int(words[0]), float(words[1])
    print(
        f"{'workers':>8} {'wall s':>7} {'CPU s':>7} {'largest MB':>10} {'sent MB':>8} {'kept MB':>10}  digest"
    )
    with TemporaryDirectory() as folder:
        scans = [str(Path(folder, f"{number}.npz")) for number in range(n_stations)]
        for scan, file in zip(take_scans(n_stations, megapixels), scans, strict=True):
            write_scan(scan, Path(file))
        for workers in ["none", *words[2].split(",")]:
            options = [] if workers == "none" else ["--scheduler", f"local:{workers}"]
            print(f"{workers:>8} {measure(scans, Path(folder, f'by {workers}'), options)}", flush=True)


if __name__ == "__main__":
    main()
