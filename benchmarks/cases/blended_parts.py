# SPDX-License-Identifier: MIT
"""Parts at random with rounded edges and corners of known radii: prisms, turned parts, blocks and pockets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
import shapely

from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus

FAMILIES = ("prism", "turned", "block")
_AREA_MM2 = 0.35  # of which there is one point
_RADII_MM = (1.0, 8.0)
_ROUNDED, _KINKED = 0.7, 0.15  # of the edges of prisms and turned parts: blends, and arcs that are none
_KINK = (1.15, 1.6)  # by which the radius of such an arc is greater than a blend's between the same ends
_MOST_CUT = 0.3  # of an edge's length, that a blend at one end takes
_FINE = 200  # chords of an arc where points are told to be inside
_MM = 1e-3


class TrueBlend(NamedTuple):
    """A blend: its face, those it lies between, by their places, its radius in metres, and its kind."""

    face: int
    supports: tuple[int, ...]
    radius_m: float
    kind: str


@dataclass(frozen=True, slots=True, eq=False)
class BlendedPart:
    """A part: points (n, 3), the true face (n,) of each, the faces' surfaces, and its blends; metres."""

    points: FloatArray
    face: IntArray
    surfaces: tuple[Surface, ...]
    blends: tuple[TrueBlend, ...]


class _Builder:
    """Faces that are added to a part, in metres."""

    def __init__(self, seed: int, area_mm2: float) -> None:
        self.rng, self.area = np.random.default_rng([530, seed]), area_mm2 * _MM**2
        self.points: list[FloatArray] = []
        self.surfaces: list[Surface] = []
        self.blends: list[TrueBlend] = []

    def add(self, surface: Surface, points: FloatArray) -> int:
        """Add a face; return its place."""
        self.surfaces.append(surface)
        self.points.append(points)
        return len(self.surfaces) - 1

    def count(self, area: float) -> int:
        """How many points an area has."""
        return max(int(area / self.area), 8)

    def length(self, low: float, high: float) -> float:
        """A length between two in millimetres; metres."""
        return float(self.rng.uniform(low, high)) * _MM

    def built(self, seed: int, noise_mm: float) -> BlendedPart:
        """The part turned at random, with noise along all axes."""
        u, v = np.linalg.qr(self.rng.normal(size=(3, 3)))
        turn = u * np.sign(np.diag(v))
        turn[:, 0] *= np.sign(np.linalg.det(turn))
        pose = Pose.from_parts(turn, self.rng.uniform(-0.1, 0.1, 3))
        points = pose.apply(np.concatenate(self.points))
        face = np.repeat(np.arange(len(self.points)), [len(each) for each in self.points])
        order = self.rng.permutation(len(points))
        noise = np.random.default_rng([531, seed, round(1e6 * noise_mm)])
        points = points[order] + noise.normal(0, noise_mm * _MM, points.shape)
        surfaces = tuple(surface.transform(pose) for surface in self.surfaces)
        return BlendedPart(points, face[order], surfaces, tuple(self.blends))


class _Outline(NamedTuple):
    """A polygon's sides between its blends: ends (n, 2, 2), and at each side's end a centre and a radius.

    `turn` (n,) is positive where the polygon is convex there; a radius of 0 is a sharp corner. An arc that
    is no blend (`is_blend`) meets its sides at an angle.
    """

    sides: FloatArray
    centre: FloatArray
    radius: FloatArray
    turn: FloatArray
    is_blend: BoolArray

    def arc(self, k: int, share: FloatArray) -> FloatArray:
        """Points (m, 2) of the arc at the end of side k, by shares (m,) of its angle."""
        first, last = self.sides[k, 1], self.sides[(k + 1) % len(self.sides), 0]
        begin, end = (np.arctan2(*(each - self.centre[k])[::-1]) for each in (first, last))
        angle = begin + share * ((end - begin + np.pi) % (2 * np.pi) - np.pi)
        return np.asarray(self.centre[k] + self.radius[k] * np.column_stack([np.cos(angle), np.sin(angle)]))

    def sweep(self, k: int) -> float:
        """The angle of that arc."""
        return float(2 * np.arcsin(np.clip(np.linalg.norm(np.diff(self.arc(k, np.array([0.0, 1.0])), axis=0))
                                           / (2 * self.radius[k]), 0, 1)))  # fmt: skip

    def polygon(self) -> shapely.Polygon:
        """The whole, its arcs by chords."""
        share = np.linspace(0, 1, _FINE)
        rings = [
            [side, self.arc(k, share)] if self.radius[k] else [side] for k, side in enumerate(self.sides)
        ]
        return shapely.Polygon(np.concatenate([each for ring in rings for each in ring]))


def _outline(corners: FloatArray, rng: np.random.Generator) -> _Outline:
    """A polygon (n, 2), counterclockwise, some of its corners rounded."""
    n = len(corners)
    along = np.roll(corners, -1, axis=0) - corners  # side k from corner k on
    length = np.linalg.norm(along, axis=1)
    along /= length[:, None]
    sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    centre, radius, turns, is_blend = np.zeros((n, 2)), np.zeros(n), np.zeros(n), np.ones(n, dtype=np.bool_)
    for k in range(n):
        two = (k + 1) % n
        cross = along[k, 0] * along[two, 1] - along[k, 1] * along[two, 0]
        turn = float(np.arctan2(cross, along[k] @ along[two]))
        turns[k], share = turn, np.tan(abs(turn) / 2)
        most = _MOST_CUT * min(length[k], length[two]) / share
        wanted, drawn, kink = rng.uniform(*_RADII_MM) * _MM, rng.random(), rng.uniform(*_KINK)
        if drawn > _ROUNDED + _KINKED or most < _RADII_MM[0] * _MM:
            continue
        radius[k] = min(wanted, most)
        cut = radius[k] * share
        sides[k, 1], sides[two, 0] = corners[two] - cut * along[k], corners[two] + cut * along[two]
        normal = np.array([-along[k, 1], along[k, 0]]) * np.sign(turn)
        centre[k] = sides[k, 1] + radius[k] * normal
        if drawn > _ROUNDED:
            is_blend[k], radius[k] = False, kink * radius[k]
            middle = (sides[k, 1] + sides[two, 0]) / 2
            inwards = (centre[k] - middle) / np.linalg.norm(centre[k] - middle)
            half = np.linalg.norm(sides[two, 0] - middle)
            centre[k] = middle + np.sqrt(radius[k] ** 2 - half**2) * inwards
    return _Outline(sides, centre, radius, turns, is_blend)


def _blend(build: _Builder, outline: _Outline, k: int, place: int, side: dict[int, int]) -> None:
    if not outline.is_blend[k]:
        return
    kind = "round" if outline.turn[k] > 0 else "fillet"
    supports = (side[k], side[(k + 1) % len(outline.sides)])
    build.blends.append(TrueBlend(place, supports, float(outline.radius[k]), kind))


def _prism(build: _Builder) -> None:
    """An L of random angles, its upright edges rounded."""
    rng, mm = build.rng, build.length
    a, b, c, d = mm(50, 70), mm(20, 30), mm(18, 26), mm(45, 60)
    corners = np.array([(0, 0), (a, 0), (a, c), (b, c), (b, d), (0, d)])
    outline = _outline(corners + rng.uniform(-6, 6, corners.shape) * _MM, rng)
    high, place = mm(20, 35), dict[int, int]()

    def lifted(section: FloatArray) -> FloatArray:
        return np.column_stack([section, rng.uniform(0, high, len(section))])

    for k, (first, last) in enumerate(outline.sides):
        way = last - first
        share = rng.uniform(0, 1, build.count(float(np.linalg.norm(way)) * high))
        place[k] = build.add(Plane([*first, 0], (way[1], -way[0], 0)), lifted(first + share[:, None] * way))
    for k in np.flatnonzero(outline.radius).tolist():
        n = build.count(outline.radius[k] * outline.sweep(k) * high)
        surface = Cylinder([*outline.centre[k], 0], (0, 0, 1), outline.radius[k])
        _blend(build, outline, k, build.add(surface, lifted(outline.arc(k, rng.uniform(0, 1, n)))), place)
    section = outline.polygon()
    low, size = np.array(section.bounds[:2]), np.array(section.bounds[2:]) - section.bounds[:2]
    for z in (0.0, high):
        spread = low + rng.uniform(0, 1, (build.count(float(np.prod(size))), 2)) * size
        inside = spread[shapely.contains_xy(section, *spread.T)]
        build.add(Plane((0, 0, z), (0, 0, 1 if z else -1)), np.insert(inside, 2, z, axis=1))


def _turned(build: _Builder) -> None:
    """A turned part with a bore, steps and a taper, its shoulders rounded."""
    rng, mm = build.rng, build.length
    bore, inner, outer, rim = mm(9, 12), mm(18, 22), mm(24, 30), mm(36, 46)
    z = np.cumsum([mm(10, 16), mm(14, 22), mm(12, 20)])
    taper = mm(2, 6) if rng.random() < 0.5 else 0.0
    corners = np.array([(bore, 0), (rim, 0), (rim, z[0]), (outer, z[0]), (outer - taper, z[1]),
                        (inner - taper, z[1]), (inner - taper, z[2]), (bore, z[2])])  # fmt: skip
    outline, place = _outline(corners, rng), dict[int, int]()

    def spun(section: FloatArray) -> FloatArray:
        turn = rng.uniform(0, 2 * np.pi, len(section))
        return np.column_stack([section[:, 0] * np.cos(turn), section[:, 0] * np.sin(turn), section[:, 1]])

    def drawn(section: FloatArray) -> FloatArray:
        """Those (m, 2) of a section that make a revolved face even, as rings are the longer the wider."""
        return section[rng.uniform(0, section[:, 0].max(), len(section)) < section[:, 0]]

    for k, (first, last) in enumerate(outline.sides):
        way = last - first
        widest = max(first[0], last[0])
        share = rng.uniform(0, 1, build.count(2 * np.pi * widest * float(np.linalg.norm(way))))
        place[k] = build.add(_revolved(first, last), spun(drawn(first + share[:, None] * way)))
    for k in np.flatnonzero(outline.radius).tolist():
        ring, tube = float(outline.centre[k, 0]), float(outline.radius[k])
        n = build.count(2 * np.pi * (ring + tube) * tube * outline.sweep(k))
        surface = Torus((0, 0, outline.centre[k, 1]), (0, 0, 1), ring, tube)
        number = build.add(surface, spun(drawn(outline.arc(k, rng.uniform(0, 1, n)))))
        _blend(build, outline, k, number, place)


def _revolved(first: FloatArray, last: FloatArray) -> Surface:
    (r, z), (s, w) = first, last
    if abs(w - z) < 1e-9:
        return Plane((0, 0, z), (0, 0, 1))
    if abs(s - r) < 1e-9:
        return Cylinder((0, 0, z), (0, 0, 1), r)
    way = (0, 0, 1.0 if (s - r) * (w - z) > 0 else -1.0)
    return Cone((0, 0, (z + w) / 2), way, (r + s) / 2, float(np.arctan(abs((s - r) / (w - z)))))


def _block(build: _Builder) -> None:
    """A skew block whose edges and corners a ball of one radius rounds; or a pocket like it in a box."""
    rng, r = build.rng, float(build.rng.uniform(*_RADII_MM)) * _MM
    is_pocket = bool(rng.integers(2))
    slant = np.eye(3) + np.triu(rng.uniform(-0.3, 0.3, (3, 3)), 1)
    edge = slant / np.linalg.norm(slant, axis=1, keepdims=True) * rng.uniform(10, 18, (3, 1)) * _MM
    normals = np.array([np.cross(edge[(k + 1) % 3], edge[(k + 2) % 3]) for k in range(3)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kind, place = ("fillet" if is_pocket else "round"), dict[tuple[int, int], int]()
    for k, side in product(range(3), (-1, 1)):
        one, two = edge[(k + 1) % 3], edge[(k + 2) % 3]
        base = side * (edge[k] + r * normals[k])
        share = rng.uniform(-1, 1, (build.count(4 * float(np.linalg.norm(np.cross(one, two)))), 2))
        place[k, side] = build.add(Plane(base, side * normals[k]), base + share @ np.stack([one, two]))
    for k, one, two in ((k, one, two) for k in range(3) for one, two in product((-1, 1), repeat=2)):
        i, j = (k + 1) % 3, (k + 2) % 3
        axis, ways = one * edge[i] + two * edge[j], np.stack([one * normals[i], two * normals[j]])
        arc = float(np.arccos(ways[0] @ ways[1]))
        side_way = (ways[1] - np.cos(arc) * ways[0]) / np.sin(arc)
        n = build.count(2 * float(np.linalg.norm(edge[k])) * r * arc)
        angle, share = rng.uniform(0, arc, (n, 1)), rng.uniform(-1, 1, (n, 1))
        points = axis + r * (np.cos(angle) * ways[0] + np.sin(angle) * side_way) + share * edge[k]
        number = build.add(Cylinder(axis, edge[k], r), points)
        build.blends.append(TrueBlend(number, (place[i, one], place[j, two]), r, kind))
    for signs in product((-1, 1), repeat=3):
        ways = np.array(signs)[:, None] * normals
        ball = rng.normal(size=(build.count(4 * np.pi * r * r), 3))
        ball /= np.linalg.norm(ball, axis=1, keepdims=True)
        inside = (np.linalg.solve(ways.T, ball.T) > 0).all(axis=0)  # in the cone of the three normals
        centre = np.array(signs) @ edge
        number = build.add(Sphere(centre, r), centre + r * ball[inside])
        supports = tuple(place[k, sign] for k, sign in enumerate(signs))
        build.blends.append(TrueBlend(number, supports, r, "corner ball"))
    if is_pocket:
        half = np.abs(edge).sum(axis=0) + r + rng.uniform(3, 6, 3) * _MM
        for k, side in product(range(3), (-1, 1)):
            base, i, j = side * half[k] * np.eye(3)[k], (k + 1) % 3, (k + 2) % 3
            points = np.repeat(base[None], build.count(4 * half[i] * half[j]), axis=0)
            points[:, [i, j]] = rng.uniform(-1, 1, (len(points), 2)) * half[[i, j]]
            build.add(Plane(base, side * np.eye(3)[k]), points)


def blended_part(seed: int, noise_mm: float, area_mm2: float = _AREA_MM2) -> BlendedPart:
    """Return a part by seed, with whose families go round; a point stands for so much area."""
    build = _Builder(seed, area_mm2)
    {"prism": _prism, "turned": _turned, "block": _block}[FAMILIES[seed % len(FAMILIES)]](build)
    return build.built(seed, noise_mm)
