# SPDX-License-Identifier: MIT
"""Points of junctions and elbows with known truth, and of surfaces that are none; millimetres."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.checks import FloatArray

N_POINTS = 3_000


@dataclass(frozen=True)
class Truth:
    """What points were made of."""

    points: np.ndarray  # (n, 3) float: In any order and pose
    # of the two surfaces, the smaller first, inf for a plane; or of the bend and the tube
    radii: tuple[float, ...] = ()
    # (3,) float: A point of the line where they touch, or where the axes of an elbow cross
    joint: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (3,) float: Along it, or across the bend
    angle: float = np.nan  # of a bend, radians


def posed(
    local: FloatArray, truth: Truth, *, rng: np.random.Generator, sigma: float, outliers: float
) -> Truth:
    """The points anywhere, with noise and a share of outliers in the box about them, a tenth larger."""
    low, high = local.min(axis=0), local.max(axis=0)
    points = local + rng.normal(0, sigma, local.shape)
    wrong = rng.uniform(size=len(points)) < outliers
    margin = 0.1 * (high - low)
    points[wrong] = rng.uniform(low - margin - 3 * sigma, high + margin + 3 * sigma, (wrong.sum(), 3))
    turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    shift = rng.uniform(-500, 500, 3)
    order = rng.permutation(len(points))
    joint = turn @ truth.joint + shift
    return Truth(points[order] @ turn.T + shift, truth.radii, joint, turn @ truth.axis, truth.angle)


def junction(
    rng: np.random.Generator,
    sigma: float,
    outliers: float,
    *,
    radii: tuple[float, float] = (25.0, 40.0),
    is_s_shaped: bool = True,
    n: int = N_POINTS,
    arc_deg: float = 60.0,
) -> Truth:
    """Two cylinders, or a cylinder and a plane, that touch along a line 60 long."""
    lengths = [np.radians(arc_deg) * r if np.isfinite(r) else 30.0 for r in radii]
    along = rng.uniform(-lengths[0], lengths[1], n)
    x, y = np.zeros(n), along.copy()
    for radius, which, sign in (
        (radii[0], along < 0, 1.0),
        (radii[1], along >= 0, -1.0 if is_s_shaped else 1.0),
    ):
        if np.isfinite(radius):
            x[which] = sign * radius * (np.cos(along[which] / radius) - 1)
            y[which] = radius * np.sin(along[which] / radius)
    local = np.column_stack([x, y, rng.uniform(-30, 30, n)])
    truth = Truth(local, radii, np.zeros(3), np.array([0.0, 0, 1]))
    return posed(local, truth, rng=rng, sigma=sigma, outliers=outliers)


def elbow(
    rng: np.random.Generator,
    sigma: float,
    outliers: float,
    *,
    bend: float = 75.0,
    tube: float = 25.0,
    angle_deg: float = 90.0,
    n: int = N_POINTS,
) -> Truth:
    """A bend between two straight tubes of 60, seen from one side: 160 degrees of the tube's circle."""
    half = np.radians(angle_deg) / 2
    total = 2 * half * bend + 120.0
    along = rng.uniform(-total / 2, total / 2, n)
    seen = rng.uniform(0, 2 * np.pi)
    around = seen + np.radians(rng.uniform(-80, 80, n))
    turn = np.clip(along / bend, -half, half)
    beyond = along - turn * bend
    out = bend + tube * np.cos(around)
    x = out * np.cos(turn) - beyond * np.sin(turn)
    y = out * np.sin(turn) + beyond * np.cos(turn)
    local = np.column_stack([x, y, tube * np.sin(around)])
    corner = np.array([bend / np.cos(half), 0.0, 0.0])
    truth = Truth(local, (bend, tube), corner, np.array([0.0, 0, 1]), 2 * half)
    return posed(local, truth, rng=rng, sigma=sigma, outliers=outliers)


def plain(kind: str, rng: np.random.Generator, sigma: float, outliers: float, n: int = N_POINTS) -> Truth:
    """A surface that is neither: plane, cylinder, sphere, or two planes that cross in an edge."""
    u, v = rng.uniform(-1, 1, (2, n))
    if kind == "plane":
        local = np.column_stack([40 * u, 30 * v, np.zeros(n)])
    elif kind == "cylinder":
        radius, arc = rng.uniform(20, 60), np.radians(rng.uniform(30, 90))
        local = np.column_stack([radius * np.cos(arc * u), radius * np.sin(arc * u), 30 * v])
    elif kind == "sphere":
        radius, up = rng.uniform(25, 60), rng.uniform(0.3, 1, n)
        level = np.sqrt(1 - up**2)
        local = radius * np.column_stack([level * np.cos(np.pi * u), level * np.sin(np.pi * u), up])
    else:
        lean = np.radians(rng.uniform(20, 70))
        local = np.column_stack([-35 * np.abs(u) * np.sin(lean), 35 * u * np.cos(lean), 30 * v])
    return posed(local, Truth(local), rng=rng, sigma=sigma, outliers=outliers)


PLAIN = ("plane", "cylinder", "sphere", "edge")
