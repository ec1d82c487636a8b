# SPDX-License-Identifier: MIT
"""Seeing: what the views measured where isometries put points of a thing: free, matched, hidden or unsure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.backs.limits import LATERAL, LIMB_DEEP, LIMB_NEAR, SAME_NORMAL
from completion.backs.views import Setting, Sight
from completion.evidence.sight import Eye, pixel_of
from completion.observe.rays import Triple
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled, inlined


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What all views say of points (k, n) that k isometries moved, each 0..1.

    `free`: a beam passed there; `matched`: surface of the thing with that normal was measured there;
    `hidden`: behind what was measured, in some view, and not refuted. The rest is not decided.
    """

    free: NDArray[np.float32]
    matched: NDArray[np.float32]
    hidden: NDArray[np.float32]


def see(
    sights: Sequence[Sight], isometries: FloatArray, points: FloatArray, normals: FloatArray, tolerance: float
) -> Seen:
    """Compare points (n, 3) with normals (n, 3), moved by isometries (k, 3, 4), with all views."""
    shape = len(isometries), len(points)
    free, matched, hidden = (np.zeros(shape, dtype=np.float32) for _ in range(3))
    for sight in sights:
        _see(
            sight.eye, sight.angles, sight.low, sight.high, sight.thing, sight.points,
            sight.normals, isometries, points, normals, tolerance, free, matched, hidden,
        )  # fmt: skip
    return Seen(free, matched, hidden)


@inlined
def moved_by(g: FloatArray, x: float, y: float, z: float) -> Triple:
    """Return a place moved by an isometry (3, 4)."""
    return (
        g[0, 0] * x + g[0, 1] * y + g[0, 2] * z + g[0, 3],
        g[1, 0] * x + g[1, 1] * y + g[1, 2] * z + g[1, 3],
        g[2, 0] * x + g[2, 1] * y + g[2, 2] * z + g[2, 3],
    )


@compiled
def _see(
    eye: Eye,
    angles: FloatArray,
    low: FloatArray,
    high: FloatArray,
    thing: BoolArray,
    measured: FloatArray,
    faces: FloatArray,
    isometries: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    tolerance: float,
    free: NDArray[np.float32],
    matched: NDArray[np.float32],
    hidden: NDArray[np.float32],
) -> None:
    """Write into free, matched and hidden (k, n) what one view says of moved points."""
    rows, columns = eye.shape
    reach2 = (LATERAL * tolerance) ** 2
    for k in range(len(isometries)):
        g = isometries[k]
        for i in range(len(points)):
            x, y, z = moved_by(g, points[i, 0], points[i, 1], points[i, 2])
            pixel = pixel_of(eye, angles, (x, y, z))
            if pixel < 0:
                continue
            dx, dy, dz = x - eye.origin[0], y - eye.origin[1], z - eye.origin[2]
            r = np.sqrt(dx * dx + dy * dy + dz * dz)
            passed = (low[pixel] - r) / tolerance - 0.5
            if passed > 0:
                free[k, i] = max(free[k, i], min(passed, 1.0))
                if passed >= 1:
                    continue
            if r > high[pixel] + tolerance:
                hidden[k, i] = 1.0
                if r > high[pixel] + LATERAL * tolerance:
                    continue
            px, py, pz = normals[i, 0], normals[i, 1], normals[i, 2]
            nx = g[0, 0] * px + g[0, 1] * py + g[0, 2] * pz
            ny = g[1, 0] * px + g[1, 1] * py + g[1, 2] * pz
            nz = g[2, 0] * px + g[2, 1] * py + g[2, 2] * pz
            row, column = pixel // columns, pixel % columns
            best = matched[k, i]
            for one in range(max(row - 1, 0), min(row + 2, rows)):
                for other in range(max(column - 1, 0), min(column + 2, columns)):
                    at = one * columns + other
                    if not thing[at]:
                        continue
                    fx, fy, fz = faces[at, 0], faces[at, 1], faces[at, 2]
                    if fx * nx + fy * ny + fz * nz < SAME_NORMAL:
                        continue
                    ax, ay, az = x - measured[at, 0], y - measured[at, 1], z - measured[at, 2]
                    if ax * ax + ay * ay + az * az > reach2:
                        continue
                    off = abs(fx * ax + fy * ay + fz * az)
                    best = max(best, min(1.5 - off / tolerance, 1.0))
            matched[k, i] = best


@dataclass(frozen=True, slots=True, eq=False)
class LimbSeen:
    """What becomes of limb points under k isometries, shares (k,) of the limb points of all views.

    `on_limb`: moved to the limb of the same view; `on_cut`: moved to where an occluder or the image's border
    cuts the thing, which only looks like an end.
    """

    on_limb: FloatArray
    on_cut: FloatArray


def see_limbs(
    sights: Sequence[Sight], isometries: FloatArray, limbs: Sequence[IntArray], size: float
) -> LimbSeen:
    """Compare limb pixels (n,) of each view, moved by isometries (k, 3, 4), with the limb of that view."""
    on_limb, on_cut = np.zeros(len(isometries)), np.zeros(len(isometries))
    for sight, pixels in zip(sights, limbs, strict=True):
        _see_limb(
            sight.eye, sight.angles, sight.points, sight.to_limb, sight.to_cut, isometries,
            sight.points[pixels], size, on_limb, on_cut,
        )  # fmt: skip
    n = max(sum(len(pixels) for pixels in limbs), 1)
    return LimbSeen(on_limb / n, on_cut / n)


@compiled
def _see_limb(
    eye: Eye,
    angles: FloatArray,
    measured: FloatArray,
    to_limb: IntArray,
    to_cut: IntArray,
    isometries: FloatArray,
    points: FloatArray,
    size: float,
    on_limb: FloatArray,
    on_cut: FloatArray,
) -> None:
    """Count into on_limb and on_cut (k,) the points that come to lie on the outline, or on a cut of it."""
    for k in range(len(isometries)):
        g = isometries[k]
        for i in range(len(points)):
            x, y, z = moved_by(g, points[i, 0], points[i, 1], points[i, 2])
            pixel = pixel_of(eye, angles, (x, y, z))
            if pixel < 0:
                continue
            dx, dy, dz = x - eye.origin[0], y - eye.origin[1], z - eye.origin[2]
            r = np.sqrt(dx * dx + dy * dy + dz * dz)
            for which in range(2):
                at = to_limb[pixel] if which == 0 else to_cut[pixel]
                if at < 0:
                    continue
                ax, ay, az = x - measured[at, 0], y - measured[at, 1], z - measured[at, 2]
                deep = (ax * dx + ay * dy + az * dz) / r
                across = ax * ax + ay * ay + az * az - deep * deep
                if abs(deep) < LIMB_DEEP * size and across < (LIMB_NEAR * size) ** 2:
                    if which == 0:
                        on_limb[k] += 1.0
                        break
                    on_cut[k] += 1.0


def is_possible(sights: Sequence[Sight], points: FloatArray, setting: Setting, slack: float) -> BoolArray:
    """Tell which points (n, 3) no beam passed by more than `slack`, above support and before walls."""
    possible = points[:, 2] > setting.support_m - slack
    for wall in setting.walls:
        possible &= points @ wall[:3] - wall[3] > -slack
    for sight in sights:
        _refute(sight.eye, sight.angles, sight.ranges, points, slack, possible)
    return possible


@compiled
def _refute(
    eye: Eye, angles: FloatArray, ranges: FloatArray, points: FloatArray, slack: float, possible: BoolArray
) -> None:
    """Write False into possible (n,) where a beam went on behind a point by more than the slack."""
    for i in range(len(points)):
        pixel = pixel_of(eye, angles, (points[i, 0], points[i, 1], points[i, 2]))
        if pixel >= 0 and np.isfinite(ranges[pixel]):
            dx, dy = points[i, 0] - eye.origin[0], points[i, 1] - eye.origin[1]
            dz = points[i, 2] - eye.origin[2]
            if ranges[pixel] - np.sqrt(dx * dx + dy * dy + dz * dz) > slack:
                possible[i] = False
