# SPDX-License-Identifier: MIT
"""Frames: what a person with a depth camera takes in a flat, and panoramas of a laser scanner."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.completion.scenes.houses.house import House
from nbv.scanning.effects.effects import Effects
from nbv.scanning.effects.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor, SphericalSensor
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

NEAREST_M, FARTHEST_M = 0.4, 6.0
_FOV_DEG = 62.0
_APART_M = 0.3  # from anything, at any height up to the camera's
_GOOD = 1.0  # merit from which on no better frame is looked for
_LOOKS = 40  # places and directions that are tried for one frame


def camera(width: int) -> PinholeSensor:
    """Return a depth camera `width` pixels wide, three quarters as high."""
    return PinholeSensor(
        fov_deg=_FOV_DEG,
        width=width,
        height=3 * width // 4,
        min_range_m=NEAREST_M,
        max_range_m=FARTHEST_M,
        name="depth camera",
    )


def frames(
    house: House, n: int = 5, width: int = 320, *, noise: str = "khoshelham2012"
) -> tuple[RangeImage, ...]:
    """Return `n` frames that a person takes, with exact poses.

    The eye is 1.2 to 1.7 m above floor on which there is room to stand, and looks at some thing or some place
    on a wall, now and then through a door, up or down, the camera never quite level. Frames of which less
    than two thirds would be surface in range, or most of it very near, are not taken. From mirrors nothing
    comes back.
    """
    poses = standing_poses(
        house.scene, house.caster, house.standing, n, np.random.default_rng([house.seed, 1])
    )
    taken = []
    for number, pose in enumerate(poses):
        scan = scan_scene(
            house.scene,
            pose,
            camera(width),
            noise=noise,
            rng=1000 * house.seed + number,
            caster=house.caster,
            name=f"house {house.seed}, frame {number}",
        )
        taken.append(without_mirrors(scan, house.mirrors))
    return tuple(taken)


def station(house: House, *, width: int = 1440, sigma_m: float | None = None) -> RangeImage:
    """Return a panorama of 360 x 150 degrees from a tripod in the largest free place, noise 2 to 5 mm."""
    rng = np.random.default_rng([house.seed, 2])
    sigma = rng.uniform(0.002, 0.005) if sigma_m is None else sigma_m
    floor = max(
        (part for area in house.standing for part in shapely.get_parts(area)), key=lambda one: one.area
    )
    middle = np.array(shapely.maximum_inscribed_circle(floor, 0.02).coords[0])
    eye = np.array([*middle, rng.uniform(1.4, 1.7)])
    sensor = SphericalSensor(
        elevation_min_deg=-60.0, elevation_max_deg=90.0, width=width, height=width * 5 // 12, name="panorama"
    )
    turn = rng.uniform(0, 2 * np.pi)
    pose = Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), 0])
    effects = Effects(noise=ConstantNoise(constant_m=sigma))
    scan = scan_scene(
        house.scene,
        pose,
        sensor,
        effects=effects,
        rng=house.seed,
        caster=house.caster,
        name=f"house {house.seed}, station",
    )
    return without_mirrors(scan, house.mirrors)


def without_mirrors(scan: RangeImage, mirrors: BoolArray) -> RangeImage:
    """Return the scan without the returns from surfaces (n_surfaces,) that are mirrors.

    A triangulating camera loses its pattern there; what some instruments return instead, the reflected way,
    is left out.
    """
    if scan.truth is None or not mirrors.any():
        return scan
    lost = mirrors[scan.truth.surface] & (scan.truth.surface >= 0)
    return replace(scan, ranges=np.where(lost, np.inf, scan.ranges)) if lost.any() else scan


def standing_poses(
    scene: Scene, caster: RayCaster, floors: tuple[BaseGeometry, ...], n: int, rng: np.random.Generator
) -> list[Pose]:
    """Return `n` poses of a camera in a person's hands, each as good as 40 tries make it."""
    poses: list[Pose] = []
    rooms = np.array([area.area for area in floors])
    share = np.sqrt(rooms) / np.sqrt(rooms).sum()
    low, high = _extents(scene)
    for _ in range(n):
        best, merit = None, -1.0
        for _ in range(_LOOKS):
            eye = _eye(floors[int(rng.choice(len(floors), p=share))], rng)
            if not has_room(caster, eye):
                continue
            pose = _look(eye, _goal(eye, low, high, rng), rng)
            seen = _merit(caster, pose) - 0.4 * any(_is_alike(pose, one) for one in poses)
            if seen > merit:
                best, merit = pose, seen
            if merit > _GOOD:
                break
        if best is not None:
            poses.append(best)
    return poses


def has_room(caster: RayCaster, eye: FloatArray) -> bool:
    """Tell whether a person can hold a camera there: floor below, nothing within 30 cm."""
    turn = 2 * np.pi * np.arange(20) / 20
    ways = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(20)])
    heights = np.array([0.15, 0.45, 0.8, 1.1, float(eye[2])])
    starts = np.repeat(np.column_stack([np.tile(eye[:2], (5, 1)), heights]), 20, axis=0)
    around = caster.first_hit(starts, np.tile(ways, (5, 1))).ranges
    down = caster.first_hit(eye[None], np.array([[0, 0, -1.0]])).ranges[0]
    up = caster.first_hit(eye[None], np.array([[0, 0, 1.0]])).ranges[0]
    return bool(around.min() >= _APART_M and abs(down - eye[2]) < 0.03 and up > 0.12)


def _extents(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """The bounds (n_surfaces, 3) of every part that is not the outside."""
    labels, corners = scene.mesh.face_surface, scene.mesh.corners
    low = np.full((len(scene.surface_names), 3), np.inf)
    high = -low
    np.minimum.at(low, labels, corners.min(axis=1))
    np.maximum.at(high, labels, corners.max(axis=1))
    kept = np.array(["facade" not in name for name in scene.surface_names])
    return low[kept], high[kept]


def _eye(floor: BaseGeometry, rng: np.random.Generator) -> FloatArray:
    """A place above a floor, evenly over its area."""
    x0, y0, x1, y1 = floor.bounds
    for _ in range(60):
        at = rng.uniform((x0, y0), (x1, y1))
        if floor.contains(shapely.Point(at)):
            break
    return np.array([*at, rng.uniform(1.2, 1.7)])


def _goal(eye: FloatArray, low: FloatArray, high: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Somewhere on a part, nearer ones more often; of large ones anywhere."""
    reach = np.linalg.norm((low + high) / 2 - eye, axis=1)
    weight = np.exp(-reach / 2.5) * np.sqrt(0.1 + np.linalg.norm(high - low, axis=1))
    one = int(rng.choice(len(low), p=weight / weight.sum()))
    return np.asarray(low[one] + rng.uniform(0.1, 0.9, 3) * (high[one] - low[one]))


def _look(eye: FloatArray, goal: FloatArray, rng: np.random.Generator) -> Pose:
    """Look at a goal, up or down by 40 degrees at most, with the camera rolled somewhat."""
    ahead = goal - eye
    level = max(float(np.linalg.norm(ahead[:2])), 0.3)
    ahead[2] = np.clip(ahead[2], -0.84 * level, 0.45 * level)
    roll = rng.normal(0, np.radians(2.5))
    spin = np.eye(4)
    spin[:2, :2] = [[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]
    return Pose.looking_at(eye, eye + ahead) @ Pose(spin)


def _is_alike(pose: Pose, other: Pose) -> bool:
    """Tell whether two cameras stand within 70 cm and look the same way within 40 degrees."""
    near = np.linalg.norm(pose.translation - other.translation) < 0.7
    return bool(near and pose.rotation[:, 2] @ other.rotation[:, 2] > 0.77)


def _merit(caster: RayCaster, pose: Pose) -> float:
    """How much of a view of 32 x 24 pixels is surface in range, less what is near, and more with jumps."""
    rays = camera(32).projection.directions()
    hits = caster.first_hit(pose.translation[None], pose.rotate(rays)).ranges
    share = float(((hits > NEAREST_M) & (hits < FARTHEST_M)).mean())
    near = float((hits < 1.0).mean())
    depth = np.clip(hits, 0, FARTHEST_M)
    jumps = float(
        (np.abs(np.diff(depth, axis=1)) > 0.2).mean() + (np.abs(np.diff(depth, axis=0)) > 0.2).mean()
    )
    return (share if share > 0.66 else share - 1) - 0.8 * near + min(2 * jumps, 0.3)
