# SPDX-License-Identifier: MIT
"""A building scanned from a station in each of its largest rooms: true relations found, and false ones."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmarks.completion.relations.sensors import SENSORS
from completion import CompletionOptions, complete
from completion.relations.surfaces import FoundRelations
from completion.result.completed_model import CompletedModel
from nbv.scanning.effects.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor, Sensor, SphericalSensor
from nbv.visibility.standing.site import find_site
from nbv.visibility.standing.site_options import SiteOptions
from scenes import RayCaster
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane, Surface
from scenes.world.scene import Scene

DATA = Path(os.environ.get("UNSEEN_DATA", "../shared/data"))
_PANORAMA = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=1080, height=360,
    name="panorama", max_range_m=12.0,
)  # fmt: skip
_CAMERA = PinholeSensor(fov_deg=90.0, width=640, height=480, max_range_m=8.0, name="camera")
_HEIGHT_M = 1.6
_REACH_M = 0.15  # around a measured point, within which its true face is looked for
_N_SAMPLE = 300
_N_TRIED = 40  # of them, whose plane may be the one of most
_PURE = 0.8  # of a surface's points that must lie on one true plane
_SAME_ANGLE, _SAME_M = np.radians(0.05), 1e-3


def building_table(n_stations: int, sensors: Sequence[int] = tuple(range(len(SENSORS)))) -> Iterator[str]:
    """Yield the lines of a table: true pairs that hold and false ones, errors of planes.

    A line for each of `sensors`, by their places in `SENSORS`.
    """
    scene = open_scene(DATA / "buildings/duplex.glb", up="y").without(("*Door*",))
    places = station_places(scene, n_stations)
    truth = _Truth.of(scene)
    yield (
        "| sensor | scans | planes | mixed | parallel | right angles | in one plane | false "
        "| angle off, deg, alone | related | place off, mm, alone | related |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for number in sensors:
        sensor = SENSORS[number]
        scans = [
            sensor.applied(scan, 1000 * number + k)
            for k, scan in enumerate(_scans(truth, places, is_camera=sensor.is_camera))
        ]
        done = complete(scans, CompletionOptions(texture=False), rng=0)
        assert done.relations is not None
        score = _scored(done, done.relations, truth)
        yield f"| {sensor.name} | {len(scans)} | {score} |"


def station_places(scene: Scene, n: int) -> FloatArray:
    """Places (n, 3) to stand in the middle of the rooms with most of them, metres."""
    site = find_site(scene, SiteOptions(heights_m=(_HEIGHT_M,)), turns=True)
    largest = [room for room, _ in Counter(site.position_room.tolist()).most_common(n)]
    middles = []
    for room in largest:
        own = site.positions[site.position_room == room]
        middles.append(own[np.argmin(np.linalg.norm(own - np.median(own, axis=0), axis=1))])
    return np.array(middles)


def _scans(truth: _Truth, places: FloatArray, *, is_camera: bool) -> Iterator[RangeImage]:
    """A panorama at each place, or four images of a camera, without errors."""
    sensor: Sensor = _CAMERA if is_camera else _PANORAMA
    for place in places:
        for turn in np.radians((20.0, 110.0, 200.0, 290.0)) if is_camera else (0.3,):
            pose = Pose.looking_at(place, place + np.array([np.cos(turn), np.sin(turn), -0.1 * is_camera]))
            yield scan_scene(truth.scene, pose, sensor, effects=Effects(), truth=False, caster=truth.caster)


@dataclass(frozen=True)
class _Score:
    """What became of true pairs and false ones, and how far planes are off."""

    n_planes: int
    n_mixed: int
    held: dict[str, tuple[int, int]]  # of each kind how many true pairs hold, of how many
    n_false: int
    angle_deg: tuple[float, float]
    place_mm: tuple[float, float]

    def __str__(self) -> str:
        kinds = " | ".join(f"{some} of {every}" for some, every in self.held.values())
        angle, place = (f"{one:.3f} | {other:.3f}" for one, other in (self.angle_deg, self.place_mm))
        return f"{self.n_planes} | {self.n_mixed} | {kinds} | {self.n_false} | {angle} | {place}"


def _scored(done: CompletedModel, found: FoundRelations, truth: _Truth) -> _Score:
    """Compare the relations with those of the true planes that the surfaces were measured on."""
    true, n_planes, samples = dict[int, Plane](), 0, dict[int, FloatArray]()
    for k, number in enumerate(found.numbers):
        fitted = found.before[k].surface
        if not isinstance(fitted, Plane) or not number:
            continue
        n_planes += 1
        samples[k] = done.patches[number - 1].source.points(done.observations, _N_SAMPLE)
        plane = truth.plane(samples[k], fitted, done.world_from_reference)
        if plane is not None:
            true[k] = plane
    n = len(found.numbers)
    turned, one_plane = _joined(found, n, ("parallel", "coplanar")), _joined(found, n, ("coplanar",))
    square = {
        frozenset(int(turned[number]) for number in one.surfaces)
        for one in found.graph.relations
        if one.kind == "perpendicular" and one.holds
    }
    held = {"parallel": [0, 0], "perpendicular": [0, 0], "coplanar": [0, 0]}
    n_false = 0
    for one, two in combinations(sorted(true), 2):
        angle = _between(true[one], true[two])
        says_parallel = turned[one] == turned[two]
        says_right = frozenset((int(turned[one]), int(turned[two]))) in square
        is_parallel, is_right = angle < _SAME_ANGLE, abs(angle - np.pi / 2) < _SAME_ANGLE
        apart = abs(float(true[one].distance(true[two].point[None])[0]))
        is_one, says_one = is_parallel and apart < _SAME_M, one_plane[one] == one_plane[two]
        for name, is_so, says in (
            ("parallel", is_parallel, says_parallel),
            ("perpendicular", is_right, says_right),
            ("coplanar", is_one, says_one),
        ):
            held[name][1] += is_so
            held[name][0] += is_so and says
            n_false += says and not is_so
    angles, places = [], []
    for fits in (found.before, found.graph.fits):
        surfaces = [(fits[k].surface, plane, samples[k]) for k, plane in true.items()]
        angles.append([_between(surface, plane) for surface, plane, _ in surfaces])
        places.append([_off(surface, plane, at) for surface, plane, at in surfaces])
    return _Score(
        n_planes=n_planes,
        n_mixed=n_planes - len(true),
        held={name: (some, every) for name, (some, every) in held.items()},
        n_false=n_false,
        angle_deg=(float(np.degrees(np.median(angles[0]))), float(np.degrees(np.median(angles[1])))),
        place_mm=(1e3 * float(np.median(places[0])), 1e3 * float(np.median(places[1]))),
    )


@dataclass(frozen=True, eq=False)
class _Truth:
    """A mesh and its ray caster."""

    scene: Scene
    caster: RayCaster

    @classmethod
    def of(cls, scene: Scene) -> _Truth:
        return cls(scene, RayCaster(scene.mesh.vertices, scene.mesh.faces))

    def plane(self, points: FloatArray, fitted: Plane, world: Pose) -> Plane | None:
        """The plane, working frame, that most points (n, 3) were measured on; None for a mixture."""
        places, normal = world.apply(points), world.rotate(fitted.normal_direction[None])[0]
        faces, off = [], []
        for side in (1.0, -1.0):
            ways = np.repeat(-side * normal[None], len(places), axis=0)
            hits = self.caster.first_hit(places - _REACH_M * ways, ways)
            faces.append(hits.face)
            off.append(np.abs(hits.ranges - _REACH_M))
        nearer = np.argmin(off, axis=0)
        face = np.array(faces)[nearer, np.arange(len(places))]
        face = face[np.min(off, axis=0) < _REACH_M]
        corners = self.scene.mesh.vertices[self.scene.mesh.faces[face]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        unit = across / np.linalg.norm(across, axis=1, keepdims=True)
        unit *= np.where(unit @ normal < 0, -1.0, 1.0)[:, None]
        told = np.column_stack([unit / _SAME_ANGLE, np.einsum("ij,ij->i", unit, corners[:, 0]) / _SAME_M])
        for one in range(min(len(told), _N_TRIED)):
            alike = np.abs(told - told[one]).max(axis=1) < 1.0
            if np.count_nonzero(alike) >= _PURE * len(points):
                return Plane(corners[one, 0], unit[one]).transformed(world.inverse())
        return None


def _off(surface: Surface, plane: Plane, points: FloatArray) -> float:
    """How far a surface is off the true plane in the mean, where points (n, 3) were measured, metres."""
    at = points - plane.distance(points)[:, None] * plane.normal_direction
    return float(np.abs(surface.distance(at)).mean())


def _joined(found: FoundRelations, n: int, kinds: tuple[str, ...]) -> NDArray[np.int32]:
    """The groups (n,) into which relations of some kinds that hold join the surfaces."""
    pairs = np.array(
        [one.surfaces for one in found.graph.relations if one.kind in kinds and one.holds], dtype=np.int64
    ).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])


def _between(one: Surface, two: Plane) -> float:
    """Angle between the normals of two planes without their signs, radians."""
    assert isinstance(one, Plane)
    across = np.cross(one.normal_direction, two.normal_direction)
    return float(np.arctan2(np.linalg.norm(across), abs(one.normal_direction @ two.normal_direction)))
