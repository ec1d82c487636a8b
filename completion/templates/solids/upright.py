# SPDX-License-Identifier: MIT
"""Upright frames: points with their third coordinate up, about their own middle; levels among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from completion.templates.engine.measured import Measured
from scenes.checks import FloatArray

_SHARE, _N_SAMPLE = 0.05, (20_000, 100_000)  # of all points, that are looked at; at least and at most
_N_TREE = 1_000_000  # among which neighbours are sought
_N_NEIGHBOURS = 16
_FLAT, _STEEP = np.cos(np.radians(25.0)), np.sin(np.radians(25.0))


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """A frame that stands upright.

    Attributes
    ----------
    turn : (3, 3) float
        Rows: its axes in the frame of the points; the last points up.
    origin : (3,) float
        Its origin there.
    """

    turn: FloatArray
    origin: FloatArray

    @classmethod
    def about(cls, measured: Measured, up: FloatArray) -> Upright:
        """Return the frame in the middle of what was measured, with up (3,) of any length; z stays z."""
        axis = np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
        beside = np.eye(3)[0] if abs(axis[0]) < 0.9 else np.eye(3)[1]
        first = beside - (beside @ axis) * axis
        first = first / np.linalg.norm(first)
        return cls(np.stack([first, np.cross(axis, first), axis]), np.median(measured.points, axis=0))

    def local(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in this frame."""
        return np.asarray((points - self.origin) @ self.turn.T)

    def outside(self, local: FloatArray) -> FloatArray:
        """Return points (n, 3) of this frame where they were measured."""
        return np.asarray(local @ self.turn + self.origin)


@dataclass(frozen=True, slots=True, eq=False)
class UprightSample:
    """Some points (n, 3) of an upright frame with their normals (n, 3), which have no side."""

    points: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, local: FloatArray) -> UprightSample:
        """Return some of the points (n, 3), spread evenly, with normals by their nearest neighbours."""
        sample = _evenly(local, int(np.clip(_SHARE * len(local), *_N_SAMPLE)))
        points = local[:: max(1, len(local) // _N_TREE)]
        _, nearest = cKDTree(points).query(sample, k=min(_N_NEIGHBOURS, len(points)))
        around = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("mki,mkj->mij", around, around))
        return cls(sample, vectors[:, :, 0])

    @property
    def flat(self) -> FloatArray:
        """Points (m, 3) of surfaces that lie flat."""
        return np.asarray(self.points[np.abs(self.normals[:, 2]) > _FLAT])

    @property
    def steep(self) -> tuple[FloatArray, FloatArray]:
        """Points (m, 3) of surfaces that stand upright, and their normals (m, 3)."""
        which = np.abs(self.normals[:, 2]) < _STEEP
        return self.points[which], self.normals[which]


def _evenly(points: FloatArray, most: int) -> FloatArray:
    """About so many of the points (n, 3), spread over what was measured: one of each cube."""
    if len(points) <= most:
        return points
    low = points.min(axis=0)
    side = float(np.ptp(points, axis=0).max()) / np.sqrt(most)
    first = np.zeros(0, np.int64)
    for _ in range(4):
        cubes = np.floor((points - low) / side).astype(np.int64)
        wide = cubes.max(axis=0) + 1
        number = (cubes[:, 0] * wide[1] + cubes[:, 1]) * wide[2] + cubes[:, 2]
        _, first = np.unique(number, return_index=True)
        if most / 2 <= len(first) <= most:
            break
        side *= np.sqrt(len(first) / (0.7 * most))
    return points[np.sort(first)]


def levels(heights: FloatArray, width: float, least: int) -> FloatArray:
    """Return heights (l,) about which at least so many of the heights (n,) lie within a width, ascending."""
    if len(heights) == 0:
        return np.zeros(0)
    first = float(heights.min())
    count = np.bincount(np.floor((heights - first) / width).astype(np.int64) + 1, minlength=3)
    count = np.append(count, 0)
    around = count[:-2] + count[1:-1] + count[2:]
    peak = (count[1:-1] >= count[:-2]) & (count[1:-1] > count[2:]) & (around >= least)
    middles = first + width * (np.flatnonzero(peak) + 0.5)
    return np.array([heights[np.abs(heights - one) <= 1.5 * width].mean() for one in middles])
