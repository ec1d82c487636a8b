# SPDX-License-Identifier: MIT
"""Solids and pieces of furniture as named, coloured triangles that are seen from outside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.surfaces.surface import perpendicular
from scenes.world.scene import Scene

_RING = 14  # corners around what is turned
_SMOOTH = 30  # around what is thick: on a radius of 13 cm the sagitta is 0.7 mm


def box(low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Return the triangles (12, 3, 3) of an upright box by two opposite corners, metres."""
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    ring = [(a[0], a[1]), (b[0], a[1]), (b[0], b[1]), (a[0], b[1])]
    return prism(ring, float(a[2]), float(b[2]))


def quads(rings: ArrayLike) -> FloatArray:
    """Return the triangles (2 n, 3, 3) of quadrilaterals (n, 4, 3)."""
    corners = np.asarray(rings, dtype=np.float64).reshape(-1, 4, 3)
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def prism(ring: Sequence[Sequence[float]] | FloatArray, low: float, high: float) -> FloatArray:
    """Return the triangles of the upright prism over a convex, counter-clockwise ring (n, 2), metres."""
    plan = np.asarray(ring, dtype=np.float64)
    foot = np.column_stack([plan, np.full(len(plan), low)])
    head = np.column_stack([plan, np.full(len(plan), high)])
    ahead = np.roll(foot, -1, axis=0)
    sides = quads(np.stack([foot, ahead, np.roll(head, -1, axis=0), head], axis=1))
    fan = [[0, k, k + 1] for k in range(1, len(plan) - 1)]
    return np.concatenate([sides, foot[fan][:, ::-1], head[fan]])


def slab(shape: BaseGeometry, low: float, high: float) -> FloatArray:
    """Return the triangles of an upright prism over any polygon, with holes or without, metres."""
    flat = triangles_of(shape)
    head = np.concatenate([flat, np.full((*flat.shape[:2], 1), high)], axis=2)
    foot = np.concatenate([flat, np.full((*flat.shape[:2], 1), low)], axis=2)[:, ::-1]
    sides = []
    for ring in (ring for part in parts_of(shape) for ring in (part.exterior, *part.interiors)):
        places = np.asarray(ring.coords)[:, :2]
        a, b = places[:-1], places[1:]
        low_a, low_b = (np.column_stack([p, np.full(len(p), low)]) for p in (a, b))
        high_a, high_b = (np.column_stack([p, np.full(len(p), high)]) for p in (a, b))
        sides.append(quads(np.stack([low_a, low_b, high_b, high_a], axis=1)))
    return np.concatenate([head, foot, *sides])


def parts_of(shape: BaseGeometry) -> list[shapely.Polygon]:
    """Return the polygons of a shape, outer rings counter-clockwise and holes clockwise."""
    pieces = shapely.get_parts(shape)
    kept = [one for one in pieces if isinstance(one, shapely.Polygon) and one.area > 1e-8]
    return [shapely.orient_polygons(one) for one in kept]


def triangles_of(shape: BaseGeometry) -> FloatArray:
    """Return triangles (n, 3, 2), counter-clockwise, that make up polygons."""
    found = [
        np.asarray(one.exterior.coords)[:3, :2]
        for part in parts_of(shape)
        for one in shapely.constrained_delaunay_triangles(part).geoms
    ]
    corners = np.asarray(found, dtype=np.float64).reshape(-1, 3, 2)
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    twice = ax * by - ay * bx
    turned = np.where((twice < 0)[:, None, None], corners[:, ::-1], corners)
    return np.asarray(turned[np.abs(twice) > 1e-12])


def lathe(profile: ArrayLike, n: int = _RING) -> FloatArray:
    """Return the triangles of what a profile (k, 2) of radius and height sweeps about z.

    The profile goes up along the outside; where it begins and ends at radius 0 the shape is closed.
    """
    radius, height = np.asarray(profile, dtype=np.float64).T
    angle = 2 * np.pi * np.arange(n + 1) / n
    angle[-1] = 0.0
    x, y = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    grid = np.stack([x, y, np.broadcast_to(height[:, None], x.shape)], axis=-1)
    return grid_triangles(grid)


def grid_triangles(grid: FloatArray) -> FloatArray:
    """Return the triangles of a grid of places (rows, columns, 3), those without area left out."""
    ring = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
    corners = quads(ring)
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(corners[np.linalg.norm(twice, axis=1) > 1e-10])


def tube(
    foot: ArrayLike, head: ArrayLike, radius: float, head_radius: float | None = None, *, n: int = _RING
) -> FloatArray:
    """Return the triangles of a closed round rod, or of a blunt cone, from one end to the other, metres."""
    length = float(np.linalg.norm(np.subtract(head, foot)))
    top = radius if head_radius is None else head_radius
    return _along(lathe([(0, 0), (radius, 0), (top, length), (0, length)], n), foot, head)


def capsule(foot: ArrayLike, head: ArrayLike, radius: float, head_radius: float | None = None) -> FloatArray:
    """Return the triangles of a rod with round ends; its ends are the centres of their spheres."""
    length = float(np.linalg.norm(np.subtract(head, foot)))
    top = radius if head_radius is None else head_radius
    turn = np.linspace(0, np.pi / 2, 8)
    below = np.column_stack([radius * np.sin(turn), -radius * np.cos(turn)])
    above = np.column_stack([top * np.cos(turn), length + top * np.sin(turn)])
    below[0, 0] = above[-1, 0] = 0.0
    return _along(lathe(np.concatenate([below, above]), _SMOOTH), foot, head)


def cushion(low: ArrayLike, high: ArrayLike, *, power: float = 0.35, n: int = 36) -> FloatArray:
    """Return the triangles of a box with soft edges (a superquadric; Barr 1981): 1 a ball, 0 a box."""
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    turn, rise = 2 * np.pi * np.arange(n + 1) / n, np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1)
    turn[-1] = 0.0

    def soft(value: FloatArray) -> FloatArray:
        return np.sign(value) * np.abs(np.where(np.abs(value) < 1e-12, 0.0, value)) ** power

    ring = np.stack([soft(np.cos(turn)), soft(np.sin(turn))], axis=-1)
    flat = soft(np.cos(rise))[:, None, None] * ring
    high_z = np.broadcast_to(soft(np.sin(rise))[:, None, None], (*flat.shape[:2], 1))
    return grid_triangles((a + b) / 2 + np.concatenate([flat, high_z], axis=-1) * (b - a) / 2)


def sheet(grid: FloatArray, thickness: float) -> FloatArray:
    """Return the triangles of a closed sheet around places (rows, columns, 3), metres thick."""
    across = np.cross(np.gradient(grid, axis=1), np.gradient(grid, axis=0))
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    half = across / np.maximum(length, 1e-12) * thickness / 2
    front, back = grid + half, grid - half
    edges = []
    for near, far in ((front, back),):
        for row in (0, -1):
            edges.append(_strip(near[row], far[row], reverse=row == 0))
            edges.append(_strip(near[:, row], far[:, row], reverse=row == -1))
    return np.concatenate([grid_triangles(front), grid_triangles(back)[:, ::-1], *edges])


def _strip(near: FloatArray, far: FloatArray, *, reverse: bool) -> FloatArray:
    ring = np.stack([near[:-1], near[1:], far[1:], far[:-1]], axis=1)
    return quads(ring[:, ::-1] if reverse else ring)


def _along(corners: FloatArray, foot: ArrayLike, head: ArrayLike) -> FloatArray:
    """Turn what stands on the origin so that it goes from `foot` towards `head`."""
    start, end = np.asarray(foot, dtype=np.float64), np.asarray(head, dtype=np.float64)
    axis = (end - start) / np.linalg.norm(end - start)
    first = perpendicular(axis)
    return np.asarray(corners @ np.stack([first, np.cross(axis, first), axis]) + start)


def volume(corners: FloatArray) -> float:
    """Return the volume in cubic metres that triangles (m, 3, 3) enclose: negative when turned inside."""
    a, b, c = np.moveaxis(corners, 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Triangles with one name."""

    name: str  # what it is
    corners: FloatArray  # (m, 3, 3) float: Metres, counter-clockwise seen from outside
    tint: FloatArray | Colour  # (3,) or (m, 3) float: sRGB in 0..1


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of furniture in its own frame.

    x goes along the wall, its middle at 0, y away from the wall, which is at 0, z up from the floor.
    """

    parts: tuple[Part, ...]  # what it is made of
    # level places on it where things can stand
    tops: tuple[tuple[float, float, float, float, float], ...] = ()

    @cached_property
    def bounds(self) -> FloatArray:
        """Smallest and largest coordinates (2, 3), metres."""
        corners = np.concatenate([one.corners.reshape(-1, 3) for one in self.parts])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


def joined(name: str, solids: Iterable[FloatArray], tint: FloatArray | Colour) -> Part:
    """Return several solids as one part."""
    return Part(name, np.concatenate(list(solids)), tint)


def motion(at: Sequence[float], yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Return the (4, 4) that tilts about x (pitch) and y (roll), turns about z (yaw), moves to `at`."""
    (cz, cx, cy), (sz, sx, sy) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = about_z @ about_x @ about_y, at
    return whole


def moved(parts: Iterable[Part], move: FloatArray, prefix: str = "") -> tuple[Part, ...]:
    """Return parts moved by a rigid (4, 4), their names after `prefix`."""
    return tuple(
        replace(one, name=prefix + one.name, corners=one.corners @ move[:3, :3].T + move[:3, 3])
        for one in parts
    )


def centred(piece: Piece) -> Piece:
    """Return a piece with the middle of its bounds at x = y = 0."""
    x, y = piece.bounds.mean(axis=0)[:2]
    tops = tuple((x0 - x, y0 - y, x1 - x, y1 - y, z) for x0, y0, x1, y1, z in piece.tops)
    return Piece(moved(piece.parts, motion((-x, -y, 0))), tops)


def scene_of(name: str, parts: Sequence[Part]) -> Scene:
    """Return parts as a scene, each with its name; parts of the same name are numbered."""
    corners = np.concatenate([one.corners for one in parts])
    number = np.repeat(np.arange(len(parts), dtype=np.int32), [len(one.corners) for one in parts])
    tint = np.concatenate([np.broadcast_to(one.tint, (len(one.corners), 3)) for one in parts])
    vertices, index = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    colours = np.repeat(np.clip(tint, 0, 1).astype(np.float32)[:, None], 3, axis=1)
    mesh = LabelledMesh(vertices, index.reshape(-1, 3).astype(np.int32), number, Appearance(colours))
    seen: dict[str, int] = {}
    names = []
    for one in parts:
        seen[one.name] = seen.get(one.name, 0) + 1
        names.append(one.name if seen[one.name] == 1 else f"{one.name} ({seen[one.name]})")
    return Scene(mesh, (None,) * len(parts), tuple(names), name)


def wood(rng: np.random.Generator) -> Colour:
    """Return the colour of some wood."""
    return _shade(np.array([[0.62, 0.42, 0.24], [0.80, 0.64, 0.44], [0.38, 0.24, 0.15]]), rng)


def paint(rng: np.random.Generator) -> Colour:
    """Return the colour of painted board: mostly nearly white."""
    return _shade(np.array([[0.92, 0.91, 0.88], [0.86, 0.86, 0.84], [0.55, 0.62, 0.62]]), rng)


def cloth(rng: np.random.Generator) -> Colour:
    """Return the colour of some cloth."""
    red, green, blue = rng.uniform(0.2, 0.85, 3)
    grey = (red + green + blue) / 3
    return (red + grey) / 2, (green + grey) / 2, (blue + grey) / 2


def _shade(palette: FloatArray, rng: np.random.Generator) -> Colour:
    red, green, blue = palette[rng.integers(len(palette))] * rng.uniform(0.85, 1.08)
    return min(red, 1.0), min(green, 1.0), min(blue, 1.0)


STEEL: Colour = (0.62, 0.65, 0.68)
WHITE: Colour = (0.93, 0.93, 0.91)
DARK: Colour = (0.14, 0.14, 0.15)
