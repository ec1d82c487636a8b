# SPDX-License-Identifier: MIT
"""Places that look alike: corridors that tell no shift along themselves, and rooms that are their own image.

A corridor is forty metres long; the camera of the rooms, which sees twelve, stands in its middle part and
looks along it. Every second one has a niche of door's size every three metres, so that shifts by three metres
look alike. A symmetric room is a box with furniture that a half turn about its middle brings onto itself, or
a square with furniture that a quarter turn does. Two scans of one share a tenth at least; where they share
less, what they show of its like corners is as if they shared it, and nobody could tell: rows of their own.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh

from benchmarks.registration.rooms import CAMERA, is_right, overlap
from completion.registration.pipeline import LEVEL, register_scans
from completion.registration.verdict import Verdict
from nbv.scanning.scanner import scan_scene
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_LENGTH_M, _DOORS_M = 40.0, 3.0
_FREE_M = 0.4  # around the camera
_SHARED = 0.1  # overlap of two scans


def alike_table(first: int, n_places: int) -> Iterator[str]:
    """Yield the lines of a table: a row each kind of place."""
    yield (
        "| place | pairs | right claims | false claims | slides | axis within 5 deg "
        "| ambiguous, truth among them | ambiguous | no overlap shown |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for kind, make in (("bare corridor", _bare), ("corridor with niches", _niched)):
        yield _row(kind, [make(np.random.default_rng([first + k, 1])) for k in range(n_places)])
    for kind, turns in (("half turn", 2), ("quarter turn", 4)):
        pairs = [_symmetric(np.random.default_rng([first + k, turns]), turns) for k in range(n_places)]
        shared = [overlap(a, b) >= _SHARED for a, b, _ in pairs]
        yield _row(kind, [one for one, met in zip(pairs, shared, strict=True) if met])
        yield _row(f"{kind}, less shared", [one for one, met in zip(pairs, shared, strict=True) if not met])


def _row(kind: str, pairs: list[tuple[RangeImage, RangeImage, FloatArray | None]]) -> str:
    counts = dict.fromkeys(("right", "false", "slides", "axis", "among", "ambiguous", "none"), 0)
    for a, b, axis in pairs:
        found = register_scans([a, b], level=LEVEL, n_threads=1)
        (told,) = found.pairs
        pose = found.pose_of(1)
        if pose is not None:
            counts["right" if is_right(pose, a, b) else "false"] += 1
        elif told.verdict is Verdict.SLIDES and told.direction is not None:
            counts["slides"] += 1
            along = a.world_from_sensor.rotation @ told.direction
            counts["axis"] += axis is not None and abs(float(along @ axis)) > np.cos(np.radians(5.0))
        elif told.verdict is Verdict.AMBIGUOUS:
            counts["ambiguous"] += 1
            counts["among"] += any(is_right(one, a, b) for one in told.alternatives)
        else:
            counts["none"] += 1
    return f"| {kind} | {len(pairs)} | " + " | ".join(str(one) for one in counts.values()) + " |"


def _bare(rng: np.random.Generator) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    return _corridor(rng, [])


def _niched(rng: np.random.Generator) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    at = np.arange(-_LENGTH_M / 2 + 1.0, _LENGTH_M / 2 - 1.0, _DOORS_M)
    return _corridor(rng, at.tolist())


def _corridor(
    rng: np.random.Generator, doors: list[float]
) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    """Two scans of a corridor along x."""
    width, height = rng.uniform(1.4, 2.6), rng.uniform(2.3, 3.0)
    parts = [_room(_LENGTH_M, width, height)]
    for x in doors:  # frames that stand out by 8 cm, on both sides
        parts += [
            _box([0.1, 0.08, 2.1], [x + shift, side * (width / 2 - 0.04), 1.05])
            for side in (-1, 1)
            for shift in (-0.5, 0.5)
        ]
    caster = _Caster(parts)
    scans = []
    x = rng.uniform(-4, 4)
    for number in range(2):
        eye = [x + number * rng.uniform(0.5, 4.0), rng.uniform(-0.3, 0.3) * width, rng.uniform(1.2, 1.8)]
        way = np.array([1.0, rng.uniform(-0.35, 0.35), rng.uniform(-0.3, 0.1)])
        scans.append(caster.scan(eye, way, rng))
    return scans[0], scans[1], np.array([1.0, 0.0, 0.0])


def _symmetric(rng: np.random.Generator, turns: int) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    """Two scans of a room that is its own image under a turn about its middle."""
    length, width = rng.uniform(3.5, 7.0), rng.uniform(3.0, 6.0)
    if turns == 4:
        width = length
    parts = [_room(length, width, rng.uniform(2.3, 3.0))]
    for _ in range(int(rng.integers(2, 6))):
        size = rng.uniform([0.2, 0.2, 0.3], [0.9, 0.9, 2.0])
        place = np.array([*(rng.uniform(-0.5, 0.5, 2) * [length - 1, width - 1]), size[2] / 2])
        turned = trimesh.transformations.rotation_matrix(rng.uniform(0, np.pi), [0, 0, 1])
        for k in range(turns):
            box = trimesh.creation.box(size)
            box.apply_transform(turned)
            box.apply_translation(place)
            box.apply_transform(trimesh.transformations.rotation_matrix(2 * np.pi * k / turns, [0, 0, 1]))
            parts.append(box)
    caster, scans = _Caster(parts), []
    azimuth = rng.uniform(0, 2 * np.pi)
    while len(scans) < 2:
        eye = np.array([*(rng.uniform(-0.5, 0.5, 2) * [length - 0.8, width - 0.8]), rng.uniform(1.2, 1.8)])
        if caster.is_tight(eye):
            continue
        turn = azimuth + len(scans) * np.radians(rng.uniform(30, 90))
        scans.append(caster.scan(eye, np.array([np.cos(turn), np.sin(turn), rng.uniform(-0.3, 0.1)]), rng))
    return scans[0], scans[1], None


class _Caster:
    """A place, and the camera in it."""

    def __init__(self, parts: list[trimesh.Trimesh]) -> None:
        self.scene = Scene.from_mesh(trimesh.util.concatenate(parts), mode="room")
        self.caster = RayCaster(self.scene.mesh.vertices, self.scene.mesh.faces)

    def is_tight(self, eye: FloatArray) -> bool:
        """Tell whether something stands close to a place (3,)."""
        around = np.random.default_rng(0).normal(size=(200, 3))
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        return bool(self.caster.first_hit(np.tile(eye, (200, 1)), around).ranges.min() < _FREE_M)

    def scan(self, eye: FloatArray | list[float], way: FloatArray, rng: np.random.Generator) -> RangeImage:
        """Take a scan from a place (3,) along a direction (3,)."""
        pose = Pose.looking_at(np.asarray(eye), np.asarray(eye) + way)
        return scan_scene(
            self.scene, pose, CAMERA, noise="gaussian-2mm", rng=rng.integers(2**31), truth=False,
            caster=self.caster,
        )  # fmt: skip


def _room(length: float, width: float, height: float) -> trimesh.Trimesh:
    """A box seen from within, its floor at z = 0, x and y about its middle, metres."""
    box = _box([length, width, height], [0.0, 0.0, height / 2])
    box.invert()
    return box


def _box(size: list[float], place: list[float]) -> trimesh.Trimesh:
    box = trimesh.creation.box(size)
    box.apply_translation(place)
    return box
