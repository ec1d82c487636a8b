# SPDX-License-Identifier: MIT
"""Pairs of scans to register: furnished rooms, free-form objects, places that look alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.cases.rooms import random_case
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

CAMERA = PinholeSensor(fov_deg=75, width=320, height=240, max_range_m=12.0)
_SAME_M = 0.03  # difference of ranges of what both measured
_NEAR_M = 0.3  # around the camera, free
_TURN, _PLACE_M = 3.0, 0.1  # degrees and metres within which a pose is right


class Room:
    """A furnished room by its seed, and a photographer in it."""

    def __init__(self, seed: int) -> None:
        self.scene = random_case(seed).scene
        self.rng = np.random.default_rng([77, seed])
        self.caster = RayCaster(self.scene.mesh.vertices, self.scene.mesh.faces)
        self.size = np.minimum(self.scene.mesh.bounds()[1], [5.5, 5.0, 3.0])
        around = np.random.default_rng(0).normal(size=(200, 3))
        self._around = around / np.linalg.norm(around, axis=1, keepdims=True)

    def scan(self, towards: float | None = None) -> tuple[RangeImage, float]:
        """Take a scan towards an azimuth (radians), or the middle; return it with its azimuth."""
        while True:
            eye = np.array([*self.rng.uniform(0.4, self.size[:2] - 0.4), self.rng.uniform(1.2, 1.8)])
            if self.caster.first_hit(np.tile(eye, (200, 1)), self._around).ranges.min() < _NEAR_M:
                continue
            middle = self.size / 2 - eye
            own = np.arctan2(middle[1], middle[0]) + np.radians(self.rng.uniform(-60, 60))
            azimuth = own if towards is None else towards
            down = self.rng.uniform(-0.35, 0.1)
            look = [np.cos(azimuth) * np.cos(down), np.sin(azimuth) * np.cos(down), np.sin(down)]
            scan = scan_scene(
                self.scene, Pose.looking_at(eye, eye + look), CAMERA, noise="gaussian-2mm",
                rng=int(self.rng.integers(2**31)), truth=False, caster=self.caster,
            )  # fmt: skip
            if scan.valid.mean() > 0.3:
                return scan, azimuth

    def pair(self) -> tuple[RangeImage, RangeImage]:
        """Take two scans that look 30 to 120 degrees apart."""
        first, azimuth = self.scan()
        turn = np.radians(self.rng.uniform(30, 120)) * self.rng.choice([-1, 1])
        return first, self.scan(azimuth + turn)[0]


def overlap(a: RangeImage, b: RangeImage, same_m: float = _SAME_M) -> float:
    """Return the least share of either scan's points that the other one measured."""
    return min(_share(a, b, same_m), _share(b, a, same_m))


def _share(seer: RangeImage, seen: RangeImage, same_m: float) -> float:
    """The share of a scan's points that another one measured, on the same side of what they lie on."""
    grid = seen.points()
    normals = np.cross(np.gradient(grid, axis=1), np.gradient(grid, axis=0))[seen.valid][::7]
    points = grid[seen.valid][::7]
    ray, own = points - seer.world_from_sensor.translation, points - seen.world_from_sensor.translation
    faces = np.einsum("ij,ij->i", normals, ray) * np.einsum("ij,ij->i", normals, own) > 0
    distance = np.linalg.norm(ray, axis=1)
    pixel = seer.projection.pixels(ray @ seer.world_from_sensor.rotation)
    inside = np.isfinite(pixel).all(axis=1) & faces
    row, column = np.rint(pixel[inside]).astype(int).T
    met = seer.ranges[row.clip(0, seer.shape[0] - 1), column.clip(0, seer.shape[1] - 1)]
    return float(np.count_nonzero(np.abs(met - distance[inside]) < same_m) / len(points))


def is_right(motion: FloatArray, a: RangeImage, b: RangeImage) -> bool:
    """Tell whether a motion (3, 4) of scan b into the frame of scan a is right."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    cosine = (np.trace(motion[:, :3].T @ true.rotation) - 1) / 2
    turn = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return turn < _TURN and float(np.linalg.norm(motion[:, 3] - true.translation)) < _PLACE_M


OBJECTS = ("stanford-bunny", "rocker-arm", "fandisk")
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "scenes" / "objects"
CAMERA_OF_OBJECTS = PinholeSensor(fov_deg=40, width=320, height=240, max_range_m=3.0)
_LENGTH_M, _AWAY_M, NOISE_M = 0.25, 0.5, 0.0003
ANGLES_DEG = (30, 60, 90)
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
        seen = scan_scene(self.scene, held @ Pose(turned), CAMERA_OF_OBJECTS, truth=False, caster=self.caster)
        noise = NOISE_M * rng.standard_normal(seen.shape)
        return replace(seen, ranges=seen.ranges + noise, sigma_m=NOISE_M)


def is_right_of_objects(motion: FloatArray, a: RangeImage, b: RangeImage) -> bool:
    """Tell whether a motion (3, 4) of scan b into the frame of scan a is right."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    turn = Rotation.from_matrix(motion[:, :3].T @ true.rotation).magnitude()
    apart = np.linalg.norm(motion[:, 3] - true.translation)
    return bool(np.degrees(turn) < _TURN and apart < _PLACE * _LENGTH_M)
