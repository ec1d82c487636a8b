# SPDX-License-Identifier: MIT
"""A duplex house: areas, thicknesses, openings, volumes and relations against its own elements."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from benchmarks.cases.buildings import LEAVES, STEP_M, Side, TrueBuilding, station_places
from benchmarks.cases.frames import DATA
from benchmarks.run import head, suite
from completion import CompletionOptions, complete
from completion.export.building.bodies import Body
from completion.export.building.faces import PlaneFace
from completion.export.building.parts import BuildingParts
from completion.export.building.rooms import BuildingRoom
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_NEAR_M = 0.02  # between a true side and a face that is its model
_SEEN_M = 0.06  # between a place and the nearest measured point, where it counts as seen
_WALL_HIGH_M, _LEAST_SEEN = 2.0, 0.1  # of walls whose thickness could be told
_PLAN_M, _PLAN_ABOVE_M = 0.02, 2.54  # step of the plan of rooms; its height above floors, above windows
HOLE_M, _AROUND_M, _THROUGH_M, _BESIDE_M = 0.01, 0.1, 0.45, 0.1
_ANOTHER_M = 0.3  # from the plan up to what is no ceiling of the storey
_ROOFED = 0.5  # share of a room that has a ceiling
_LEAST_HOLE_M2, _LEAST_ROOM_M2 = 0.3, 1.0
_SAMPLES = 400


@dataclass(frozen=True, slots=True)
class Pair:
    """A quantity: what it is of, what is true, what the model says (0 for nothing), and how much was seen."""

    kind: str
    true: float
    said: float
    seen: float = 1.0

    @property
    def error(self) -> float:
        """Relative."""
        return abs(self.said - self.true) / self.true

    @property
    def is_right(self) -> bool:
        """Whether it is within 5 %."""
        return self.error <= 0.05


def areas(sides: Sequence[Side], parts: BuildingParts, measured: FloatArray) -> Iterator[Pair]:
    """Areas of true sides; the model's are those of its faces in the same plane within their rectangle."""
    tree = cKDTree(measured)
    for side in sides:
        covered = np.zeros(len(side.places), dtype=np.bool_)
        for face in parts.faces:
            covered |= _is_on(face, side)
        said = float(covered.sum()) * STEP_M**2
        yield Pair("wall", side.area_m2, said, _seen(tree, side))


def _seen(tree: cKDTree, side: Side) -> float:
    """Share of what rooms show of a side that has a measured point near it."""
    near, _ = tree.query(side.places[side.is_shown], distance_upper_bound=_SEEN_M)
    return float(np.isfinite(near).mean())


def _is_on(face: PlaneFace, side: Side) -> np.ndarray:
    """Which places of a side a face covers."""
    if face.frame.normal @ side.normal < np.cos(np.radians(2.0)):
        return np.zeros(len(side.places), dtype=np.bool_)
    near = np.abs(face.frame.height(side.places)) < _NEAR_M
    found = np.zeros(len(side.places), dtype=np.bool_)
    if near.any():
        found[near] = shapely.contains_xy(face.area, face.frame.flat(side.places[near]))
    return found


def thicknesses(truth: TrueBuilding, bodies: Sequence[Body], rng: np.random.Generator) -> Iterator[Pair]:
    """Thicknesses of bodies; true is how far the first elements from both sides are apart (median)."""
    for body in bodies:
        low, high = np.reshape(body.area.bounds, (2, 2))
        uv = rng.uniform(low, high, (20 * _SAMPLES, 2))
        uv = uv[shapely.contains_xy(body.area, uv)][:_SAMPLES]
        off = 0.03
        fronts, backs = (body.frame.place(uv, w) for w in (off, -body.thickness_m - off))
        ways = np.tile(body.frame.normal, (len(uv), 1))
        there, back = truth.shell.first_hit(fronts, -ways), truth.shell.first_hit(backs, ways)
        known = there.hit & back.hit
        true = body.thickness_m + 2 * off - there.ranges[known] - back.ranges[known]
        yield Pair(body.kind, float(np.median(true)) if known.any() else np.inf, body.thickness_m)


def walls(
    truth: TrueBuilding, sides: Sequence[Side], parts: BuildingParts, measured: FloatArray
) -> Iterator[Pair]:
    """True walls of which both sides were seen, with the thickness that is said of most of them."""
    tree = cKDTree(measured)
    for number in sorted({side.element for side in sides}):
        own = [side for side in sides if side.element == number]
        box = truth.box(number)
        if len(own) < 2 or box[1, 2] - box[0, 2] < _WALL_HIGH_M:
            continue
        seen = [_seen(tree, one) for one in own]
        said, best = 0.0, 0
        for body in (one for one in parts.bodies if one.kind == "wall"):
            inside = sum(int(_is_in(body, side).sum()) for side in own)
            if inside > best:
                said, best = body.thickness_m, inside
        if min(seen) >= _LEAST_SEEN:
            yield Pair("wall", float(np.ptp(box, axis=0)[:2].min()), said, min(seen))


def _is_in(body: Body, side: Side) -> np.ndarray:
    """Which places that a side shows lie on either face of a body."""
    places = side.places[side.is_shown]
    depth = -body.frame.height(places)
    near = (np.abs(depth) < _NEAR_M) | (np.abs(depth - body.thickness_m) < _NEAR_M)
    return np.asarray(near & shapely.contains_xy(body.area, body.frame.flat(places)))


def openings(truth: TrueBuilding, parts: BuildingParts) -> Iterator[Pair]:
    """Holes that doors and windows leave in walls; the model's area is the median of those that are there.

    Doors and windows that touch leave one hole.
    """
    for axis, box in leaf_groups(truth):
        area = len(hole_places(truth, box, axis)) * HOLE_M**2
        if area < _LEAST_HOLE_M2:
            continue
        other, said = 1 - axis, []
        for one in (opening for face in parts.faces for opening in face.openings):
            middle = one.points.mean(axis=0)
            is_flat = np.ptp(one.points[:, axis]) < 0.05 and abs(middle - box.mean(axis=0))[axis] < _THROUGH_M
            if is_flat and (np.abs(middle - box.mean(axis=0))[[other, 2]] < 0.3).all():
                said.append(float(shapely.Polygon(one.points[:, [other, 2]]).area))
        kind = "inner" if has_rooms_on_both_sides(truth, box, axis) else "outer"
        yield Pair(kind, area, float(np.median(said)) if said else 0.0)


def has_rooms_on_both_sides(truth: TrueBuilding, box: FloatArray, axis: int) -> bool:
    """Whether there are walls all around both places before a hole."""
    places = np.tile(box.mean(axis=0), (2, 1)) + np.outer([-0.6, 0.6], np.eye(3)[axis])
    ways = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    hits = truth.closed.first_hit(np.repeat(places, len(ways), axis=0), np.tile(ways, (2, 1)))
    return bool(hits.hit.all())


def leaf_groups(truth: TrueBuilding) -> list[tuple[int, FloatArray]]:
    """Boxes (2, 3) around doors and windows that touch, with the axis across their wall; no skylights."""
    found: list[tuple[int, FloatArray]] = []
    for number, name in enumerate(truth.classes):
        if not name.startswith(LEAVES) or not (truth.element == number).any():
            continue
        box = truth.box(number)
        axis = int(np.argmin(np.ptp(box, axis=0)))
        if axis == 2:
            continue
        beside = [
            k
            for k, (along, other) in enumerate(found)
            if along == axis
            and (box[0] - _BESIDE_M < other[1]).all()
            and (other[0] - _BESIDE_M < box[1]).all()
        ]
        boxes = [box, *(found[k][1] for k in beside)]
        found = [one for k, one in enumerate(found) if k not in beside]
        found.append((axis, np.stack([np.min(boxes, axis=(0, 1)), np.max(boxes, axis=(0, 1))])))
    return found


def hole_places(truth: TrueBuilding, box: FloatArray, axis: int) -> FloatArray:
    """Places (n, 3), one for each square of a grid, where beams get through along an axis, around a box."""
    other, middle = 1 - axis, box.mean(axis=0)
    steps = [np.arange(box[0, k] - _AROUND_M, box[1, k] + _AROUND_M, HOLE_M) for k in (other, 2)]
    places = np.empty((len(steps[0]) * len(steps[1]), 3))
    places[:, [other, 2]] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    places[:, axis] = middle[axis]
    free = np.ones(len(places), dtype=np.bool_)
    for sign in (-1.0, 1.0):
        hits = truth.shell.first_hit(places, np.tile(sign * np.eye(3)[axis], (len(places), 1)))
        free &= ~hits.hit | (hits.ranges > _THROUGH_M)
    up = truth.shell.first_hit(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)))
    is_slab = np.array([one == "IfcSlab" for one in truth.classes])[truth.shell_element[up.face]]
    free &= ~(up.hit & (up.ranges < 0.15) & is_slab)  # within the slab, below the door
    return places[free]


def rooms(truth: TrueBuilding, parts: BuildingParts) -> Iterator[tuple[Pair, Pair]]:
    """Floor areas and volumes of true rooms: what is connected in the plan above doors and windows.

    Heights are those of rays up and down. A stairwell belongs to each storey between its floor and its
    ceiling, and what is below a skylight ends at the ceiling.
    """
    low, high = truth.vertices.min(axis=0), truth.vertices.max(axis=0)
    steps = [np.arange(low[k], high[k], _PLAN_M) for k in (0, 1)]
    for k, storey in enumerate(parts.storeys):
        places = np.empty((len(steps[0]), len(steps[1]), 3))
        places[:, :, :2] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
        places[:, :, 2] = storey.elevation_m + _PLAN_ABOVE_M
        label = _connected(truth, places)
        flat = places.reshape(-1, 3)
        up, down = (
            truth.shell.first_hit(flat, np.tile([0.0, 0.0, sign], (len(flat), 1))) for sign in (1.0, -1.0)
        )
        above = (storey.ceiling_m if storey.ceiling_m is not None else np.inf) - flat[:, 2]
        rise = np.where(up.hit & (up.ranges < _ANOTHER_M), up.ranges, above)
        height = rise + np.minimum(down.ranges, _PLAN_ABOVE_M)
        roofed = (
            np.array([one == "IfcCovering" for one in truth.classes])[truth.shell_element[up.face]] & up.hit
        )
        for one in np.flatnonzero(np.bincount(label) * _PLAN_M**2 >= _LEAST_ROOM_M2).tolist():
            own = label == one
            area = float(own.sum()) * _PLAN_M**2
            if roofed[own].mean() < _ROOFED:
                continue
            said = _said_of(parts, k, flat[own])
            area_said, volume_said = (said.area_m2, said.volume_m3 or 0.0) if said else (0.0, 0.0)
            volume = float(height[own].sum()) * _PLAN_M**2
            yield Pair("floor", area, area_said), Pair("room", volume, volume_said)


def _connected(truth: TrueBuilding, places: FloatArray) -> NDArray[np.int32]:
    """Numbers (n,) of the parts of a plan (rows, columns, 3) between whose cells no wall lies, from 0."""
    index = np.arange(places.shape[0] * places.shape[1]).reshape(places.shape[:2])
    links = []
    for axis, (near, far) in enumerate(((index[:-1], index[1:]), (index[:, :-1], index[:, 1:]))):
        starts = places.reshape(-1, 3)[near.ravel()]
        hits = truth.closed.first_hit(starts, np.tile(np.eye(3)[axis], (len(starts), 1)))
        free = ~(hits.hit & (hits.ranges < _PLAN_M))
        links.append(np.column_stack([near.ravel()[free], far.ravel()[free]]))
    pairs = np.concatenate(links)
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(index.size,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1])


def _said_of(parts: BuildingParts, storey: int, places: FloatArray) -> BuildingRoom | None:
    """The model's closed room that most of some places lie in; None of none."""
    best, said = len(places) // 2, None
    for room in parts.rooms:
        if room.storey == storey and room.closed:
            inside = int(shapely.contains_xy(room.outline, places[:, :2]).sum())
            if inside > best:
                best, said = inside, room
    return said


_PANORAMA = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=1080, height=360,
    name="panorama", max_range_m=12.0,
)  # fmt: skip
_CAMERA = PinholeSensor(fov_deg=90.0, width=640, height=480, max_range_m=8.0, name="camera")
_SEEN = 0.5


@suite("quantities", smallest="--stations 2")
def quantities(
    stations: int = 14,
    noise: str = "gaussian-2mm",
    sensor: str = "panorama",
    listed: bool = False,
) -> Iterator[str]:
    """Areas, thicknesses, openings and volumes of a duplex house against its own elements."""
    truth = TrueBuilding.read(DATA / "buildings/duplex.npz")
    start = time.process_time()
    scans = list(house_scans(stations, noise, sensor))
    done = complete(scans, CompletionOptions(texture=False), rng=0)
    parts = done.building()
    yield f"{len(scans)} scans, {len(parts.faces)} planes, {time.process_time() - start:.0f} s of processors"
    measured = np.concatenate([scan.points()[scan.valid][::4] for scan in scans])
    yield from head("", "within 5 %", "of", "told", "off, median", "90 %")
    for name, pairs in _groups(truth, parts, measured):
        yield _row(name, pairs)
        for pair in pairs if listed else ():
            yield f"    {pair.kind}: {pair.said:.4f} of {pair.true:.4f}, seen {pair.seen:.2f}"


def _groups(
    truth: TrueBuilding, parts: BuildingParts, measured: FloatArray
) -> Iterator[tuple[str, list[Pair]]]:
    sides = list(truth.sides())
    found = list(areas(sides, parts, measured))
    yield "sides of walls, at least half seen, area", [pair for pair in found if pair.seen >= _SEEN]
    yield "sides of walls, less seen, area", [pair for pair in found if 0 < pair.seen < _SEEN]
    holes = list(openings(truth, parts))
    yield "openings between rooms, area", [pair for pair in holes if pair.kind == "inner"]
    yield "openings to the outside, area", [pair for pair in holes if pair.kind == "outer"]
    yield "walls seen from both sides, thickness", list(walls(truth, sides, parts, measured))
    told = list(thicknesses(truth, parts.bodies, np.random.default_rng(0)))
    yield "thicknesses told, of walls", [pair for pair in told if pair.kind == "wall"]
    yield "thicknesses told, of slabs", [pair for pair in told if pair.kind == "slab"]
    levels, volumes = zip(*rooms(truth, parts), strict=True)
    yield "rooms, floor area", list(levels)
    yield "rooms, volume", list(volumes)


def _row(name: str, pairs: Sequence[Pair]) -> str:
    found = [pair for pair in pairs if pair.said > 0]
    errors = np.array([pair.error for pair in found])
    told = " | ".join(f"{100 * np.quantile(errors, q):.2f} %" if len(errors) else "-" for q in (0.5, 0.9))
    return f"| {name} | {sum(pair.is_right for pair in pairs)} | {len(pairs)} | {len(found)} | {told} |"


def house_scans(n: int, noise: str, sensor: str) -> Iterator[RangeImage]:
    """Scans from the middle of rooms: a panorama in each, or eight frames of a camera."""
    scene = open_scene(DATA / "buildings/duplex.glb", up="y").without(("*Door*", "*Window*"))
    caster = scene.ray_caster()
    for k, place in enumerate(station_places(scene, n)):
        turns = (0.3,) if sensor == "panorama" else np.radians(20.0 + 45.0 * np.arange(8))
        for j, turn in enumerate(turns):
            down = 0.0 if sensor == "panorama" else (-0.35, 0.25)[j % 2]
            pose = Pose.looking_at(place, place + np.array([np.cos(turn), np.sin(turn), down]))
            chosen = _PANORAMA if sensor == "panorama" else _CAMERA
            yield scan_scene(scene, pose, chosen, noise=noise, rng=100 * k + j, truth=False, caster=caster)
