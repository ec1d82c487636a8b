# SPDX-License-Identifier: MIT
"""As-built states: a building with planted deviations, and the true deviation of each of its faces."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from benchmarks.cases.buildings import station_places
from benchmarks.cases.frames import DATA
from benchmarks.cases.houses.solids import box, tube
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.winding import turn_outside_out
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

MOVES_M = (0.003, 0.005, 0.01, 0.02, 0.05)
_GAP_M, _DEEP_M, _BESIDE_M = 0.06, 0.4, 0.15  # of boxes that hide: before the element, deep, beyond its edge
_LEAST_SEEN_M2 = 0.5  # of a main face, or the state tests nothing
_LARGEST_HIDDEN_M = 3.2
_CLEAR_M = 0.35  # around stations
_PIECE_M = 0.2  # of a wall that is bent
_COARSE = SphericalSensor(
    azimuth_span_deg=360.0, elevation_min_deg=-60.0, elevation_max_deg=85.0, width=240, height=97
)


@dataclass(frozen=True, slots=True, eq=False)
class MainFace:
    """A plane of an element that is at least half as large as its largest.

    `faces` are its triangles; `centre` (3,) the middle of their box, `normal` (3,) outward.
    """

    element: int
    centre: FloatArray
    normal: FloatArray
    area_m2: float
    faces: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Building:
    """A design, what stands in the building beside it (m, 3, 3), and where scanners stand (s, 3); metres."""

    name: str
    design: ElementMesh
    furniture: tuple[FloatArray, ...]
    stations: FloatArray

    @cached_property
    def main_faces(self) -> list[MainFace]:
        """Main faces of all elements, largest first in each; glass is none."""
        mesh = self.design.mesh
        known = mesh.corners, mesh.face_normals(), mesh.face_areas()
        owned = np.argsort(mesh.face_surface, kind="stable")
        owned = owned[~_is_glass(mesh)[owned]]
        starts = np.searchsorted(mesh.face_surface[owned], np.arange(len(self.design.elements) + 1))
        return [
            one
            for k in range(len(self.design.elements))
            for one in _planes(k, owned[starts[k] : starts[k + 1]], *known)
        ]

    @cached_property
    def furnished(self) -> Scene:
        """The building as designed, with what stands in it."""
        return _built(self.design, {}, list(self.furniture))[0]

    @cached_property
    def seen(self) -> list[MainFace]:
        """Upright main faces across their element of which stations see half a square metre, coarsely."""
        number = np.full(len(self.design.mesh.faces) + 1, -1)
        for k, face in enumerate(self.main_faces):
            number[face.faces] = k
        source = _built(self.design, {}, list(self.furniture))[1]
        area = np.zeros(len(self.main_faces))
        for eye in self.stations:
            scan = scan_scene(self.furnished, Pose.looking_at(eye, eye + [1.0, 0.0, 0.0]), _COARSE)
            assert scan.truth is not None
            met = np.where(scan.truth.face >= 0, number[source[scan.truth.face]], -1)
            area += np.bincount(met[met >= 0], pixel_areas(scan)[met >= 0], len(area))
        return [
            face
            for face, own in zip(self.main_faces, area, strict=True)
            if own >= _LEAST_SEEN_M2 and self._is_across(face)
        ]

    def _is_across(self, face: MainFace) -> bool:
        """Tell whether a face is upright and its normal along the lesser of the level extents."""
        mesh = self.design.mesh
        places = mesh.corners[mesh.face_surface == face.element].reshape(-1, 3)
        thick, wide = (np.ptp(places @ way) for way in (face.normal, np.cross([0, 0, 1.0], face.normal)))
        return bool(abs(face.normal[2]) < 0.1 and thick < wide)


@cache
def duplex() -> Building:
    """Return the duplex house without its foundations: 147 elements, furnished, 14 stations."""
    held = np.load(DATA / "buildings/duplex.npz")
    told = [Element(name, ifc_class) for ifc_class, name in json.loads(str(held["elements"]))]
    kept = [k for k, one in enumerate(told) if one.ifc_class not in ("IfcFurnishingElement", "IfcFooting")]
    mesh = LabelledMesh(held["vertices"].astype(float), held["faces"], held["element"].astype(np.int32))
    number = np.full(len(told), -1, np.int32)
    number[kept] = np.arange(len(kept))
    own = mesh.some(number[mesh.face_surface] >= 0)
    own = LabelledMesh(own.vertices, own.faces, number[own.face_surface])
    design = ElementMesh(turn_outside_out(own, own.face_surface).mesh, tuple(told[k] for k in kept), "duplex")
    furniture = tuple(
        mesh.corners[mesh.face_surface == k]
        for k, one in enumerate(told)
        if one.ifc_class == "IfcFurnishingElement"
    )
    leaves = [k for k, one in enumerate(told) if one.ifc_class in ("IfcDoor", "IfcWindow")]
    rooms = Scene.from_mesh(mesh.some(~np.isin(mesh.face_surface, leaves)), name="duplex", mode="room")
    return Building("duplex", design, furniture, station_places(rooms, 14))


def pixel_areas(scan: RangeImage) -> FloatArray:
    """Return the true area (rows, columns) that each pixel stands for, square metres; 0 for none."""
    assert scan.truth is not None
    rays, truth = scan.projection.directions(), scan.truth
    if scan.projection.kind == "pinhole":
        solid = scan.projection.pixel_angle**2 * rays[..., 2] ** 3
    else:
        solid = scan.projection.pixel_angle**2 * np.sqrt(1 - rays[..., 1] ** 2)
    met = np.isfinite(truth.ranges) & scan.valid
    cosine = np.maximum(np.cos(np.where(met, truth.incidence, 0.0)), 0.02)
    return np.where(met, np.where(met, truth.ranges, 0.0) ** 2 * solid / cosine, 0.0)


def _planes(
    element: int, left: NDArray[np.int64], corners: FloatArray, normals: FloatArray, areas: FloatArray
) -> Iterator[MainFace]:
    """Yield the main faces of an element of the triangles `left`, largest first."""
    found: list[tuple[float, NDArray[np.int64], FloatArray]] = []
    while len(left) and areas[left].sum() >= 0.5 * max((area for area, *_ in found), default=0.0):
        seed = left[np.argmax(areas[left])]
        if areas[seed] <= 0:
            break
        off = np.abs((corners[left] - corners[seed, 0]) @ normals[seed]).max(axis=1)
        own = (normals[left] @ normals[seed] > np.cos(np.radians(1.0))) & (off < 0.002)
        found.append((float(areas[left[own]].sum()), left[own], normals[seed]))
        left = left[~own]
    found.sort(key=lambda one: -one[0])
    for area, faces, normal in found:
        if area >= 0.5 * found[0][0]:
            places = corners[faces].reshape(-1, 3)
            centre = (places.min(axis=0) + places.max(axis=0)) / 2
            centre += ((places[0] - centre) @ normal) * normal
            yield MainFace(element, centre, normal, area, faces)


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """What was done to an element.

    `kind`: unchanged, moved, tilted, thickness, bowed, displaced, open, removed, hidden, hidden removed.
    `size`: metres along `normal`, or radians for tilted and open. `motion` (4, 4) is that of its body.
    """

    kind: str = "unchanged"
    size: float = 0.0
    motion: FloatArray = field(default_factory=lambda: np.eye(4))
    centre: FloatArray = field(default_factory=lambda: np.zeros(3))
    normal: FloatArray = field(default_factory=lambda: np.zeros(3))
    along: FloatArray = field(default_factory=lambda: np.zeros(3))  # level direction of a bow, 1 at its ends

    @property
    def label(self) -> str:
        """Row of the tables: the kind, of moves with their size."""
        return f"moved {1000 * abs(self.size):.0f} mm" if self.kind == "moved" else self.kind

    @property
    def is_gone(self) -> bool:
        """Whether nothing of it was built."""
        return self.kind in ("removed", "hidden removed")

    def rise_at(self, places: FloatArray) -> FloatArray:
        """How far a bow or thickness moves places (n, 3) of the design along `normal`, metres."""
        if self.kind == "bowed":
            return np.asarray(self.size * (1 - ((places - self.centre) @ self.along) ** 2))
        if self.kind == "thickness":
            return np.where(np.abs((places - self.centre) @ self.normal) < 1e-3, self.size, 0.0)
        return np.zeros(len(places))

    def offset_at(self, place: FloatArray, normal: FloatArray) -> float:
        """Return the true deviation, along `normal`, of the built face from the design's at a place on it."""
        turned = self.motion[:3, :3] @ normal
        there = self.motion[:3, :3] @ place + self.motion[:3, 3]
        rise = float(self.rise_at(place[None])[0] * (self.normal @ normal))
        return float(turned @ (there - place) / (turned @ normal)) + rise

    def build(self, corners: FloatArray) -> FloatArray:
        """Return triangles (m, 3, 3) of the design as they were built."""
        flat = corners.reshape(-1, 3)
        risen = flat + self.rise_at(flat)[:, None] * self.normal
        return np.asarray(risen @ self.motion[:3, :3].T + self.motion[:3, 3]).reshape(corners.shape)


UNCHANGED = Change()


@dataclass(frozen=True, eq=False)
class PlantedState:
    """A design and what was built.

    `built` has the design's elements as surfaces, then one for each extra; `source_face` names the design's
    triangle of each of its own, -1 for extras. `changes` are by element; what is not there is unchanged.
    """

    name: str
    design: ElementMesh
    built: Scene
    source_face: NDArray[np.int64]
    changes: Mapping[int, Change]
    stations: FloatArray
    main_faces: tuple[MainFace, ...]

    def change(self, element: int) -> Change:
        """Return what was done to an element."""
        return self.changes.get(element, UNCHANGED)


def planted_state(building: Building, seed: int) -> PlantedState:
    """Return a building with deviations that `seed` draws among what its stations see.

    Ten walls moved by 3 to 50 mm, two tilted, one of another thickness, one bowed, one displaced by 0.2 to
    0.4 m; one door open; one wall and two doors or windows removed; three elements hidden 60 mm behind boxes,
    one of them removed. Boxes and pipes stand in the rooms besides.
    """
    rng = np.random.default_rng([20280, seed])
    seen = building.seen
    changes: dict[int, Change] = {}
    hiding: list[FloatArray] = []
    for kind, size, classes in _plan(rng):
        for chosen in rng.permutation(len(seen)):
            face = seen[chosen]
            ifc_class = building.design.elements[face.element].ifc_class
            if face.element in changes or not ifc_class.startswith(classes):
                continue
            if kind.startswith("hidden"):
                boxes = _boxes_before(building, [one for one in seen if one.element == face.element])
                if not boxes:
                    continue
                hiding += boxes
            changes[face.element] = _change(building.design.mesh, face, kind, size, rng)
            break
    extras = [*building.furniture, *hiding, *_clutter(building, rng)]
    built, source = _built(building.design, changes, extras)
    return PlantedState(
        f"{building.name} {seed}",
        building.design,
        built,
        source,
        changes,
        building.stations,
        tuple(building.main_faces),
    )


_WALLS, _LEAVES = ("IfcWall",), ("IfcDoor", "IfcWindow")


def _plan(rng: np.random.Generator) -> Iterator[tuple[str, float, tuple[str, ...]]]:
    """Yield kinds, sizes and classes of changes; metres, radians for doors, at the edge for tilts."""

    def either(low: float, high: float) -> float:
        return float(rng.choice([-1.0, 1.0]) * rng.uniform(low, high))

    yield "open", float(np.radians(either(30, 90))), ("IfcDoor",)
    for size in MOVES_M:
        yield from (("moved", either(size, size), _WALLS) for _ in range(2))
    yield from (("tilted", either(0.01, 0.03), _WALLS) for _ in range(2))
    yield "thickness", either(0.015, 0.03), _WALLS
    yield "bowed", either(0.015, 0.03), _WALLS
    yield "displaced", float(rng.uniform(0.2, 0.4)), _WALLS
    yield from (("removed", 0.0, classes) for classes in (_WALLS, _LEAVES, _LEAVES))
    yield from ((kind, 0.0, _WALLS + _LEAVES) for kind in ("hidden", "hidden", "hidden removed"))


def _change(mesh: LabelledMesh, face: MainFace, kind: str, size: float, rng: np.random.Generator) -> Change:
    """Return the change of an element about one of its main faces."""
    normal, motion = face.normal, np.eye(4)
    level = np.cross([0.0, 0.0, 1.0], normal)
    places = mesh.corners[mesh.face_surface == face.element].reshape(-1, 3) - face.centre
    half = np.maximum(np.ptp(places @ level), 1e-9) / 2, np.maximum(np.ptp(places[:, 2]), 1e-9) / 2
    middle = face.centre + (places.min(axis=0) + places.max(axis=0)) / 2
    if kind in ("moved", "displaced"):
        motion[:3, 3] = size * normal
    elif kind == "tilted":
        about, reach = ((level, half[1]), ([0.0, 0.0, 1.0], half[0]))[int(rng.integers(2))]
        size = float(np.arcsin(size / reach))
        motion = _turn(middle, np.asarray(about), size)
    elif kind == "open":
        leaf = mesh.corners[_leaf(mesh, face.element)].reshape(-1, 3)
        side = leaf @ level
        hinge = leaf[np.argmax(side) if rng.random() < 0.5 else np.argmin(side)]
        motion = _turn(hinge, np.array([0.0, 0.0, 1.0]), size)
    centre = face.centre + ((middle - face.centre) @ level) * level
    return Change(kind, size, motion, centre, normal, level / half[0])


def _turn(place: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(angle * axis).as_matrix()
    motion[:3, 3] = place - motion[:3, :3] @ place
    return motion


def _leaf(mesh: LabelledMesh, element: int) -> NDArray[np.int64]:
    """Triangles of the leaf of a door: the connected part with its largest triangle."""
    own = np.flatnonzero(mesh.face_surface == element)
    faces, n = mesh.faces[own], len(mesh.vertices)
    edges = (np.concatenate([faces[:, 0], faces[:, 1]]), np.concatenate([faces[:, 1], faces[:, 2]]))
    part = connected_components(coo_array((np.ones(2 * len(own)), edges), shape=(n, n)), directed=False)[1]
    largest = int(np.argmax(mesh.face_areas()[own]))
    return np.asarray(own[part[faces[:, 0]] == part[faces[largest, 0]]])


def _is_glass(mesh: LabelledMesh) -> BoolArray:
    """Tell which triangles (m,) beams pass."""
    look = mesh.appearance
    if look is None or look.opacity is None:
        return np.zeros(len(mesh.faces), np.bool_)
    return np.asarray(look.opacity < 0.5)


def _built(
    design: ElementMesh, changes: Mapping[int, Change], extras: list[FloatArray]
) -> tuple[Scene, NDArray[np.int64]]:
    """Return the scene that was built, and the design's triangle of each of its own."""
    mesh, n = design.mesh, len(design.elements)
    every, corners, source, is_glass = mesh.corners, [], [], _is_glass(mesh)
    for element in range(n):
        own = np.flatnonzero((mesh.face_surface == element) & ~is_glass)
        change = changes.get(element, UNCHANGED)
        if change.is_gone or not len(own):
            continue
        if change.kind == "open":
            leaf = _leaf(mesh, element)
            own = np.setdiff1d(own, leaf)
            corners.append(change.build(every[leaf]))
            source.append(np.full(len(leaf), -1))
            change = UNCHANGED
        triangles = every[own]
        if change.kind == "bowed":
            vertices, faces, of = trimesh.remesh.subdivide_to_size(
                triangles.reshape(-1, 3), np.arange(3 * len(own)).reshape(-1, 3), _PIECE_M, 12, True
            )
            own, triangles = own[of], vertices[faces]
        corners.append(change.build(triangles))
        source.append(own)
    opened = next((k for k, one in changes.items() if one.kind == "open"), -1)
    surface = np.concatenate([np.where(one >= 0, mesh.face_surface[one], opened) for one in source])
    number = np.concatenate([surface, *(np.full(len(one), n + k) for k, one in enumerate(extras))])
    together = np.concatenate([*corners, *extras])
    labelled = LabelledMesh(
        together.reshape(-1, 3), np.arange(3 * len(together), dtype=np.int32).reshape(-1, 3), number
    )
    names = [f"{k} {one.name}" for k, one in enumerate(design.elements)]
    names += [f"extra {k}" for k in range(len(extras))]
    sources = np.concatenate([*source, np.full(len(together) - len(surface), -1)])
    return Scene(labelled, (None,) * len(names), tuple(names), f"{design.name} as built"), sources


def _boxes_before(building: Building, faces: list[MainFace]) -> list[FloatArray]:
    """Return a box before each side of an element that is seen; none where one is too large or in the way."""
    mesh = building.design.mesh
    boxes = []
    for face in faces:
        places = mesh.corners[mesh.face_surface == face.element].reshape(-1, 3)
        axis, sign = int(np.argmax(np.abs(face.normal))), np.sign(face.normal.sum())
        low, high = places.min(axis=0) - _BESIDE_M, places.max(axis=0) + _BESIDE_M
        if np.ptp(places, axis=0).max() > _LARGEST_HIDDEN_M or abs(face.normal[axis]) < 0.999:
            return []
        front = (places[:, axis] * sign).max() * sign + sign * _GAP_M
        low[axis], high[axis] = sorted([front, front + sign * _DEEP_M])
        away = np.maximum(np.maximum(low - building.stations, building.stations - high), 0)
        if (np.linalg.norm(away, axis=1) < _CLEAR_M).any():
            return []
        boxes.append(box(low, high))
    return boxes


def _clutter(building: Building, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield six boxes on the floors and two upright pipes, each in sight of a station."""
    caster, lower = building.furnished.ray_caster(), np.array([0.0, 0.0, -1.0])
    n_boxes = n_pipes = 0
    while n_boxes < 6 or n_pipes < 2:
        eye = building.stations[rng.integers(len(building.stations))]
        turn, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 2.0)
        at = eye + reach * np.array([np.cos(turn), np.sin(turn), 0.0])
        if caster.are_blocked(eye[None], at[None])[0]:
            continue
        at = at + caster.first_hit(at[None], lower[None]).ranges[0] * lower
        half = rng.uniform(0.15, 0.3, 3)
        if not np.isfinite(at).all():
            continue
        if n_boxes < 6:
            n_boxes += 1
            yield box(at - [*half[:2], 0.0], at + [*half[:2], 2 * half[2]])
        else:
            n_pipes += 1
            yield tube(at, at + [0.0, 0.0, 2.0], float(rng.uniform(0.03, 0.08)), n=30)
