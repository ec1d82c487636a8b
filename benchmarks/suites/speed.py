# SPDX-License-Identifier: MIT
"""Speed and memory: rays beside other casters, reading of E57, writing, growth with stations and frames."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh

from benchmarks.cases.frames import walk
from benchmarks.cases.rooms import row_of_rooms, stations_of_row
from benchmarks.run import head, row, suite
from benchmarks.store import peak_bytes
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from nbv import PinholeSensor, scan_scene
from scenes import Pose, RangeImage, RayCaster
from scenes.checks import FloatArray
from scenes.io.formats.grid_fit import SCANNER_FROM_SENSOR
from scenes.io.scan_files import read_scan, write_scan
from scenes.mesh.blocks import morton_order
from scenes.scan.colour import colour_bytes
from scenes.scan.projection import PinholeProjection, SphericalProjection

SIDE, N_RAYS = 1000, 1_000_000
Job = Callable[[], object]


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """A mesh, a viewpoint, the rays of its image, and points that may be visible from there."""

    vertices: FloatArray
    faces: np.ndarray
    viewpoint: FloatArray
    image: FloatArray
    targets: dict[str, FloatArray]

    @classmethod
    def of(cls, vertices: FloatArray, faces: np.ndarray, at: list[float]) -> Workload:
        """Rays from `at` towards the origin, and samples of the surface a little nearer than it."""
        image = Pose.looking_at(at, (0, 0, 0)).rotate(PinholeProjection.from_fov(SIDE, SIDE, 70).directions())
        rng, corners = np.random.default_rng(2), vertices[faces]
        areas = np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).swapaxes(0, 1)), axis=1)
        chosen = corners[rng.choice(len(faces), N_RAYS, p=areas / areas.sum())]
        viewpoint = np.array([at])
        points = np.einsum("nc,nck->nk", rng.dirichlet([1, 1, 1], N_RAYS), chosen)
        points = viewpoint + (points - viewpoint) * (1 - 1e-5)
        targets = {"random": points, "Morton": np.ascontiguousarray(points[morton_order(points)])}
        return cls(vertices, faces, viewpoint, np.ascontiguousarray(image), targets)


def room_with_spheres() -> tuple[FloatArray, np.ndarray]:
    """A closed room of 8 x 8 x 3 m and twelve spheres of 81,920 triangles each."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.4)
    places = np.random.default_rng(0).uniform([-3, -3, -1], [3, 3, 1], (12, 3))
    balls = [ball.copy().apply_translation(place) for place in places]
    mesh = trimesh.util.concatenate([trimesh.creation.box((8, 8, 3)), *balls])
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)


def rough_terrain() -> tuple[FloatArray, np.ndarray]:
    """Waves of seven octaves and 5 cm of noise on a grid of 707 x 707 squares over 100 x 100 m."""
    rng, n = np.random.default_rng(1), 708
    x, y = np.meshgrid(*[np.linspace(-50, 50, n)] * 2)
    z = rng.normal(scale=0.05, size=x.shape)
    for octave in range(1, 8):
        for heading, phase in rng.uniform(0, 2 * np.pi, (4, 2)):
            frequency = 0.05 * 2**octave
            z += np.sin(frequency * (x * np.cos(heading) + y * np.sin(heading)) + phase) / frequency / 4
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    faces = np.concatenate([np.stack([i, i + 1, i + n + 1], axis=1), np.stack([i, i + n + 1, i + n], axis=1)])
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces.astype(np.int32)


def _embreex(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """Raw embreex: float32 arrays that need no check, face numbers alone."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    centre = (work.vertices.min(axis=0) + work.vertices.max(axis=0)) / 2
    scene, pool = EmbreeScene(robust=True), ThreadPoolExecutor(n_threads)
    TriangleMesh(scene, (work.vertices - centre).astype(np.float32), work.faces)
    start = np.repeat((work.viewpoint - centre).astype(np.float32), N_RAYS, axis=0)
    parts = [slice(k * N_RAYS // n_threads, (k + 1) * N_RAYS // n_threads) for k in range(n_threads)]

    def job(along: np.ndarray, reach: np.ndarray | None = None) -> Job:
        def cast(part: slice) -> None:
            if reach is None:
                scene.run(start[part], along[part])
            else:
                scene.run(start[part], along[part], reach[part].copy(), query="OCCLUDED")

        return lambda: list(pool.map(cast, parts))

    yield "primary", "raw embreex", job(work.image.reshape(-1, 3).astype(np.float32))
    for order, points in work.targets.items():
        way = points - work.viewpoint
        length = np.linalg.norm(way, axis=1, keepdims=True)
        yield order, "raw embreex", job((way / length).astype(np.float32), length[:, 0].astype(np.float32))


def _open3d(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """RaycastingScene of Open3D, its rays already tensors of float32."""
    try:
        import open3d as o3d
    except (ImportError, OSError):
        return
    scene = o3d.t.geometry.RaycastingScene(nthreads=2)
    scene.add_triangles(
        o3d.core.Tensor(work.vertices.astype(np.float32)), o3d.core.Tensor(work.faces.astype(np.uint32))
    )

    def rays(along: np.ndarray) -> Any:
        start = np.broadcast_to(work.viewpoint, along.shape)
        return o3d.core.Tensor(np.concatenate([start, along], axis=1).astype(np.float32))

    name, image = "Open3D RaycastingScene", rays(work.image.reshape(-1, 3))
    yield "primary", name, lambda: scene.cast_rays(image, nthreads=n_threads)
    for order, points in work.targets.items():
        ways = rays(points - work.viewpoint)
        yield order, name, partial(scene.test_occlusions, ways, 0.0, 1.0, nthreads=n_threads)


def _ours(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """Both backends: float64 in, everything checked."""
    for backend in ("embreex", "packets"):
        caster = RayCaster(work.vertices, work.faces, n_threads, backend=backend)
        yield "primary", f"unseen {backend}", partial(caster.first_hit, work.viewpoint, work.image)
        for order, points in work.targets.items():
            yield order, f"unseen {backend}", partial(caster.are_blocked, work.viewpoint, points)


@suite("rays", smallest="--rounds 1")
def rays(rounds: int = 5) -> Iterator[str]:
    """Million rays a second of our ray caster beside its peers: same rays, same cores, in turn."""
    yield from head("scene", "rays", "caster", "threads", "Mray/s, best", "median")
    places = {
        "room": (room_with_spheres(), [-3.5, -3.5, 1.0]),
        "terrain": (rough_terrain(), [-40.0, -40, 12]),
    }
    for scene, (mesh, at) in places.items():
        work = Workload.of(*mesh, at)
        jobs = [
            (kind, name, n, job)
            for n in (1, 2)
            for contestant in (_embreex, _open3d, _ours)
            for kind, name, job in contestant(work, n)
        ]
        seconds = np.empty((rounds + 1, len(jobs)))  # the first round warms up
        for turn in seconds:
            for k, (*_, job) in enumerate(jobs):
                begin = time.perf_counter()
                job()
                turn[k] = time.perf_counter() - begin
        for (kind, name, n, _), spent in zip(jobs, seconds[1:].T, strict=True):
            rates = [f"{N_RAYS / value / 1e6:.1f}" for value in (spent.min(), np.median(spent))]
            yield row(scene, kind, name, n, *rates)


def _apart(work: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """Return the result of work in a fresh process, whose memory holds nothing else."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def _completed(scans: Callable[[], list[RangeImage]], warm: list[RangeImage]) -> dict[str, Any]:
    """CPU seconds, by stage as well, and memory of completing scans; a digest of what came of it."""
    complete(warm, CompletionOptions(texture=False), n_threads=1)  # loads all compiled code
    idle, begun, stages = peak_bytes() or 0, time.process_time(), dict[str, float]()
    stage_of, since = ["read"], [time.process_time()]

    def listen(stage: str, _done: int, _total: int) -> None:
        now = time.process_time()
        stages[stage_of[0]] = stages.get(stage_of[0], 0.0) + now - since[0]
        stage_of[0], since[0] = stage, now

    done = complete(scans(), CompletionOptions(texture=False), rng=0, n_threads=1, progress=listen)
    seconds, held = time.process_time() - begun, (peak_bytes() or 0) - idle
    listen("", 0, 0)
    return {
        "seconds": seconds, "MB": held / 1e6, "regions": sum(map(len, done.measured_surfaces.regions)),
        "surfaces": len(done.patches), "digest": digest(done),
        "stages": ", ".join(f"{name} {spent:.1f}" for name, spent in stages.items()),
    }  # fmt: skip


def digest(done: CompletedModel) -> str:
    """Return the first digits of the hash of owners and inferred area."""
    held = hashlib.sha256()
    for array in (*done.owners, *(patch.hypothesised for patch in done.patches)):
        held.update(np.ascontiguousarray(array).tobytes())
    return held.hexdigest()[:8]


def _growth(results: Mapping[int, dict[str, Any]]) -> Iterator[str]:
    """A row a number, and the exponent of a least-squares line through the logarithms."""
    yield from head("n", "CPU s", "MB", "regions", "surfaces", "digest", "CPU s by stage")
    for n, found in results.items():
        spent, held = f"{found['seconds']:.1f}", f"{found['MB']:.0f}"
        yield row(n, spent, held, found["regions"], found["surfaces"], found["digest"], found["stages"])
    if len(results) > 1:
        seconds = [found["seconds"] for found in results.values()]
        slope = np.polyfit(np.log(list(results)), np.log(seconds), 1)[0]
        yield f"CPU seconds grow with the number to the power of {slope:.2f}"


def _stations(folder: str, n: int) -> dict[str, Any]:
    warm = [read_scan(f"{folder}/small{k}.npz") for k in range(2)]
    return _completed(lambda: [read_scan(f"{folder}/{k}.npz") for k in range(n)], warm)


@suite("stations", smallest="--numbers 1 --megapixels 0.02")
def stations(numbers: str = "1,2,4,8", megapixels: float = 0.25) -> Iterator[str]:
    """Completing with the number of stations: rooms in rows with open doors, a panorama in each."""
    counts = [int(word) for word in numbers.split(",")]
    with TemporaryDirectory() as folder:
        for k, scan in enumerate(stations_of_row(2, 0.02)):
            write_scan(scan, Path(folder, f"small{k}.npz"))
        for k, scan in enumerate(stations_of_row(max(counts), megapixels)):
            write_scan(scan, Path(folder, f"{k}.npz"))
        yield from _growth({n: _apart(_stations, folder, n) for n in counts})


def _frames(n: int, width: int) -> dict[str, Any]:
    scene, camera = row_of_rooms(8), PinholeSensor(
        fov_deg=62.0, width=width, height=3 * width // 4, max_range_m=6.0
    )  # fmt: skip
    poses = walk(RayCaster(scene.mesh.vertices, scene.mesh.faces), np.array([2.5, 1.5, 1.5]), n)
    frames = [
        replace(frame, colour=colour_bytes(frame.colour))
        for k, pose in enumerate(poses)
        for frame in [scan_scene(scene, pose, camera, noise="khoshelham2012", truth=False, rng=k)]
    ]
    return _completed(lambda: frames, frames[:2])


@suite("frames", smallest="--numbers 2 --width 160")
def frames(numbers: str = "10,20,40,80", width: int = 320) -> Iterator[str]:
    """Completing with the number of RGB-D frames: the first N frames of a walk through rooms."""
    yield from _growth({int(n): _apart(_frames, int(n), width) for n in numbers.split(",")})


def box_scan(millions: float) -> RangeImage:
    """A box from inside, so many million pixels: ranges with noise, some without return."""
    rows, rng = int(np.sqrt(millions * 1e6 / 2)), np.random.default_rng(0)
    projection = SphericalProjection.regular(2 * rows, rows, 360.0, (-60.0, 60.0))
    rays = projection.directions()
    walls = np.array([4.0, 1.2, 3.0]), np.array([-4.0, -1.8, -3.0])
    with np.errstate(divide="ignore"):
        ranges = np.where(rays > 0, walls[0] / rays, walls[1] / rays).min(axis=-1)
    ranges += rng.normal(0, 0.002, ranges.shape)
    ranges[rng.random(ranges.shape) < 0.02] = np.inf
    colour = np.rint(np.abs(rays) * 255).astype(np.float32) / 255
    light = rng.random(ranges.shape, np.float32)
    return RangeImage(ranges, projection, Pose.identity(), colour=colour, intensity=light)


def write_as_scanners_do(scan: RangeImage, path: Path) -> None:
    """Write an E57 with points in single precision, column by column, a little off the rays."""
    import pye57

    assert scan.colour is not None
    assert scan.intensity is not None
    column, line = np.nonzero(scan.valid.T)
    points = SCANNER_FROM_SENSOR.apply(scan.points_in_sensor()[line, column])
    points += np.random.default_rng(1).normal(0, 3e-4, points.shape)
    data: dict[str, np.ndarray] = {
        f"cartesian{axis}": points[:, k].astype(np.float32) for k, axis in enumerate("XYZ")
    }
    for k, name in enumerate(("Red", "Green", "Blue")):
        data[f"color{name}"] = colour_bytes(scan.colour[line, column, k])
    data |= {"rowIndex": line.astype(np.uint16), "columnIndex": column.astype(np.uint16)}
    data["intensity"] = scan.intensity[line, column]
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(data, name="scanner", rotation=np.array([1.0, 0, 0, 0]), translation=np.zeros(3))
    file.close()


def _read(small: str, large: str) -> dict[str, Any]:
    """CPU seconds and memory of reading a scan after a small one, by which all is loaded."""
    read_scan(small)
    before, begin = peak_bytes() or 0, time.process_time()
    scan = read_scan(large)
    seconds, peak = time.process_time() - begin, (peak_bytes() or 0) - before
    arrays = (scan.ranges, scan.colour, scan.intensity, scan.sensor_points)
    held = sum(array.nbytes for array in arrays if array is not None)
    return {"points": int(scan.valid.sum()) / 1e6, "s": seconds, "peak": peak / 1e6, "scan": held / 1e6}


@suite("e57", smallest="--millions 0.01")
def e57(millions: str = "1,3.27,20") -> Iterator[str]:
    """Reading a large E57 as we write it and as scanners do: CPU seconds and peak memory."""
    yield from head("written by", "M points", "CPU s", "MB at the peak", "MB of the scan")
    with TemporaryDirectory() as folder:
        small, large = (str(Path(folder, name)) for name in ("small.e57", "large.e57"))
        for name, write in (("unseen", write_scan), ("a scanner", write_as_scanners_do)):
            write(box_scan(0.01), Path(small))
            for size in millions.split(","):
                write(box_scan(float(size)), Path(large))
                found = _apart(_read, small, large)
                cells = [f"{found['points']:.2f}", f"{found['s']:.2f}"]
                yield row(name, *cells, f"{found['peak']:.0f}", f"{found['scan']:.0f}")
