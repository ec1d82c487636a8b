# SPDX-License-Identifier: MIT
"""Tracing: points on the curve where two surfaces cross, or where they touch.

Crossing surfaces: Newton's steps of least length on both distances. Touching ones (a fillet and its wall)
meet in a curve that no crossing determines: it is where the normals agree and the surface midway passes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_N_STEPS = 12
_EXACT = 1e-9  # mm
_MOST_STEPS = 4000
_MOST_TURN = np.radians(12.0)  # between steps


class Settled(NamedTuple):
    """Points (n, 3) moved onto the curve, its directions (n, 3), their gaps (n,), and which hold (n,)."""

    points: FloatArray
    along: FloatArray
    gap: FloatArray
    holds: BoolArray


def settled(one: Surface, two: Surface, points: FloatArray, *, touching: bool) -> Settled:
    """Move points (n, 3) near the curve of two surfaces onto it."""
    return _touching(one, two, points) if touching else _crossing(one, two, points)


def _crossing(one: Surface, two: Surface, points: FloatArray) -> Settled:
    x = points.copy()
    for _ in range(_N_STEPS):
        a, b = one.normal(x), two.normal(x)
        d, e = one.distance(x), two.distance(x)
        c = np.einsum("ij,ij->i", a, b)
        sine2 = np.maximum(1 - c**2, 1e-12)
        step = ((d - c * e) / sine2)[:, None] * a + ((e - c * d) / sine2)[:, None] * b
        x = x - step
        if np.abs(step).max(initial=0.0) < _EXACT:
            break
    along = np.cross(one.normal(x), two.normal(x))
    size = np.linalg.norm(along, axis=1)
    along = along / np.maximum(size, 1e-300)[:, None]
    gap = np.maximum(np.abs(one.distance(x)), np.abs(two.distance(x)))
    holds = np.isfinite(x).all(axis=1) & (gap < 1e-6) & (size > 1e-3)
    return Settled(x, along, gap, holds)


def _touching(one: Surface, two: Surface, points: FloatArray) -> Settled:
    x, small = points.copy(), 1e-4
    side = np.sign(np.einsum("ij,ij->i", one.normal(x), two.normal(x)))
    side = np.where(side == 0, 1.0, side)
    across = np.zeros_like(x)
    for _ in range(_N_STEPS):
        a, b = one.normal(x), side[:, None] * two.normal(x)
        middle = (one.distance(x) + side * two.distance(x)) / 2
        up = a + b
        up = up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)
        bend = np.empty((len(x), 3, 3))
        for k in range(3):
            shift = np.zeros(3)
            shift[k] = small
            fore = one.normal(x + shift) - side[:, None] * two.normal(x + shift)
            back = one.normal(x - shift) - side[:, None] * two.normal(x - shift)
            bend[:, :, k] = (fore - back) / (2 * small)
        flat = np.eye(3) - up[:, :, None] * up[:, None, :]
        u, s, vt = np.linalg.svd(flat @ bend @ flat)
        across = vt[:, 0]
        rest = np.einsum("ij,ij->i", u[:, :, 0], a - b)
        away = np.where(s[:, 0] > 1e-9, rest / np.maximum(s[:, 0], 1e-9), 0.0)
        step = away[:, None] * across + middle[:, None] * up
        x = x - step
        if np.abs(step).max(initial=0.0) < _EXACT:
            break
    a, b = one.normal(x), side[:, None] * two.normal(x)
    along = np.cross(a + b, across)
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    gap = np.abs(one.distance(x) - side * two.distance(x)) / 2
    holds = np.isfinite(x).all(axis=1) & (np.einsum("ij,ij->i", a, b) > np.cos(np.radians(10.0)))
    return Settled(x, along, gap, holds)


class Traced(NamedTuple):
    """Points (n, 3) in order along a curve, and whether it returns to the first."""

    points: FloatArray
    is_closed: bool
    gap: float


def traced(
    one: Surface, two: Surface, contacts: FloatArray, spacing: float, *, touching: bool
) -> Traced | None:
    """Follow the curve of two surfaces as far as there are contacts (n, 3), and some way beyond.

    None where no contact leads to such a curve within two sampling distances.
    """
    some = contacts[:: max(1, len(contacts) // 200)]
    start = settled(one, two, some, touching=touching)
    good = start.holds & (np.linalg.norm(start.points - some, axis=1) < 2 * spacing)
    if good.sum() < 2:
        return None
    first = start.points[good]
    centre = int(np.argmin(np.linalg.norm(first - np.median(first, axis=0), axis=1)))
    tree = cKDTree(contacts)
    follow = _Follower(one, two, tree, spacing, touching)
    ahead, is_closed = follow.from_point(first[centre], start.along[good][centre])
    gap = float(np.median(start.gap[good]))
    if is_closed:
        return Traced(ahead, True, gap)
    behind, _ = follow.from_point(first[centre], -start.along[good][centre])
    return Traced(np.concatenate([behind[:0:-1], ahead]), False, gap)


class _Follower(NamedTuple):
    one: Surface
    two: Surface
    tree: cKDTree
    spacing: float
    touching: bool

    def from_point(self, start: FloatArray, along: FloatArray) -> tuple[FloatArray, bool]:
        """Points (n, 3) from one on, and whether they came back to it."""
        found, step, lost, gone = [start], self.spacing / 1.5, 0.0, 0.0
        here, way = start, along
        for _ in range(_MOST_STEPS):
            next_ = settled(self.one, self.two, (here + step * way)[None], touching=self.touching)
            ahead = next_.along[0] * np.sign(next_.along[0] @ way)
            moved = float(np.linalg.norm(next_.points[0] - here))
            fine = bool(next_.holds[0]) and 0.3 * step < moved < 1.7 * step
            if not fine or ahead @ way < np.cos(_MOST_TURN):
                step /= 2
                if step < 1e-3 * self.spacing:
                    break
                continue
            here, way, gone = next_.points[0], ahead, gone + moved
            if gone > 3 * step and np.linalg.norm(here - start) < 1.01 * step and (start - here) @ way >= 0:
                if np.linalg.norm(here - start) < 0.3 * step and len(found) > 3:
                    found.pop()
                    here = found[-1]
                found.append(next_.points[0])
                if np.linalg.norm(found[-1] - start) < 0.3 * step:
                    found.pop()
                return np.array(found), True
            found.append(here)
            lost = lost + moved if self.tree.query(here)[0] > 2.5 * self.spacing else 0.0
            if lost > 6 * self.spacing:
                break
            step = min(step * 1.5, self.spacing / 1.5)
        return np.array(found), False
