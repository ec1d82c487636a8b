# SPDX-License-Identifier: MIT
"""Furnished: walks through houses of files, emptied and furnished anew by a seed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

from benchmarks.completion.scenes.houses.building import Building, furnished
from benchmarks.completion.scenes.houses.frames import camera, without_mirrors
from benchmarks.frames import walk
from nbv import scan_scene
from scenes import RangeImage, RayCaster
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis

_EYE_M = 1.5  # above the floor
_APART_M = 1.0  # what the frames of a walk cover at least, along either axis
_TRIES = 20


@dataclass(frozen=True)
class FurnishedWalk:
    """Every `each`-th frame of a walk through a house whose furniture is drawn by a seed, with exact poses.

    Attributes
    ----------
    name : str
        Of the house.
    path : Path
        Its file.
    kept : tuple of str
        How the names of what belongs to the house begin; all else is taken out.
    seed : int
        Of furniture, of the place where the walk begins, and of the noise.
    up : x, y or z
        Axis of the file that points up.
    n_frames, each : int
        How many frames the walk has, and which of them are kept.
    """

    house: str
    path: Path
    kept: tuple[str, ...]
    seed: int
    up: Axis = "y"
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
