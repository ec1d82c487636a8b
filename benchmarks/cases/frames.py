# SPDX-License-Identifier: MIT
"""Frames of one place that complete each other: real ones, walks through houses, generated flats."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

from benchmarks.cases.houses.house import (
    Building,
    House,
    camera,
    frames,
    furnished,
    random_house,
    without_mirrors,
)
from nbv import PinholeSensor, scan_scene
from scenes import RangeImage, RayCaster, read_scan
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis
from scenes.pose import Pose

_EYE_M = 1.5  # above the floor
_APART_M = 1.0  # what the frames of a walk cover at least, along either axis
_TRIES = 20


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


@dataclass(frozen=True)
class FurnishedWalk:
    """Every `each`-th frame of a walk through a house whose furniture is drawn by a seed, with exact poses.

    `name`: of the house. `n_frames`, `each`: how many frames the walk has, and which of them are kept.
    """

    house: str
    path: Path  # its file
    kept: tuple[str, ...]  # how the names of what belongs to the house begin; all else is taken out
    seed: int  # of furniture, of the place where the walk begins, and of the noise
    up: Axis = "y"  # axis of the file that points up
    n_frames: int = 240
    each: int = 8
    registration_m = 0.005

    @property
    def name(self) -> str:
        """The house and its seed."""
        return f"{self.house}, furnished {self.seed}"

    @cached_property
    def building(self) -> Building:
        """The house, furnished."""
        scene = open_scene(self.path, up=self.up)
        shell = scene.without([name for name in scene.surface_names if not name.startswith(self.kept)])
        return furnished(shell, np.random.default_rng([20269, self.seed]))

    @property
    def caster(self) -> RayCaster:
        """The house, to cast rays at."""
        return self.building.caster

    @cached_property
    def frames(self) -> tuple[RangeImage, ...]:
        """The frames that are kept."""
        rng = np.random.default_rng([20269, self.seed, 1])
        for _ in range(_TRIES):
            poses = walk(self.caster, self._start(rng), self.n_frames, rng.uniform(0, 2 * np.pi))
            if np.ptp([pose.translation for pose in poses], axis=0).max() > _APART_M:
                break
        return tuple(
            without_mirrors(
                scan_scene(
                    self.building.scene,
                    pose,
                    camera(320),
                    noise="khoshelham2012",
                    rng=1000 * self.seed + k,
                    caster=self.caster,
                    name=f"{self.name}, frame {k}",
                ),
                self.building.mirrors,
            )
            for k, pose in enumerate(poses[:: self.each])
        )

    def _start(self, rng: np.random.Generator) -> FloatArray:
        """A place to stand, evenly over the floor."""
        areas = np.array([area.area for area, _ in self.building.standing])
        floor, level = self.building.standing[int(rng.choice(len(areas), p=areas / areas.sum()))]
        x0, y0, x1, y1 = floor.bounds
        while True:
            at = rng.uniform((x0, y0), (x1, y1))
            if floor.contains(shapely.Point(at)):
                return np.array([*at, level + _EYE_M])


DATA = Path(os.environ.get("UNSEEN_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


@dataclass(frozen=True)
class RealFrames:
    """Posed frames of a real place, or of one whose truth is not known.

    `intrinsics`, `depth_scale`: where the folder does not tell them.
    """

    name: str  # folder below `range` of the data
    n_frames: int  # how many it holds
    registration_m: float  # how well its poses are known, metres
    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None

    @cached_property
    def frames(self) -> tuple[RangeImage, ...]:
        """All frames."""
        places = (DATA / "range" / f"{self.name}#{k + 1}" for k in range(self.n_frames))
        return tuple(
            read_scan(place, intrinsics=self.intrinsics, depth_scale=self.depth_scale) for place in places
        )


@dataclass(frozen=True)
class Walk:
    """Every `each`-th frame of a simulated walk through a house, with exact poses.

    `n_frames`, `each`: how many frames it has, and which of them are kept.
    """

    name: str  # of the walk
    scene: str  # file below the data
    start: tuple[float, float, float]  # (3,) float: Where the walk begins, metres, z up
    n_frames: int
    each: int
    up: Axis = "y"  # axis of the file that points up
    seed: int = 0  # of the noise of the first
    registration_m = 0.005

    @cached_property
    def caster(self) -> RayCaster:
        """The house, to cast rays at."""
        mesh = open_scene(DATA / self.scene, up=self.up).mesh
        return RayCaster(mesh.vertices, mesh.faces)

    @cached_property
    def frames(self) -> tuple[RangeImage, ...]:
        """The frames that are kept."""
        scene = open_scene(DATA / self.scene, up=self.up)
        camera = PinholeSensor(fov_deg=62.0, width=320, height=240, max_range_m=6.0)
        poses = walk(self.caster, np.array(self.start), self.n_frames)[:: self.each]
        return tuple(
            scan_scene(
                scene,
                pose,
                camera,
                noise="khoshelham2012",
                truth=False,
                rng=self.seed + k,
                caster=self.caster,
            )
            for k, pose in enumerate(poses)
        )


@dataclass(frozen=True)
class Flat:
    """Frames that a person takes in a generated flat, with exact poses."""

    seed: int  # of the flat
    n_frames: int = 5  # how many are taken
    registration_m = 0.005

    @property
    def name(self) -> str:
        """The flat by its seed."""
        return f"house {self.seed}"

    @cached_property
    def house(self) -> House:
        """The flat."""
        return random_house(self.seed)

    @property
    def caster(self) -> RayCaster:
        """The flat, to cast rays at."""
        return self.house.caster

    @cached_property
    def frames(self) -> tuple[RangeImage, ...]:
        """The frames."""
        return frames(self.house, self.n_frames)


Known = Walk | Flat | FurnishedWalk  # whose truth is known
Source = RealFrames | Known

REAL = (
    RealFrames("icl_nuim", 5, 0.01, (481.2, -480.0, 319.5, 239.5), 5000.0),
    RealFrames("align3d_sample1", 6, 0.02),
    RealFrames("align3d_sample2", 3, 0.02),
    RealFrames("open3d_redwood", 5, 0.02),
    RealFrames("nyu_dining", 5, 0.05, (518.0, 519.0, 325.5, 253.5), 1000.0),
)
JUDGED = (REAL[4], RealFrames("nvblox_3dmatch", 5, 0.03), RealFrames("tdtk", 2, 0.04))
"""Real frames of rooms whose poses are known well enough that one judges another."""
WALKS = (
    Walk("duplex, lower storey", "buildings/duplex.glb", (5.5, -3.4, 1.5), 240, 8),
    Walk("duplex, upper storey", "buildings/duplex.glb", (6.5, -3.4, 4.6), 240, 8),
    Walk("small house", "scenes/aws_small_house.glb", (2.0, -0.5, 1.4), 240, 8, "z"),
)
HOUSES = tuple(Flat(seed) for seed in range(20))
_DUPLEX = (
    *("IfcWall", "IfcSlab", "IfcBeam", "IfcWindow", "IfcCovering", "IfcStair", "IfcRailing", "IfcMember"),
    *("IfcDoor-123", "IfcDoor-124", "IfcDoor-40", "IfcDoor-41"),  # to the open
)
_SMALL_HOUSE = ("RoomWall", "HouseWall", "RoomWindow", "Floor", "FoldingDoor")
FURNISHED = (
    *(FurnishedWalk("duplex", DATA / "buildings/duplex.glb", _DUPLEX, seed) for seed in range(10)),
    *(
        FurnishedWalk("small house", DATA / "scenes/aws_small_house.glb", _SMALL_HOUSE, seed, "z")
        for seed in range(10, 20)
    ),
)
HELD_OUT_HOUSES = tuple(Flat(seed) for seed in range(100, 120))


def groups(n_frames: int, together: int) -> Iterator[Sequence[int]]:
    """Yield the frames that are completed together, `together` of them, each frame once as the first."""
    for first in range(n_frames):
        yield [(first + k * max(1, n_frames // together)) % n_frames for k in range(together)]
