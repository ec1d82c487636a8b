# SPDX-License-Identifier: MIT
"""Shapes of machined parts, made with the geometry kernel, millimetres.

Five parts have been looked at while the division of meshes was made (`TUNING`); ten others (`HELD_OUT`) have
dimensions drawn by a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.run.libraries import import_extra

KINDS = "plane", "cylinder", "cone", "sphere", "torus"
_UP = (0.0, 0.0, 1.0)
_Test = Callable[[FloatArray], bool]


class _Kernel:
    """The geometry kernel's classes by name, each from the module that its name begins with."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_extra(f"OCP.{name.split('_')[0]}", "step"), name)


occ = _Kernel()


def kind_of(surface: Any) -> int:
    """Place among `KINDS` of the kind of a face's surface."""
    kind = surface.GetType()
    return int(getattr(kind, "value", kind))


def sub_shapes(shape: Any, kind: str) -> list[Any]:
    """Faces or edges."""
    walk, found = occ.TopExp_Explorer(shape, getattr(occ.TopAbs_ShapeEnum, f"TopAbs_{kind}")), list[Any]()
    while walk.More():
        found.append(getattr(occ.TopoDS, kind.capitalize())(walk.Current()))
        walk.Next()
    return found


def _frame(place: Sequence[float], axis: Sequence[float]) -> Any:
    return occ.gp_Ax2(occ.gp_Pnt(*map(float, place)), occ.gp_Dir(*map(float, axis)))


def _box(low: Sequence[float], high: Sequence[float]) -> Any:
    corners = [occ.gp_Pnt(*map(float, corner)) for corner in (low, high)]
    return occ.BRepPrimAPI_MakeBox(*corners).Shape()


def _rod(place: Sequence[float], radius: float, length: float, axis: Sequence[float] = _UP) -> Any:
    return occ.BRepPrimAPI_MakeCylinder(_frame(place, axis), float(radius), float(length)).Shape()


def _cone(place: Sequence[float], radii: tuple[float, float], length: float) -> Any:
    return occ.BRepPrimAPI_MakeCone(_frame(place, _UP), float(radii[0]), float(radii[1]), length).Shape()


def _ball(place: Sequence[float], radius: float) -> Any:
    return occ.BRepPrimAPI_MakeSphere(occ.gp_Pnt(*map(float, place)), float(radius)).Shape()


def _ring(height: float, radius: float, tube: float) -> Any:
    return occ.BRepPrimAPI_MakeTorus(_frame((0, 0, height), _UP), float(radius), float(tube)).Shape()


def _cut(shape: Any, *others: Any) -> Any:
    for other in others:
        shape = occ.BRepAlgoAPI_Cut(shape, other).Shape()
    return shape


def _common(shape: Any, other: Any) -> Any:
    return occ.BRepAlgoAPI_Common(shape, other).Shape()


def _fuse(shape: Any, *others: Any) -> Any:
    for other in others:
        shape = occ.BRepAlgoAPI_Fuse(shape, other).Shape()
    joined = occ.ShapeUpgrade_UnifySameDomain(shape, True, True, True)
    joined.Build()
    return joined.Shape()


def _rounded(shape: Any, size: float, chosen: _Test, *, chamfer: bool = False) -> Any:
    """Fillets, or chamfers, on the edges whose middle passes a test."""
    kind = occ.BRepFilletAPI_MakeChamfer if chamfer else occ.BRepFilletAPI_MakeFillet
    made, seen = kind(shape), list[FloatArray]()
    for edge in sub_shapes(shape, "EDGE"):
        curve = occ.BRepAdaptor_Curve(edge)
        middle = np.array(curve.Value((curve.FirstParameter() + curve.LastParameter()) / 2).Coord())
        if chosen(middle) and not any(np.allclose(middle, other, atol=1e-6) for other in seen):
            seen.append(middle)
            made.Add(float(size), edge)
    if not seen:
        raise InputError("no edge to round")
    return made.Shape()


def _prism(outline: Sequence[Sequence[float]], height: float) -> Any:
    """An outline (k, 3) of straight sides, moved up, or along y where it stands."""
    corners = [occ.gp_Pnt(*map(float, corner)) for corner in outline]
    wire = occ.BRepBuilderAPI_MakeWire()
    for one, two in pairwise([*corners, corners[0]]):
        wire.Add(occ.BRepBuilderAPI_MakeEdge(one, two).Edge())
    face = occ.BRepBuilderAPI_MakeFace(wire.Wire()).Face()
    is_flat = np.ptp([corner[2] for corner in outline]) == 0
    way = occ.gp_Vec(0.0, 0.0, height) if is_flat else occ.gp_Vec(0.0, height, 0.0)
    return occ.BRepPrimAPI_MakePrism(face, way).Shape()


def _polar(n: int, radius: float, start: float = 0.0) -> list[tuple[float, float]]:
    angles = start + 2 * np.pi * np.arange(n) / n
    return [(float(radius * np.cos(angle)), float(radius * np.sin(angle))) for angle in angles]


def _at(level: float, axis: int = 2) -> _Test:
    return lambda middle: abs(middle[axis] - level) < 1e-6


def _is_circle(level: float, radius: float) -> _Test:
    return lambda middle: abs(middle[2] - level) < 1e-6 and abs(np.hypot(*middle[:2]) - radius) < 1e-3


# Five parts that the division was made with


def _flange() -> Any:
    shape = _cut(_fuse(_rod((0, 0, 0), 60, 12), _rod((0, 0, 12), 32, 28)), _rod((0, 0, -1), 20, 50))
    for x, y in _polar(6, 46):
        shape = _cut(shape, _rod((x, y, -1), 4.5, 20), _cone((x, y, 9.5), (4.5, 7), 2.5))
    return _rounded(_rounded(shape, 4, _is_circle(12, 32)), 1, _is_circle(40, 32), chamfer=True)


def _bracket() -> Any:
    shape = _fuse(_box((0, 0, 0), (80, 50, 8)), _box((0, 0, 0), (8, 50, 60)))
    holes = [_rod((x, y, -1), 3.3, 20) for x in (30, 65) for y in (12, 38)]
    shape = _cut(shape, *holes, _rod((-1, 25, 40), 9, 20, (1, 0, 0)))
    shape = _rounded(shape, 6, lambda m: _at(8, 0)(m) and _at(8)(m))
    shape = _rounded(shape, 10, lambda m: _at(80, 0)(m) and _at(4)(m) and (_at(0, 1)(m) or _at(50, 1)(m)))
    return _rounded(shape, 2, lambda m: _at(60)(m) and abs(m[0] - 4) < 1e-3, chamfer=True)


def _shaft() -> Any:
    shape = _fuse(_rod((0, 0, 0), 10, 30), _rod((0, 0, 30), 15, 50), _rod((0, 0, 80), 12, 25))
    shape = _cut(shape, _box((-3, 9, 85), (3, 20, 100)), _ring(55, 15.5, 2))
    shape = _cut(shape, _cone((0, 0, -1e-9), (3, 0), 3.0), _rod((0, 0, 90), 2.5, 30))
    shape = _rounded(shape, 1, lambda m: _at(0)(m) and np.hypot(*m[:2]) > 9.9, chamfer=True)
    shape = _rounded(shape, 1.5, _is_circle(30, 10))
    return _rounded(shape, 1, lambda m: _at(105)(m) and np.hypot(*m[:2]) > 11.9, chamfer=True)


def _housing() -> Any:
    shape = _rounded(_box((0, 0, 0), (100, 70, 40)), 12, _at(20))
    shape = _cut(shape, _rounded(_box((6, 6, 5), (94, 64, 50)), 6, _at(27.5)))
    shape = _cut(_fuse(shape, _rod((50, 35, 4), 11, 20)), _rod((50, 35, -1), 5, 40))
    posts = [(x, y) for x in (18, 82) for y in (18, 52)]
    shape = _fuse(shape, *[_rod((x, y, 4), 6, 30) for x, y in posts])
    shape = _cut(shape, *[_rod((x, y, 20), 2, 30) for x, y in posts])
    shape = _cut(shape, _rod((-1, 35, 22), 8, 20, (1, 0, 0)), _box((95, 25, 15), (110, 45, 30)))
    return _rounded(shape, 2, lambda m: _at(0)(m) and np.hypot(m[0] - 50, m[1] - 35) > 20)


def _lug() -> Any:
    shape = _fuse(
        _box((0, -20, 0), (60, 20, 15)), _rod((60, 0, 0), 20, 15), _box((-10, -30, -8), (10, 30, 15))
    )
    shape = _cut(shape, _rod((60, 0, -1), 9, 30), _rod((60, 0, 12), 13, 10))
    shape = _cut(shape, _rod((0, 20, -20), 3.5, 50), _rod((0, -20, -20), 3.5, 50))
    shape = _rounded(shape, 5, lambda m: _at(10, 0)(m) and abs(abs(m[1]) - 20) < 1e-6)
    return _rounded(shape, 1.5, lambda m: (
        _at(15)(m) and m[0] > 10.1
        and (abs(abs(m[1]) - 20) < 1e-6 or bool(np.hypot(m[0] - 60, m[1]) > 19.9))
    ))  # fmt: skip


# Ten parts with dimensions by chance, each a value as a draughtsman might write it


def _draw(rng: np.random.Generator, low: float, high: float, step: float = 0.1) -> float:
    return float(np.round(np.round(rng.uniform(low, high) / step) * step, 6))


def _elbow(rng: np.random.Generator) -> Any:
    """A pipe elbow with two flanges."""
    outer, bend, tall = _draw(rng, 15, 22), _draw(rng, 45, 65), _draw(rng, 8, 12)
    bore, wide, hole = outer - _draw(rng, 3, 5), outer + _draw(rng, 16, 22), _draw(rng, 2.5, 4)
    quarter = [
        occ.BRepPrimAPI_MakeTorus(_frame((0, 0, 0), (0, 1, 0)), bend, tube, np.pi / 2).Shape()
        for tube in (outer, bore)
    ]
    ends = _ends_of(quarter[0])
    shape = quarter[0]
    for place, way in ends:
        shape = _fuse(shape, _rod(place.tolist(), wide, tall, way.tolist()))
    shape = _cut(shape, quarter[1])
    for place, way in ends:
        shape = _cut(shape, _rod(place.tolist(), bore, tall + 1, way.tolist()))
        side = np.cross(way, (0, 1, 0))
        for x, y in _polar(4, (outer + wide) / 2 + 1, np.pi / 4):
            at = place + x * side + y * np.array([0, 1, 0]) - way
            shape = _cut(shape, _rod(at.tolist(), hole, tall + 2, way.tolist()))
    return shape


def _ends_of(shape: Any) -> list[tuple[FloatArray, FloatArray]]:
    """Centre (3,) and outward normal (3,) of the flat faces."""
    ends = []
    for face in sub_shapes(shape, "FACE"):
        surface = occ.BRepAdaptor_Surface(face)
        if KINDS[kind_of(surface)] == "plane":
            known = occ.GProp_GProps()
            occ.BRepGProp.SurfaceProperties_s(face, known)
            way = np.array(surface.Plane().Axis().Direction().Coord())
            sign = -1 if face.Orientation() == occ.TopAbs_Orientation.TopAbs_REVERSED else 1
            ends.append((np.array(known.CentreOfMass().Coord()), sign * way))
    return ends


def _nut(rng: np.random.Generator) -> Any:
    """A hexagon with chamfered corners, a washer face and a bore with countersinks."""
    across, tall = _draw(rng, 18, 46, 1), _draw(rng, 10, 24)
    corner, bore = across / np.sqrt(3), _draw(rng, across / 5, across / 3.4)
    shape = _prism([(x, y, 0.0) for x, y in _polar(6, corner)], tall)
    narrow, wide = across / 2 * 0.95, across / 2 * 0.95 + tall * np.sqrt(3)
    for radii in ((wide, narrow), (narrow, wide)):
        shape = _common(shape, _cone((0, 0, 0), radii, tall))
    shape = _fuse(shape, _rod((0, 0, -0.6), across / 2 * 0.94, 0.6))
    shape = _cut(shape, _rod((0, 0, -2), bore, tall + 4))
    return _cut(shape, _cone((0, 0, tall - 1.5), (bore - 0.5, bore + 1.0), 1.5))


def _stepped_block(rng: np.random.Generator) -> Any:
    """A block with a step, two pockets of round corners, and countersunk holes."""
    long, wide, tall = _draw(rng, 80, 130, 1), _draw(rng, 50, 70, 1), _draw(rng, 25, 40, 1)
    step, low, hole = _draw(rng, 20, 28), _draw(rng, 10, 16), _draw(rng, 2, 3.5)
    shape = _cut(_box((0, 0, 0), (long, wide, tall)), _box((-1, -1, low), (step, wide + 1, tall + 1)))
    deep, corner = _draw(rng, 6, 12), _draw(rng, 3, 6)
    half = (long - step) / 2
    for k in range(2):
        left, right = step + k * half + 7, step + (k + 1) * half - 7
        pocket = _box((left, 10, tall - deep - 3 * k), (right, wide - 10, tall + 5))
        middle = (tall - deep - 3 * k + tall + 5) / 2
        shape = _cut(shape, _rounded(pocket, corner, _at(middle)))
    for y in (wide / 4, 3 * wide / 4):
        shape = _cut(shape, _rod((step / 2, y, -1), hole, low + 2))
        shape = _cut(shape, _cone((step / 2, y, low - 2), (hole, hole + 2), 2.0))
    return _rounded(shape, 1.5, lambda m: _at(tall)(m) and (_at(0, 1)(m) or _at(wide, 1)(m)), chamfer=True)


def _pillow_block(rng: np.random.Generator) -> Any:
    """A bearing housing: a base with drafted sides, a barrel across, ribs, a bore with shoulders."""
    long, wide, base = _draw(rng, 100, 140, 1), _draw(rng, 36, 48, 1), _draw(rng, 10, 15)
    high, barrel = _draw(rng, 45, 60), _draw(rng, 24, 30)
    bore, draft = barrel - _draw(rng, 7, 10), np.tan(np.radians(_draw(rng, 2, 6, 0.5)))
    foot = [(-long / 2, 0, 0), (long / 2, 0, 0), (long / 2 - base * draft, 0, base),
            (-long / 2 + base * draft, 0, base)]  # fmt: skip
    neck = [(-barrel, 0, base), (barrel, 0, base), (barrel - (high - base) * draft, 0, high),
            (-barrel + (high - base) * draft, 0, high)]  # fmt: skip
    shape = _fuse(_prism(foot, wide), _prism(neck, wide), _rod((0, -3, high), barrel, wide + 6, (0, 1, 0)))
    thick = _draw(rng, 4, 7)
    rib = [(-long / 2 + 12, 0, base), (long / 2 - 12, 0, base), (0, 0, high + barrel * 0.4)]
    whole = _prism(rib, thick)
    moved = occ.gp_Trsf()
    moved.SetTranslation(occ.gp_Vec(0.0, (wide - thick) / 2, 0.0))
    shape = _fuse(shape, occ.BRepBuilderAPI_Transform(whole, moved, True).Shape())
    shape = _cut(shape, _rod((0, -5, high), bore, wide + 10, (0, 1, 0)))
    shape = _cut(shape, _rod((0, wide / 4, high), bore + 2.5, wide, (0, 1, 0)))
    feet = [(side * (long / 2 - 7.5), wide / 2, -1) for side in (-1, 1)]
    return _cut(shape, *[_rod(place, _draw(rng, 2.5, 4), base + 2) for place in feet])


def _toothed_disc(rng: np.random.Generator) -> Any:
    """A disc with straight teeth, a hub, a bore with a keyway, and holes in its web."""
    n, root, tall = int(rng.integers(14, 26)), _draw(rng, 30, 42), _draw(rng, 8, 14)
    tooth, hub, bore = _draw(rng, 3, 5), _draw(rng, 14, 18), _draw(rng, 6, 9)
    outline = []
    for k in range(n):
        for radius, share in ((root, -0.3), (root + tooth, -0.14), (root + tooth, 0.14), (root, 0.3)):
            angle = 2 * np.pi * (k + share) / n
            outline.append((radius * np.cos(angle), radius * np.sin(angle), 0.0))
    shape = _fuse(_prism(outline, tall), _rod((0, 0, 0), hub, tall + _draw(rng, 6, 12)))
    shape = _cut(shape, _rod((0, 0, -1), bore, tall + 30), _box((-2, 0, -1), (2, bore + 2.2, tall + 30)))
    middle = (hub + root) / 2
    holes = [_rod((x, y, -1), _draw(rng, 3, 4), tall + 2) for x, y in _polar(5, middle)]
    return _rounded(_cut(shape, *holes), 2, _is_circle(tall, hub))


def _valve_body(rng: np.random.Generator) -> Any:
    """A ball with three pipes and crossing bores, one of them stepped."""
    ball, pipe, reach = _draw(rng, 24, 30), _draw(rng, 13, 17), _draw(rng, 42, 55)
    bore, cross = pipe - _draw(rng, 3, 5), _draw(rng, 5, 7)
    shape = _fuse(_ball((0, 0, 0), ball), _rod((-reach, 0, 0), pipe, 2 * reach, (1, 0, 0)))
    shape = _fuse(shape, _rod((0, 0, 0), pipe - 2, reach), _rod((-reach, 0, 0), pipe + 6, 6, (1, 0, 0)))
    shape = _cut(shape, _rod((-reach - 1, 0, 0), bore, 2 * reach + 2, (1, 0, 0)))
    return _cut(shape, _rod((0, 0, 0), cross, reach + 1), _rod((0, 0, reach - 8), cross + 2, 9))


def _slotted_plate(rng: np.random.Generator) -> Any:
    """A plate with slots and counterbored holes, its corners round."""
    long, wide, tall = _draw(rng, 90, 140, 1), _draw(rng, 50, 80, 1), _draw(rng, 8, 14)
    shape = _rounded(_box((0, 0, 0), (long, wide, tall)), _draw(rng, 5, 9), _at(tall / 2))
    half, width = _draw(rng, 8, 14), _draw(rng, 3, 5)
    for y in (wide * 0.3, wide * 0.7):
        slot = _fuse(
            _box((long / 2 - half, y - width, -1), (long / 2 + half, y + width, tall + 1)),
            *[_rod((long / 2 + side * half, y, -1), width, tall + 2) for side in (-1, 1)],
        )
        shape = _cut(shape, slot)
    hole, deep = _draw(rng, 2.5, 3.5), _draw(rng, 3, 5)
    for x in (14.0, long - 14):
        for y in (14.0, wide - 14):
            shape = _cut(
                shape, _rod((x, y, -1), hole, tall + 2), _rod((x, y, tall - deep), hole + 2, deep + 1)
            )
    return shape


def _knob(rng: np.random.Generator) -> Any:
    """A turned knob: a ball on a conical neck, a collar with two grooves, a blind hole."""
    ball, collar, tall = _draw(rng, 14, 20), _draw(rng, 16, 22), _draw(rng, 16, 24)
    neck, long = _draw(rng, 6, 8), _draw(rng, 18, 26)
    centre = tall + long + 0.8 * ball
    shape = _fuse(_rod((0, 0, 0), collar, tall), _cone((0, 0, tall), (neck + 3, neck), long + 0.3 * ball))
    shape = _fuse(shape, _ball((0, 0, centre), ball))
    for share in (0.3, 0.7):
        shape = _cut(shape, _ring(share * tall, collar + 0.4, _draw(rng, 1.2, 2)))
    deep = _draw(rng, 10, 14)
    shape = _cut(shape, _rod((0, 0, -1), 3, deep + 1), _cone((0, 0, deep - 1e-9), (3, 0), 1.8))
    return _rounded(shape, 1, _is_circle(0, collar), chamfer=True)


def _boss_box(rng: np.random.Generator) -> Any:
    """A box with round upright edges, a chamfered foot, and a round boss on a fillet."""
    long, wide, tall = _draw(rng, 50, 80, 1), _draw(rng, 40, 60, 1), _draw(rng, 18, 30, 1)
    shape = _rounded(_box((0, 0, 0), (long, wide, tall)), _draw(rng, 4, 8), _at(tall / 2))
    shape = _rounded(shape, _draw(rng, 1, 2), _at(0), chamfer=True)
    radius, high, blend = _draw(rng, 9, 13), _draw(rng, 10, 18), _draw(rng, 2, 4)
    x, y = long / 2, wide / 2
    shape = _fuse(shape, _rod((x, y, tall), radius, high))
    is_foot: _Test = lambda m: _at(tall)(m) and abs(np.hypot(m[0] - x, m[1] - y) - radius) < 1e-3  # noqa: E731
    shape = _rounded(shape, blend, is_foot)
    shape = _cut(shape, _rod((x, y, tall - 5), radius - 4, high + 10))
    rim: _Test = lambda m: _at(tall)(m) and np.hypot(m[0] - x, m[1] - y) > radius + blend + 1e-3  # noqa: E731
    return _rounded(shape, _draw(rng, 1, 2.5), rim)


def _bent_sheet(rng: np.random.Generator) -> Any:
    """Sheet metal of one thickness with two bends, and holes."""
    thick, inner = _draw(rng, 1, 2.5), _draw(rng, 1.5, 4)
    long, wide, high, lip = (
        _draw(rng, 40, 60, 1),
        _draw(rng, 25, 40, 1),
        _draw(rng, 25, 40),
        _draw(rng, 14, 20),
    )
    outer = [(0, 0, 0), (long, 0, 0), (long, 0, high), (long + lip, 0, high), (long + lip, 0, high - thick),
             (long + thick, 0, high - thick), (long + thick, 0, -thick), (0, 0, -thick)]  # fmt: skip
    shape = _prism(outer, wide)
    bends = [((long, 0), inner), ((long + thick, -thick), inner + thick),
             ((long + thick, high - thick), inner), ((long, high), inner + thick)]  # fmt: skip
    for (x, z), radius in bends:
        shape = _rounded(shape, radius, lambda m, x=x, z=z: _at(x, 0)(m) and _at(z)(m))  # type: ignore[misc]
    hole = _draw(rng, 2, 4)
    for y in (wide / 4, 3 * wide / 4):
        shape = _cut(shape, _rod((long / 3, y, -thick - 1), hole, thick + 2))
    return _cut(shape, _rod((long - 1, wide / 2, high / 2), hole + 2, thick + 2, (1, 0, 0)))


TUNING: dict[str, Callable[[], Any]] = {
    "flange": _flange, "bracket": _bracket, "shaft": _shaft, "housing": _housing, "lug": _lug,
}  # fmt: skip
HELD_OUT: dict[str, Callable[[np.random.Generator], Any]] = {
    "elbow": _elbow, "nut": _nut, "stepped block": _stepped_block, "pillow block": _pillow_block,
    "toothed disc": _toothed_disc, "valve body": _valve_body, "slotted plate": _slotted_plate, "knob": _knob,
    "boss box": _boss_box, "bent sheet": _bent_sheet,
}  # fmt: skip
