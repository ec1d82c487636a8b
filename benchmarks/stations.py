# SPDX-License-Identifier: MIT
"""How completing grows with the number of stations: rooms in a row with open doors, a station in each.

Rooms of 5 x 4 x 2.7 m stand in rows of four, joined by doors along the row, each with a table, a cupboard and
a post; a panoramic scan of 360 x 120 degrees with 2 mm of noise from the middle of each. Every number of
stations is read from files and completed in a process of its own, without texture, on one thread: CPU seconds
by stage, the peak of memory above what the process held before it read the first scan, regions, surfaces, a
digest of owners and inferred area. The last line is the exponent of a least-squares line through the
logarithms. Run by `make bench`, or alone:

    python -m benchmarks.stations [N,N,...] [MEGAPIXELS]
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.growth import peak, print_growth
from completion import CompletionOptions, complete
from nbv import SphericalSensor, scan_scene
from scenes import Pose, RangeImage, RayCaster, Scene
from scenes.io.scan_files import read_scan, write_scan
from scenes.world.builtin import Finish, SceneBuilder

SIZE = np.array([5.0, 4.0, 2.7])
WALL = 0.12
ROW = 4
WHITE = Finish((0.8, 0.8, 0.8))


def building(n_rooms: int) -> Scene:
    """Rooms in rows of four; the door of each leads to the next one in its row."""
    builder = SceneBuilder("rooms", "room")
    for room in range(n_rooms):
        corner = np.array([room % ROW, room // ROW, 0]) * (SIZE + WALL) * [1, 1, 0]
        x, y, z = np.diag(SIZE)
        name = f"room {room + 1}"
        door = (1.2 + 0.2 * (room % 3), 0.0, 2.1 + 0.2 * (room % 3), 2.05)
        before = (SIZE[1] - 2.1 - 0.2 * ((room - 1) % 3), 0.0, SIZE[1] - 1.2 - 0.2 * ((room - 1) % 3), 2.05)
        has_next = room % ROW < ROW - 1 and room + 1 < n_rooms
        builder.add_rectangle(f"{name} floor", corner, x, y, WHITE)
        builder.add_rectangle(f"{name} ceiling", corner + z + y, x, -y, WHITE)
        builder.add_rectangle(f"{name} south", corner + x, -x, z, WHITE)
        builder.add_rectangle(f"{name} north", corner + y, x, z, WHITE)
        builder.add_panel(f"{name} west", corner, y, z, WHITE, [_mirrored(before)] if room % ROW else [])
        builder.add_panel(f"{name} east", corner + x + y, -y, z, WHITE, [_mirrored(door)] if has_next else [])
        table = corner + [0.5, 2.6, 0.0]
        builder.add_box(f"{name} table", table + [0, 0, 0.68], table + [1.4, 0.8, 0.72], WHITE)
        builder.add_box(f"{name} cupboard", corner + [3.9, 0.05, 0.0], corner + [4.9, 0.5, 1.9], WHITE)
        builder.add_cylinder(f"{name} post", corner + [1.2, 1.0, 0.0], [0, 0, SIZE[2]], 0.09, WHITE)
    return builder.finish()


def _mirrored(hole: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return SIZE[1] - hole[2], hole[1], SIZE[1] - hole[0], hole[3]


def take_scans(n_stations: int, megapixels: float) -> list[RangeImage]:
    """Scan each room from near its middle."""
    scene, width = building(n_stations), round(np.sqrt(3 * megapixels * 1e6))
    sensor = SphericalSensor(elevation_max_deg=60.0, width=width, height=width // 3, name="panorama")
    caster = RayCaster(scene.mesh.vertices, scene.mesh.faces)
    scans = []
    for room in range(n_stations):
        corner = np.array([room % ROW, room // ROW, 0]) * (SIZE + WALL) * [1, 1, 0]
        eye = corner + [2.5, 2.0, 1.5]
        pose = Pose.looking_at(eye, eye + [np.cos(room), np.sin(room), 0.0])
        scans.append(scan_scene(scene, pose, sensor, noise="gaussian-2mm", rng=room, caster=caster))
    return scans


def measure(n_stations: int) -> dict[str, object]:
    """Complete so many stations in this process; return what it took."""
    complete(take_scans(2, 0.02), CompletionOptions(texture=False), n_threads=1)  # loads all compiled code
    read_scan(os.environ["MEASURE"] + "/small.npz")
    idle = peak()
    scans = [read_scan(f"{os.environ['MEASURE']}/{number}.npz") for number in range(n_stations)]
    begun, stages, last = time.process_time(), {}, ["", time.process_time()]

    def listen(stage: str, _done: int, _total: int) -> None:
        now = time.process_time()
        stages[last[0]] = stages.get(last[0], 0.0) + now - last[1]
        last[:] = [stage, now]

    done = complete(scans, CompletionOptions(texture=False), rng=0, n_threads=1, progress=listen)
    seconds, held = time.process_time() - begun, peak() - idle  # before a digest reads all pixels
    listen("", 0, 0)
    digest = hashlib.sha256()
    for array in (*done.owners, *(patch.hypothesised for patch in done.patches)):
        digest.update(np.ascontiguousarray(array))
    return {
        "stations": n_stations,
        "seconds": seconds,
        "MB": held / 1e6,
        "regions": sum(patch.source.n_parts for patch in done.patches),
        "surfaces": len(done.patches),
        "digest": digest.hexdigest()[:8],
        "stages": {name: spent for name, spent in stages.items() if name},
    }


def main() -> None:
    """Measure each number of stations in a process of its own; print a line each, and the exponent."""
    numbers = [int(word) for word in (sys.argv[1] if len(sys.argv) > 1 else "1,2,4,8").split(",")]
    megapixels = float(sys.argv[2]) if len(sys.argv) > 2 else 0.25
    if os.environ.get("MEASURE"):
        print(json.dumps(measure(numbers[0])))
        return
    head = f"{'stations':>8} {'CPU s':>7} {'MB':>8} {'regions':>8} {'surfaces':>8}"
    print(f"{head}  digest    CPU s until each stage began")
    columns = {"seconds": "7.1f", "MB": "8.0f", "regions": "8", "surfaces": "8", "digest": "9"}
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_scan(take_scans(1, 0.02)[0], folder / "small.npz")
        for number, scan in enumerate(take_scans(max(numbers), megapixels)):
            write_scan(scan, folder / f"{number}.npz")
        print_growth("benchmarks.stations", numbers, [str(megapixels)], folder, columns)


if __name__ == "__main__":
    main()
