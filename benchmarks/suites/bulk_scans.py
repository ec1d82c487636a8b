# SPDX-License-Identifier: MIT
"""Scans in bulk: CPU and memory of `unseen scan --poses`, kills and workers; a scanner beside bare rays."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.run import head, row, suite
from nbv.scanning.beam import Intensity, sub_rays
from nbv.scanning.effects import Effects, stage_streams
from nbv.scanning.noise_models import range_sigma_m
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor_profile import load_sensor
from scenes.checks import FloatArray, InputError
from scenes.io.poses.trajectory import write_poses
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.projection import Projection
from scenes.world.scene import Scene

SENSOR = "phase_terrestrial"
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class BulkRun:
    """What a run of the command took: seconds by the clock and of all its processes, its largest process."""

    wall_s: float
    cpu_s: float
    peak_mb: float
    scan_s: float
    written_mb: float
    digest: str


def write_inputs(folder: Path, scene: str, n: int, megapixels: float) -> None:
    """Write a sensor of so many pixels, and n poses about the middle of the scene's box."""
    like = load_sensor(SENSOR)
    rows, columns = like.projection.shape
    scale = np.sqrt(megapixels * 1e6 / (rows * columns))
    size = f"width = {round(columns * scale)}\nheight = {round(rows * scale)}\n"
    (folder / "scanner.toml").write_text(f'like = "{SENSOR}"\n{size}')
    corners = open_scene(scene).mesh.vertices
    low, high = corners.min(axis=0), corners.max(axis=0)
    rng = np.random.default_rng(0)
    places = low + (high - low) * rng.uniform(0.45, 0.55, (n, 3))
    ways = rng.normal(size=(n, 2))
    looks = places + np.column_stack([ways, np.zeros(n)])
    write_poses(folder / "poses.txt", [Pose.looking_at(*pair) for pair in zip(places, looks, strict=True)])


def start(folder: Path, scene: str, out: str, *more: str) -> subprocess.Popen[bytes]:
    """Start the command in a folder with its inputs."""
    words = ("scan", scene, "--poses", "poses.txt", "--sensor", "scanner.toml", "--noise", "profile")
    root = str(Path(__file__).parents[2])
    return subprocess.Popen(
        [sys.executable, "-m", "nbv.cli", *words, "-o", out, "--no-truth", "--quiet", *more],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": root},
    )


def _family(process: int) -> list[int]:
    """Return a process and those that it started, and they."""
    family = [process]
    for one in family:
        try:
            for thread in Path(f"/proc/{one}/task").iterdir():
                family += map(int, (thread / "children").read_text().split())
        except OSError:
            continue
    return family


def _peak_kb(process: int) -> int:
    """Return the peak of resident memory so far; `getrusage` would count that of whoever started it."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), 0)


def finish(process: subprocess.Popen[bytes], begin: float, out: Path) -> BulkRun:
    """Wait for the command; hash what it wrote.

    Raises InputError: it failed.
    """
    peak, ended = 0, 0
    while not ended:
        peak = max([peak, *map(_peak_kb, _family(process.pid))])
        time.sleep(_POLL_S)
        ended, status, usage = os.wait4(process.pid, os.WNOHANG)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise InputError(f"unseen scan ended with {process.returncode}")
    wall = time.perf_counter() - begin
    beside = out.with_name(f"{out.name}.manifest.json")
    manifest = json.loads((beside if out.is_file() else out / "manifest.json").read_text())
    files = manifest["outputs"]
    digest = hashlib.sha256("".join(file["sha256"] for file in files).encode()).hexdigest()[:8]
    cpu, scan_s = usage.ru_utime + usage.ru_stime, manifest["times"]["stages_s"]["scan"]
    return BulkRun(wall, cpu, peak / 1e3, scan_s, sum(file["bytes"] for file in files) / 1e6, digest)


def run_bulk(scene: str, n: int, megapixels: float, *more: str, out: str = "scans") -> BulkRun:
    """Scan n times in a folder that is gone afterwards."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder, scene, n, megapixels)
        begin = time.perf_counter()
        return finish(start(folder, scene, out, *more), begin, folder / out)


def killed_and_resumed(scene: str, n: int, megapixels: float, *more: str) -> tuple[int, BulkRun]:
    """Kill a run when a third of the scans are there, and run it again; return how many there were."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_inputs(folder, scene, n, megapixels)
        process = start(folder, scene, "scans", *more)
        records = folder / "scans" / ".journal" / "records"
        while len(list(records.glob("view-*.json"))) < n / 3 and process.poll() is None:
            time.sleep(_POLL_S)
        process.send_signal(signal.SIGKILL)
        process.wait()
        n_kept = len(list(records.glob("view-*.json")))
        begin = time.perf_counter()
        return n_kept, finish(start(folder, scene, "scans", *more), begin, folder / "scans")


@suite("bulk-scans", smallest="--numbers 2,3 --workers 2 --megapixels 0.01")
def bulk_scans(
    numbers: str = "25,50,100,200", workers: int = 25, megapixels: float = 1.0, scene: str = "builtin:office"
) -> Iterator[str]:
    """CPU seconds a Mpixel, memory by number of scans, a kill, one file of all, one worker against two."""
    files = ("--format", "e57")

    def line(name: str, n: int, found: BulkRun) -> str:
        pixels = n * megapixels
        return row(
            name, n, f"{found.wall_s:.0f}", f"{found.scan_s:.0f}", f"{found.cpu_s:.0f}",
            f"{found.cpu_s / pixels:.2f}", f"{found.peak_mb:.0f}", f"{found.written_mb:.0f}", found.digest,
        )  # fmt: skip

    yield f"load of the machine at the start: {os.getloadavg()[0]:.1f} of {os.cpu_count()} cores"
    yield from head(
        "run", "scans", "wall s", "of them scanning", "CPU s", "CPU s a Mpixel", "peak MB", "MB written",
        "digest",
    )  # fmt: skip
    for n in map(int, filter(None, numbers.split(","))):
        yield line("one thread", n, run_bulk(scene, n, megapixels, *files, "--threads", "1"))
    if not workers:
        return
    n_kept, again = killed_and_resumed(scene, workers, megapixels, *files, "--threads", "1")
    yield line(f"killed at {n_kept}, then resumed", workers, again)
    yield line("one file", workers, run_bulk(scene, workers, megapixels, "--threads", "1", out="all.e57"))
    yield line("two threads", workers, run_bulk(scene, workers, megapixels, *files, "--threads", "2"))
    one, two = (
        run_bulk(scene, workers, megapixels, *files, "--threads", "1", "--scheduler", f"local:{n}")
        for n in (1, 2)
    )
    yield line("one worker", workers, one)
    yield line("two workers", workers, two)
    yield f"two workers scan {one.scan_s / two.scan_s:.2f} times as fast as one"


def _open3d_caster(scene: Scene) -> Any:
    """Return the scene in Open3D's RaycastingScene, None where that is not installed."""
    try:
        import open3d as o3d
    except (ImportError, OSError):
        return None
    caster = o3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(
        o3d.core.Tensor(scene.mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(scene.mesh.faces.astype(np.uint32)),
    )

    def cast(starts: FloatArray, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ranges (n,) and cosines of incidence (n,) of rays in single precision."""
        rays = np.concatenate([np.broadcast_to(starts, ways.shape), ways], axis=1).astype(np.float32)
        hits = caster.cast_rays(o3d.core.Tensor(rays), nthreads=1)
        cosine = np.abs(np.einsum("nk,nk->n", hits["primitive_normals"].numpy(), rays[:, 3:]))
        return hits["t_hit"].numpy().astype(np.float64), cosine

    return cast


def mean_of_light(ranges: FloatArray, cosine: FloatArray) -> FloatArray:
    """Mean range (n,) of the rays (n, k) of each beam, weighted by their light; inf where none came back."""
    met = np.isfinite(ranges)
    weight = np.where(met, np.maximum(cosine, 1e-12) / np.where(met, ranges, 1.0) ** 2, 0.0)
    total = weight.sum(axis=1)
    mean = (weight * np.where(met, ranges, 0.0)).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, mean, np.inf)


def _beams(projection: Projection, pose: Pose) -> FloatArray:
    return np.ascontiguousarray(pose.rotate(projection.directions().reshape(-1, 3)))


def _timed(work: Any, rounds: int) -> tuple[Any, float]:
    """Return what `work` returns, and the least CPU seconds of so many rounds."""
    spent, found = [], None
    for _ in range(rounds):
        found = None
        begin = time.process_time()
        found = work()
        spent.append(time.process_time() - begin)
    return found, min(spent)


def _differences(one: FloatArray, other: FloatArray) -> FloatArray:
    """Differences (n,) of ranges, NaN where either ray met nothing."""
    return np.where(np.isfinite(one), one, np.nan) - np.where(np.isfinite(other), other, np.nan)


def _by_incidence(error: FloatArray, predicted: FloatArray | None, incidence: FloatArray) -> list[str]:
    """Standard deviations in millimetres by bins of incidence, and those predicted."""
    cells, incidence_deg = [], np.degrees(incidence)
    for low, high in _BINS:
        inside = (incidence_deg >= low) & (incidence_deg < high) & np.isfinite(error)
        if not inside.any():
            cells.append("-")
            continue
        told = f"{1e3 * np.sqrt(np.mean(predicted[inside] ** 2)):.3f}, " if predicted is not None else ""
        cells.append(f"{1e3 * np.std(error[inside]):.3g} ({told}{inside.sum()})")
    return cells


_BINS = ((0, 20), (20, 40), (40, 60), (60, 80), (80, 88))
_EDGE_M = 0.01


@suite("scanner-beside", smallest="--megapixels 0.01 --rounds 1")
def scanner_beside(
    megapixels: float = 1.0, rounds: int = 3, scene: str = "builtin:office", scale: float = 20.0
) -> Iterator[str]:
    """A phase scanner beside the bare rays of Open3D: same scene, made larger, and beams, one thread."""
    with TemporaryDirectory() as name:
        write_inputs(Path(name), scene, 1, megapixels)
        sensor = load_sensor(Path(name, "scanner.toml"))
    small, grey = open_scene(scene), Intensity(reflectivity=0.5)
    corners = small.mesh.vertices * scale
    world = replace(small, mesh=replace(small.mesh, vertices=corners))
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    pose, footprint = Pose.looking_at(middle, middle + [1.0, 0.3, 0.0]), sensor.effects.footprint
    model = sensor.effects.noise
    if footprint is None or model is None:
        raise InputError(f"{SENSOR} has no footprint, or no noise")
    caster, along = world.ray_caster(1), _beams(sensor.projection, pose)
    turns = 2 * np.pi * stage_streams(0, ("footprint",))["footprint"].random(len(along))
    theirs = _open3d_caster(world)
    take = partial(scan_scene, world, pose, sensor, rng=0, caster=caster, n_threads=1)
    edges = Effects(footprint=footprint, intensity=grey)
    noise = Effects(intensity=grey, noise=model)

    hits, bare_s = _timed(lambda: caster.first_hit(middle[None], along).flat(), rounds)
    mean, beams_s = _timed(lambda: take(effects=edges).ranges.ravel(), rounds)
    _, whole_s = _timed(lambda: take(noise="profile").ranges.ravel(), rounds)
    noisy = take(effects=noise).ranges.ravel()
    n, n_rays = len(along), footprint.n_rays_cast
    k, truth = n_rays * n, hits.ranges
    incidence = np.arccos(np.where(hits.hit, hits.incidence_cosine, np.nan))
    sigma = range_sigma_m(model, np.where(hits.hit, truth, 1.0), incidence, 1.0, 0.5)
    moved = np.abs(_differences(mean, truth)) > _EDGE_M
    no_noise = ["-"] * len(_BINS)
    yield from head(
        "caster", "rays", "Mray a CPU s", f"edge points, {1e3 * _EDGE_M:g} mm off",
        *(f"sd mm at {low}-{high} deg (model's, pixels)" for low, high in _BINS),
    )  # fmt: skip
    yield row("unseen, bare", n, f"{n / bare_s / 1e6:.2f}", 0, *no_noise)
    yield row(
        f"unseen, {n_rays} rays a beam", n + k, f"{(n + k) / beams_s / 1e6:.2f}", moved.sum(), *no_noise
    )
    cells = _by_incidence(_differences(noisy, truth), sigma, incidence)
    yield row("unseen, all errors", n + k, f"{(n + k) / whole_s / 1e6:.2f}", moved.sum(), *cells)
    if theirs is None:
        yield "Open3D is not installed: python -m pip install -e '.[bench]'"
        return
    (ranges, _), theirs_s = _timed(lambda: theirs(middle[None], along), rounds)
    off = _differences(ranges, truth)
    off[np.abs(off) > _EDGE_M] = np.nan  # another surface, at its edge
    yield row("Open3D, bare", n, f"{n / theirs_s / 1e6:.2f}", 0, *_by_incidence(off, None, incidence))
    by_them, spent = np.empty(n), 0.0
    for first in range(0, n, _CHUNK):
        part = slice(first, first + _CHUNK)
        starts, ways = sub_rays(along[part], footprint, turns[part])
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        begin = time.process_time()
        found = theirs(starts + middle, ways)
        spent += time.process_time() - begin
        by_them[part] = mean_of_light(*(array.reshape(-1, n_rays) for array in found))
    also = np.abs(_differences(by_them, truth)) > _EDGE_M
    yield row(f"Open3D, {n_rays} rays a beam", k, f"{k / spent / 1e6:.2f}", also.sum(), *no_noise)
    both = moved & also
    apart = np.median(np.abs(by_them[both] - mean[both])) if both.any() else np.nan
    yield (
        f"{both.sum()} edge points are those of both, with mean ranges {1e3 * apart:.3g} mm apart (median); "
        f"{int((hits.hit != np.isfinite(ranges)).sum())} of the bare rays hit for one caster alone."
    )


_CHUNK = 1 << 16  # beams
