# SPDX-License-Identifier: MIT
"""Parts put together from sampled primitives: the surface of every point is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus

Keep = Callable[[np.ndarray], np.ndarray]
Face = tuple[
    Surface, tuple[float, float, float, float], Keep | None
]  # surface, bounds of its chart, what is there
UP = (0, 0, 1)


def sampled(
    faces: list[Face], spacing: float, sigma: float, seed: int
) -> tuple[np.ndarray, np.ndarray, list[Surface]]:
    """Points (n, 3) about `spacing` apart with noise, moved anyhow; their faces (n,) from 1; the surfaces."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = Pose.from_parts(turn * np.sign(np.linalg.det(turn)), rng.uniform(-1, 1, 3))
    points, labels = [], []
    for number, (surface, (u0, u1, v0, v1), keep) in enumerate(faces, start=1):
        shape = max(1, round((u1 - u0) / spacing)), max(1, round((v1 - v0) / spacing))
        cells = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 2)
        inside = (cells + 0.5 + rng.uniform(-0.3, 0.3, cells.shape)) / shape
        uv = [u0, v0] + inside * [u1 - u0, v1 - v0]
        some = surface.from_uv(uv)
        some = some if keep is None else some[keep(some)]
        points.append(some)
        labels.append(np.full(len(some), number))
    order = rng.permutation(sum(len(some) for some in points))
    cloud = pose.apply(np.concatenate(points)[order])
    return (
        cloud + sigma * rng.normal(size=cloud.shape),
        np.concatenate(labels)[order],
        [surface.transform(pose) for surface, _, _ in faces],
    )


def turn_of(radius: float) -> tuple[float, float]:
    """Bounds of a whole turn in arc length."""
    return -np.pi * radius, np.pi * radius


def ring(inner: float, outer: float) -> Keep:
    """What lies between two circles about the z axis."""
    return lambda points: (
        (np.hypot(points[:, 0], points[:, 1]) >= inner) & (np.hypot(points[:, 0], points[:, 1]) <= outer)
    )


def plate() -> list[Face]:
    """100 x 60 x 10 mm with two bores of 10 and 16 mm radius."""
    bores = [(-0.025, 0.0, 0.010), (0.025, 0.0, 0.016)]

    def solid(points: np.ndarray) -> np.ndarray:
        away = [np.hypot(points[:, 0] - x, points[:, 1] - y) >= r for x, y, r in bores]
        return np.all(away, axis=0)

    half = (-0.05, 0.05, -0.03, 0.03)
    faces: list[Face] = [
        (Plane((0, 0, 0.005), UP, (1, 0, 0)), half, solid),
        (Plane((0, 0, -0.005), UP, (1, 0, 0)), half, solid),
    ]
    for side in (-1, 1):
        faces.append((Plane((side * 0.05, 0, 0), (1, 0, 0), (0, 1, 0)), (-0.03, 0.03, -0.005, 0.005), None))
        faces.append((Plane((0, side * 0.03, 0), (0, 1, 0), (1, 0, 0)), (-0.05, 0.05, -0.005, 0.005), None))
    faces += [(Cylinder((x, y, 0), UP, r), (*turn_of(r), -0.005, 0.005), None) for x, y, r in bores]
    return faces


def shaft() -> list[Face]:
    """Two diameters, a fillet of 6 mm between them, a chamfer, a shoulder, and both ends."""
    fillet = Torus((0, 0, 0.046), UP, 0.021, 0.006, concave=True)
    inward = (np.pi, 1.5 * np.pi)  # the quarter that looks to the axis and down
    return [
        (Plane((0, 0, 0), UP), (-0.03, 0.03, -0.03, 0.03), ring(0, 0.03)),
        (Cylinder((0, 0, 0), UP, 0.03), (*turn_of(0.03), 0, 0.04), None),
        (Plane((0, 0, 0.04), UP), (-0.03, 0.03, -0.03, 0.03), ring(0.021, 0.03)),
        (fillet, (*turn_of(0.021), *(0.006 * angle for angle in inward)), None),
        (Cylinder((0, 0, 0), UP, 0.015), (*turn_of(0.015), 0.046, 0.08), None),
        (
            Cone((0, 0, 0.0825), (0, 0, -1), 0.0125, np.pi / 4),
            (-0.03, 0.03, -0.03, 0.03),
            heights(0.08, 0.085),
        ),
        (Plane((0, 0, 0.085), UP), (-0.01, 0.01, -0.01, 0.01), ring(0, 0.01)),
    ]


def heights(low: float, high: float) -> Keep:
    """What lies between two heights."""
    return lambda points: (points[:, 2] >= low) & (points[:, 2] <= high)


def flange() -> list[Face]:
    """A disk with four bolt holes about a hub with a bore."""
    holes = [(0.035 * np.cos(t), 0.035 * np.sin(t)) for t in np.arange(4) * np.pi / 2]

    def solid(inner: float) -> Keep:
        def keep(points: np.ndarray) -> np.ndarray:
            away = [np.hypot(points[:, 0] - x, points[:, 1] - y) >= 0.006 for x, y in holes]
            return ring(inner, 0.05)(points) & np.all(away, axis=0)

        return keep

    square = (-0.05, 0.05, -0.05, 0.05)
    faces: list[Face] = [
        (Plane((0, 0, 0), UP), square, solid(0.012)),
        (Plane((0, 0, 0.012), UP), square, solid(0.02)),
        (Cylinder((0, 0, 0), UP, 0.05), (*turn_of(0.05), 0, 0.012), None),
        (Cylinder((0, 0, 0), UP, 0.02), (*turn_of(0.02), 0.012, 0.04), None),
        (Cylinder((0, 0, 0), UP, 0.012, concave=True), (*turn_of(0.012), 0, 0.04), None),
        (Plane((0, 0, 0.04), UP), square, ring(0.012, 0.02)),
    ]
    return faces + [
        (Cylinder((x, y, 0), UP, 0.006, concave=True), (*turn_of(0.006), 0, 0.012), None) for x, y in holes
    ]


def knob() -> list[Face]:
    """A ball on a cone on a foot."""
    return [
        (Sphere((0, 0, 0.06), 0.02), (*turn_of(0.02), -0.0265, 0.0314), heights(0.0427, 0.08)),
        (Cone((0, 0, 0.02), (0, 0, -1), 0.017, 0.3), (-0.06, 0.06, -0.06, 0.06), heights(0.0, 0.0427)),
        (Plane((0, 0, 0), UP), (-0.03, 0.03, -0.03, 0.03), ring(0, 0.0232)),
    ]


PARTS = {"plate": plate, "shaft": shaft, "flange": flange, "knob": knob}
