# SPDX-License-Identifier: MIT
"""Buildings by seed: walls, slabs, doors, stairs and furniture as solids, and their true floors."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.scene import Scene

_FACES = np.array([
    [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
    [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
])  # fmt: skip
DOOR_M, HEAD_M, STOREY_M = 0.9, 2.05, 2.6


@dataclass
class Building:
    """Solids with names, and the true rooms: floor rectangles (x0, y0, x1, y1) with their height."""

    vertices: list = field(default_factory=list)
    faces: list = field(default_factory=list)
    names: list = field(default_factory=list)
    rooms: list = field(default_factory=list)
    furniture: list = field(default_factory=list)
    doorways: list = field(default_factory=list)
    n_vertices: int = 0

    def solid(self, name, corners):
        """A hexahedron: the four corners of its lower face, counter-clockwise from above, then the upper."""
        self.vertices.append(np.asarray(corners, dtype=float))
        self.faces.append(_FACES + self.n_vertices)
        self.names.append(name)
        self.n_vertices += 8

    def box(self, name, low, high):
        (x0, y0, z0), (x1, y1, z1) = low, high
        ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        self.solid(name, [(x, y, z) for z in (z0, z1) for x, y in ring])

    def scene(self, name="building"):
        labels = np.repeat(np.arange(len(self.names)), 12)
        mesh = LabelledMesh(np.vstack(self.vertices), np.vstack(self.faces), labels)
        unique = tuple(f"{name} {k}" for k, name in enumerate(self.names))
        return Scene(mesh, (None,) * len(unique), unique, name)

    def wall(self, axis, at, start, end, bottom, top, thickness, door=None, leaf=False):
        """A wall along an axis, with a doorway around `door`."""

        def part(a, b, low, high, name="wall", thick=thickness):
            if b - a < 1e-6 or high - low < 1e-6:
                return
            one, two = ([a, at - thick / 2], [b, at + thick / 2])
            if axis == 1:
                one, two = one[::-1], two[::-1]
            self.box(name, (*one, low), (*two, high))

        if door is None:
            part(start, end, bottom, top)
            return
        part(start, door - DOOR_M / 2, bottom, top)
        part(door + DOOR_M / 2, end, bottom, top)
        part(door - DOOR_M / 2, door + DOOR_M / 2, bottom + HEAD_M, top)
        low, high = [door - DOOR_M / 2, at - thickness / 2], [door + DOOR_M / 2, at + thickness / 2]
        if not leaf:
            self.doorways.append((*(low + high if axis == 0 else low[::-1] + high[::-1]), bottom))
        if leaf:
            part(door - DOOR_M / 2, door + DOOR_M / 2, bottom, bottom + HEAD_M, "door", 0.04)

    def furnish(self, rng, room):
        """Put a table, a cupboard, a podium of 8 cm or nothing into a room, clear of its walls."""
        x0, y0, x1, y1, z = room
        kind = rng.choice(["table", "bed", "cupboard", "bench", "nothing"])
        size = {"table": (2.2, 1.1), "bed": (1.9, 1.5), "cupboard": (1.2, 0.6), "bench": (1.5, 0.4)}.get(kind)
        if size is None or x1 - x0 < size[0] + 1.6 or y1 - y0 < size[1] + 1.6:
            return
        x = rng.uniform(x0 + 0.7, x1 - size[0] - 0.7)
        y = rng.uniform(y0 + 0.7, y1 - size[1] - 0.7)
        box = (x, y, x + size[0], y + size[1])
        self.furniture.append((*box, z))
        if kind in ("table", "bench"):
            top = z + (0.75 if kind == "table" else 0.45)
            self.box(kind, (x, y, top - 0.04), (x + size[0], y + size[1], top))
            for u, v in ((x, y), (x + size[0] - 0.05, y), (x, y + size[1] - 0.05),
                         (x + size[0] - 0.05, y + size[1] - 0.05)):  # fmt: skip
                self.box("leg", (u, v, z), (u + 0.05, v + 0.05, top - 0.04))
        else:
            self.box(kind, (x, y, z), (x + size[0], y + size[1], z + (0.45 if kind == "bed" else 0.9)))


def house(seed, *, slab_m=0.2, closed=False, gable=False, storeys=1, sunken=False, ground=True):
    """A house of two by one or two rooms a storey, on ground that goes on around it."""
    rng = np.random.default_rng(seed)
    made, wall = Building(), float(rng.uniform(0.1, 0.3))
    widths, depths = rng.uniform(3.2, 5.0, 2), rng.uniform(3.2, 5.0, int(rng.integers(1, 3)))
    xs, ys = np.cumsum([0, *widths]), np.cumsum([0, *depths])
    if ground:
        made.box("ground", (-6, -6, -slab_m - 1.0), (xs[-1] + 6, ys[-1] + 6, -slab_m - 0.1))
    pitch = STOREY_M + slab_m
    for storey in range(storeys):
        z = storey * pitch
        hole = None
        if storey:  # a flight from the storey below, along the first wall
            hole = (xs[0] + wall / 2 + 0.05, ys[0] + wall / 2 + 0.05, xs[0] + 1.1, ys[0] + wall / 2 + 2.9)
            n = 14
            for k in range(n):
                y = hole[1] + k * 0.2
                low = z - pitch
                made.box("tread", (hole[0], y, low), (hole[2], y + 0.2, low + (k + 1) * pitch / (n + 1)))
        _slab(made, xs, ys, z, slab_m, wall, hole)
        rooms = []
        for i in range(2):
            for j in range(len(depths)):
                room = (xs[i] + wall / 2, ys[j] + wall / 2, xs[i + 1] - wall / 2, ys[j + 1] - wall / 2, z)
                rooms.append(room)
        top = z + STOREY_M
        for j in range(len(depths)):  # between left and right, and outer ones
            for i, x in enumerate(xs):
                door = (ys[j] + ys[j + 1]) / 2 if i == 1 or (i == 0 and j == 0 and storey == 0) else None
                made.wall(1, x, ys[j] - wall / 2, ys[j + 1] + wall / 2, z, top, wall, door, closed)
        for i in range(2):
            for j, y in enumerate(ys):
                door = (xs[i] + xs[i + 1]) / 2 if 0 < j < len(depths) and i == 1 else None
                made.wall(0, y, xs[i] + wall / 2, xs[i + 1] - wall / 2, z, top, wall, door, closed)
        for room in rooms[1 if storeys > 1 else 0 :]:
            made.furnish(rng, room)
        made.rooms += rooms
    high = storeys * pitch
    if gable:
        x0, x1, y0, y1 = xs[0] - 0.5, xs[-1] + 0.5, ys[0] - 0.5, ys[-1] + 0.5
        _gable(made, x0, x1, y0, y1, high - slab_m)
    else:
        made.box("roof", (xs[0] - wall, ys[0] - wall, high - slab_m), (xs[-1] + wall, ys[-1] + wall, high))
    if sunken:
        _lower(made, made.rooms[0])
    return made


def _slab(made, xs, ys, z, slab_m, wall, hole):
    x0, y0, x1, y1 = xs[0] - wall / 2, ys[0] - wall / 2, xs[-1] + wall / 2, ys[-1] + wall / 2
    parts = [(x0, y0, x1, y1)]
    if hole is not None:
        a, b, c, d = hole
        parts = [(x0, y0, a, y1), (c, y0, x1, y1), (a, y0, c, b), (a, d, c, y1)]
    for a, b, c, d in parts:
        made.box("slab", (a, b, z - slab_m), (c, d, z))


def _gable(made, x0, x1, y0, y1, z):
    """Two sloping leaves that meet over the middle, and no ceiling below them."""
    ridge, thick, mid = z + 0.45 * (y1 - y0), 0.15, (y0 + y1) / 2
    for a, b, za, zb in ((y0, mid, z, ridge), (mid, y1, ridge, z)):
        low = [(x0, a, za), (x1, a, za), (x1, b, zb), (x0, b, zb)]
        made.solid("roof", low + [(x, y, h + thick) for x, y, h in low])


def _lower(made, room):
    """A podium over half of a room with two steps: the other half is sunken."""
    x0, y0, x1, y1, z = room
    mid = (x0 + x1) / 2
    made.box("podium", (mid, y0, z), (x1, y1, z + 0.3))
    made.box("step", (mid - 0.3, y0 + 0.3, z), (mid, y0 + 1.5, z + 0.15))
    made.rooms.append((mid, y0, x1, y1, z + 0.3))


def warehouse(seed):
    """A hall with racks of three levels, whose shelves are large and level."""
    rng = np.random.default_rng(seed)
    made, w, d, h = Building(), float(rng.uniform(12, 18)), float(rng.uniform(9, 14)), 7.0
    made.box("slab", (0, 0, -0.15), (w, d, 0))
    made.box("roof", (0, 0, h), (w, d, h + 0.2))
    for axis, at, end in ((1, 0.1, d), (1, w - 0.1, d), (0, 0.1, w), (0, d - 0.1, w)):
        made.wall(axis, at, 0, end, 0, h, 0.2)
    made.rooms.append((0.2, 0.2, w - 0.2, d - 0.2, 0.0))
    for y in np.arange(1.8, d - 2.4, 3.4):
        box = (1.8, y, w - 1.8, y + 1.1)
        made.furniture.append((*box, 0.0))
        for level in (0.35, 2.4, 4.4):
            made.box("rack", (*box[:2], level - 0.1), (*box[2:], level))
        for x in (box[0], box[2] - 0.1):
            made.box("rack", (x, box[1], 0), (x + 0.1, box[3], 5.5))
    return made
