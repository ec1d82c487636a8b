# SPDX-License-Identifier: MIT
"""Scans without poses against the design of a building: placed rightly, refused, or placed wrongly.

Right is within 5 cm and half a degree of the truth, all scans of a set.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.asbuilt.placement import place_on_design
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from scenes.checks import FloatArray, InputError, IntArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_PANORAMA = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=900, height=300,
    name="panorama", max_range_m=20.0,
)  # fmt: skip
_NOISE, _HEIGHT_M = "gaussian-2mm", 1.6
_KINDS = "neighbours", "apart", "units", "tilted"
_TILT_DEG, _OFF_M = 2.0, 500.0
_RIGHT_M, _RIGHT_DEG = 0.05, 0.5


class _Set(NamedTuple):
    """Scans with poses that know nothing, and the true ones."""

    kind: str
    scans: list[RangeImage]
    poses: list[Pose]


class _Result(NamedTuple):
    """What became of a set: scans placed, of how many, the farthest off, metres and degrees; CPU seconds."""

    kind: str
    scans: int
    placed: int
    off_m: float
    off_deg: float
    agreeing: float
    through: float
    cpu_s: float
    said: str


@cache
def _house() -> Scene:
    return open_scene(DATA / "buildings/duplex.glb", up="y")


@cache
def _places() -> tuple[FloatArray, IntArray]:
    """Where a tripod may stand among the furniture, doors open, and in which room each place is."""
    site = find_site(_house().without(("*Door*",)), SiteOptions(heights_m=(_HEIGHT_M,)), turns=True)
    return np.asarray(site.positions), np.asarray(site.position_room)


def _set(seed: int) -> _Set:
    """Three to five scans of three rooms of the duplex, furnished, some of its doors open, by seed."""
    rng, kind = np.random.default_rng(seed), _KINDS[seed % len(_KINDS)]
    names = _house().surface_names
    doors = [name for name in names if name.startswith("IfcDoor")]
    gone = [name for name in doors if rng.random() < 0.6]
    glazed = rng.random() < 0.5  # beams pass windows, and nothing comes back
    built = _house().without((*gone, *(("IfcWindow*",) if glazed else ())))
    places, room = _places()
    rooms = np.unique(room)
    first = int(rng.choice(rooms))
    middle = {one: places[room == one].mean(axis=0) for one in rooms.tolist()}
    near = sorted(middle, key=lambda one: float(np.linalg.norm((middle[one] - middle[first]) * [1, 1, 3])))
    chosen = near[:3] if kind != "units" else [first, *rng.choice(near[1:], 2, replace=False).tolist()]
    if kind == "apart":
        chosen[2] = int(rng.choice(near[5:]))
    n = int(rng.integers(3, 6))
    order = [*chosen, *rng.choice(chosen[:2], n - 3).tolist()]
    caster, scans, poses = built.ray_caster(), [], []
    for number, one in enumerate(order):
        place = rng.choice(places[room == one])
        tilt = rng.normal(0, 0.4, 2) * _TILT_DEG if kind == "tilted" else rng.normal(0, 0.02, 2)
        tilt = np.clip(tilt, -_TILT_DEG, _TILT_DEG)
        leaned = Rotation.from_euler("zyx", [rng.uniform(0, 360), *tilt], degrees=True).as_matrix()
        upright = Pose.looking_at((0, 0, 0), (1, 0, 0))
        true = Pose.from_parts(leaned @ upright.rotation, place)
        scan = scan_scene(built, true, _PANORAMA, noise=_NOISE, rng=rng, truth=False, caster=caster)
        about = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
        stated = Pose.from_parts(about @ upright.rotation, rng.uniform(-_OFF_M, _OFF_M, 3))
        scans.append(scan.with_facts(world_from_sensor=stated, name=f"{seed}-{number}"))
        poses.append(true)
    return _Set(kind, scans, poses)


def _place(seed: int) -> _Result:
    """Place a set on the design, which knows no furniture."""
    kind, scans, truth = _set(seed)
    design = _house().without(("IfcFurnishingElement*",)).element_mesh
    started = time.process_time()
    try:
        found = place_on_design(design, scans, n_threads=1)
    except InputError as refusal:
        return _Result(kind, len(scans), 0, 0.0, 0.0, 0.0, 0.0, time.process_time() - started, str(refusal))
    spent = time.process_time() - started
    off_m, off_deg, placed = 0.0, 0.0, 0
    for pose, true in zip(found.poses, truth, strict=True):
        if pose is not None:
            apart = pose.inverse() @ true
            placed += 1
            off_m = max(off_m, float(np.linalg.norm(apart.translation)))
            off_deg = max(off_deg, float(np.degrees(Rotation.from_matrix(apart.rotation).magnitude())))
    said = " ".join(found.sentences)
    return _Result(kind, len(scans), placed, off_m, off_deg, found.agreeing, found.through, spent, said)


@suite("placement", smallest="--sets 1")
def placement(first: int = 200, sets: int = 20, listed: bool = False) -> Iterator[str]:
    """Unregistered scans of three furnished rooms of a duplex house against its design, without furniture."""
    yield from head("set", "kind", "scans", "placed", "off, mm", "off, deg", "agree", "through", "CPU s", "")
    results = each(_place, range(first, first + sets))
    tally = dict.fromkeys(("right", "part", "refused", "wrong"), 0)
    for seed, one in zip(range(first, first + sets), results, strict=True):
        is_wrong = one.off_m > _RIGHT_M or one.off_deg > _RIGHT_DEG
        word = "refused" if not one.placed else "right" if one.placed == one.scans else "part"
        word = "wrong" if is_wrong else word
        tally[word] += 1
        yield row(
            seed, one.kind, one.scans, one.placed, f"{1000 * one.off_m:.1f}", f"{one.off_deg:.3f}",
            f"{one.agreeing:.2f}", f"{one.through:.3f}", f"{one.cpu_s:.0f}", word,
        )  # fmt: skip
        if listed:
            yield f"    {one.said}"
    yield ", ".join(f"{number} {word}" for word, number in tally.items())
