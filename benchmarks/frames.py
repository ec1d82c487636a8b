# SPDX-License-Identifier: MIT
"""How completing grows with the number of RGB-D frames: a simulated walk through a house, the first N of it.

The camera is held 1.5 m above the floor. It goes 10 cm ahead at each frame while nothing stands nearer than
0.7 m before it, else it turns to where there is more room, and meanwhile looks from side to side and up and
down. Noise and steps are those of a depth camera (`khoshelham2012`), poses are exact, no two frames are
alike. Each number of frames is read from files and completed in a process of its own, without texture, on
one thread: CPU seconds, with reading, in all and a frame, the peak of memory above what the process held
before it read the first frame, surfaces, cells of their charts, a digest of owners and inferred area, and CPU
seconds of each stage, merging counted with segmentation. The last line is the exponent of a least-squares
line through the logarithms:

    python -m benchmarks.frames [N,N,...] [WIDTH] [SCENE X,Y,Z [UP]]

WIDTH is 320 unless given, three quarters of it the height. SCENE is a mesh file, UP its axis that is up (z
unless given), X,Y,Z (metres, z up) where the walk begins; without them it leads through the rooms of
`benchmarks.stations`. The walk is kept in the folder FRAMES, where that variable is set, else forgotten.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.growth import peak, print_growth
from benchmarks.stations import building
from completion import CompletionOptions, complete
from nbv import PinholeSensor, scan_scene
from scenes import Pose, RayCaster
from scenes.checks import FloatArray
from scenes.io.rgbd_writer import write_rgbd
from scenes.io.scan_request import ScanRequest, read_request
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis
from scenes.run.mapping import trim
from scenes.run.spill import Spill
from scenes.scan.colour import colour_bytes
from scenes.world.scene import Scene

STEP_M, CLEAR_M = 0.1, 0.7
TURN = np.radians(12.0)
_SIDES = np.radians([-60, -45, -30, -15, 0, 15, 30, 45, 60])
_HEIGHTS = np.array([-0.9, -0.4, 0.0, 0.2])  # from the camera, metres


def walk(caster: RayCaster, start: FloatArray, n_frames: int, heading: float = 0.0) -> list[Pose]:
    """Walk from `start` (3,), metres, first to `heading`, radians; return where the camera was and looked."""
    poses, place, turning = [], np.array(start, dtype=np.float64), 0.0
    for number in range(n_frames):
        angle = heading + _SIDES
        ahead = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
        origins = place + np.stack([0 * _HEIGHTS, 0 * _HEIGHTS, _HEIGHTS], axis=1)
        ranges = caster.first_hit(
            np.repeat(origins, len(ahead), axis=0), np.tile(ahead, (len(origins), 1))
        ).ranges
        room = np.minimum(ranges.reshape(len(origins), -1).min(axis=0), 5.0)
        if room[2:7].min() > CLEAR_M and number % 97 < 90:
            place, turning = place + STEP_M * ahead[4], 0.0
        else:
            turning = turning or (TURN if room[5:].sum() > room[:4].sum() else -TURN)
            heading += turning
        gaze = heading + np.radians(35) * np.sin(number / 9.0)
        down = np.radians(-12) + np.radians(18) * np.sin(number / 23.0)
        look = [np.cos(gaze) * np.cos(down), np.sin(gaze) * np.cos(down), np.sin(down)]
        poses.append(Pose.looking_at(place, place + np.array(look)))
    return poses


def take_frames(scene: Scene, start: FloatArray, n_frames: int, width: int, folder: Path) -> None:
    """Write the frames of a walk as an RGB-D folder; until then they are in files as well."""
    caster, spill = RayCaster(scene.mesh.vertices, scene.mesh.faces), Spill()
    camera = PinholeSensor(fov_deg=62.0, width=width, height=3 * width // 4, max_range_m=6.0)
    frames = []
    for k, pose in enumerate(walk(caster, start, n_frames)):
        frame = scan_scene(scene, pose, camera, noise="khoshelham2012", truth=False, rng=k, caster=caster)
        frames.append(spill.keep(replace(frame, colour=colour_bytes(frame.colour))))
        trim()
    write_rgbd(frames, folder)


def measure(folder: Path, n_frames: int) -> dict[str, object]:
    """Complete the first frames in this process; return what it took."""
    warm = read_request(ScanRequest((f"{folder}#1", f"{folder}#2"))).scans
    complete(warm, CompletionOptions(texture=False), n_threads=1)  # loads all compiled code
    stages: dict[str, float] = {}
    idle, begun, last = peak(), time.process_time(), ("read", time.process_time())

    def listen(stage: str, _done: int, _total: int) -> None:
        nonlocal last
        now = time.process_time()
        stages[last[0]] = stages.get(last[0], 0.0) + now - last[1]
        last = (stage, now)

    scans = read_request(ScanRequest(tuple(f"{folder}#{k + 1}" for k in range(n_frames)))).scans
    done = complete(scans, CompletionOptions(texture=False), rng=0, n_threads=1, progress=listen)
    seconds, taken = time.process_time() - begun, peak() - idle
    listen("", 0, 0)
    digest = hashlib.sha256()
    for array in (*done.owners, *(patch.hypothesised for patch in done.patches)):
        digest.update(array.tobytes())
    return {
        "seconds": seconds,
        "a frame": seconds / n_frames,
        "MB": taken / 1e6,
        "surfaces": len(done.patches),
        "M cells": sum(patch.grid.shape[0] * patch.grid.shape[1] for patch in done.patches) / 1e6,
        "digest": digest.hexdigest()[:8],
        "stages": {name: spent for name, spent in stages.items() if name},
    }


def main() -> None:
    """Measure each number of frames in a process of its own; print a line each, and the exponent."""
    words = sys.argv[1:]
    numbers = [int(word) for word in (words[0] if words else "10,20,40,80").split(",")]
    if os.environ.get("MEASURE"):
        print(json.dumps(measure(Path(os.environ["MEASURE"]), numbers[0])))
        return
    print("  frames   CPU s  a frame     MB surfaces M cells  digest   stages")
    columns = {
        "seconds": "7.1f", "a frame": "8.3f", "MB": "6.0f", "surfaces": "8", "M cells": "7.1f", "digest": "8"
    }  # fmt: skip
    with TemporaryDirectory() as temporary:
        folder = Path(os.environ.get("FRAMES", f"{temporary}/walk"))
        if not folder.is_dir():
            scene, start = _place(words[2:])
            take_frames(scene, start, max(numbers), int(words[1]) if len(words) > 1 else 320, folder)
        print_growth("benchmarks.frames", numbers, [], folder, columns)


def _place(words: Sequence[str]) -> tuple[Scene, FloatArray]:
    """The scene, and where a walk through it begins (3,), metres, by the words of the command line."""
    if len(words) < 2:
        return building(8), np.array([2.5, 1.5, 1.5])
    up: Axis = {"x": "x", "y": "y", "z": "z"}[words[2] if len(words) > 2 else "z"]
    return open_scene(words[0], up=up), np.array(words[1].split(","), dtype=np.float64)


if __name__ == "__main__":
    main()
