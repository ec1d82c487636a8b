# SPDX-License-Identifier: MIT
"""Tracing: points on the curve where two surfaces cross, or where they touch.

Crossing surfaces: Newton's steps of least length on both distances. Touching ones (a fillet and its wall)
meet in a curve that no crossing determines: it is where the normals agree and the surface midway passes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.export.step import limits
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_N_TRACING_STEPS = 12
_MOST_STEPS = 4000


class CurvePoints(NamedTuple):
    """Points (n, 3) moved onto the curve, its directions (n, 3), their gaps (n,), and which hold (n,).

    And how far (n,) surfaces that touch have to turn on before their normals agree as little as there.
    """

    points: FloatArray
    along: FloatArray
    gap: FloatArray
    holds: BoolArray
    width: FloatArray


def project_on_curve(surface: Surface, two: Surface, points: FloatArray, *, touching: bool) -> CurvePoints:
    """Move points (n, 3) near the curve of two surfaces onto it."""
    return (
        _project_on_contact(surface, two, points) if touching else _project_on_crossing(surface, two, points)
    )


def _project_on_crossing(surface: Surface, two: Surface, points: FloatArray) -> CurvePoints:
    x = points.copy()
    for _ in range(_N_TRACING_STEPS):
        a, b = surface.normal(x), two.normal(x)
        d, e = surface.distance(x), two.distance(x)
        c = np.einsum("ij,ij->i", a, b)
        sine2 = np.maximum(1 - c**2, 1e-12)
        step = ((d - c * e) / sine2)[:, None] * a + ((e - c * d) / sine2)[:, None] * b
        x = x - step
        if np.abs(step).max(initial=0.0) < limits.TRACING_EXACT:
            break
    along = np.cross(surface.normal(x), two.normal(x))
    size = np.linalg.norm(along, axis=1)
    along = along / np.maximum(size, 1e-300)[:, None]
    gap = np.maximum(np.abs(surface.distance(x)), np.abs(two.distance(x)))
    holds = np.isfinite(x).all(axis=1) & (gap < 1e-6) & (size > 1e-3)
    return CurvePoints(x, along, gap, holds, np.zeros(len(x)))


def _project_on_contact(surface: Surface, two: Surface, points: FloatArray) -> CurvePoints:
    x, small = points.copy(), 1e-4
    side = np.sign(np.einsum("ij,ij->i", surface.normal(x), two.normal(x)))
    side = np.where(side == 0, 1.0, side)
    across, bent = np.zeros_like(x), np.zeros(len(x))
    for _ in range(_N_TRACING_STEPS):
        a, b = surface.normal(x), side[:, None] * two.normal(x)
        middle = (surface.distance(x) + side * two.distance(x)) / 2
        up = a + b
        up = up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-12)
        bend = np.empty((len(x), 3, 3))
        for k in range(3):
            shift = np.zeros(3)
            shift[k] = small
            fore = surface.normal(x + shift) - side[:, None] * two.normal(x + shift)
            back = surface.normal(x - shift) - side[:, None] * two.normal(x - shift)
            bend[:, :, k] = (fore - back) / (2 * small)
        flat = np.eye(3) - up[:, :, None] * up[:, None, :]
        u, s, vt = np.linalg.svd(flat @ bend @ flat)
        across, bent = vt[:, 0], s[:, 0]
        turn = np.einsum("ij,ij->i", u[:, :, 0], a - b)
        away = np.where(s[:, 0] > 1e-9, turn / np.maximum(s[:, 0], 1e-9), 0.0)
        step = away[:, None] * across + middle[:, None] * up
        x = x - step
        if np.abs(step).max(initial=0.0) < limits.TRACING_EXACT:
            break
    a, b = surface.normal(x), side[:, None] * two.normal(x)
    along = np.cross(a + b, across)
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    gap = np.abs(surface.distance(x) - side * two.distance(x)) / 2
    holds = np.isfinite(x).all(axis=1) & (np.einsum("ij,ij->i", a, b) > np.cos(np.radians(10.0)))
    width = np.linalg.norm(a - b, axis=1) / np.maximum(bent, 1e-9)
    return CurvePoints(x, along, gap, holds, width)


class CurvePath(NamedTuple):
    """Points (n, 3) in order along a curve, and whether it returns to the first."""

    points: FloatArray
    is_closed: bool
    gap: float


def trace_curve(
    surface: Surface, two: Surface, contacts: FloatArray, spacing: float, *, touching: bool
) -> CurvePath | None:
    """Follow the curve of two surfaces as far as there are contacts (n, 3), and some way beyond.

    None where no contact leads to such a curve within two sampling distances.
    """
    sample = contacts[:: max(1, len(contacts) // 200)]
    start = project_on_curve(surface, two, sample, touching=touching)
    good = start.holds & (np.linalg.norm(start.points - sample, axis=1) < 2 * spacing)
    good &= start.width < limits.CONTACT_REACH * spacing
    if good.sum() < 2:
        return None
    first = start.points[good]
    centre = int(np.argmin(np.linalg.norm(first - np.median(first, axis=0), axis=1)))
    tree = cKDTree(contacts)
    follow = _Follower(surface, two, tree, spacing, touching)
    ahead, is_closed = follow.from_point(first[centre], start.along[good][centre])
    gap = float(np.median(start.gap[good]))
    if is_closed:
        return CurvePath(ahead, True, gap)
    behind, _ = follow.from_point(first[centre], -start.along[good][centre])
    return CurvePath(np.concatenate([behind[:0:-1], ahead]), False, gap)


class _Follower(NamedTuple):
    surface: Surface
    two: Surface
    tree: cKDTree
    spacing: float
    touching: bool

    def from_point(self, start: FloatArray, along: FloatArray) -> tuple[FloatArray, bool]:
        """Points (n, 3) from one on, and whether they came back to it: where most of the way has contacts.

        Ways that do not come back end some way beyond the first gap in the contacts.
        """
        path, step, lost, gone = [start], self.spacing / 1.5, 0.0, 0.0
        kept, bare = 0, 0.0
        here, way = start, along
        for _ in range(_MOST_STEPS):
            next_ = project_on_curve(
                self.surface, self.two, (here + step * way)[None], touching=self.touching
            )
            ahead = next_.along[0] * np.sign(next_.along[0] @ way)
            moved = float(np.linalg.norm(next_.points[0] - here))
            fine = bool(next_.holds[0]) and 0.3 * step < moved < 1.7 * step
            if not fine or ahead @ way < np.cos(limits.MOST_TURN):
                step /= 2
                if step < 1e-3 * self.spacing:
                    break
                continue
            here, way, gone = next_.points[0], ahead, gone + moved
            if gone > 3 * step and np.linalg.norm(here - start) < 1.01 * step and (start - here) @ way >= 0:
                if np.linalg.norm(here - start) < 0.3 * step and len(path) > 3:
                    path.pop()
                    here = path[-1]
                path.append(next_.points[0])
                if np.linalg.norm(path[-1] - start) < 0.3 * step:
                    path.pop()
                return np.array(path), True
            path.append(here)
            is_bare = self.tree.query(here)[0] > limits.MEASURED_REACH * self.spacing
            lost, bare = (lost + moved, bare + moved) if is_bare else (0.0, bare)
            if lost > 6 * self.spacing:
                kept = kept or len(path)
                if bare > limits.MAJORITY * gone:
                    break
            step = min(step * 1.5, self.spacing / 1.5)
        return np.array(path[: kept or None]), False
