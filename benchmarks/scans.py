# SPDX-License-Identifier: MIT
"""A whole scan beside the cast that it needs: 1000 x 1000 pixels of a textured room of a million triangles.

A scan is rays, hits, incidence, colour, Gaussian noise and points in the world. It is held against the cast
of the same rays alone: by embreex, in float32 arrays that need no check and give face numbers only, and by
our packets. Contestants take turns; a ratio is the median over the rounds. Run by `make bench`, or alone:

    python benchmarks/scans.py [ROUNDS]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from rays import SIDE, N, raw_embreex, room_with_spheres, workload

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

AT = [-3.5, -3.5, 1.0]


def textured_room() -> Scene:
    """The room with spheres, papered with noise."""
    vertices, faces = room_with_spheres()
    image = np.random.default_rng(1).integers(0, 255, (512, 512, 3)).astype(np.uint8)
    corner_uv = (vertices[faces][:, :, :2] * 0.3).astype(np.float32)
    white, first = np.ones((len(faces), 3, 3), np.float32), np.zeros(len(faces), np.int32)
    mesh = LabelledMesh(vertices, faces, first, Appearance(white, (image,), first, corner_uv))
    return Scene(mesh, (None,), ("all",), "A", "room")


def jobs(n_threads: int) -> dict[str, Callable[[], object]]:
    """What is timed, by name."""
    scene, pose = textured_room(), Pose.looking_at(AT, (0, 0, 0))
    caster = RayCaster(scene.mesh.vertices, scene.mesh.faces, n_threads)
    sensor = PinholeSensor(fov_deg=70, width=SIDE, height=SIDE)
    work = workload("A", (scene.mesh.vertices, scene.mesh.faces), AT)
    raw = {name: job for rays, name, job in raw_embreex(work, n_threads) if rays == "primary"}
    face = np.empty(N, np.int32)

    def packets(part: slice) -> int:
        ways = work.image.reshape(-1, 3)[part]
        return caster._embree.first_faces(work.viewpoint, ways, SIDE, None, face[part])

    def scan() -> object:
        taken = scan_scene(
            scene, pose, sensor, noise="gaussian-2mm", rng=0, caster=caster, n_threads=n_threads
        )
        return taken.points()

    return {
        "raw embreex": raw["raw embreex"],
        "packets, faces alone": lambda: caster._in_chunks(N, 32 * SIDE, packets),
        "first_hit": lambda: caster.first_hit(work.viewpoint, work.image),
        "scan_scene and points": scan,
    }


def main(rounds: int) -> None:
    """Measure and print."""
    print(f"\na scan of {SIDE} x {SIDE} pixels: ms, best (median)")
    for n_threads in (1, 2):
        timed = jobs(n_threads)
        seconds = {name: np.empty(rounds + 1) for name in timed}
        for turn in range(rounds + 1):
            for name, job in timed.items():
                started = time.perf_counter()
                job()
                seconds[name][turn] = time.perf_counter() - started
        seconds = {name: times[1:] for name, times in seconds.items()}
        print(f"{n_threads} thread{'s' if n_threads > 1 else ''}")
        for name, times in seconds.items():
            print(f"  {name:24}{1e3 * times.min():8.0f} ({1e3 * np.median(times):.0f})")
        whole = seconds["scan_scene and points"]
        for peer, aim in (("raw embreex", "   target 1.2 at most"), ("packets, faces alone", "")):
            print(f"  scan / {peer:22}{np.median(whole / seconds[peer]):6.2f}{aim}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 9)
