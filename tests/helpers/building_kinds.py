# SPDX-License-Identifier: MIT
"""Buildings of other kinds: ramps, split levels, attics, mezzanines, galleries, cellars, sheets, turned.

Each function returns a building whose `rooms` are floor rectangles (x0, y0, x1, y1, height) or, on ramps,
(x0, y0, x1, y1, height at x0, height at x1).
"""

from __future__ import annotations

import numpy as np

from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.world.scene import Scene
from tests.helpers.buildings import DOOR_M, Building

_WALL = 0.2


def _outer(made, x0, y0, x1, y1, bottom, top, doors=()):
    """Walls around a rectangle, centred on its sides, with a doorway in the sides (0 to 3) that are named."""
    doors = dict(doors)
    for k, y in enumerate((y0, y1)):
        made.wall(0, y, x0 - _WALL / 2, x1 + _WALL / 2, bottom, top, _WALL, doors.get(k))
    for k, x in enumerate((x0, x1)):
        made.wall(1, x, y0 + _WALL / 2, y1 - _WALL / 2, bottom, top, _WALL, doors.get(2 + k))


def _flight(made, x, y0, y1, bottom, top, run=0.28, risers=None):
    """Treads that rise along x from `x` on, and the x at which they end."""
    n = risers or int(np.ceil((top - bottom) / 0.18))
    for k in range(n - 1):
        made.box(
            "tread", (x + k * run, y0, bottom), (x + (k + 1) * run, y1, bottom + (k + 1) * (top - bottom) / n)
        )
    return x + (n - 1) * run


def hall_with_ramp():
    """An L of two halls, one 0.6 m higher, and a ramp of 4.3 degrees between them."""
    made, high = Building(), 0.6
    made.box("slab", (-0.1, -0.1, -0.2), (14.0, 6.1, 0))
    made.solid("ramp", [(14, 0, -0.2), (22, 0, -0.2), (22, 6, -0.2), (14, 6, -0.2),
                        (14, 0, 0), (22, 0, high), (22, 6, high), (14, 6, 0)])  # fmt: skip
    made.box("slab", (22.0, -0.1, high - 0.2), (28.1, 16.1, high))
    made.box("roof", (-0.1, -0.1, 5.0), (28.1, 16.1, 5.2))
    made.wall(0, -0.1, -0.1, 28.2, -0.2, 5, _WALL)
    made.wall(0, 6.1, -0.1, 22, -0.2, 5, _WALL)
    made.wall(1, 22, 6.1, 16.1, high, 5, _WALL)
    made.wall(0, 16.1, 22, 28.2, high, 5, _WALL)
    made.wall(1, -0.1, -0.1, 6.1, -0.2, 5, _WALL)
    made.wall(1, 28.2, -0.1, 16.1, high, 5, _WALL)
    made.rooms += [(0, 0, 14, 6, 0.0), (14, 0, 22, 6, 0.0, high), (22, 0, 28.1, 16, high)]
    return made


def split_level():
    """Two halves, one 1.26 m above the other, with a flight of seven risers in an opening of the wall."""
    made, up = Building(), 1.26
    made.box("slab", (0, 0, -0.2), (6, 7, 0))
    made.box("slab", (6, 0, up - 0.2), (11, 7, up))
    made.box("earth", (6, 0, -0.2), (11, 7, up - 0.2))
    made.box("roof", (-0.2, -0.2, 4.0), (11.2, 7.2, 4.2))
    _outer(made, 0, 0, 11, 7, 0, 4.0, {2: 1.2})
    made.wall(1, 6.0, 0.1, 2.0, 0, 4.0, _WALL)
    made.wall(1, 6.0, 3.2, 6.9, 0, 4.0, _WALL)
    made.wall(1, 6.0, 2.0, 3.2, up + 2.05, 4.0, _WALL)
    _flight(made, 6.0 - 6 * 0.28, 2.0, 3.2, 0, up, risers=7)
    made.rooms += [(0.1, 0.1, 5.9, 6.9, 0.0), (6.1, 0.1, 10.9, 6.9, up)]
    made.doorways.append((5.8, 2.0, 6.2, 3.2, up))
    return made


def attic():
    """A ground floor, and an attic under a gable without knee walls, joined by a stair."""
    made = Building()
    w, d, z = 9.0, 8.0, 2.8
    made.box("slab", (0, 0, -0.2), (w, d, 0))
    end = 0.6 + 15 * 0.25
    x0, x1, y0, y1 = 0.6, end, 3.4, 4.5
    for a, b, c, e in ((0, 0, w, y0), (0, y1, w, d), (0, y0, x0, y1), (x1, y0, w, y1)):
        made.box("slab", (a, b, z - 0.25), (c, e, z))
    _flight(made, x0, y0, y1, 0, z, run=0.25, risers=16)
    _outer(made, 0, 0, w, d, 0, z - 0.25, {0: 7.0})
    ridge, mid = z + 3.2, d / 2
    for a, b, za, zb in ((-0.4, mid, z - 0.32, ridge), (mid, d + 0.4, ridge, z - 0.32)):
        low = [(-0.4, a, za), (w + 0.4, a, za), (w + 0.4, b, zb), (-0.4, b, zb)]
        made.solid("roof", low + [(x, y, h + 0.15) for x, y, h in low])
    for x in (0.0, w):
        made.solid("gable", [(x - 0.1, 0, z), (x + 0.1, 0, z), (x + 0.1, d, z), (x - 0.1, d, z),
                             (x - 0.1, mid, ridge), (x + 0.1, mid, ridge),
                             (x + 0.1, mid + 0.01, ridge), (x - 0.1, mid + 0.01, ridge)])  # fmt: skip
    made.rooms += [(0.1, 0.1, w - 0.1, d - 0.1, 0.0), (0.1, 1.0, w - 0.1, d - 1.0, z)]
    return made


def rack_hall():
    """A hall with racks of four levels, a conveyor, pallets, and a mezzanine with a stair and rails."""
    made, w, d, h, z = Building(), 26.0, 16.0, 8.0, 3.2
    made.box("slab", (0, 0, -0.2), (w, d, 0))
    made.box("roof", (-0.2, -0.2, h), (w + 0.2, d + 0.2, h + 0.2))
    _outer(made, 0, 0, w, d, 0, h, {2: 12.0})
    for y in (2.0, 5.2, 8.4):
        box = (2.0, y, 15.0, y + 1.2)
        made.furniture.append((*box, 0.0))
        for level in (0.2, 1.9, 3.7, 5.5):
            made.box("shelf", (*box[:2], level - 0.1), (*box[2:], level))
        for x in np.arange(2.0, 15.1, 2.58):
            made.box("post", (x, y, 0), (x + 0.1, y + 0.1, 6.0))
            made.box("post", (x, y + 1.1, 0), (x + 0.1, y + 1.2, 6.0))
    made.box("conveyor", (3.0, 12.5, 0.75), (15.0, 13.4, 0.9))
    made.furniture.append((3.0, 12.5, 15.0, 13.4, 0.0))
    for x in (17.0, 18.6, 20.2):
        made.box("pallet", (x, 1.0, 0), (x + 1.2, 2.0, 1.1))
        made.furniture.append((x, 1.0, x + 1.2, 2.0, 0.0))
    made.box("mezzanine", (18.0, 9.0, z - 0.2), (w, d, z))
    for x in (18.2, 25.6):
        made.box("column", (x, 9.1, 0), (x + 0.2, 9.3, z - 0.2))
    made.box("column", (18.2, 15.5, 0), (18.4, 15.7, z - 0.2))
    end = _flight(made, 18.0 - 17 * 0.28, 14.2, 15.3, 0, z, risers=18)
    assert abs(end - 18.0) < 1e-9
    for low in (0.5, 1.0):  # rails
        made.box("rail", (18.0, 9.0, z + low), (w, 9.04, z + low + 0.05))
        made.box("rail", (18.0, 9.0, z + low), (18.04, 14.2, z + low + 0.05))
    made.rooms += [(0.1, 0.1, w - 0.1, d - 0.1, 0.0), (18.0, 9.0, w - 0.1, d - 0.1, z)]
    return made


def gallery():
    """A hall of two storeys with a gallery around its void, and a stair up."""
    made, w, d, z = Building(), 12.0, 10.0, 3.0
    made.box("slab", (0, 0, -0.2), (w, d, 0))
    made.box("roof", (-0.2, -0.2, 6.0), (w + 0.2, d + 0.2, 6.2))
    _outer(made, 0, 0, w, d, 0, 6.0, {2: 5.0})
    x0, x1, y0, y1 = 2.0, 10.0, 2.2, 7.8
    for a, b, c, e in ((0, 0, w, y0), (0, y1, w, d), (0, y0, x0, y1), (x1, y0, w, y1)):
        made.box("gallery", (a, b, z - 0.2), (c, e, z))
    _flight(made, x1 - 16 * 0.28, 4.4, 5.6, 0, z, risers=17)
    for a, b, c, e in ((x0, y0 - 0.04, x1, y0), (x0, y1, x1, y1 + 0.04), (x0 - 0.04, y0, x0, y1),
                       (x1, y0, x1 + 0.04, 4.4), (x1, 5.6, x1 + 0.04, y1)):  # fmt: skip
        made.box("parapet", (a, b, z), (c, e, z + 1.0))
    made.rooms += [(0.1, 0.1, w - 0.1, d - 0.1, 0.0)]
    made.rooms += [(0.1, 0.1, w - 0.1, y0, z), (0.1, y1, w - 0.1, d - 0.1, z)]
    made.rooms += [(0.1, y0, x0, y1, z), (x1, y0, w - 0.1, y1, z)]
    return made


def basement():
    """A cellar under a ground floor on level ground, whose stair goes down inside."""
    made, w, d, pitch = Building(), 8.0, 7.0, 2.7
    low = -pitch
    for a, b, c, e in ((-8, -8, 16, 0), (-8, d, 16, 15), (-8, 0, 0, d), (w, 0, 16, d)):
        made.box("ground", (a, b, low - 0.5), (c, e, -0.05))
    made.box("slab", (-0.1, -0.1, low - 0.2), (w + 0.1, d + 0.1, low))
    x0, x1, y0, y1 = 0.4, 0.4 + 14 * 0.25, 0.3, 1.4
    for a, b, c, e in ((0, 0, w, y0), (0, y1, w, d), (0, y0, x0, y1), (x1, y0, w, y1)):
        made.box("slab", (a, b, -0.25), (c, e, 0))
    _flight(made, x0, y0, y1, low, 0, run=0.25, risers=15)
    _outer(made, 0, 0, w, d, low, -0.25)
    made.wall(1, 5.0, 0.1, d - 0.1, low, -0.25, 0.15, 4.0)
    _outer(made, 0, 0, w, d, 0, 2.6, {1: 6.0})
    made.box("roof", (-0.2, -0.2, 2.6), (w + 0.2, d + 0.2, 2.8))
    made.rooms += [
        (0.1, 0.1, 4.92, d - 0.1, low),
        (5.08, 0.1, w - 0.1, d - 0.1, low),
        (0.1, 0.1, w - 0.1, d - 0.1, 0),
    ]
    return made


def sheets():
    """A corridor with three rooms whose walls, floors and ceilings have no thickness."""
    made = Building()
    quads = []

    def wall(axis, at, start, end, bottom, top):
        if axis == 0:
            quads.append([(start, at, bottom), (end, at, bottom), (end, at, top), (start, at, top)])
        else:
            quads.append([(at, start, bottom), (at, end, bottom), (at, end, top), (at, start, top)])

    def with_door(axis, at, start, end, door):
        wall(axis, at, start, door - DOOR_M / 2, 0, 2.5)
        wall(axis, at, door + DOOR_M / 2, end, 0, 2.5)
        wall(axis, at, door - DOOR_M / 2, door + DOOR_M / 2, 2.05, 2.5)
        made.doorways.append((door - DOOR_M / 2, at - 0.1, door + DOOR_M / 2, at + 0.1, 0.0))

    quads += [[(0, 0, z), (12, 0, z), (12, 6, z), (0, 6, z)] for z in (0.0, 2.5)]
    for at, start, end in ((0, 0, 12), (6, 0, 12)):
        wall(0, at, start, end, 0, 2.5)
    for at in (0, 12):
        wall(1, at, 0, 6, 0, 2.5)
    for at in (4, 8):
        wall(1, at, 1.5, 6, 0, 2.5)
    for k in range(3):
        with_door(0, 1.5, 4 * k, 4 * k + 4, 4 * k + 2)
    made.rooms += [(0, 0, 12, 1.5, 0.0), *((4 * k, 1.5, 4 * k + 4, 6, 0.0) for k in range(3))]
    vertices = np.array(quads, dtype=float).reshape(-1, 3)
    start = 4 * np.arange(len(quads))[:, None, None]
    faces = (start + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    made.mesh = LabelledMesh(vertices, faces, np.zeros(len(faces), np.int32))
    return made


def scene_of(made, name="building", turned_deg=0.0):
    """The scene of a building, turned about the vertical."""
    scene = Scene(made.mesh, (None,), ("model",), name) if hasattr(made, "mesh") else made.scene(name)
    if not turned_deg:
        return scene
    return Scene(
        LabelledMesh(scene.mesh.vertices @ _turn(turned_deg).T, scene.mesh.faces, scene.mesh.face_surface),
        scene.surfaces, scene.surface_names, name,
    )  # fmt: skip


def turned_back(places, turned_deg):
    """Places (n, 3) of a turned scene in the building's own axes."""
    return places @ _turn(turned_deg)


def _turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
