# SPDX-License-Identifier: MIT
"""Free-form surfaces between planes and cylinders, drawn at random, as points with noise; millimetres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from completion.fitting.patches.joins import Boundary, JoinKind
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane

At = Callable[[FloatArray, FloatArray], FloatArray]
"""From two parameters (n,) in [0, 1] to points (n, 3)."""

WALL, FLOOR, END = Plane((0, 0, 0), (1, 0, 0)), Plane((0, 0, 0), (0, 0, 1)), Plane((0, 0, 0), (0, 1, 0))
_RADIUS = 50.0


@dataclass(frozen=True, slots=True, eq=False)
class PatchCase:
    """Points (n, 3), where they would be without noise (n, 3), and what is around them."""

    points: FloatArray
    exact: FloatArray
    boundaries: dict[str, Boundary]


def blend(rng: np.random.Generator) -> tuple[At, dict[str, Boundary]]:
    """Tangent to a wall and a floor, at right angles to an end."""
    radius, growth, wave = rng.uniform(25, 45), rng.uniform(-10, 20), rng.uniform(1, 4)
    waves = int(rng.integers(1, 3))

    def at(u: FloatArray, v: FloatArray) -> FloatArray:
        turn, size = u * np.pi / 2, radius + growth * v**2
        swell = wave * np.sin(2 * turn) ** 2 * np.cos(waves * np.pi * v)
        x, z = size * (1 - np.cos(turn)), size * (1 - np.sin(turn))
        return np.column_stack([x + swell * np.cos(turn), 100 * v, z + swell * np.sin(turn)])

    return at, {
        "u0": Boundary(WALL, JoinKind.TANGENT),
        "u1": Boundary(FLOOR, JoinKind.TANGENT),
        "v0": Boundary(END, JoinKind.ORTHOGONAL),
    }


def dome(rng: np.random.Generator) -> tuple[At, dict[str, Boundary]]:
    """A rise of a floor, tangent to it all round."""
    height, lean = rng.uniform(8, 20), rng.uniform(-0.5, 0.5)

    def at(u: FloatArray, v: FloatArray) -> FloatArray:
        x, y = 2 * u - 1, 2 * v - 1
        rise = height * ((1 - x**2) * (1 - y**2)) ** 2 * (1 + lean * x)
        return np.column_stack([70 * x, 45 * y, rise])

    return at, dict.fromkeys(("u0", "u1", "v0", "v1"), Boundary(FLOOR, JoinKind.TANGENT))


def cover(rng: np.random.Generator) -> tuple[At, dict[str, Boundary]]:
    """A curved cover of a box: connected to two walls, at right angles to the two others."""
    height, tilt, bend = rng.uniform(10, 25), rng.uniform(-0.3, 0.3), rng.uniform(3, 8)

    def at(u: FloatArray, v: FloatArray) -> FloatArray:
        rise = height * np.sin(np.pi * u) + 60 * tilt * u + bend * np.cos(2 * np.pi * v) * (1 + u)
        return np.column_stack([90 * u, 60 * v, rise])

    walls = {"u0": WALL, "u1": Plane((90, 0, 0), (1, 0, 0)), "v0": END, "v1": Plane((0, 60, 0), (0, 1, 0))}
    joins = {
        "u0": JoinKind.CONNECTED,
        "u1": JoinKind.CONNECTED,
        "v0": JoinKind.ORTHOGONAL,
        "v1": JoinKind.ORTHOGONAL,
    }
    return at, {side: Boundary(walls[side], joins[side]) for side in walls}


def collar(rng: np.random.Generator) -> tuple[At, dict[str, Boundary]]:
    """Tangent to a tube and to the floor that it stands on, at right angles to an end."""
    radius, growth, wave = rng.uniform(15, 25), rng.uniform(2, 10), rng.uniform(0.5, 2)
    span = np.radians(rng.uniform(30, 120))

    def at(u: FloatArray, v: FloatArray) -> FloatArray:
        turn, about = u * np.pi / 2, span * v
        size = radius + growth * np.sin(2 * about) ** 2
        swell = wave * np.sin(2 * turn) ** 2 * np.cos(4 * about)
        reach = _RADIUS + size * (1 - np.cos(turn)) + swell * np.cos(turn)
        z = size * (1 - np.sin(turn)) + swell * np.sin(turn)
        return np.column_stack([reach * np.cos(about), reach * np.sin(about), z])

    tube = Cylinder((0, 0, 0), (0, 0, 1), _RADIUS)
    return at, {
        "u0": Boundary(tube, JoinKind.TANGENT),
        "u1": Boundary(FLOOR, JoinKind.TANGENT),
        "v0": Boundary(END, JoinKind.ORTHOGONAL),
    }


def flange(rng: np.random.Generator) -> tuple[At, dict[str, Boundary]]:
    """At right angles to a tube, between it and a wider one that it is connected to."""
    wave, waves, lift = rng.uniform(2, 6), rng.uniform(1, 3), rng.uniform(0, 8)
    span = np.radians(rng.uniform(30, 120))

    def at(u: FloatArray, v: FloatArray) -> FloatArray:
        about, reach = span * v, _RADIUS + 30 * u
        z = wave * np.sin(waves * about) + lift * u**2
        return np.column_stack([reach * np.cos(about), reach * np.sin(about), z])

    inner, outer = (Cylinder((0, 0, 0), (0, 0, 1), radius) for radius in (_RADIUS, _RADIUS + 30))
    return at, {"u0": Boundary(inner, JoinKind.ORTHOGONAL), "u1": Boundary(outer, JoinKind.CONNECTED)}


KINDS = {"blend": blend, "dome": dome, "cover": cover, "collar": collar, "flange": flange}
"""By name; collars and flanges meet cylinders, the others planes alone."""


def case_of(kind: str, seed: int, sigma: float, n: int) -> PatchCase:
    """A case with n points off by sigma along the normal, turned and moved at random."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    at, boundaries = KINDS[kind](rng)
    u, v = rng.uniform(0, 1, (2, n))
    step = 1e-5
    along, across = at(u + step, v) - at(u - step, v), at(u, v + step) - at(u, v - step)
    normals = np.cross(along, across)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-200, 200, 3)
    world = Pose(pose)
    moved = {side: replace(one, surface=one.surface.transform(world)) for side, one in boundaries.items()}
    exact = at(u, v)
    return PatchCase(
        world.apply(exact + sigma * rng.normal(size=(n, 1)) * normals), world.apply(exact), moved
    )
