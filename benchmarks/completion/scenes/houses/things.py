# SPDX-License-Identifier: MIT
"""Things: one figure, chair or plant in a bare room, of which nothing may be continued but enclosed holes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.completion.scenes.houses.frames import camera
from benchmarks.completion.scenes.houses.furniture.figures import figure
from benchmarks.completion.scenes.houses.furniture.parts import Part, Piece, centred, motion, moved, scene_of
from benchmarks.completion.scenes.houses.furniture.plants import plant
from benchmarks.completion.scenes.houses.furniture.seats import chair
from benchmarks.completion.scenes.houses.furniture.solids import quads
from nbv.scanning.scanner import scan_scene
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

KINDS = ("figure", "chair", "plant")


@dataclass(frozen=True, eq=False)
class Thing:
    """A bare room with one thing on its floor.

    Attributes
    ----------
    seed : int
        The same seed gives the same bytes.
    kind : str
        figure, chair, plant, or what a file holds.
    scene : Scene
        Metres, z up.
    is_thing : (n_surfaces,) bool
        Which surfaces of the scene are the thing's.
    """

    seed: int
    kind: str
    scene: Scene
    is_thing: BoolArray

    @cached_property
    def caster(self) -> RayCaster:
        """The room, to cast rays at."""
        return self.scene.ray_caster()

    @property
    def thing_faces(self) -> BoolArray:
        """Which faces (m,) are the thing's."""
        return np.asarray(self.is_thing[self.scene.mesh.face_surface], dtype=np.bool_)

    @cached_property
    def frames(self) -> tuple[RangeImage, ...]:
        """Three frames of the thing, from 1 to 3 m off, whole or in part, by a depth camera."""
        rng = np.random.default_rng([20267, self.seed, 1])
        corners = self.scene.mesh.corners[self.thing_faces].reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        taken: list[RangeImage] = []
        while len(taken) < 3:
            eye = _eye(rng, (low + high) / 2)
            pose = Pose.looking_at(eye, rng.uniform(low, high))
            if not self._is_inside(eye):
                continue
            number = len(taken)
            taken.append(
                scan_scene(
                    self.scene,
                    pose,
                    camera(320),
                    noise="khoshelham2012",
                    rng=1000 * self.seed + number,
                    caster=self.caster,
                    name=f"{self.kind} {self.seed}, frame {number}",
                )
            )
        return tuple(taken)

    def _is_inside(self, eye: FloatArray) -> bool:
        """Tell whether a camera there is in the room, 30 cm off its walls."""
        (x0, y0, _), (x1, y1, _) = self.scene.mesh.bounds()
        return bool(x0 + 0.3 < eye[0] < x1 - 0.3 and y0 + 0.3 < eye[1] < y1 - 0.3)


def random_thing(seed: int, kind: str | None = None) -> Thing:
    """Return a room with a figure, a chair or a plant, by turns; the same seed gives the same bytes.

    Raises
    ------
    InputError
        Another kind.
    """
    rng = np.random.default_rng([20267, seed])
    kind = kind or KINDS[seed % len(KINDS)]
    if kind not in KINDS:
        raise InputError(f"expected a thing of {', '.join(KINDS)}, got {kind!r}")
    if kind == "plant":
        return _in_a_room(seed, kind, plant(rng, rng.uniform(0.5, 1.8)), rng)
    return _in_a_room(seed, kind, figure(rng) if kind == "figure" else chair(rng), rng)


def thing_of_file(seed: int, kind: str, path: Path, *, up: Axis, unit_m: float) -> Thing:
    """Return a room with what a mesh file holds, turned and placed by `seed`; its unit is in metres."""
    mesh = open_scene(path, up=up).mesh
    piece = Piece((Part(kind, unit_m * mesh.corners, (0.6, 0.45, 0.3)),))
    return _in_a_room(seed, kind, piece, np.random.default_rng([20268, seed]))


def _in_a_room(seed: int, kind: str, piece: Piece, rng: np.random.Generator) -> Thing:
    size = rng.uniform([3.2, 3.2, 2.4], [5.0, 5.0, 2.9])
    room = _bare_room(size)
    place = size[0] / 2 + rng.uniform(-0.6, 0.6), size[1] - rng.uniform(0.5, 1.8)
    own = centred(piece)
    at = motion((*place, -float(own.bounds[0, 2])), rng.uniform(0, 2 * np.pi))
    parts = [*room, *moved(own.parts, at)]
    return Thing(seed, kind, scene_of(f"{kind} {seed}", parts), np.arange(len(parts)) >= len(room))


def _bare_room(size: FloatArray) -> list[Part]:
    x, y, z = np.diag(size)
    o = np.zeros(3)
    faces = {
        "floor": [o, x, x + y, y],
        "ceiling": [z, z + y, z + x + y, z + x],
        "wall x=0": [o, y, y + z, z],
        "wall x=far": [x, x + z, x + y + z, x + y],
        "wall y=0": [o, z, x + z, x],
        "wall y=far": [y, x + y, x + y + z, y + z],
    }
    tints = {"floor": (0.55, 0.48, 0.4), "ceiling": (0.92, 0.92, 0.9)}
    return [Part(name, quads([ring]), tints.get(name, (0.86, 0.84, 0.8))) for name, ring in faces.items()]


def _eye(rng: np.random.Generator, middle: FloatArray) -> FloatArray:
    turn, away = rng.uniform(0, 2 * np.pi), rng.uniform(1.0, 3.0)
    return np.array([middle[0] + away * np.cos(turn), middle[1] + away * np.sin(turn), rng.uniform(1.1, 1.7)])
