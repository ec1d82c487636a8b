# SPDX-License-Identifier: MIT
"""Furnished flats by seed, houses of files furnished anew, single things, and the frames taken of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from benchmarks.cases.houses.furnishing import Layout, Taken, build_in, furnish
from benchmarks.cases.houses.plan import (
    Opening,
    Plan,
    Room,
    Shaft,
    Side,
    Wall,
    random_openings,
    random_plan,
    random_skylights,
)
from benchmarks.cases.houses.solids import Part, motion, moved, scene_of
from benchmarks.cases.houses.things import MIRROR
from benchmarks.cases.houses.walls import fit_way, fit_window, keep_clear, shell
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor
from nbv.visibility.floors import cut_columns, find_floors
from nbv.visibility.rooms import find_rooms
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene


@dataclass(frozen=True, eq=False)
class House:
    """A furnished flat of one to four rooms."""

    seed: int  # the same seed gives the same bytes
    plan: Plan  # its walls and rooms
    openings: tuple[Opening, ...]  # doors, windows and niches
    density: float  # of its furniture: 0 bare, 1 crammed
    scene: Scene  # everything, each part with its name; metres, z up, the floor at 0
    standing: tuple[BaseGeometry, ...]  # for each room where a person can stand

    @cached_property
    def caster(self) -> RayCaster:
        """The flat, to cast rays at."""
        return self.scene.ray_caster()

    @cached_property
    def mirrors(self) -> BoolArray:
        """Which surfaces (n_surfaces,) are mirrors."""
        return np.array([MIRROR in name.split(": ")[-1] for name in self.scene.surface_names])


def random_house(seed: int) -> House:
    """Return the flat with this seed: the same seed gives the same bytes.

    Walls are skew, thin and thick; ceilings slope, with skylights; doors are ajar; there are niches, stairs,
    columns and casings, and furniture from bare to crammed. Walls go through behind what stands before them,
    and the floor under it: that is what a completion has to find. Panes are left out: a camera looks through
    them, out to where nothing is in its range.
    """
    rng = np.random.default_rng([20266, seed])
    plan = random_plan(rng)
    openings = random_openings(plan, rng)
    density = float(np.clip(rng.beta(1.3, 1.1), 0.03, 1.0))
    layouts = [Layout(plan, room, number) for number, room in enumerate(plan.rooms)]
    for number, opening in enumerate(openings):
        _fit(number, plan, opening, layouts, rng)
    shafts: list[Shaft] = list(random_skylights(plan, rng))
    for layout in layouts:
        well = build_in(layout, rng)
        shafts += [] if well is None else [well]
        furnish(layout, rng, float(np.clip(density * rng.uniform(0.7, 1.3), 0, 1)))
    parts = shell(plan, openings, shafts, rng) + [part for layout in layouts for part in layout.parts]
    return House(
        seed=seed,
        plan=plan,
        openings=openings,
        density=density,
        scene=scene_of(f"house {seed}", parts),
        standing=tuple(layout.standing_room() for layout in layouts),
    )


def _fit(
    number: int, plan: Plan, opening: Opening, layouts: Sequence[Layout], rng: np.random.Generator
) -> None:
    """Fit an opening with what belongs to it, and keep furniture out of its way."""
    wall = plan.walls[opening.wall]
    fronts = {}
    for layout in layouts:
        for side in layout.room.sides:
            if side.wall == opening.wall and side.start <= opening.span[0] and opening.span[1] <= side.end:
                fronts[side.sign] = layout
    if opening.kind in ("window", "glazed door"):
        fit_window(number, wall, opening, fronts[opening.sign], rng)
    elif opening.kind == "niche":
        keep_clear(wall, opening, fronts[opening.sign])
    else:
        fit_way(number, wall, opening, fronts, rng)


_NARROWEST_M, _LEAST_M2 = 1.5, 4.0  # of a rectangle
_CEILING_M = 2.6  # where there is none
_INSET_M, _REACH_M, _EVEN_M = 0.3, 0.15, 0.03  # of rays at walls: start, farthest wall, what is one face
_HEIGHTS_M = (0.25, 0.9, 1.7)
_PASSAGE_M = 0.7  # before a way out of a rectangle
_PLASTER = (0.87, 0.85, 0.81)


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Part of a room's floor: corners, level and height of the ceiling above it, metres."""

    low: tuple[float, float]
    high: tuple[float, float]
    level: float
    height: float


@dataclass(frozen=True, eq=False)
class Building:
    """A house with furniture."""

    scene: Scene  # everything, each part with its name; metres, z up
    # for each rectangle where a person can stand, and the level of its floor
    standing: tuple[tuple[BaseGeometry, float], ...]

    @cached_property
    def caster(self) -> RayCaster:
        """The house, to cast rays at."""
        return self.scene.ray_caster()

    @cached_property
    def mirrors(self) -> BoolArray:
        """Which surfaces (n_surfaces,) are mirrors."""
        return np.array([MIRROR in name.split(": ")[-1] for name in self.scene.surface_names])


def furnished(shell: Scene, rng: np.random.Generator) -> Building:
    """Return a house without furniture, furnished; the same generator gives the same bytes.

    Pieces stand before walls, not before windows, and leave the ways out of each rectangle clear.
    """
    caster = shell.ray_caster()
    mesh = shell.mesh
    parts = [
        Part(name, mesh.corners[mesh.face_surface == k], _PLASTER)
        for k, name in enumerate(shell.surface_names)
        if (mesh.face_surface == k).any()
    ]
    standing = []
    density = float(rng.uniform(0.1, 0.7))
    for number, one in enumerate(rectangles_of(shell, caster)):
        layout = _layout(number, one, caster, rng)
        furnish(layout, rng, float(np.clip(density * rng.uniform(0.6, 1.4), 0, 1)))
        parts += moved(layout.parts, motion((0, 0, one.level)))
        standing.append((layout.standing_room(), one.level))
    return Building(scene_of(f"{shell.name}, furnished", parts), tuple(standing))


def rectangles_of(shell: Scene, caster: RayCaster) -> list[Rectangle]:
    """Return rectangles along the axes that lie within the rooms of a house, the largest of each first."""
    rooms = find_rooms(find_floors(cut_columns(shell.mesh, caster), caster), caster)
    columns = rooms.floors.columns
    found = []
    for room in rooms.rooms:
        if room.is_outside:
            continue
        free = np.zeros(columns.shape, np.bool_)
        free.ravel()[columns.cell[rooms.room == room.number]] = True
        height = _CEILING_M if room.ceiling_m is None else room.ceiling_m - room.level_m
        for i0, i1, j0, j1 in _largest_first(free, columns.cell_m):
            low = columns.low + columns.cell_m * np.array([i0, j0])
            high = columns.low + columns.cell_m * np.array([i1, j1])
            found.append(Rectangle((low[0], low[1]), (high[0], high[1]), room.level_m, height))
    return found


def _largest_first(free: BoolArray, cell_m: float) -> Iterator[tuple[int, int, int, int]]:
    """Cells from and to of rectangles of free cells, each taken out before the next is looked for."""
    left, narrow = free.copy(), int(np.ceil(_NARROWEST_M / cell_m))
    while True:
        best, area = None, _LEAST_M2 / cell_m**2
        run = np.zeros(left.shape[1], np.int64)
        for i, row in enumerate(left):
            run = np.where(row, run + 1, 0)
            for deep in np.unique(run[run >= narrow]):
                for j0, j1 in _runs(run >= deep):
                    if j1 - j0 >= narrow and deep * (j1 - j0) > area:
                        best, area = (i + 1 - int(deep), i + 1, j0, j1), deep * (j1 - j0)
        if best is None:
            return
        yield best
        left[best[0] : best[1], best[2] : best[3]] = False


def _runs(true: BoolArray) -> list[tuple[int, int]]:
    """Where runs of True begin and end."""
    steps = np.diff(np.concatenate([[0], true.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist(), strict=True))


def _layout(number: int, one: Rectangle, caster: RayCaster, rng: np.random.Generator) -> Layout:
    """A rectangle with its walls where rays meet them, and its ways out kept clear."""
    (x0, y0), (x1, y1) = one.low, one.high
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    walls, sides, passages = [], [], []
    for k, corner in enumerate(corners):
        along = corners[(k + 1) % 4] - corner
        length = float(np.linalg.norm(along))
        along /= length
        inward = np.array([-along[1], along[0]])
        at = np.arange(0.05, length, 0.05)
        away = _to_wall(caster, corner + np.outer(at, along), inward, one.level)
        near = away[np.abs(away) < _REACH_M]
        face = float(near.min()) if len(near) else 0.0
        walls.append(Wall(corner - face * inward, along, 0.0, False))
        for first, last in _runs(np.abs(away - face).max(axis=1) < _EVEN_M):
            sides.append(Side(k, 1, float(at[first]), float(at[last - 1])))
        for first, last in _runs(away.min(axis=1) > _REACH_M):
            passages.append(walls[k].place(at[[first, last - 1]], np.zeros(2), 0.0)[:, :2])
    low = np.array([walls[3].point[0], walls[0].point[1]])
    high = np.array([walls[1].point[0], walls[2].point[1]])
    outline = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    room = Room(
        outline, tuple(sides) or _bare(walls), np.array([[0.0, 0.0, one.height]]), _use(high - low, rng)
    )
    layout = Layout(Plan(tuple(walls), (room,)), room, number)
    for ends in passages:
        layout.taken.append(Taken(shapely.LineString(ends).buffer(_PASSAGE_M), 0.0, one.height))
    return layout


def _to_wall(caster: RayCaster, places: FloatArray, inward: FloatArray, level: float) -> FloatArray:
    """How far (n, 3) walls stand beyond places (n, 2) on a side, at three heights above the floor."""
    starts = np.concatenate(
        [np.column_stack([places + _INSET_M * inward, np.full(len(places), level + h)]) for h in _HEIGHTS_M]
    )
    ways = np.broadcast_to([-inward[0], -inward[1], 0.0], starts.shape)
    ranges = caster.first_hit(starts, np.ascontiguousarray(ways)).ranges
    return np.asarray(ranges.reshape(len(_HEIGHTS_M), -1).T - _INSET_M)


def _bare(walls: Sequence[Wall]) -> tuple[Side, ...]:
    """A side too short for anything: of a rectangle without walls."""
    return tuple(Side(k, 1, 0.0, 0.01) for k in range(len(walls)))


def _use(size: NDArray[np.float64], rng: np.random.Generator) -> str:
    """What a rectangle is used for, by its area."""
    if size.prod() > 12.0:
        return str(rng.choice(["living", "bedroom", "kitchen", "living"]))
    return str(rng.choice(["study", "bedroom", "bath", "hall", "storage", "kitchen"]))


NEAREST_M, FARTHEST_M = 0.4, 6.0
_FOV_DEG = 62.0
_APART_M = 0.3  # from anything, at any height up to the camera's
_GOOD = 1.0  # merit from which on no better frame is looked for
_LOOKS = 40  # places and directions that are tried for one frame


def camera(width: int) -> PinholeSensor:
    """Return a depth camera `width` pixels wide, three quarters as high."""
    return PinholeSensor(
        fov_deg=_FOV_DEG,
        width=width,
        height=3 * width // 4,
        min_range_m=NEAREST_M,
        max_range_m=FARTHEST_M,
        name="depth camera",
    )


def frames(
    house: House, n: int = 5, width: int = 320, *, noise: str = "khoshelham2012"
) -> tuple[RangeImage, ...]:
    """Return `n` frames that a person takes, with exact poses.

    The eye is 1.2 to 1.7 m above floor on which there is room to stand, and looks at some thing or some place
    on a wall, now and then through a door, up or down, the camera never quite level. Frames of which less
    than two thirds would be surface in range, or most of it very near, are not taken. From mirrors nothing
    comes back.
    """
    poses = standing_poses(
        house.scene, house.caster, house.standing, n, np.random.default_rng([house.seed, 1])
    )
    taken = []
    for number, pose in enumerate(poses):
        scan = scan_scene(
            house.scene,
            pose,
            camera(width),
            noise=noise,
            rng=1000 * house.seed + number,
            caster=house.caster,
            name=f"house {house.seed}, frame {number}",
        )
        taken.append(without_mirrors(scan, house.mirrors))
    return tuple(taken)


def station(house: House, *, width: int = 1440, sigma_m: float | None = None) -> RangeImage:
    """Return a panorama of 360 x 150 degrees from a tripod in the largest free place, noise 2 to 5 mm."""
    rng = np.random.default_rng([house.seed, 2])
    sigma = rng.uniform(0.002, 0.005) if sigma_m is None else sigma_m
    floor = max(
        (part for area in house.standing for part in shapely.get_parts(area)), key=lambda one: one.area
    )
    middle = np.array(shapely.maximum_inscribed_circle(floor, 0.02).coords[0])
    eye = np.array([*middle, rng.uniform(1.4, 1.7)])
    sensor = SphericalSensor(
        elevation_min_deg=-60.0, elevation_max_deg=90.0, width=width, height=width * 5 // 12, name="panorama"
    )
    turn = rng.uniform(0, 2 * np.pi)
    pose = Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), 0])
    effects = Effects(noise=ConstantNoise(constant_m=sigma))
    scan = scan_scene(
        house.scene,
        pose,
        sensor,
        effects=effects,
        rng=house.seed,
        caster=house.caster,
        name=f"house {house.seed}, station",
    )
    return without_mirrors(scan, house.mirrors)


def without_mirrors(scan: RangeImage, mirrors: BoolArray) -> RangeImage:
    """Return the scan without the returns from surfaces (n_surfaces,) that are mirrors.

    A triangulating camera loses its pattern there; what some instruments return instead, the reflected way,
    is left out.
    """
    if scan.truth is None or not mirrors.any():
        return scan
    lost = mirrors[scan.truth.surface] & (scan.truth.surface >= 0)
    return replace(scan, ranges=np.where(lost, np.inf, scan.ranges)) if lost.any() else scan


def standing_poses(
    scene: Scene, caster: RayCaster, floors: tuple[BaseGeometry, ...], n: int, rng: np.random.Generator
) -> list[Pose]:
    """Return `n` poses of a camera in a person's hands, each as good as 40 tries make it."""
    poses: list[Pose] = []
    rooms = np.array([area.area for area in floors])
    share = np.sqrt(rooms) / np.sqrt(rooms).sum()
    low, high = _extents(scene)
    for _ in range(n):
        best, merit = None, -1.0
        for _ in range(_LOOKS):
            eye = _eye(floors[int(rng.choice(len(floors), p=share))], rng)
            if not has_room(caster, eye):
                continue
            pose = _look(eye, _goal(eye, low, high, rng), rng)
            seen = _merit(caster, pose) - 0.4 * any(_is_alike(pose, one) for one in poses)
            if seen > merit:
                best, merit = pose, seen
            if merit > _GOOD:
                break
        if best is not None:
            poses.append(best)
    return poses


def has_room(caster: RayCaster, eye: FloatArray) -> bool:
    """Tell whether a person can hold a camera there: floor below, nothing within 30 cm."""
    turn = 2 * np.pi * np.arange(20) / 20
    ways = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(20)])
    heights = np.array([0.15, 0.45, 0.8, 1.1, float(eye[2])])
    starts = np.repeat(np.column_stack([np.tile(eye[:2], (5, 1)), heights]), 20, axis=0)
    around = caster.first_hit(starts, np.tile(ways, (5, 1))).ranges
    down = caster.first_hit(eye[None], np.array([[0, 0, -1.0]])).ranges[0]
    up = caster.first_hit(eye[None], np.array([[0, 0, 1.0]])).ranges[0]
    return bool(around.min() >= _APART_M and abs(down - eye[2]) < 0.03 and up > 0.12)


def _extents(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """The bounds (n_surfaces, 3) of every part that is not the outside."""
    labels, corners = scene.mesh.face_surface, scene.mesh.corners
    low = np.full((len(scene.surface_names), 3), np.inf)
    high = -low
    np.minimum.at(low, labels, corners.min(axis=1))
    np.maximum.at(high, labels, corners.max(axis=1))
    kept = np.array(["facade" not in name for name in scene.surface_names])
    return low[kept], high[kept]


def _eye(floor: BaseGeometry, rng: np.random.Generator) -> FloatArray:
    """A place above a floor, evenly over its area."""
    x0, y0, x1, y1 = floor.bounds
    for _ in range(60):
        at = rng.uniform((x0, y0), (x1, y1))
        if floor.contains(shapely.Point(at)):
            break
    return np.array([*at, rng.uniform(1.2, 1.7)])


def _goal(eye: FloatArray, low: FloatArray, high: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Somewhere on a part, nearer ones more often; of large ones anywhere."""
    reach = np.linalg.norm((low + high) / 2 - eye, axis=1)
    weight = np.exp(-reach / 2.5) * np.sqrt(0.1 + np.linalg.norm(high - low, axis=1))
    one = int(rng.choice(len(low), p=weight / weight.sum()))
    return np.asarray(low[one] + rng.uniform(0.1, 0.9, 3) * (high[one] - low[one]))


def _look(eye: FloatArray, goal: FloatArray, rng: np.random.Generator) -> Pose:
    """Look at a goal, up or down by 40 degrees at most, with the camera rolled somewhat."""
    ahead = goal - eye
    level = max(float(np.linalg.norm(ahead[:2])), 0.3)
    ahead[2] = np.clip(ahead[2], -0.84 * level, 0.45 * level)
    roll = rng.normal(0, np.radians(2.5))
    spin = np.eye(4)
    spin[:2, :2] = [[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]]
    return Pose.looking_at(eye, eye + ahead) @ Pose(spin)


def _is_alike(pose: Pose, other: Pose) -> bool:
    """Tell whether two cameras stand within 70 cm and look the same way within 40 degrees."""
    near = np.linalg.norm(pose.translation - other.translation) < 0.7
    return bool(near and pose.rotation[:, 2] @ other.rotation[:, 2] > 0.77)


def _merit(caster: RayCaster, pose: Pose) -> float:
    """How much of a view of 32 x 24 pixels is surface in range, less what is near, and more with jumps."""
    rays = camera(32).projection.directions()
    hits = caster.first_hit(pose.translation[None], pose.rotate(rays)).ranges
    share = float(((hits > NEAREST_M) & (hits < FARTHEST_M)).mean())
    near = float((hits < 1.0).mean())
    depth = np.clip(hits, 0, FARTHEST_M)
    jumps = float(
        (np.abs(np.diff(depth, axis=1)) > 0.2).mean() + (np.abs(np.diff(depth, axis=0)) > 0.2).mean()
    )
    return (share if share > 0.66 else share - 1) - 0.8 * near + min(2 * jumps, 0.3)
