# SPDX-License-Identifier: MIT
"""Folds, facets and seconds of the light model beside meshes of Open3D."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases.buildings import station_places
from benchmarks.cases.frames import DATA
from benchmarks.cases.rooms import random_case
from benchmarks.methods.meshes import PEERS
from benchmarks.metrics.folds import (
    TrueFolds,
    flaws,
    folds_of_mesh,
    folds_of_panels,
    score_folds,
    share_within,
    true_places,
)
from benchmarks.run import suite
from completion import Completion, CompletionOptions, complete
from nbv import PinholeSensor, scan_scene
from scenes import RangeImage, builtin_scene, read_scan
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.world.scene import Scene

_VIEWS = {
    "office": ((0.5, 0.5, 1.7), (4.0, 3.0, 0.8)),
    "chair_before_wall": ((0.5, -2.2, 1.5), (0.0, 0.8, 0.7)),
    "pipe_rack": ((0.7, -2.6, 1.5), (-0.05, 0.9, 0.9)),
    "engaged_column": ((0.6, -2.4, 1.5), (0.0, 0.9, 0.8)),
}
_REAL: dict[str, dict[str, Any]] = {
    "range/pcl/office1.pcd": {},
    "range/icl_nuim#1": {"intrinsics": (481.2, -480.0, 319.5, 239.5), "depth_scale": 5000.0},
    "range/e57/pumpA.e57": {},
}
_CAMERA = PinholeSensor(fov_deg=75, width=640, height=480)
_LOOSE = ("Railing", "Member", "Furnishing", "FlowTerminal", "StairFlight")  # of the duplex: no part of rooms
_HEAD = (
    "| | model | triangles | of the pixels' | recall | precision | angle off, deg, median / p95 "
    "| surface within 1 cm | T-junctions | edges of > 2: goes on, other | open, m | s |"
)


@suite("panels", smallest="--rooms 0 --duplex 1 --no-built-in --no-real --no-peers")
def panels(
    rooms: int = 10,
    first_room: int = 2000,
    duplex: int = 6,
    noise: str = "gaussian-2mm",
    built_in: bool = True,
    real: bool = True,
    peers: bool = True,
) -> Iterator[str]:
    """Folds, facets and seconds of the light model beside meshes of Open3D."""
    yield _HEAD
    yield "|---" * 11 + "|---|"
    for name, scene, scans, exact in _simulated(rooms, first_room, duplex, noise, built_in=built_in):
        yield from _rows(name, scene, scans, peers=peers and exact)
    for path, known in _REAL.items() if real else ():
        scan = read_scan(DATA / path, **known)
        done, seconds = _completed([scan])
        yield _row(path, "panels", done, len(done.observed_mesh().faces), seconds, ["-"] * 4)


def _simulated(
    rooms: int, first_room: int, duplex: int, noise: str, *, built_in: bool
) -> Iterator[tuple[str, Scene, list[RangeImage], bool]]:
    """Yield what is scanned: its name, scene, scans, and whether these are exact."""
    for name, (eye, target) in _VIEWS.items() if built_in else ():
        scene = builtin_scene(name)
        yield name, scene, [scan_scene(scene, Pose.looking_at(eye, target), _CAMERA)], True
    for seed in range(first_room, first_room + rooms):
        case = random_case(seed)
        scans = [scan_scene(case.scene, view, noise=noise, rng=seed + k) for k, view in enumerate(case.views)]
        yield case.name, case.scene, scans, False
    if duplex:
        scene = open_scene(DATA / "buildings/duplex.glb", up="y")
        for k, place in enumerate(station_places(scene, duplex)):
            turn = np.radians(20.0 + 75.0 * k)
            pose = Pose.looking_at(place, place + np.array([np.cos(turn), np.sin(turn), -0.15]))
            yield f"duplex {k + 1}", scene, [scan_scene(scene, pose, _CAMERA, noise=noise, rng=k)], False


def _rows(name: str, scene: Scene, scans: list[RangeImage], *, peers: bool) -> Iterator[str]:
    """The lines of one scene: the light model, the pixels' mesh, and what others make of it."""
    truth, (points, back) = TrueFolds.of(scene, scans, _LOOSE), true_places(scans)
    done, seconds = _completed(scans)
    pixels = done.observed_mesh()
    world = done.world_from_reference
    shown = _with_rest(done)
    said = [score_folds(folds_of_panels(done), truth).cells(), f"{share_within(*shown, points, back):.4f}"]
    yield _row(name, "panels", done, len(pixels.faces), seconds, said)
    if not peers:
        return
    vertices, faces = world.apply(pixels.vertices), pixels.faces.astype(np.int64)
    n = len(done.panels().faces)
    for label, make in PEERS.items():
        start = time.process_time()
        mesh = make(vertices, faces, n)
        spent = time.process_time() - start
        score = score_folds(folds_of_mesh(*mesh), truth).cells()
        within = share_within(*mesh, points, back)
        share = len(mesh[1]) / len(faces)
        yield f"| | {label} | {len(mesh[1])} | {share:.2%} | {score} | {within:.4f} | | | | {spent:.1f} |"


def _completed(scans: list[RangeImage]) -> tuple[Completion, float]:
    """A completion, and the processor's seconds that its panels took."""
    done = complete(scans, CompletionOptions(texture=False), rng=0, n_threads=1)
    start = time.process_time()
    done.panels()
    return done, time.process_time() - start


def _with_rest(done: Completion) -> tuple[FloatArray, NDArray[np.int64]]:
    """The light model with what belongs to no surface, world coordinates."""
    own = done.panels()
    faces = np.concatenate([own.faces, own.remainder.faces])
    return done.world_from_reference.apply(own.vertices), faces


def _row(name: str, label: str, done: Completion, n_pixels: int, seconds: float, said: list[str]) -> str:
    model, (within, goes_on, other) = done.panels(), flaws(done)
    cells = [
        name,
        label,
        str(len(model.faces)),
        f"{len(model.faces) / max(n_pixels, 1):.2%}",
        *said,
        str(within),
        f"{goes_on}, {other}",
        f"{sum(model.open_m.values()):.1f}",
        f"{seconds:.1f}",
    ]
    return f"| {' | '.join(cells)} |"
