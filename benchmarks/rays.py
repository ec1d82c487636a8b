# SPDX-License-Identifier: MIT
"""Rays a second of our ray caster beside its peers: one run, same rays, same cores, contestants in turn.

Scene A is a closed room with spheres, B a rough terrain, a million triangles each. Primary rays are the
pixels of a 1000 x 1000 image; visibility rays go from one point to a million samples of the surface, in
random and in Morton order, and ask only whether something is hit. Run by `make bench`, or alone:

    python benchmarks/rays.py [ROUNDS]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from trimesh.ray.ray_pyembree import RayMeshIntersector

from scenes.mesh.blocks import morton_order
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import PinholeProjection

SIDE, N = 1000, 1_000_000
Job = Callable[[], object]


@dataclass(frozen=True)
class Workload:
    """A mesh, a viewpoint, the rays of its image and points that may be visible from there."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    viewpoint: np.ndarray
    image: np.ndarray
    targets: dict[str, np.ndarray]


def room_with_spheres() -> tuple[np.ndarray, np.ndarray]:
    """A closed room of 8 x 8 x 3 m and twelve spheres of 81,920 triangles each."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.4)
    places = np.random.default_rng(0).uniform([-3, -3, -1], [3, 3, 1], (12, 3))
    balls = [ball.copy().apply_translation(place) for place in places]
    mesh = trimesh.util.concatenate([trimesh.creation.box((8, 8, 3)), *balls])
    return np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32)


def rough_terrain() -> tuple[np.ndarray, np.ndarray]:
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


def workload(name: str, mesh: tuple[np.ndarray, np.ndarray], at: list[float]) -> Workload:
    """Rays from `at` towards the origin, and samples of the surface a little nearer than it."""
    vertices, faces = mesh
    pose = Pose.looking_at(at, (0, 0, 0))
    image = pose.rotate(PinholeProjection.from_fov(SIDE, SIDE, 70).directions())
    rng, corners = np.random.default_rng(2), vertices[faces]
    areas = np.linalg.norm(np.cross(*(corners[:, 1:] - corners[:, :1]).swapaxes(0, 1)), axis=1)
    chosen = corners[rng.choice(len(faces), N, p=areas / areas.sum())]
    viewpoint = np.array([at])
    points = np.einsum("nc,nck->nk", rng.dirichlet([1, 1, 1], N), chosen)
    points = viewpoint + (points - viewpoint) * (1 - 1e-5)
    targets = {"random": points, "Morton": np.ascontiguousarray(points[morton_order(points)])}
    return Workload(
        name=name,
        vertices=vertices,
        faces=faces,
        viewpoint=viewpoint,
        image=np.ascontiguousarray(image),
        targets=targets,
    )


def in_tiles(image: np.ndarray) -> np.ndarray:
    """The image's vectors (n, 3), tile after tile of 4 x 4 pixels."""
    tiles = image.reshape(SIDE // 4, 4, SIDE // 4, 4, 3).swapaxes(1, 2)
    return np.ascontiguousarray(tiles.reshape(-1, 3))


def raw_embreex(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """What embreex does with float32 arrays that need no check: face numbers alone."""
    centre = (work.vertices.min(axis=0) + work.vertices.max(axis=0)) / 2
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, (work.vertices - centre).astype(np.float32), work.faces)
    start = np.repeat((work.viewpoint - centre).astype(np.float32), N, axis=0)
    scene.run(start[:1], start[:1] + 1)

    def split(along: np.ndarray, reach: np.ndarray | None = None) -> Job:
        parts = [slice(k * N // n_threads, (k + 1) * N // n_threads) for k in range(n_threads)]

        def cast(part: slice) -> None:
            if reach is None:
                scene.run(start[part], along[part])
            else:
                scene.run(start[part], along[part], reach[part].copy(), query="OCCLUDED")

        return lambda: list(pool(n_threads).map(cast, parts))

    yield "primary", "raw embreex", split(work.image.reshape(-1, 3).astype(np.float32))
    yield "primary", "raw embreex, 4 x 4 tiles", split(in_tiles(work.image).astype(np.float32))
    for order, points in work.targets.items():
        way = points - work.viewpoint
        length = np.linalg.norm(way, axis=1, keepdims=True)
        yield order, "raw embreex", split((way / length).astype(np.float32), length[:, 0].astype(np.float32))


def open3d(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """RaycastingScene, its rays already tensors of float32."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=2)
    scene.add_triangles(
        o3d.core.Tensor(work.vertices.astype(np.float32)), o3d.core.Tensor(work.faces.astype(np.uint32))
    )

    def rays(along: np.ndarray) -> object:
        start = np.broadcast_to(work.viewpoint, along.shape)
        return o3d.core.Tensor(np.concatenate([start, along], axis=1).astype(np.float32))

    name, image = "Open3D RaycastingScene", rays(work.image.reshape(-1, 3))
    yield "primary", name, lambda: scene.cast_rays(image, nthreads=n_threads)
    for order, points in work.targets.items():
        ways = rays(points - work.viewpoint)
        yield order, name, lambda ways=ways: scene.test_occlusions(ways, 0.0, 1.0, nthreads=n_threads)


def trimesh_first(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """Trimesh's intersects_first, which has no threads and no any-hit query."""
    if n_threads == 1:
        caster = RayMeshIntersector(trimesh.Trimesh(work.vertices, work.faces, process=False))
        start, along = np.repeat(work.viewpoint, N, axis=0), work.image.reshape(-1, 3)
        yield "primary", "trimesh intersects_first", lambda: caster.intersects_first(start, along)


def ours(work: Workload, n_threads: int) -> Iterator[tuple[str, str, Job]]:
    """Both backends: face numbers alone, and all of `first_hit`; float64 in, everything checked."""
    tiles, faces = in_tiles(work.image), np.empty(N, np.int32)
    for backend in ("embreex", "packets"):
        caster = RayCaster(work.vertices, work.faces, n_threads, backend=backend)
        name = f"unseen {backend}"

        def first_faces(part: slice, caster: RayCaster = caster) -> int:
            return caster._embree.first_faces(work.viewpoint, tiles[part], 0, None, faces[part])

        yield "primary", f"{name}, faces alone", lambda c=caster, f=first_faces: c._in_chunks(N, 1 << 15, f)
        yield "primary", f"{name}, first_hit", lambda c=caster: c.first_hit(work.viewpoint, work.image)
        for order, points in work.targets.items():
            yield (
                order,
                name,
                lambda c=caster, p=points: c.blocked(work.viewpoint, p),
            )


def pool(n_threads: int) -> ThreadPoolExecutor:
    """The threads that raw embreex is given."""
    return _POOLS.setdefault(n_threads, ThreadPoolExecutor(n_threads))


_POOLS: dict[int, ThreadPoolExecutor] = {}
Times = dict[tuple[str, str, int], np.ndarray]  # of (workload's rays, contestant, threads), seconds a round


def measure(work: Workload, contestants: list[Callable], rounds: int) -> Times:
    """Run all contestants in turn, `rounds` times after one to warm up."""
    jobs: dict[tuple[str, str, int], Job] = {}
    for n_threads in (1, 2):
        for contestant in contestants:
            for rays, name, job in contestant(work, n_threads):
                jobs[rays, name, n_threads] = job
    seconds = {key: np.empty(rounds + 1) for key in jobs}
    for turn in range(rounds + 1):
        for key, job in jobs.items():
            started = time.perf_counter()
            job()
            seconds[key][turn] = time.perf_counter() - started
    return {key: times[1:] for key, times in seconds.items()}


def print_table(work: Workload, times: Times) -> None:
    """Mray/s, best and median of the rounds."""
    print(f"\nscene {work.name}, {len(work.faces):,} triangles: Mray/s, best (median)")
    print(f"{'':32}{'1 thread':>16}{'2 threads':>16}")
    for rays in ("primary", "random", "Morton"):
        print("primary rays" if rays == "primary" else f"visibility, {rays} order")
        for name in dict.fromkeys(name for r, name, _ in times if r == rays):
            row = f"  {name:30}"
            for n_threads in (1, 2):
                seconds = times.get((rays, name, n_threads))
                row += (
                    f"{'-':>16}"
                    if seconds is None
                    else (f"{f'{N / seconds.min() / 1e6:.1f} ({N / np.median(seconds) / 1e6:.1f})':>16}")
                )
            print(row)


def print_ratios(work: Workload, times: Times) -> None:
    """Speed against the target's peer: the median over rounds of the ratio within a round."""
    packets, peer, raw = (
        3.0 if work.name == "A" else 2.0,
        "Open3D RaycastingScene",
        "raw embreex, 4 x 4 tiles",
    )
    aims = [
        ("primary", "unseen packets, faces alone", peer, packets),
        ("primary", "unseen packets, first_hit", peer, None),
        ("Morton", "unseen packets", peer, 1.2),
        ("random", "unseen packets", peer, None),
        ("primary", "unseen embreex, faces alone", raw, 0.95),
        ("primary", "unseen embreex, first_hit", raw, None),
    ]
    print("ratios")
    for rays, name, other, aim in aims:
        if (rays, other, 1) in times:
            ratios = [np.median(times[rays, other, n] / times[rays, name, n]) for n in (1, 2)]
            wanted = "" if aim is None else f"   target {aim:g}"
            label = f"{rays}: {name} / {other}"
            print(f"  {label:70}{ratios[0]:8.2f}{ratios[1]:8.2f}{wanted}")


def print_agreement(work: Workload) -> None:
    """Two million rays, half of an image and half random: where the backends differ, and why."""
    packets, single = (RayCaster(work.vertices, work.faces, backend=name) for name in ("packets", "embreex"))
    along = np.random.default_rng(3).normal(size=(N, 3))
    n_differ, apart, same, border = 0, 0.0, 0.0, 0.0
    for rays in (work.image, along):
        a, b = packets.first_hit(work.viewpoint, rays), single.first_hit(work.viewpoint, rays)
        differ = a.face != b.face
        n_differ += int(differ.sum())
        both = ~differ & a.hit
        same = max(same, float(np.abs(a.ranges[both] - b.ranges[both]).max()))
        met = differ & a.hit & b.hit
        apart = max(apart, float(np.abs(a.ranges[met] - b.ranges[met]).max(initial=0)))
        weights = [hits.barycentric[differ & hits.hit].min(axis=1) for hits in (a, b)]
        border = max(border, float(np.concatenate(weights).max(initial=0)))
    print(
        f"agreement on 2 M rays: {n_differ} name another face, all within {border:.1e} of a face's border "
        f"(ranges there {apart:.1e} m apart); elsewhere ranges differ by {same:.1e} m"
    )


def main(rounds: int) -> None:
    """Measure both scenes and print."""
    contestants: list[Callable] = [raw_embreex, trimesh_first, ours]
    try:
        import open3d as _  # noqa: F401

        contestants.insert(1, open3d)
    except (ImportError, OSError) as error:
        print(f"without Open3D, which does not load: {error}")
        print("(Debian: apt-get install libusb-1.0-0 libgl1 libgomp1; then pip install open3d)")
    for name, mesh, at in (
        ("A", room_with_spheres(), [-3.5, -3.5, 1.0]),
        ("B", rough_terrain(), [-40.0, -40.0, 12.0]),
    ):
        work = workload(name, mesh, at)
        times = measure(work, contestants, rounds)
        print_table(work, times)
        print_ratios(work, times)
        print_agreement(work)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9)
