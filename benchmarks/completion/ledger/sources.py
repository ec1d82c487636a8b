# SPDX-License-Identifier: MIT
"""Sources: frames of one place that complete each other, real ones and walks through houses."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.completion.ledger.furnished import FurnishedWalk
from benchmarks.completion.scenes.houses.frames import frames
from benchmarks.completion.scenes.houses.house import House, random_house
from benchmarks.frames import walk
from nbv import PinholeSensor, scan_scene
from scenes import RangeImage, RayCaster, read_scan
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis

DATA = Path(os.environ.get("UNSEEN_DATA", Path(__file__).resolve().parents[4] / "shared" / "data"))


@dataclass(frozen=True)
class RealFrames:
    """Posed frames of a real place, or of one whose truth is not known.

    Attributes
    ----------
    name : str
        Folder below `range` of the data.
    n_frames : int
        How many it holds.
    registration_m : float
        How well its poses are known, metres.
    intrinsics, depth_scale : optional
        Where the folder does not tell them.
    """

    name: str
    n_frames: int
    registration_m: float
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

    Attributes
    ----------
    name : str
        Of the walk.
    scene : str
        File below the data.
    start : (3,) float
        Where the walk begins, metres, z up.
    n_frames, each : int
        How many frames it has, and which of them are kept.
    up : x, y or z
        Axis of the file that points up.
    seed : int
        Of the noise of the first.
    """

    name: str
    scene: str
    start: tuple[float, float, float]
    n_frames: int
    each: int
    up: Axis = "y"
    seed: int = 0
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
    """Frames that a person takes in a generated flat, with exact poses.

    Attributes
    ----------
    seed : int
        Of the flat.
    n_frames : int
        How many are taken.
    """

    seed: int
    n_frames: int = 5
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
