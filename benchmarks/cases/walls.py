# SPDX-License-Identifier: MIT
"""Walls by seed: a room whose far wall has an opening behind clutter, or something that looks like one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene

Hole = tuple[float, float, float, float]  # y and z of its near and of its far corner
Size = tuple[float, float, float]  # x, y, z of a room, metres
GREY = Finish((0.78, 0.77, 0.74))
_FLOOR, _CEILING, _SIDE = Finish((0.55, 0.50, 0.44)), Finish((0.90, 0.90, 0.88)), Finish((0.70, 0.70, 0.68))
_REVEAL, _BEYOND = Finish((0.62, 0.62, 0.60)), Finish((0.46, 0.54, 0.62))
WOOD = Finish((0.6, 0.5, 0.4))
_STRAYS = 0.01
_PANORAMA = SphericalSensor(
    azimuth_span_deg=110.0, elevation_min_deg=-50.0, elevation_max_deg=40.0, width=880, height=720,
    name="panorama", max_range_m=20.0,
)  # fmt: skip
_CAMERA = PinholeSensor(fov_deg=75.0, width=640, height=480, max_range_m=12.0, name="camera")


def room_of(rng: np.random.Generator) -> Size:
    return float(rng.uniform(3.5, 6.0)), float(rng.uniform(3.4, 5.0)), float(rng.uniform(2.4, 3.0))


def hole_of(rng: np.random.Generator, kind: str, room: Size) -> Hole:
    width = float(rng.uniform(0.7, 1.1) if kind == "doorway" else rng.uniform(0.6, 1.4))
    low = 0.0 if kind == "doorway" else float(rng.uniform(0.6, 1.0))
    high = float(rng.uniform(1.95, 2.15)) if kind == "doorway" else low + float(rng.uniform(0.6, 1.2))
    start = float(rng.uniform(0.5, room[1] - width - 0.5))
    return start, low, start + width, high


def add_shell(
    build: SceneBuilder,
    room: Size,
    holes: list[Hole],
    kind: str,
    depth: float,
    rng: np.random.Generator,
    *,
    width: float | None = None,
) -> None:
    """Floor, ceiling and walls; the far wall with holes and reveals, another room or nothing behind it."""
    x, y, z = np.diag(room)
    build.add_rectangle("floor", np.zeros(3), x, y, _FLOOR)
    build.add_rectangle("ceiling", z + y, x, -y, _CEILING)
    build.add_rectangle("wall x=0", np.zeros(3), y, z, GREY)
    build.add_rectangle("wall y=0", np.zeros(3), x, z, _SIDE)
    build.add_rectangle("wall y=far", y, x, z, _SIDE)
    end = room[1] if width is None else width
    from_far = [(end - hole[2], hole[1], end - hole[0], hole[3]) for hole in holes]
    build.add_panel(
        "wall", (room[0], end, 0.0), (0, -end, 0), z, GREY, holes=from_far, are_openings=kind != "niche"
    )
    deep = np.array([depth, 0.0, 0.0])
    for y0, z0, y1, z1 in holes:
        low = np.array([room[0], y0, z0])
        across, up = np.array([0, y1 - y0, 0.0]), np.array([0, 0, z1 - z0])
        build.add_rectangle("reveal left", low, deep, up, _REVEAL)
        build.add_rectangle("reveal right", low + across, deep, up, _REVEAL)
        build.add_rectangle("reveal top", low + up, deep, across, _REVEAL)
        build.add_rectangle("reveal bottom", low, deep, across, _REVEAL)
        if kind == "niche":
            build.add_rectangle("back", low + deep, across, up, GREY)
    if kind != "niche" and (holes or width is not None):
        away = np.array([rng.uniform(1.5, 5.0), 0.0, 0.0])
        corner = x + away - y - z * 0.2
        build.add_rectangle("beyond", corner, 3 * y, 1.6 * z, _BEYOND)
        build.add_rectangle("floor beyond", x - y, away, 3 * y, _BEYOND)


def clutter_of(
    rng: np.random.Generator, room: Size, hole: Hole, eye: FloatArray, hidden: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Boxes before the wall whose shadows from the eye cover about a share of the hole, from one side."""
    y0, _, y1, z1 = hole
    share = hidden * rng.uniform(0.9, 1.3)
    stands = rng.uniform(0.3, 1.0)  # before the wall
    scale = 1 - stands / (room[0] - eye[0])  # from the wall's plane to that of the box's front
    boxes = []
    style = rng.integers(3)
    if style == 0:  # from below, over the whole width
        low, high, top = y0 - 0.3, y1 + 0.3, hole[1] + share * (z1 - hole[1])
        edges = [(low, high, top)]
    elif style == 1:  # from the side, tall
        cut = share * (y1 - y0)
        left = rng.random() < 0.5
        edges = [(y0 - 0.4, y0 + cut, z1 + 0.1) if left else (y1 - cut, y1 + 0.4, z1 + 0.1)]
    else:  # two boxes
        part = share / 2
        edges = [
            (y0 - 0.3, y0 + part * 1.4 * (y1 - y0), hole[1] + 0.8 * (z1 - hole[1])),
            (y0 + 0.3 * (y1 - y0), y1 + 0.3, hole[1] + part * (z1 - hole[1])),
        ]
    for low, high, top in edges:
        ya, yb = (eye[1] + scale * (edge - eye[1]) for edge in (low, high))
        za = eye[2] + scale * (top - eye[2])
        front = eye[0] + scale * (room[0] - eye[0])
        ya, yb = max(ya, 0.02), min(yb, room[1] - 0.02)
        if yb - ya > 0.05 and za > 0.05:
            back = min(front + rng.uniform(0.15, 0.4), room[0] - 0.02)
            boxes.append((np.array([front, ya, 0.0]), np.array([back, yb, min(za, room[2] - 0.05)])))
    return boxes


def scan_of(
    scene: Scene,
    eye: FloatArray,
    room: Size,
    rng: np.random.Generator,
    noise_m: float,
) -> RangeImage:
    """A panorama, or a camera's image, with noise and strays, of a wall that the sensor looks at askew."""
    sensor: Sensor = _PANORAMA if rng.random() < 0.6 else _CAMERA
    aim = np.array([room[0], room[1] * rng.uniform(0.35, 0.65), eye[2] if sensor is _PANORAMA else 1.2])
    pose = Pose.looking_at(eye, aim)
    scan = scan_scene(
        scene, pose, sensor, noise=f"gaussian-{1000 * noise_m:g}mm", rng=int(rng.integers(2**31)), truth=False
    )
    ranges = scan.ranges.copy()
    stray = (rng.random(ranges.shape) < _STRAYS) & np.isfinite(ranges)
    ranges[stray] = rng.uniform(0.5, 8.0, int(stray.sum()))
    return replace(scan, ranges=ranges)


KINDS = ("doorway", "window", "niche")


@dataclass(frozen=True, slots=True, eq=False)
class WallCase:
    """A scan of a wall, and what is in it."""

    scan: RangeImage  # from one station, with noise and a share of strays
    kind: str  # "doorway", "window", "niche", or what the null is
    x: float  # where the wall is
    hole: Hole | None  # the true rectangle
    depth: float  # of its reveals
    hidden: float  # share of the opening's area that the clutter hides from the station
    # for each side, the share along which beams pass just inside and end just outside it
    seen: dict[str, float]


def opening_case(seed: int, kind: str, hidden: float, noise_m: float = 0.005) -> WallCase:
    """Return an opening of a kind, about `hidden` of which stands behind boxes."""
    for attempt in range(40):
        rng = np.random.default_rng([20270, seed, KINDS.index(kind), round(100 * hidden), attempt])
        room, hole, depth = room_of(rng), (0.0, 0.0, 0.0, 0.0), float(rng.uniform(0.08, 0.35))
        hole = hole_of(rng, kind, room)
        eye = np.array([rng.uniform(0.8, 1.6), rng.uniform(0.2, 0.8) * room[1], rng.uniform(1.3, 1.7)])
        build = SceneBuilder(f"{kind} {seed}", "room")
        add_shell(build, room, [hole], kind, depth, rng)
        boxes = clutter_of(rng, room, hole, eye, hidden)
        for number, (low, high) in enumerate(boxes):
            build.add_box(f"box {number}", low, high, WOOD)
        scene = build.finish()
        share, seen = _visible(scene, eye, room, hole)
        if abs(share - hidden) <= 0.1:
            return WallCase(scan_of(scene, eye, room, rng, noise_m), kind, room[0], hole, depth, share, seen)
    raise RuntimeError(f"no clutter hides {hidden:.0%} of {kind} {seed}")


def _visible(scene: Scene, eye: FloatArray, room: Size, hole: Hole) -> tuple[float, dict[str, float]]:
    """Share of the hole that is hidden, and of each side that is seen: its inside and its outside."""
    y0, z0, y1, z1 = hole
    caster = scene.ray_caster()

    def reached(y: FloatArray, z: FloatArray) -> FloatArray:
        places = np.column_stack([np.full(y.size, room[0]), y.ravel(), z.ravel()])
        away = places - eye
        far = np.linalg.norm(away, axis=1)
        hit = caster.first_hit(np.broadcast_to(eye, away.shape), away / far[:, None])
        return np.asarray(hit.ranges > far - 1e-3)

    grid = np.meshgrid(np.linspace(y0, y1, 42)[1:-1], np.linspace(z0, z1, 42)[1:-1])
    hidden = 1 - reached(*grid).mean()
    t, near, seen = np.linspace(0.02, 0.98, 60), 0.02, {}
    for name, axis, at, sign in (
        ("left", 0, y1, 1), ("right", 0, y0, -1), ("bottom", 1, z0, -1), ("top", 1, z1, 1)
    ):  # fmt: skip
        along = (z0 + t * (z1 - z0)) if axis == 0 else (y0 + t * (y1 - y0))
        both = np.ones(len(t), dtype=bool)
        for shift in (sign * near, -sign * near):
            across = np.full(len(t), at + shift)
            both &= reached(*((across, along) if axis == 0 else (along, across)))
        seen[name] = float(both.mean())
    return float(hidden), seen


Null = Literal[
    "plain", "picture", "wall end", "cupboards", "lost patch", "mirror", "wardrobes", "table", "shelves"
]  # fmt: skip
NULLS: tuple[Null, ...] = (
    "plain", "picture", "wall end", "cupboards", "lost patch", "mirror", "wardrobes", "table", "shelves"
)  # fmt: skip
_BOARD_M = 0.025  # thickness of shelves


def null_case(seed: int, kind: Null, noise_m: float = 0.005) -> WallCase:
    """Return a wall without an opening, but with what looks like one."""
    rng = np.random.default_rng([20271, seed, NULLS.index(kind)])
    room = room_of(rng)
    eye = np.array([rng.uniform(0.8, 1.6), rng.uniform(0.25, 0.75) * room[1], rng.uniform(1.3, 1.7)])
    build = SceneBuilder(f"{kind} {seed}", "room")
    hole = hole_of(rng, "doorway" if rng.random() < 0.5 else "window", room)
    if kind == "wall end":
        end = float(rng.uniform(0.45, 0.7) * room[1])
        add_shell(build, room, [], "plain", 0.1, rng, width=end)
    else:
        add_shell(build, room, [], "plain", 0.1, rng)
    if kind == "picture":
        for _ in range(3):
            at = rng.uniform([0.1 * room[1], 0.8], [0.7 * room[1], 1.4])
            size, thick = rng.uniform(0.3, 1.0, 2), float(rng.uniform(0.01, 0.06))
            low = np.array([room[0] - thick, *at])
            build.add_box("picture", low, low + [thick, size[0], size[1]], WOOD)
    if kind == "cupboards":
        gap, high = float(rng.uniform(0.4, 1.0)), float(rng.uniform(1.2, 2.2))
        middle, deep = float(rng.uniform(0.4, 0.6) * room[1]), float(rng.uniform(0.3, 0.6))
        for y0, y1 in ((0.1, middle - gap / 2), (middle + gap / 2, room[1] - 0.1)):
            build.add_box("cupboard", (room[0] - deep, y0, 0.0), (room[0], y1, high), WOOD)
    if kind in _FURNITURE:
        for foot, head in _FURNITURE[kind](rng, room):
            build.add_box(kind, foot, head, WOOD)
    for number, (low, up) in enumerate(clutter_of(rng, room, hole, eye, 0.3)):
        build.add_box(f"box {number}", low, up, WOOD)
    scene = build.finish()
    scan = scan_of(scene, eye, room, rng, noise_m)
    if kind == "mirror":
        scan = _with_mirror(scan, scene, room, hole, rng.normal(0.0, noise_m, scan.shape))
    if kind == "lost patch":
        scan = _without_patch(scan, room, hole)
    return WallCase(scan, kind, room[0], None, 0.0, 0.0, {})


def _without_patch(scan: RangeImage, room: Size, hole: Hole) -> RangeImage:
    """The scan without returns from a rectangle of the wall, as dark paint loses them."""
    points = scan.points()
    on = np.abs(points[..., 0] - room[0]) < 0.05
    y0, z0, y1, z1 = hole
    inside = (points[..., 1] > y0) & (points[..., 1] < y1) & (points[..., 2] > z0) & (points[..., 2] < z1)
    return replace(scan, ranges=np.where(on & inside, np.inf, scan.ranges))


def _with_mirror(
    scan: RangeImage,
    scene: Scene,
    room: Size,
    hole: Hole,
    error: FloatArray,
) -> RangeImage:
    """The scan with a mirror on the wall: beams that meet it are reflected, and measure on."""
    points, (y0, z0, y1, z1) = scan.points(), hole
    on = (np.abs(points[..., 0] - room[0]) < 0.05) & (points[..., 1] > y0) & (points[..., 1] < y1)
    on &= (points[..., 2] > z0) & (points[..., 2] < z1)
    rays = scan.rays()[on]
    away = (room[0] - scan.origin[0]) / rays[:, 0]
    places = scan.origin + (away - 1e-4)[:, None] * rays
    onward = scene.ray_caster().first_hit(places, rays * [-1.0, 1.0, 1.0]).ranges
    ranges = scan.ranges.copy()
    ranges[on] = away + onward + error[on]
    return replace(scan, ranges=ranges)


Boxes = list[tuple[FloatArray, FloatArray]]


def _wardrobes(rng: np.random.Generator, room: Size) -> Boxes:
    """Wardrobes side by side with their fronts in one plane, gaps between them, the wall behind."""
    deep, before, start = rng.uniform(0.45, 0.65), rng.uniform(0.0, 0.1), rng.uniform(0.1, 0.5)
    boxes = Boxes()
    while len(boxes) < 4:
        wide, high = rng.uniform(0.6, 1.3), rng.uniform(1.7, min(2.3, room[2] - 0.1))
        if start + wide > room[1] - 0.1:
            break
        low = np.array([room[0] - before - deep, start, 0.0])
        boxes.append((low, np.array([room[0] - before, start + wide, high])))
        start += wide + rng.uniform(0.35, 0.9)
    return boxes


def _table(rng: np.random.Generator, room: Size) -> Boxes:
    """A table on four legs whose apron stands across the view, some way before the wall."""
    wide, deep, high = rng.uniform(1.2, 2.0), rng.uniform(0.7, 0.9), rng.uniform(0.70, 0.76)
    leg, apron, top = rng.uniform(0.05, 0.09), rng.uniform(0.08, 0.14), 0.03
    x, y = room[0] - deep - rng.uniform(0.1, 0.9), rng.uniform(0.2, room[1] - wide - 0.2)
    low = np.array([x, y, 0.0])
    boxes = [(low + [0, 0, high - top], low + [deep, wide, high])]
    for a, b in ((0.0, 0.0), (deep - leg, 0.0), (0.0, wide - leg), (deep - leg, wide - leg)):
        boxes.append((low + [a, b, 0.0], low + [a + leg, b + leg, high - top]))
    under = low + [0.0, leg, high - top - apron], low + [_BOARD_M, wide - leg, high - top]
    return [*boxes, under, (under[0] + [deep - _BOARD_M, 0, 0], under[1] + [deep - _BOARD_M, 0, 0])]


def _shelves(rng: np.random.Generator, room: Size) -> Boxes:
    """Open shelves before the wall, of boards, with things on some of them."""
    wide, deep, high = rng.uniform(1.0, 1.9), rng.uniform(0.28, 0.4), rng.uniform(1.5, 2.1)
    low = np.array([room[0] - deep - 0.005, rng.uniform(0.2, room[1] - wide - 0.2), 0.0])
    n, divided = int(rng.integers(3, 6)), rng.random() < 0.6
    levels = np.linspace(0.05, high, n + 1)
    boxes = [(low + [0, 0, z - _BOARD_M], low + [deep, wide, z]) for z in levels]
    uprights = [0.0, *([wide / 2] if divided else []), wide - _BOARD_M]
    boxes += [(low + [0, y, 0.0], low + [deep, y + _BOARD_M, high]) for y in uprights]
    for z in levels[:-1]:
        if rng.random() < 0.5:
            y, size = rng.uniform(0.05, wide / 2), rng.uniform([0.2, 0.1], [0.45 * wide, 0.6 * high / n])
            front = rng.uniform(0.0, 0.1)
            boxes.append((low + [front, y, z], low + [deep - 0.01, y + size[0], z + size[1]]))
    return boxes


_FURNITURE = {"wardrobes": _wardrobes, "table": _table, "shelves": _shelves}
