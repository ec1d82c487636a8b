# SPDX-License-Identifier: MIT
"""Parts: named, coloured triangles, how they are moved, and pieces of furniture made of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.world.scene import Scene

Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Triangles with one name.

    Attributes
    ----------
    name : str
        What it is.
    corners : (m, 3, 3) float
        Metres, counter-clockwise seen from outside.
    tint : (3,) or (m, 3) float
        sRGB in 0..1.
    """

    name: str
    corners: FloatArray
    tint: FloatArray | Colour


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of furniture in its own frame.

    x goes along the wall, its middle at 0, y away from the wall, which is at 0, z up from the floor.

    Attributes
    ----------
    parts : tuple of Part
        What it is made of.
    tops : tuple of (x0, y0, x1, y1, z)
        Level places on it where things can stand.
    """

    parts: tuple[Part, ...]
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
