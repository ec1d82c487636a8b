# SPDX-License-Identifier: MIT
"""Objects: free-form things seen from two sides, 30, 60 and 90 degrees apart.

Each is made 25 cm long from corner to corner. A camera of 320 x 240 pixels with .3 mm of noise looks at it
from half a metre, from anywhere and turned about its axis by any angle. Right is within 3 degrees and 3 % of
the length.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.registration.rooms import overlap
from completion.registration.motions import STILL, composed, inverse
from completion.registration.pipeline import LEVEL, register_scans
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

OBJECTS = ("stanford-bunny", "rocker-arm", "fandisk")
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "scenes" / "objects"
CAMERA = PinholeSensor(fov_deg=40, width=320, height=240, max_range_m=3.0)
_LENGTH_M, _AWAY_M, _NOISE_M = 0.25, 0.5, 0.0003
_ANGLES = (30, 60, 90)
_TURN, _PLACE = 3.0, 0.03  # degrees, and share of the length


class Thing:
    """An object of the shared data, and a photographer around it."""

    def __init__(self, name: str) -> None:
        scene = open_scene(str(DATA / f"{name}.obj"))
        low, high = scene.mesh.bounds()
        factor = _LENGTH_M / float(np.linalg.norm(high - low))
        vertices = (scene.mesh.vertices - (low + high) / 2) * factor
        self.scene: Scene = replace(scene, mesh=replace(scene.mesh, vertices=vertices))
        self.caster = RayCaster(vertices, scene.mesh.faces)

    def pair(self, angle_deg: float, rng: np.random.Generator) -> tuple[RangeImage, RangeImage]:
        """Take two scans from directions so far apart."""
        first = rng.normal(size=3)
        first /= np.linalg.norm(first)
        axis = np.cross(first, rng.normal(size=3))
        turn = Rotation.from_rotvec(np.radians(angle_deg) * axis / np.linalg.norm(axis))
        one, two = (self._scan(way, rng) for way in (first, turn.apply(first)))
        return one, two

    def _scan(self, way: FloatArray, rng: np.random.Generator) -> RangeImage:
        roll = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True).as_matrix()
        held = Pose.looking_at(_AWAY_M * way, np.zeros(3))
        turned = np.eye(4)
        turned[:3, :3] = roll
        seen = scan_scene(self.scene, held @ Pose(turned), CAMERA, truth=False, caster=self.caster)
        noise = _NOISE_M * rng.standard_normal(seen.shape)
        return replace(seen, ranges=seen.ranges + noise, sigma_m=_NOISE_M)


def object_table(first: int, n_pairs: int) -> Iterator[str]:
    """Yield the lines of a table: pairs of each angle and object, right ones, claims."""
    yield "| object | degrees apart | pairs | median overlap | best is right | claimed | falsely | CPU s |"
    yield "|---|---|---|---|---|---|---|---|"
    for name in OBJECTS:
        thing = Thing(name)
        for angle in _ANGLES:
            rng = np.random.default_rng([first, angle])
            counts, shares, spent = np.zeros(3, np.int64), [], 0.0
            for _ in range(n_pairs):
                a, b = thing.pair(angle, rng)
                shares.append(overlap(a, b, 4 * _NOISE_M))
                started = time.process_time()
                found = register_scans([a, b], level=LEVEL, n_threads=1)
                spent += time.process_time() - started
                (told,) = found.pairs
                held = found.pose_of(1)
                motions = told.alternatives if held is None else [composed(inverse(STILL), held)]
                right = len(motions) > 0 and is_right(motions[0], a, b)
                counts += [right, held is not None, held is not None and not right]
            yield (
                f"| {name} | {angle} | {n_pairs} | {np.median(shares):.2f} | {counts[0]} | {counts[1]} "
                f"| {counts[2]} | {spent / n_pairs:.2f} |"
            )


def is_right(motion: FloatArray, a: RangeImage, b: RangeImage) -> bool:
    """Tell whether a motion (3, 4) of scan b into the frame of scan a is right."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    turn = Rotation.from_matrix(motion[:, :3].T @ true.rotation).magnitude()
    apart = np.linalg.norm(motion[:, 3] - true.translation)
    return bool(np.degrees(turn) < _TURN and apart < _PLACE * _LENGTH_M)
