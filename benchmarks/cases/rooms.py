# SPDX-License-Identifier: MIT
"""Rooms by seed, furnished and scanned, some of which break the prior; the built-in office; small clutter."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from benchmarks.metrics.inferred import Hypothesis, continued_surfaces
from benchmarks.metrics.truth import TrueCells, TrueChart, TrueModel, look, true_charts
from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel
from completion.result.record import completion_record
from nbv.scanning.effects import Effects
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor, View
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.atomic import json_text
from scenes.scan.range_image import RangeImage
from scenes.surfaces.surface import Opening
from scenes.world.builtin import PLASTER, Finish, SceneBuilder, brick, builtin_scene, grass, gravel
from scenes.world.scene import Scene

UNSCORED = ("outside",)  # what is seen through openings


@dataclass(frozen=True)
class Case:
    """A scene and the views it is scanned from."""

    name: str  # what to call it
    scene: Scene  # the truth
    views: tuple[View, ...]  # where it is scanned from; all scans are completed together
    # (k, 2, 3) float: Boxes in which the scene breaks the prior that hidden surface goes on
    breaks: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 3)))
    # names of the surfaces that are scored; all but what is seen through openings when not given
    scored: tuple[str, ...] | None = None

    @property
    def breaks_prior(self) -> bool:
        """Whether it is one of the scenes of S7."""
        return len(self.breaks) > 0

    @cached_property
    def model(self) -> TrueModel:
        """The truth as arrays."""
        scene = self.scene
        scored = tuple(
            name not in UNSCORED if self.scored is None else name in self.scored
            for name in scene.surface_names
        )
        return TrueModel(scene.mesh, scene.surfaces, scored, scene.openings, self.breaks)

    @cached_property
    def charts(self) -> tuple[TrueChart, ...]:
        """The charts of the true surfaces."""
        return true_charts(self.model)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of the geometry, the views and what is scored."""
        mesh = self.scene.mesh
        digest = hashlib.sha256(json_text([self.name, self.scene.surface_names, self.scored]).encode())
        for array in (mesh.vertices, mesh.faces, mesh.face_surface, self.breaks):
            digest.update(np.ascontiguousarray(array).tobytes())
        for view in self.views:
            digest.update(view.world_from_sensor.matrix.tobytes() + json_text(view.sensor.to_json()).encode())
        return digest.hexdigest()

    def scans(self, effects: Effects, rng: int) -> tuple[RangeImage, ...]:
        """Scan from all views; `rng` is the seed of the first scan's noise."""
        caster = self.scene.ray_caster()
        return tuple(
            scan_scene(self.scene, view, effects=effects, rng=rng + index, caster=caster, name=self.name)
            for index, view in enumerate(self.views)
        )

    def cells(self, scans: Sequence[RangeImage]) -> tuple[TrueCells, ...]:
        """Return what the scans see and miss of the truth."""
        return look(self.model, self.charts, scans)


def hypothesis_of(completed: CompletedModel, scans: Sequence[RangeImage]) -> Hypothesis:
    """Return what a completion inferred from `scans`, in world coordinates."""
    mesh = completed.hypothesised
    first = mesh.faces[:, 0]
    provenance = mesh.provenance[mesh.faces].max(axis=1, initial=0)
    openings = tuple(
        Opening(number, np.asarray(opening["points"], dtype=np.float64))
        for number, surface in enumerate(completion_record(completed)["surfaces"])
        for opening in surface["openings"]
    )
    return Hypothesis(
        vertices=completed.world_from_reference.apply(mesh.vertices),
        faces=mesh.faces,
        surface=mesh.surface[first] - 1,
        sd=mesh.sd[mesh.faces].max(axis=1, initial=0.0),
        confidence=mesh.confidence[mesh.faces].mean(axis=1),
        true_surface=continued_surfaces(completed.owners, scans, len(completed.patches)),
        openings=openings,
        reason=provenance,
        reasons=tuple(member.name.lower().replace("_", "-") for member in Provenance),
    )


_TRIES = 40
_GAP_M = 0.12
_NEAR_CORNER_M = 1.3  # the corner at the origin is left to the scanner
_WOOD, _STEEL = Finish((0.62, 0.42, 0.24)), Finish((0.55, 0.62, 0.70))


@dataclass(frozen=True, slots=True)
class Footprint:
    """A rectangle of floor that is taken: x and y of its low and high corner, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    def touches(self, other: Footprint, gap: float) -> bool:
        """Tell whether the two are nearer to each other than `gap` along x and along y."""
        return (
            self.x0 < other.x1 + gap
            and other.x0 < self.x1 + gap
            and self.y0 < other.y1 + gap
            and other.y0 < self.y1 + gap
        )


Piece = Callable[[SceneBuilder, str, FloatArray, float, np.random.Generator], None]


def furnish(
    build: SceneBuilder,
    size: FloatArray,
    rng: np.random.Generator,
    taken: list[Footprint],
    *,
    ends_hidden: bool,
) -> list[FloatArray]:
    """Add furniture to the room `size` (x, y, z); `taken` grows by it.

    With `ends_hidden` a column that looks as if it stood on the floor ends behind a box before it.
    Returns list of (2, 3) float: boxes in which what was added breaks the prior.
    """
    breaks = [_ending_column(build, size, rng, taken)] if ends_hidden else []
    pieces: list[tuple[str, Piece, float]] = [("column", _column, rng.uniform(0.24, 0.4))]
    pieces += [(f"box {k}", _box, rng.uniform(0.4, 0.8)) for k in range(int(rng.integers(1, 4)))]
    pieces += [(f"post {k}", _post, rng.uniform(0.08, 0.16)) for k in range(int(rng.integers(0, 3)))]
    pieces += [("table", _table, rng.uniform(0.9, 1.3))] * int(rng.random() < 0.7)
    pieces += [("drum", _drum, rng.uniform(0.4, 0.6))] * int(rng.random() < 0.5)
    for name, piece, width in pieces:
        centre = _free_place(size, width * 0.75, rng, taken)
        if centre is not None:
            piece(build, name, np.array([*centre, size[2]]), width, rng)
    _add_pipes(build, size, rng)
    return breaks


def _free_place(
    size: FloatArray, half: float, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray | None:
    """Find a centre (x, y) with room for `half` to all sides, and take the place; None if there is none."""
    for _ in range(_TRIES):
        centre = rng.uniform([half + 0.1] * 2, size[:2] - half - 0.1)
        place = Footprint(*(centre - half), *(centre + half))
        free = not any(place.touches(other, _GAP_M) for other in taken)
        if free and (centre - half > _NEAR_CORNER_M).any() and np.linalg.norm(centre) > _NEAR_CORNER_M + half:
            taken.append(place)
            return np.asarray(centre, dtype=np.float64)
    return None


def _box(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    half = np.array([width, width * rng.uniform(0.6, 1.0)]) / 2
    colour = Finish(tuple(rng.uniform(0.35, 0.85, 3)))
    low, high = np.array([*(at[:2] - half), 0.0]), np.array([*(at[:2] + half), rng.uniform(0.5, 1.3)])
    build.add_box(name, low, high, colour, yaw=rng.uniform(-0.6, 0.6))


def _post(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    low, high = np.array([*(at[:2] - width / 2), 0.0]), np.array([*(at[:2] + width / 2), 0.0])
    high[2] = at[2] if rng.random() < 0.3 else rng.uniform(1.0, 1.8)
    build.add_box(name, low, high, Finish((0.36, 0.50, 0.72)), yaw=rng.uniform(-0.6, 0.6))


def _column(build: SceneBuilder, name: str, at: FloatArray, width: float, _rng: np.random.Generator) -> None:
    build.add_cylinder(name, (*at[:2], 0.0), (0, 0, at[2]), width / 2, PLASTER, caps=False)


def _drum(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    build.add_cylinder(name, (*at[:2], 0.0), (0, 0, rng.uniform(0.7, 1.2)), width / 2, _STEEL)


def _table(build: SceneBuilder, name: str, at: FloatArray, width: float, rng: np.random.Generator) -> None:
    half, height = np.array([width, width * 0.6]) / 2, rng.uniform(0.68, 0.78)
    build.add_box(
        f"{name} top",
        (*(at[:2] - half), height - 0.04),
        (*(at[:2] + half), height),
        _WOOD,
        yaw=rng.uniform(-0.4, 0.4),
    )
    build.add_cylinder(f"{name} leg", (*at[:2], 0.0), (0, 0, height - 0.04), 0.05, _STEEL, caps=False)


def _add_pipes(build: SceneBuilder, size: FloatArray, rng: np.random.Generator) -> None:
    """Add up to three level pipes along the wall y = far, from wall to wall."""
    if rng.random() < 0.5:
        return
    height = rng.uniform(0.25, 0.5)
    for index in range(int(rng.integers(1, 4))):
        radius = rng.uniform(0.03, 0.08)
        foot = (0.0, size[1] - radius - 0.04, height)
        build.add_cylinder(f"pipe {index + 1}", foot, (size[0], 0, 0), radius, _STEEL, caps=False)
        height += radius + rng.uniform(0.15, 0.3)


def _ending_column(
    build: SceneBuilder, size: FloatArray, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray:
    """Add a pipe that hangs from the ceiling and ends behind a box, clear of the floor."""
    radius, end = rng.uniform(0.1, 0.16), rng.uniform(0.35, 0.6)
    centre = size[:2] * rng.uniform(0.6, 0.72, 2)
    build.add_cylinder("hanging column", (*centre, end), (0, 0, size[2] - end), radius, PLASTER)
    before = centre - 0.5 * centre / np.linalg.norm(centre)
    half = radius + 0.22
    low, high = np.array([*(before - half), 0.0]), np.array([*(before + half), end + 0.45])
    build.add_box("hiding box", low, high, _WOOD, yaw=float(np.arctan2(centre[1], centre[0])))
    taken.append(
        Footprint(*np.minimum(before - 1.3 * half, centre - half), *np.maximum(before + half, centre + half))
    )
    return np.array([[*(centre - radius - 0.02), 0.0], [*(centre + radius + 0.02), end + 0.02]])


CAMERA = PinholeSensor(fov_deg=62.7, width=640, height=480, max_range_m=12.0, name="camera")
PANORAMA = SphericalSensor(
    azimuth_span_deg=180.0, elevation_min_deg=-60.0, elevation_max_deg=60.0, width=720, height=480,
    name="panorama",
)  # fmt: skip
_PANORAMA_SHARE = 0.25
_TWO_VIEWS_SHARE = 0.2


def stations(
    size: FloatArray, taken: Sequence[Footprint], rng: np.random.Generator, breaks: FloatArray
) -> tuple[View, ...]:
    """Return one view, or now and then two, from near the corner at the origin into the room `size`.

    A quarter of them are panoramas of 180 x 120 degrees, the others images of a camera; both level, as a
    tripod is, or looking down somewhat. They turn towards the boxes `breaks` (k, 2, 3), if there are any.
    """
    aims = breaks.mean(axis=1)
    n_views = 1 + int(rng.random() < _TWO_VIEWS_SHARE)
    sensor: Sensor = PANORAMA if rng.random() < _PANORAMA_SHARE else CAMERA
    return tuple(View(_pose(size, taken, rng, sensor, aims), sensor) for _ in range(n_views))


def _pose(
    size: FloatArray, taken: Sequence[Footprint], rng: np.random.Generator, sensor: Sensor, aims: FloatArray
) -> Pose:
    eye = np.zeros(3)
    for _ in range(100):
        eye = np.array([*rng.uniform(0.35, 1.15, 2), rng.uniform(1.25, 1.75)])
        spot = Footprint(*eye[:2], *eye[:2])
        if not any(spot.touches(place, 0.15) for place in taken):
            break
    goal = size * np.array([rng.uniform(0.7, 0.95), rng.uniform(0.6, 0.9), 0.0])
    if len(aims):
        goal = (goal + aims[0]) / 2
    goal[2] = eye[2] if sensor.kind == "spherical" else rng.uniform(0.7, 1.2)
    return Pose.looking_at(eye, goal)


Break = Literal["niche", "step", "hidden door", "ending cylinder"]
BREAKS: tuple[Break, ...] = ("niche", "step", "hidden door", "ending cylinder")
_OUTSIDE_M = 2.0  # how far beyond the wall lies what is seen through its openings


@dataclass(frozen=True, slots=True, eq=False)
class Shell:
    """The room itself: metres along x, y, z, and the wall x = size[0] with holes as (y, z) rectangles."""

    size: FloatArray
    window: tuple[float, float, float, float] | None
    door: tuple[float, float, float, float] | None


def random_case(seed: int, *, breaks: Break | None = None) -> Case:
    """Return the room with this seed.

    Of every ten seeds in a row three break the prior, each in another way in turn: a niche or a step in a
    wall, a door wholly hidden behind a cabinet, or a cylinder that ends behind its occluder.
    `seed`: the same seed gives the same bytes. `breaks`: break the prior in this way, whatever the seed says.
    """
    kind = breaks or break_of(seed)
    rng = np.random.default_rng([20260, seed])
    shell = _shell(rng)
    build = SceneBuilder(f"room_{seed}", "room")
    taken: list[Footprint] = []
    boxes = _build_shell(build, shell, kind, rng, taken)
    boxes += furnish(build, shell.size, rng, taken, ends_hidden=kind == "ending cylinder")
    broken = np.array(boxes).reshape(-1, 2, 3)
    name = f"room {seed}" + (f", {kind}" if kind else "")
    return Case(name, build.finish(), stations(shell.size, taken, rng, broken), broken)


def break_of(seed: int) -> Break | None:
    """Return how the room with this seed breaks the prior: three of any ten seeds in a row do."""
    place = seed % 10
    if place not in (2, 5, 8):
        return None
    return BREAKS[(3 * (seed // 10) + (2, 5, 8).index(place)) % len(BREAKS)]


def _shell(rng: np.random.Generator) -> Shell:
    size = np.array([rng.uniform(3.6, 5.5), rng.uniform(3.4, 5.0), rng.uniform(2.4, 3.0)])
    window = door = None
    if rng.random() < 0.7:
        width, low = rng.uniform(0.7, 1.3), rng.uniform(0.7, 1.0)
        start = rng.uniform(0.25, size[1] / 2 + 0.15 - width)
        window = (start, low, start + width, low + rng.uniform(0.8, 1.2))
    if rng.random() < 0.5:
        start = rng.uniform(size[1] / 2 + 0.3, size[1] - 1.05)
        door = (start, 0.0, start + rng.uniform(0.7, 0.9), rng.uniform(1.95, 2.1))
    return Shell(size, window, door)


def _build_shell(
    build: SceneBuilder, shell: Shell, kind: Break | None, rng: np.random.Generator, taken: list[Footprint]
) -> list[FloatArray]:
    """Add floor, ceiling and walls; return the boxes where they break the prior."""
    x, y, z = np.diag(shell.size)
    paint = brick() if rng.random() < 0.5 else PLASTER
    build.add_rectangle("floor", np.zeros(3), x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_rectangle("wall x=0", np.zeros(3), y, z, PLASTER)
    build.add_rectangle("wall y=0", x, -x, z, paint)
    openings = [hole for hole in (shell.window, shell.door) if hole is not None]
    width = float(shell.size[1])
    from_far_end = [(width - high, low, width - near, top) for near, low, high, top in openings]
    build.add_panel("wall x=far", x + y, u=-y, v=z, finish=paint, holes=from_far_end)
    if openings:
        reach = np.array([_OUTSIDE_M, 0, 0])
        low, high = -3 * y / width, (width + 3) * y / width
        build.add_rectangle("outside", x + reach + high - z, low - high, 3 * z, grass(4.0))
    if kind in ("niche", "hidden door"):
        return [_recess(build, shell, kind, rng, taken)]
    if kind == "step":
        return [_step(build, shell, rng, taken)]
    build.add_rectangle("wall y=far", y, x, z, PLASTER)
    return []


def _recess(
    build: SceneBuilder, shell: Shell, kind: Break, rng: np.random.Generator, taken: list[Footprint]
) -> FloatArray:
    """Build the wall y = far with a niche or a closed-off door, and the cabinet that hides all of it."""
    x, y, z = np.diag(shell.size)
    width = rng.uniform(0.5, 0.8) if kind == "niche" else rng.uniform(0.75, 0.9)
    bottom, top = (rng.uniform(0.3, 0.6), rng.uniform(1.1, 1.4)) if kind == "niche" else (0.0, 2.0)
    depth = rng.uniform(0.12, 0.3) if kind == "niche" else 0.8
    start = rng.uniform(1.6, shell.size[0] - width - 1.0)
    build.add_panel(
        "wall y=far",
        y,
        u=x,
        v=z,
        finish=PLASTER,
        holes=[(start, bottom, start + width, top)],
        are_openings=False,
    )
    low = np.array([start, shell.size[1], bottom])
    high = np.array([start + width, shell.size[1] + depth, top])
    across, deep, up = np.diag(high - low)
    name, finish = kind, Finish((0.66, 0.60, 0.55))
    build.add_rectangle(f"{name} back", low + deep, across, up, finish)
    build.add_rectangle(f"{name} bottom", low, across, deep, finish)
    build.add_rectangle(f"{name} top", low + up + deep, across, -deep, finish)
    build.add_rectangle(f"{name} west", low, deep, up, finish)
    build.add_rectangle(f"{name} east", low + across + deep, -deep, up, finish)
    gap = rng.uniform(0.05, 0.2)
    front = np.array([start - 0.25, shell.size[1] - gap - 0.45, 0.0])
    back = np.array([start + width + 0.25, shell.size[1] - gap, top + 0.12])
    build.add_box("cabinet", front, back, Finish((0.72, 0.58, 0.40)))
    taken.append(Footprint(*front[:2], *back[:2]))
    margin = 0.02
    return np.stack([low - margin, high + margin])


def _step(build: SceneBuilder, shell: Shell, rng: np.random.Generator, taken: list[Footprint]) -> FloatArray:
    """Build the wall y = far in two halves, one farther away, and the screen that hides the step."""
    width, length, height = (float(value) for value in shell.size)
    at, depth = rng.uniform(1.8, width - 1.4), rng.uniform(0.06, 0.2)
    up = np.array([0, 0, height])
    build.add_rectangle("wall y=far", (0, length, 0), (at, 0, 0), up, PLASTER)
    build.add_rectangle("wall y=farther", (at, length + depth, 0), (width - at, 0, 0), up, PLASTER)
    build.add_rectangle("step", (at, length, 0), (0, depth, 0), up, PLASTER)
    build.add_rectangle("step floor", (at, length, 0), (width - at, 0, 0), (0, depth, 0), gravel())
    build.add_rectangle(
        "step ceiling", (at, length + depth, height), (width - at, 0, 0), (0, -depth, 0), PLASTER
    )
    build.add_rectangle("step end", (width, length + depth, 0), (0, -depth, 0), up, PLASTER)
    low, high = np.array([at - 0.3, length - 0.4, 0.0]), np.array([at + 0.3, length - 0.1, height - 0.05])
    build.add_box("screen", low, high, Finish((0.45, 0.52, 0.58)))
    taken.append(Footprint(*low[:2], *high[:2]))
    return np.array([[at - 0.35, length - 0.02, 0.0], [at + 0.35, length + depth + 0.02, height]])


BENCH_CAMERA = PinholeSensor(
    fov_deg=math.degrees(2 * math.atan(320 / 525)), width=640, height=480, name="f = 525 px"
)
_OFFICE_EYES = (
    ((0.45, 0.6, 1.55), (3.7424, 2.75502, 0.83166)),
    ((0.71612, 0.51565, 1.72088), (4.00293, 2.72641, 1.16466)),
    ((0.24599, 0.65157, 1.7443), (3.4606, 2.83511, 0.79644)),
    ((0.33761, 0.43459, 1.35921), (3.53624, 2.7204, 0.62176)),
    ((0.65314, 0.71529, 1.37965), (3.91099, 3.0128, 1.05122)),
    ((0.53292, 0.89488, 1.30804), (3.99809, 2.73904, 0.53885)),
    ((0.73944, 0.32424, 1.32367), (3.50836, 3.11063, 0.56923)),
    ((0.53912, 0.58661, 1.55164), (3.79315, 2.64995, 0.47742)),
    ((0.6636, 0.67937, 1.32074), (3.95374, 2.73864, 0.35412)),
    ((0.47625, 0.80485, 1.70005), (3.67282, 2.87233, 0.47226)),
)  # of the benchmark's frames, and what is 4 m ahead of them


def office_cases(n: int = 10) -> list[Case]:
    """Return the office from ten places, each a case of its own."""
    scene = builtin_scene("office")
    views = [View(Pose.looking_at(eye, goal), BENCH_CAMERA) for eye, goal in _OFFICE_EYES[:n]]
    return [Case(f"office {index}", scene, (view,)) for index, view in enumerate(views)]


def generated_cases(n: int, first_seed: int = 0) -> list[Case]:
    """Return rooms with the seeds `first_seed` and following."""
    return [random_case(first_seed + index) for index in range(n)]


_ROOM_M, _WALL_M, _IN_ROW = np.array([5.0, 4.0, 2.7]), 0.12, 4
_WHITE = Finish((0.8, 0.8, 0.8))


def row_of_rooms(n_rooms: int) -> Scene:
    """Rooms in rows of four; the door of each leads to the next one in its row."""
    builder = SceneBuilder("rooms", "room")
    for room in range(n_rooms):
        corner = np.array([room % _IN_ROW, room // _IN_ROW, 0]) * (_ROOM_M + _WALL_M) * [1, 1, 0]
        x, y, z = np.diag(_ROOM_M)
        name = f"room {room + 1}"
        door = (1.2 + 0.2 * (room % 3), 0.0, 2.1 + 0.2 * (room % 3), 2.05)
        before = (
            _ROOM_M[1] - 2.1 - 0.2 * ((room - 1) % 3),
            0.0,
            _ROOM_M[1] - 1.2 - 0.2 * ((room - 1) % 3),
            2.05,
        )
        has_next = room % _IN_ROW < _IN_ROW - 1 and room + 1 < n_rooms
        builder.add_rectangle(f"{name} floor", corner, x, y, _WHITE)
        builder.add_rectangle(f"{name} ceiling", corner + z + y, x, -y, _WHITE)
        builder.add_rectangle(f"{name} south", corner + x, -x, z, _WHITE)
        builder.add_rectangle(f"{name} north", corner + y, x, z, _WHITE)
        builder.add_panel(f"{name} west", corner, y, z, _WHITE, [_mirrored(before)] if room % _IN_ROW else [])
        builder.add_panel(
            f"{name} east", corner + x + y, -y, z, _WHITE, [_mirrored(door)] if has_next else []
        )
        table = corner + [0.5, 2.6, 0.0]
        builder.add_box(f"{name} table", table + [0, 0, 0.68], table + [1.4, 0.8, 0.72], _WHITE)
        builder.add_box(f"{name} cupboard", corner + [3.9, 0.05, 0.0], corner + [4.9, 0.5, 1.9], _WHITE)
        builder.add_cylinder(f"{name} post", corner + [1.2, 1.0, 0.0], [0, 0, _ROOM_M[2]], 0.09, _WHITE)
    return builder.finish()


def _mirrored(hole: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    return _ROOM_M[1] - hole[2], hole[1], _ROOM_M[1] - hole[0], hole[3]


def stations_of_row(n_stations: int, megapixels: float) -> list[RangeImage]:
    """Scan each room from near its middle."""
    scene, width = row_of_rooms(n_stations), round(np.sqrt(3 * megapixels * 1e6))
    sensor = SphericalSensor(elevation_max_deg=60.0, width=width, height=width // 3, name="panorama")
    caster = RayCaster(scene.mesh.vertices, scene.mesh.faces)
    scans = []
    for room in range(n_stations):
        corner = np.array([room % _IN_ROW, room // _IN_ROW, 0]) * (_ROOM_M + _WALL_M) * [1, 1, 0]
        eye = corner + [2.5, 2.0, 1.5]
        pose = Pose.looking_at(eye, eye + [np.cos(room), np.sin(room), 0.0])
        scans.append(scan_scene(scene, pose, sensor, noise="gaussian-2mm", rng=room, caster=caster))
    return scans
