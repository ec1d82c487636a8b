# SPDX-License-Identifier: MIT
"""Machined parts scanned from one side: points with the scanner's place, and the whole true surface.

"tuning" parts fit the probabilities of `completion.parts.backs`: the five models that were looked at and
swept parts, of which half the outlines are alike in a mirror. "held-out" ones are of other kinds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from benchmarks.cases.frames import DATA
from benchmarks.cases.profiles import SweptCase, swept_case
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import FloatArray
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene

NOISE, PIXELS, AWAY = 3e-4, 220, 2.2  # shares of size, pixels a side of the image, sizes to the sensor
SWEPT = 24
MESHES = ("featuretype.STL", "fandisk.obj", "rocker-arm.obj")
SIZE_M = 0.1
_N_TURNS, _N_SHARE = 72, 16
_UP_DEG = 15, 70


@dataclass(frozen=True, slots=True, eq=False)
class OneSided:
    """A part of 0.1 m: points (n, 3) from one place, that place (3,), triangles (m, 3, 3); metres."""

    points: FloatArray
    origin: FloatArray
    corners: FloatArray


def parts_of(half: str) -> list[str]:
    """Return the names of the parts of a half, "tuning" or "held-out"; meshes only where the data are."""
    from benchmarks.cases.model_shapes import HELD_OUT, TUNING  # its kernel is only loaded where it is there

    if half == "tuning":
        return [*TUNING, *(f"swept {seed}" for seed in range(SWEPT))]
    return [*HELD_OUT, *(name for name in MESHES if (DATA / "scenes/objects" / name).exists())]


def one_sided(name: str, seed: int) -> OneSided:
    """Return a part scanned from a place by chance, 15 to 70 degrees above its foot; the seed draws both."""
    rng = np.random.default_rng([61, seed, sum(map(ord, name))])
    corners = _corners_of(name, seed)
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    corners = (corners - (low + high) / 2) * (SIZE_M / np.linalg.norm(high - low))
    azimuth, up = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(*_UP_DEG))
    way = np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    sensor = PinholeSensor(fov_deg=30, width=PIXELS, height=PIXELS, min_range_m=0.001, max_range_m=10)
    mesh = LabelledMesh(
        corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3),
        np.zeros(len(corners), np.int32),
    )  # fmt: skip
    scene = Scene(mesh, (None,), ("part",), "part", "object")
    scan = scan_scene(scene, View(Pose.looking_at(AWAY * SIZE_M * way, np.zeros(3)), sensor))
    exact = scan.points()
    exact = exact[np.isfinite(exact).all(axis=2)]
    origin = AWAY * SIZE_M * way
    rays = exact - origin
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    noise = NOISE * SIZE_M * rng.normal(size=len(exact))
    return OneSided(exact + noise[:, None] * rays, origin, corners)


def _corners_of(name: str, seed: int) -> FloatArray:
    """Triangles (m, 3, 3), turned by chance about two axes in odd seeds."""
    if name.startswith("swept"):
        corners = _swept(swept_case(int(name.split()[1])))
    elif name in MESHES:
        mesh = load_scene(DATA / "scenes/objects" / name, up="z", units="m", mode="object").mesh
        corners = mesh.vertices[mesh.faces]
    else:
        from benchmarks.cases.models import model_mesh

        corners = model_mesh(name, "fine", 2 * (seed // 2)).corners
    turn = Rotation.random(random_state=seed).as_matrix() if seed % 2 else np.eye(3)
    return np.asarray(corners @ turn.T)


def _swept(case: SweptCase) -> FloatArray:
    """The triangles of a swept part, as it stands before it is turned, millimetres."""
    share = np.linspace(0, 1, _N_SHARE)
    if case.kind == "revolved":
        line = np.concatenate([one.places(share) for one in case.segments])
        angle = np.linspace(0, 2 * np.pi, _N_TURNS + 1)
        ring = np.stack([
            np.broadcast_to(line[:, :1], (len(line), len(angle))),
            line[:, 1:] * np.cos(angle), line[:, 1:] * np.sin(angle),
        ], axis=2)  # fmt: skip
        return _quads(ring)
    outer, *inner = case.loops
    walls = []
    for loop in case.loops:
        line = np.concatenate([one.places(share) for one in loop.segments])
        line = np.concatenate([line, line[:1]])
        walls.append(_quads(np.stack([np.insert(line, 2, level, axis=1) for level in (loop.low, loop.high)])))
    through = shapely.union_all([loop.polygon for loop in inner if loop.low == 0.0])
    every = shapely.union_all([loop.polygon for loop in inner])
    flats = [(outer.polygon.difference(every), outer.high), (outer.polygon.difference(through), 0.0)]
    flats += [(loop.polygon, loop.low) for loop in inner if loop.low > 0.0]
    for area, level in flats:
        pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
        walls.append(
            np.array([np.insert(shapely.get_coordinates(one)[:3], 2, level, axis=1) for one in pieces])
        )
    return np.concatenate(walls)


def _quads(grid: FloatArray) -> FloatArray:
    """Two triangles (m, 3, 3) for each mesh of a grid (k, n, 3)."""
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    first, second = np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)
    every = np.concatenate([first.reshape(-1, 3, 3), second.reshape(-1, 3, 3)])
    area = np.linalg.norm(np.cross(every[:, 1] - every[:, 0], every[:, 2] - every[:, 0]), axis=1)
    return np.asarray(every[area > 0])
