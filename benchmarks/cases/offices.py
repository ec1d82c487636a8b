# SPDX-License-Identifier: MIT
"""Offices: rooms on both sides of a corridor, walls in layers of drywall, suspended ceilings, pipes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from benchmarks.cases.asbuilt import Building
from benchmarks.cases.houses.solids import box, tube
from scenes.checks import FloatArray
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh

_WIDE, _DEEP, _HALL = 3.6, 5.0, 2.0  # of rooms along and across the corridor; half of it is `_HALL` / 2
_HIGH, _CEILING, _SLAB = 3.2, 2.7, 0.25  # of storeys, suspended ceilings, slabs
_OUTER, _INNER, _BOARD = 0.3, 0.1, 0.038  # thick walls, partitions, furring
_DOOR, _DOOR_HIGH, _WINDOW, _SILL, _HEAD = 0.95, 2.1, 1.6, 0.9, 2.3
_GAP = 0.003  # between a leaf or pane and its frame: no shared corners
_GLASS = 0.2  # opacity

Solids = list[FloatArray]
Part = tuple[str, str, Solids, Solids]  # class, name, solids, panes


@cache
def office() -> Building:
    """Return an office of 18 rooms: more than 300 elements, 23 stations."""
    return office_design(9, seed=1)


@cache
def large_office() -> Building:
    """Return an office of 60 rooms: about 1,000 elements."""
    return office_design(30, seed=2)


def office_design(n_rooms: int, seed: int) -> Building:
    """Return an office with `n_rooms` on each side of its corridor; `seed` furnishes it.

    Its frame: x along the corridor, whose middle is y = 0, floors at z = 0; metres.
    """
    rng = np.random.default_rng([20282, seed])
    parts = [one for k in range(n_rooms) for one in _bay(k)] + list(_ends(n_rooms))
    furniture = [one for k in range(n_rooms) for side in (-1.0, 1.0) for one in _furniture(k, side, rng)]
    stations = [
        [(k + rng.uniform(0.4, 0.6)) * _WIDE, side * (_HALL / 2 + rng.uniform(0.45, 0.55) * _DEEP), 1.6]
        for k in range(n_rooms)
        for side in (-1.0, 1.0)
    ]
    stations += [[(k + 0.5) * _WIDE, 0.1, 1.6] for k in range(0, n_rooms, 2)]
    return Building(f"office {seed}", _design(parts), tuple(furniture), np.array(stations))


def _design(parts: list[Part]) -> ElementMesh:
    solid = [np.concatenate([*solids, *panes]) for *_, solids, panes in parts]
    clear = [
        np.repeat([1.0, _GLASS], [sum(map(len, solids)), sum(map(len, panes))]) for *_, solids, panes in parts
    ]
    number = np.repeat(np.arange(len(parts), dtype=np.int32), [len(one) for one in solid])
    vertices, index = np.unique(np.concatenate(solid).reshape(-1, 3).round(9), axis=0, return_inverse=True)
    grey = np.full((len(number), 3, 3), 0.7, np.float32)
    look = Appearance(grey, opacity=np.concatenate(clear).astype(np.float32))
    mesh = LabelledMesh(vertices, index.reshape(-1, 3).astype(np.int32), number, look)
    return ElementMesh(mesh, tuple(Element(name, ifc_class) for ifc_class, name, *_ in parts), "office")


def _bay(k: int) -> Iterator[Part]:
    """Yield the elements of the bay number k: a room on either side, a piece of corridor between."""
    a, b = k * _WIDE, (k + 1) * _WIDE
    edge, half = _HALL / 2 + _DEEP, _HALL / 2
    yield "IfcSlab", f"Slab {k}", [box([a, -edge - _OUTER, -_SLAB], [b, edge + _OUTER, 0])], []
    yield "IfcSlab", f"Roof {k}", [box([a, -edge - _OUTER, _HIGH], [b, edge + _OUTER, _HIGH + _SLAB])], []
    yield "IfcCovering", f"Corridor ceiling {k}", [box([a, -half, 2.5], [b, half, 2.52])], []
    pipe = [tube([a, 0.6, 2.35], [b, 0.6, 2.35], 0.055, n=36)]
    yield "IfcPipeSegment", f"Corridor pipe {k}", pipe, []
    for side, letter in ((-1.0, "A"), (1.0, "B")):
        for ifc_class, name, solids, panes in _room(k, half, edge):
            flipped = [[_across(one, side) for one in some] for some in (solids, panes)]
            yield ifc_class, f"{name} {letter}{k}", flipped[0], flipped[1]


def _across(corners: FloatArray, side: float) -> FloatArray:
    """Triangles on the other side of the corridor, where `side` is negative."""
    return corners if side > 0 else (corners * [1.0, -1.0, 1.0])[:, ::-1]


def _room(k: int, near: float, far: float) -> Iterator[Part]:
    """Yield the elements of a room beyond the corridor's wall at y = near, up to the facade at y = far."""
    a, b = k * _WIDE, (k + 1) * _WIDE
    left, right, middle = a + _INNER, b, (a + b) / 2
    window = middle - _WINDOW / 2, _SILL, middle + _WINDOW / 2, _HEAD
    door = a + 0.6, 0.0, a + 0.6 + _DOOR, _DOOR_HIGH
    inside = far - _BOARD
    yield "IfcWall", "Facade", _pierced(a, b, (far, far + _OUTER), _HIGH, window), []
    yield "IfcWall", "Furring of facade", _pierced(left + _BOARD, b, (inside, far), _CEILING, window), []
    yield "IfcWall", "Corridor wall", _pierced(a, b, (near, near + _INNER), _HIGH, door), []
    yield "IfcWall", "Partition", [box([a, near + _INNER, 0], [left, far, _HIGH])], []
    yield "IfcWall", "Furring of partition", [
        box([left, near + _INNER, 0], [left + _BOARD, far, _CEILING])
    ], []  # fmt: skip
    yield "IfcCovering", "Suspended ceiling", [
        box([left, near + _INNER, _CEILING], [right, far, _CEILING + 0.02])
    ], []  # fmt: skip
    yield "IfcCovering", "Floor finish", [
        box([left + _BOARD, near + _INNER, 0], [right, inside, 0.015])
    ], []  # fmt: skip
    yield "IfcWindow", "Window", *_filled(window, far + 0.1, 0.05, 0.012)
    frame, leaf = _filled(door, near + 0.03, 0.06, 0.04)
    yield "IfcDoor", "Door", frame + leaf, []
    yield "IfcCovering", "Skirting", [
        box([left + _BOARD, inside - 0.012, 0.015], [right, inside, 0.1])
    ], []  # fmt: skip
    y = far - 0.6
    if k % 2:
        yield (
            "IfcColumn",
            "Round column",
            [tube([right - 0.5, y, 0], [right - 0.5, y, _HIGH], 0.18, n=48)],
            [],
        )
    else:
        yield "IfcColumn", "Column", [box([right - 0.65, y - 0.15, 0], [right - 0.35, y + 0.15, _HIGH])], []
    x = left + _BOARD + 0.09
    yield "IfcPipeSegment", "Riser", [tube([x, y, 0.02], [x, y, _HIGH - 0.02], 0.045, n=36)], []
    yield "IfcBeam", "Beam", [box([a, near + 2.4, _CEILING + 0.1], [b, near + 2.6, _HIGH])], []
    yield "IfcLightFixture", "Light", [
        box([middle - 0.6, near + 3.4, _CEILING - 0.06], [middle + 0.6, near + 3.7, _CEILING])
    ], []  # fmt: skip
    yield "IfcFurniture", "Built-in shelf", [
        box([left + _BOARD, near + 0.9, 1.2], [left + _BOARD + 0.25, near + 2.1, 1.225])
    ], []  # fmt: skip


def _pierced(
    a: float, b: float, across: tuple[float, float], high: float, hole: tuple[float, float, float, float]
) -> Solids:
    """Return a wall from x = a to b with a rectangular hole, x and z of two of its corners."""
    (y0, y1), (x0, z0, x1, z1) = across, hole
    whole = [
        box([a, y0, 0], [x0, y1, high]), box([x1, y0, 0], [b, y1, high]), box([x0, y0, z1], [x1, y1, high])
    ]  # fmt: skip
    return whole + ([box([x0, y0, 0], [x1, y1, z0])] if z0 > 0 else [])


def _filled(
    hole: tuple[float, float, float, float], y: float, thick: float, inner: float
) -> tuple[Solids, Solids]:
    """Return the frame in a hole and what it holds, a leaf or a pane of thickness `inner`."""
    x0, z0, x1, z1 = hole
    low = z0 if z0 == 0 else z0 + thick
    frame = [
        box([x0, y, z0], [x0 + thick, y + thick, z1]), box([x1 - thick, y, z0], [x1, y + thick, z1]),
        box([x0 + thick, y, z1 - thick], [x1 - thick, y + thick, z1]),
    ]  # fmt: skip
    frame += [box([x0 + thick, y, z0], [x1 - thick, y + thick, low])] if z0 > 0 else []
    foot = [x0 + thick + _GAP, y + 0.005, low + _GAP]
    return frame, [box(foot, [x1 - thick - _GAP, y + 0.005 + inner, z1 - thick - _GAP])]


def _ends(n_rooms: int) -> Iterator[Part]:
    """Yield what closes the building at both ends."""
    edge, last = _HALL / 2 + _DEEP + _OUTER, n_rooms * _WIDE
    yield "IfcWall", "End 1", [box([-_OUTER, -edge, 0], [0, edge, _HIGH])], []
    yield "IfcWall", "End 2", [box([last, -edge, 0], [last + _OUTER, edge, _HIGH])], []


def _furniture(k: int, side: float, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield a desk with its legs, a cupboard and a carton of a room."""
    x, y = (k + 0.5) * _WIDE + rng.uniform(-0.3, 0.3), _HALL / 2 + _DEEP - rng.uniform(1.2, 1.6)
    solids = [box([x - 0.8, y - 0.4, 0.72], [x + 0.8, y + 0.4, 0.75])]
    solids += [
        box([x + u - 0.03, y + v - 0.03, 0.015], [x + u + 0.03, y + v + 0.03, 0.72])
        for u in (-0.75, 0.75)
        for v in (-0.35, 0.35)
    ]
    at, high = (k + 1) * _WIDE - 0.45, rng.uniform(1.1, 2.0)
    foot = _HALL / 2 + rng.uniform(0.5, 1.2)
    solids.append(box([at, foot, 0.015], [at + 0.4, foot + rng.uniform(0.8, 1.6), high]))
    yield _across(np.concatenate(solids), side)
