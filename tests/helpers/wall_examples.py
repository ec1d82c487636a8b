# SPDX-License-Identifier: MIT
"""Small walls with relief and ripple: height maps, and meshes that have them."""

from __future__ import annotations

from functools import cache

import numpy as np

from benchmarks.cases.relief import smooth
from completion.fitting.result import SurfaceFit
from scenes.surfaces.catalogue import Plane

SHAPE, CELL = (64, 80), 0.01
PANEL = np.s_[12:40, 10:38]
SWITCH = np.s_[40:52, 60:68]


@cache
def ripple(seed: int, sd: float = 0.002, length: float = 9.0, noise: float = 0.0003) -> np.ndarray:
    """A smooth ripple with white noise (64, 80), metres."""
    rng = np.random.default_rng(seed)
    out = sd * smooth(SHAPE, length, rng) + noise * rng.normal(size=SHAPE)
    out.setflags(write=False)
    return out


@cache
def panelled(seed: int) -> np.ndarray:
    """A wall (64, 80) with a panel of 5 mm and a switch of 9 mm."""
    out = ripple(seed).copy()
    out[PANEL] += 0.005
    out[SWITCH] += 0.009
    out.setflags(write=False)
    return out


def faces_of(shape: tuple[int, int]) -> np.ndarray:
    """Triangles (m, 3) of a grid of vertices."""
    index = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    halves = np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)
    return np.concatenate([half.reshape(-1, 3) for half in halves]).astype(np.int32)


def plane_fit(point: object, normal: object, rms: float = 0.002) -> SurfaceFit:
    """A plane as it is constrained, with the rms of what lies on it."""
    return SurfaceFit(Plane(point, normal), rms, np.zeros((3, 3)), 1000)


def wall_mesh(heights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[SurfaceFit]]:
    """A wall's vertices in the plane z = 0, its faces, labels and fit."""
    y, x = np.meshgrid(*(CELL * np.arange(n) for n in heights.shape), indexing="ij")
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    labels = np.ones(len(vertices), np.int64)
    return vertices, faces_of(heights.shape), labels, [plane_fit((0, 0, 0), (0, 0, 1))]


def corner_mesh(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[SurfaceFit]]:
    """Two walls, z = 0 and x = 0, that share a column of vertices on the crease."""
    one, other = ripple(seed), ripple(seed + 1)
    vertices, faces, labels, fits = wall_mesh(one)
    crease = np.arange(SHAPE[0]) * SHAPE[1]
    vertices[crease, 0] = other[:, 0]
    y, z = np.meshgrid(*(CELL * np.arange(n) for n in SHAPE), indexing="ij")
    second = np.stack([other, y, z], axis=-1)[:, 1:].reshape(-1, 3)
    number = np.empty(SHAPE, np.int64)
    number[:, 0] = crease
    number[:, 1:] = len(vertices) + np.arange(len(second)).reshape(SHAPE[0], -1)
    both = np.concatenate([faces, number.ravel()[faces[:, ::-1]]]).astype(np.int32)
    labels = np.concatenate([labels, np.full(len(second), 2)])
    return np.concatenate([vertices, second]), both, labels, [*fits, plane_fit((0, 0, 0), (1, 0, 0))]
