# SPDX-License-Identifier: MIT
"""What of a trimmed face was measured, and what of a region its face holds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.exchange.step.curves.kernel import kernel
from scenes.checks import FloatArray, IntArray

_NEAR = 2.5  # sampling distances from a point that was measured
_MOST_SAMPLES = 20_000
_TURN = 0.3  # radians between triangles


class Shares(NamedTuple):
    """Share of a face's area near its region's points, and share of the points near the face."""

    measured: float
    held: float


def shares_of(face: Any, points: FloatArray, spacing: float) -> Shares:
    """Return what of a face was measured by the points (n, 3) of its region, mm."""
    corners, triangles = triangles_of(face, 0.2 * spacing)
    if not len(triangles):
        return Shares(0.0, 0.0)
    samples = _sampled(corners[triangles], spacing)
    near = cKDTree(points).query(samples)[0] <= _NEAR * spacing
    held = cKDTree(samples).query(points)[0] <= _NEAR * spacing
    return Shares(float(near.mean()), float(held.mean()))


def triangles_of(shape: Any, sag: float) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3) and triangles (m, 3) of a shape, off it by at most `sag`, mm."""
    modules = kernel()
    modules.BRepMesh.BRepMesh_IncrementalMesh(shape, sag, False, _TURN, False)
    corners, triangles, first = list[tuple[float, float, float]](), list[tuple[int, int, int]](), 0
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        face = modules.TopoDS.TopoDS.Face(walk.Current())
        net = modules.BRep.BRep_Tool.Triangulation_s(face, modules.TopLoc.TopLoc_Location())
        walk.Next()
        if net is None:
            continue
        corners += [net.Node(k).Coord() for k in range(1, net.NbNodes() + 1)]
        is_turned = face.Orientation() == modules.TopAbs.TopAbs_Orientation.TopAbs_REVERSED
        for k in range(1, net.NbTriangles() + 1):
            a, b, c = (first + net.Triangle(k).Value(n) - 1 for n in (1, 2, 3))
            triangles.append((a, c, b) if is_turned else (a, b, c))
        first = len(corners)
    return np.array(corners).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _sampled(corners: FloatArray, spacing: float) -> FloatArray:
    """Points (k, 3) spread over triangles (m, 3, 3), about a sampling distance apart."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.cumsum(np.linalg.norm(across, axis=1) / 2)
    n = int(np.clip(total[-1] / spacing**2, 200, _MOST_SAMPLES))
    own = np.minimum(np.searchsorted(total, (np.arange(n) + 0.5) / n * total[-1]), len(corners) - 1)
    index = np.arange(1, n + 1)
    a, b = (0.5 + index / 1.324717957244746) % 1.0, (0.5 + index / 1.324717957244746**2) % 1.0
    over = a + b > 1
    a, b = np.where(over, 1 - a, a)[:, None], np.where(over, 1 - b, b)[:, None]
    some = corners[own]
    return np.asarray(some[:, 0] + a * (some[:, 1] - some[:, 0]) + b * (some[:, 2] - some[:, 0]))


def edges_of(shape: Any, n: int = 30) -> list[FloatArray]:
    """Points (n, 3) along each edge of a shape, mm."""
    modules, found = kernel(), list[FloatArray]()
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_EDGE)
    while walk.More():
        edge = modules.TopoDS.TopoDS.Edge(walk.Current())
        walk.Next()
        if modules.BRep.BRep_Tool.Degenerated_s(edge):
            continue
        curve = modules.BRepAdaptor.BRepAdaptor_Curve(edge)
        t = np.linspace(curve.FirstParameter(), curve.LastParameter(), n)
        found.append(np.array([curve.Value(float(one)).Coord() for one in t]))
    return found
