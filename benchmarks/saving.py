# SPDX-License-Identifier: MIT
"""What it costs to write a completion: seconds of the processor for each file, and what they take in memory.

    python -m benchmarks.saving [SCAN...]

Each scan is completed by itself, without texture; without one the built-in office is scanned by a camera and
by a panorama of 3.3 megapixels. Meshes and outlines that files share are made once: "in turn" is what a file
costs after those above it, as in `unseen complete`, "alone" what it costs by itself. The first row holds
what writing loads.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.completion import Completion, placed
from completion.result.record import completion_record
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor, SphericalSensor
from scenes.io.ply import write_meshes_ply
from scenes.io.scan_files import read_scans
from scenes.pose import Pose
from scenes.run.atomic import write_json
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import builtin_scene

EYE, TARGET, TURNED = (1.2, 2.9, 1.5), (3.5, 1.0, 0.9), (2.2, 2.9, 1.5)
CAMERA = PinholeSensor(fov_deg=70, width=640, height=480)
PANORAMA = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=90, width=2810, height=1171
)


def scans_of(names: list[str]) -> Iterator[tuple[str, RangeImage]]:
    """The scans of files, or simulated ones without any."""
    for name in names:
        for number, scan in enumerate(read_scans(name)):
            yield f"{Path(name).name} #{number}", scan
    if not names:
        office = builtin_scene("office")
        for title, sensor, target in (("camera", CAMERA, TARGET), ("panorama", PANORAMA, TURNED)):
            pose = Pose.looking_at(EYE, target)
            yield title, scan_scene(office, pose, sensor, noise="gaussian-2mm", rng=0)


def load(_completion: Completion, _path: Path) -> None:
    """Import what files are written by."""
    import trimesh  # noqa: F401

    import nbv.report.completion_report  # noqa: F401


def write_report(completion: Completion, path: Path) -> None:
    """Write the page."""
    from nbv.report.completion_report import completion_page

    completion_page(completion, "Benchmark", n_threads=1).write(path)


FILES: dict[str, Callable[[Completion, Path], object]] = {
    "(loading)": load,
    "completion.json": lambda completion, path: write_json(path, completion_record(completion)),
    "completed.glb": lambda completion, path: completion.export(path),
    "polygons.json": lambda completion, path: completion.export(path),
    "observed.ply": lambda completion, path: write_meshes_ply(
        path, placed(completion, completion.derived.observed_parts())
    ),
    "hypothesised.ply": lambda completion, path: write_meshes_ply(
        path, placed(completion, completion.derived.hypothesised_parts())
    ),
    "report.html": write_report,
}
"""What writes each file, in the order of a run."""


def seconds(work: Callable[[], object]) -> float:
    """The processor's seconds that a call takes, on all threads."""
    started = time.process_time()
    work()
    return time.process_time() - started


def peak_mb() -> float:
    """Most memory that this process has held, megabytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def tell(title: str, scan: RangeImage) -> None:
    """Complete a scan; write its files in turn, and each by itself; print what they took."""
    options, found = CompletionOptions(texture=False), []
    complete(scan, options, n_threads=1)  # compiles, or loads what was compiled
    spent = seconds(lambda: found.append(complete(scan, options, n_threads=1)))
    completion = found[0]
    print(f"\n{title}: {scan.ranges.size / 1e6:.2f} megapixels, {len(completion.patches)} surfaces")
    print(f"completed in {spent:.2f} s, {peak_mb():.0f} MB")
    print(f"{'file':18}{'in turn, s':>11}{'alone, s':>10}{'MB':>8}")
    total = 0.0
    with TemporaryDirectory() as folder:
        for name, write in FILES.items():
            path = Path(folder) / name
            in_turn = seconds(partial(write, completion, path))
            alone = seconds(partial(write, replace(completion), path))  # nothing is derived from it so far
            size = path.stat().st_size / 1e6 if path.exists() else 0.0
            print(f"{name:18}{in_turn:11.2f}{alone:10.2f}{size:8.2f}", flush=True)
            total += in_turn
    print(f"{'all':18}{total:11.2f}{'':10}{peak_mb():8.0f} at most in memory")


if __name__ == "__main__":
    for named in scans_of(sys.argv[1:]):
        tell(*named)
