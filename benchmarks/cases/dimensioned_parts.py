# SPDX-License-Identifier: MIT
"""Machined parts at random, with true surfaces and dimensions: plates, flanges, shafts, brackets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Surface, Torus

FAMILIES = ("plate", "flange", "shaft", "bracket")
_AREA_MM2 = 1.2  # of which there is one point
_LEAST = 150  # points of a face
_Hole = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class DimensionedPart:
    """A part: points (n, 3), the true face (n,) of each, faces' surfaces, and what it was built to.

    `meant` are kinds and values, millimetres or degrees.
    """

    points: FloatArray
    face: IntArray
    surfaces: tuple[Surface, ...]
    meant: tuple[tuple[str, float], ...]


class _Builder:
    """Faces that are added to a part, in millimetres."""

    def __init__(self, seed: int, area_mm2: float) -> None:
        self._seed, self._area_mm2 = seed, area_mm2
        self.rng = np.random.default_rng([490, seed])
        self.points: list[FloatArray] = []
        self.surfaces: list[Surface] = []
        self.meant: list[tuple[str, float]] = []

    def size(self, low: float, high: float) -> float:
        """A length: most are round, some are not."""
        step = self.rng.choice([1.0, 0.5, 0.1, 0.0], p=[0.5, 0.15, 0.15, 0.2])
        value = float(self.rng.uniform(low, high))
        return value if step == 0 else float(np.rint(value / step) * step)

    def _add(self, surface: Surface, points: FloatArray) -> None:
        self.points.append(points)
        self.surfaces.append(surface)

    def _count(self, area: float) -> int:
        return max(int(area / self._area_mm2), _LEAST)

    def plane(
        self, corner: object, u: object, v: object, holes: Sequence[_Hole] = (), disc: _Hole | None = None
    ) -> None:
        """A parallelogram from a corner along two sides, or within it a disc, without holes in (u, v) mm."""
        base, one, two = (np.array(each, dtype=np.float64) for each in (corner, u, v))
        size = np.array([np.linalg.norm(one), np.linalg.norm(two)])
        n = self._count(float(np.linalg.norm(np.cross(one, two))))
        uv = self.rng.uniform(0, 1, (n, 2)) * size
        keep = np.ones(n, dtype=np.bool_)
        if disc is not None:
            keep &= np.hypot(uv[:, 0] - disc[0], uv[:, 1] - disc[1]) < disc[2]
        for x, y, r in holes:
            keep &= np.hypot(uv[:, 0] - x, uv[:, 1] - y) > r
        uv = uv[keep] / size
        self._add(Plane(base, np.cross(one, two)), base + uv[:, :1] * one + uv[:, 1:] * two)

    def disc(self, height: float, inner: float, outer: float, holes: Sequence[_Hole] = ()) -> None:
        """A ring across z about the z axis; holes by their x and y."""
        side = np.array([2 * outer, 0, 0]), np.array([0, 2 * outer, 0])
        shifted = [(x + outer, y + outer, r) for x, y, r in (*holes, (0.0, 0.0, inner))]
        self.plane((-outer, -outer, height), *side, holes=shifted, disc=(outer, outer, outer))

    def cylinder(
        self, point: object, direction: object, radius: float, length: float,
        arc: tuple[float, float] = (0.0, 2 * np.pi), zero: object | None = None,
    ) -> None:  # fmt: skip
        """A cylinder from a point on its axis on, over an arc from `zero`."""
        surface = Cylinder(point, direction, radius, zero)
        n = self._count(radius * (arc[1] - arc[0]) * length)
        angle, height = self.rng.uniform(*arc, n), self.rng.uniform(0, length, n)
        side = np.cross(surface.direction, surface.zero_direction)
        out = np.cos(angle)[:, None] * surface.zero_direction + np.sin(angle)[:, None] * side
        self._add(surface, surface.point + radius * out + height[:, None] * surface.direction)

    def cone(self, height: float, low: float, high: float, length: float) -> None:
        """A cone about z from a height on, its radius from `low` to `high`."""
        n, widest = self._count(np.pi * abs(high**2 - low**2)), max(low, high)
        share = np.sqrt(self.rng.uniform((min(low, high) / widest) ** 2, 1.0, n))
        radius = share * widest
        z = height + (radius - low) / (high - low) * length
        angle = self.rng.uniform(0, 2 * np.pi, len(radius))
        middle = (low + high) / 2
        way = np.array([0, 0, 1.0 if high > low else -1.0])
        surface = Cone((0, 0, height + length / 2), way, middle, float(np.arctan(abs(high - low) / length)))
        self._add(surface, np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z]))

    def ring_fillet(self, height: float, ring: float, tube: float, arc: tuple[float, float]) -> None:
        """Part of a torus about z: angles about its tube from outwards towards z."""
        n = self._count(2 * np.pi * ring * tube * (arc[1] - arc[0]))
        angle, about = self.rng.uniform(0, 2 * np.pi, n), self.rng.uniform(*arc, n)
        away = ring + tube * np.cos(about)
        points = np.column_stack([away * np.cos(angle), away * np.sin(angle), height + tube * np.sin(about)])
        self._add(Torus((0, 0, height), (0, 0, 1), ring, tube), points)

    def hole(self, x: float, y: float, r: float, top: float, depth: float, through: bool) -> None:
        """A hole along z from a height down; a blind one has a floor."""
        self.cylinder((x, y, top - depth), (0, 0, 1), r, depth)
        if not through:
            self.plane((x - r, y - r, top - depth), (2 * r, 0, 0), (0, 2 * r, 0), disc=(r, r, r))

    def built(self, noise_mm: float) -> DimensionedPart:
        """The part, turned at random, with noise in all directions; metres."""
        axis = self.rng.normal(size=4)
        w, x, y, z = axis / np.linalg.norm(axis)
        turn = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        pose = Pose.from_parts(turn, self.rng.uniform(-0.1, 0.1, 3))
        points = np.concatenate(self.points)
        noise = np.random.default_rng([491, self._seed, round(1e6 * noise_mm)])  # another at each
        points = points + noise.normal(0, noise_mm, points.shape)
        face = np.repeat(np.arange(len(self.points)), [len(each) for each in self.points])
        order = self.rng.permutation(len(points))
        surfaces = tuple(_in_metres(surface).transform(pose) for surface in self.surfaces)
        return DimensionedPart(pose.apply(points / 1000)[order], face[order], surfaces, tuple(self.meant))


def _in_metres(surface: object) -> Surface:
    match surface:
        case Plane():
            return Plane(surface.point / 1000, surface.normal_direction)
        case Cylinder():
            return Cylinder(surface.point / 1000, surface.direction, surface.radius / 1000)
        case Cone():
            return Cone(surface.point / 1000, surface.direction, surface.radius / 1000, surface.half_angle)
        case Torus():
            return Torus(
                surface.centre / 1000, surface.direction, surface.radius / 1000, surface.tube_radius / 1000
            )
    raise TypeError(type(surface))


def dimensioned_part(seed: int, noise_mm: float, area_mm2: float = _AREA_MM2) -> DimensionedPart:
    """Return a part by seed, with whose families go round; a point stands for so much area."""
    build = _Builder(seed, area_mm2)
    {"plate": _plate, "flange": _flange, "shaft": _shaft, "bracket": _bracket}[
        FAMILIES[seed % len(FAMILIES)]
    ](build)
    return build.built(noise_mm)


def _plate(build: _Builder) -> None:
    """A plate with a raised block, holes in a grid or a row, through or blind, and a bore."""
    rng = build.rng
    length, width, thick = build.size(80, 120), build.size(50, 75), build.size(8, 14)
    radius, columns, rows = build.size(6, 9) / 2, int(rng.integers(3, 5)), int(rng.integers(1, 3))
    pitch, across = build.size(16, 20), build.size(20, 26)
    is_through, depth = bool(rng.integers(2)), build.size(4, 6)
    first = np.array([build.size(10, 14), build.size(9, 13)])
    holes = [
        (first[0] + i * pitch, first[1] + j * across, radius) for i in range(columns) for j in range(rows)
    ]
    rise, block = build.size(6, 12), build.size(10, 14)
    holes = [hole for hole in holes if hole[0] + radius + 3 < length - block]
    for x, y, r in holes:
        build.hole(x, y, r, thick, thick if is_through else depth, is_through)
    edge = length - block
    build.plane((0, 0, thick), (edge, 0, 0), (0, width, 0), holes)
    build.plane(
        (0, width, 0),
        (length, 0, 0),
        (0, -width, 0),
        [(x, width - y, r) for x, y, r in holes] if is_through else (),
    )
    top = thick + rise
    build.plane((edge, 0, top), (block, 0, 0), (0, width, 0))
    build.plane((edge, 0, thick), (0, 0, rise), (0, width, 0))
    build.plane((length, 0, 0), (0, width, 0), (0, 0, top))
    build.plane((0, 0, 0), (0, 0, thick), (0, width, 0))
    for y in (0.0, width):
        build.plane((0, y, 0), (edge, 0, 0), (0, 0, thick))
        build.plane((edge, y, 0), (block, 0, 0), (0, 0, top))
    build.meant += [("overall size", length), ("overall size", width), ("overall size", top),
                    ("thickness", thick), ("hole diameter", 2 * radius), ("pitch", pitch)]  # fmt: skip
    build.meant += [("pitch", across)] if rows > 1 else []
    build.meant += [] if is_through else [("hole depth", depth)]
    build.meant += (
        [("axis to plane", float(first[1]))] if first[1] < width - first[1] - (rows - 1) * across else []
    )


def _flange(build: _Builder) -> None:
    """A flange with a hub, a bore and holes on a circle."""
    rng = build.rng
    outer, hub, bore = build.size(50, 64), build.size(26, 32), build.size(12, 20)
    thick, high, radius = build.size(8, 14), build.size(22, 40), build.size(6, 10) / 2
    n, ring, start = int(rng.integers(4, 9)), build.size(39, 43), float(rng.uniform(0, 1))
    angle = start + 2 * np.pi * np.arange(n) / n
    holes = [(ring * np.cos(a), ring * np.sin(a), radius) for a in angle]
    for x, y, r in holes:
        build.hole(x, y, r, thick, thick, through=True)
    build.disc(0, bore, outer, holes)
    build.disc(thick, hub, outer, holes)
    build.disc(high, bore, hub)
    build.cylinder((0, 0, 0), (0, 0, 1), bore, high)
    build.cylinder((0, 0, 0), (0, 0, 1), outer, thick)
    build.cylinder((0, 0, thick), (0, 0, 1), hub, high - thick)
    build.meant += [("outer diameter", 2 * outer), ("outer diameter", 2 * hub), ("hole diameter", 2 * bore),
                    ("hole diameter", 2 * radius), ("pitch circle diameter", 2 * ring), ("thickness", thick),
                    ("overall size", high)]  # fmt: skip


def _shaft(build: _Builder) -> None:
    """A shaft of three steps, one with a fillet, a chamfer at its end and a bore with a drill's cone."""
    radii = [build.size(9, 12), build.size(15, 19), build.size(25, 30)]
    lengths = [build.size(20, 30), build.size(25, 35), build.size(15, 30)]
    fillet, chamfer, drill, depth = build.size(4, 6), build.size(2, 3), build.size(3.5, 5), build.size(14, 20)
    z = np.cumsum([0.0, *lengths])
    build.cylinder((0, 0, 0), (0, 0, 1), radii[2], lengths[0])
    build.cylinder((0, 0, z[1] + fillet), (0, 0, 1), radii[1], lengths[1] - fillet)
    build.cylinder((0, 0, z[2]), (0, 0, 1), radii[0], lengths[2] - chamfer)
    build.disc(0, 0, radii[2])
    build.disc(z[1], radii[1] + fillet, radii[2])
    build.ring_fillet(z[1] + fillet, radii[1] + fillet, fillet, (np.pi, 1.5 * np.pi))
    build.disc(z[2], radii[0], radii[1])
    build.cone(z[3] - chamfer, radii[0], radii[0] - chamfer, chamfer)
    build.disc(z[3], drill, radii[0] - chamfer)
    build.cylinder((0, 0, z[3] - depth), (0, 0, 1), drill, depth)
    tip = drill / np.tan(np.radians(59.0))
    build.cone(z[3] - depth - tip, 0.0, drill, tip)
    build.meant += [("outer diameter", 2 * r) for r in radii]
    build.meant += [("overall size", float(z[3])), ("fillet radius", fillet), ("cone angle", 118.0),
                    ("cone angle", 90.0), ("hole diameter", 2 * drill), ("hole depth", depth),
                    ("step", lengths[2])]  # fmt: skip


def _bracket(build: _Builder) -> None:
    """An L with a fillet inside, a sloping end and holes in both legs."""
    rng = build.rng
    length, width, high = build.size(70, 90), build.size(40, 60), build.size(50, 70)
    thick, fillet, radius = build.size(7, 10), build.size(5, 8), build.size(6, 9) / 2
    bore, slope = build.size(12, 18) / 2, float(rng.uniform(25, 40))
    y = build.size(9, 11)
    gap = width - 2 * y
    x = build.size(30, 36)
    holes = [(x, y, radius), (x, y + gap, radius), (x + gap, y, radius), (x + gap, y + gap, radius)]
    run = thick / np.tan(np.radians(slope))  # of the sloping end
    holes = [hole for hole in holes if hole[0] + radius + 3 < length - run]
    for each in holes:
        build.hole(*each, thick, thick, through=True)
    build.plane((thick + fillet, 0, thick), (length - run - thick - fillet, 0, 0), (0, width, 0),
                [(a - thick - fillet, b, r) for a, b, r in holes])  # fmt: skip
    build.plane((0, width, 0), (length, 0, 0), (0, -width, 0), [(a, width - b, r) for a, b, r in holes])
    build.plane((length, 0, 0), (0, width, 0), (-run, 0, thick))
    place = (width / 2, (high + thick) / 2 + 4)
    build.plane((0, 0, 0), (0, 0, high), (0, width, 0), [(place[1], place[0], bore)])
    build.plane((thick, 0, thick + fillet), (0, width, 0), (0, 0, high - thick - fillet),
                [(place[0], place[1] - thick - fillet, bore)])  # fmt: skip
    build.plane((0, 0, high), (thick, 0, 0), (0, width, 0))
    build.cylinder((thick + fillet, 0, thick + fillet), (0, 1, 0), fillet, width, (-np.pi / 2, 0), (-1, 0, 0))
    build.cylinder((0, *place), (1, 0, 0), bore, thick)
    for side in (0.0, width):
        build.plane((0, side, thick), (thick, 0, 0), (0, 0, high - thick))
        build.plane((0, side, 0), (length - run, 0, 0), (0, 0, thick))
    build.meant += [("overall size", width), ("overall size", high), ("hole diameter", 2 * bore),
                    ("hole diameter", 2 * radius), ("fillet radius", fillet), ("angle", slope),
                    ("thickness", thick)]  # fmt: skip
