# SPDX-License-Identifier: MIT
"""Closing: holes of a part's mesh that lie on one plane or cylinder, closed on it and marked as inferred.

Without beams nothing says whether a hole is one of the measurement or of the part. Only those are closed that
what is known of the surface around them closes; a bore, whose border lies on two surfaces, stays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import Delaunay, cKDTree

from completion.parts.division.divided_part import DividedPart
from completion.parts.division.limits import NEARLY_ALL, ROUNDED_OFF, WIDEST_HOLE
from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray
from scenes.mesh.merging import merge_vertices
from scenes.surfaces.catalogue import Cylinder, Plane

_LEFT = {
    "several": "border on several surfaces",
    "kind": "lie on a surface that is neither plane nor cylinder",
    "outside": "are where the surface itself ends",
    "filled": "hold something that was measured",
    "crossed": "have a border that crosses itself",
}


@dataclass(frozen=True, slots=True, eq=False)
class ClosedPart(ArrayValue):
    """A part's mesh with holes closed.

    Attributes
    ----------
    points : (n, 3) float
        Those of the part, then those that were added within holes in cylinders.
    faces : (m, 3) int
        Triangles of the part, then those that close holes, turned as their neighbours are.
    surface : (m,) int
        Label of the surface of each triangle; 0 for none.
    is_inferred : (m,) bool
        Which triangles nobody measured.
    n_holes : int
        Borders of the mesh, closed in themselves.
    n_closed : int
        How many of them were closed.
    inferred_m2 : float
        Area of what closes them.
    left : dict of str to int
        Why the others were left, and how many.
    """

    points: FloatArray
    faces: IntArray
    surface: IntArray
    is_inferred: BoolArray
    n_holes: int
    n_closed: int
    inferred_m2: float
    left: dict[str, int]

    @property
    def told(self) -> str:
        """What was closed and what was not, in words."""
        why = ", ".join(f"{n} {_LEFT[reason]}" for reason, n in sorted(self.left.items()))
        left = f"; left open: {why}" if why else ""
        area = f"{1e4 * self.inferred_m2:.3g} cm2"
        return (
            f"{self.n_closed} of {self.n_holes} borders of the mesh were closed on the plane or cylinder "
            f"around them, {area} in closed.ply: without beams nothing vetoes it{left}"
        )


def close_holes(part: DividedPart) -> ClosedPart | None:
    """Close the holes of a part's mesh that one plane or cylinder closes.

    Parameters
    ----------
    part : DividedPart
        Divided into surfaces; of points without triangles nothing can be closed.

    Returns
    -------
    ClosedPart or None
        None where there is no mesh, or it has no border.
    """
    if part.faces is None or part.triangle_surface is None or not len(part.faces):
        return None
    size = float(np.linalg.norm(np.ptp(part.points, axis=0)))
    _, place = merge_vertices(part.points, ROUNDED_OFF * size)  # files of triangles share no corners
    first = np.unique(place, return_index=True)[1]
    loops = [(first[loop], beside) for loop, beside in _borders(place[part.faces])]
    if not loops:
        return None
    points, faces, surface, left = [part.points], [part.faces], [part.triangle_surface], Counter[str]()
    n_points, tree = len(part.points), cKDTree(part.points)
    for loop, beside in loops:
        labels, corners_beside = part.triangle_surface[beside], part.points[part.faces[beside]]
        closed_hole = _close_hole(part, loop, labels, corners_beside, tree=tree)
        if isinstance(closed_hole, str):
            left[closed_hole] += 1
            continue
        label, added, triangles = closed_hole
        faces.append(np.where(triangles >= 0, triangles, n_points - 1 - triangles))
        points.append(added)
        surface.append(np.full(len(triangles), label))
        n_points += len(added)
    every, corners = np.concatenate(faces), np.concatenate(points)
    is_inferred = np.arange(len(every)) >= len(part.faces)
    sides = np.diff(corners[every[is_inferred]], axis=1)
    area = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2
    return ClosedPart(
        points=corners,
        faces=every.astype(np.int32),
        surface=np.concatenate(surface).astype(np.int32),
        is_inferred=is_inferred,
        n_holes=len(loops),
        n_closed=len(faces) - 1,
        inferred_m2=area,
        left=dict(left),
    )


def _borders(faces: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Borders of a mesh that close in themselves: their points in the triangles' order, and the triangles.

    One that passes a point twice is left out.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    n = int(edges.max()) + 1
    alone = np.flatnonzero(~np.isin(edges @ [1, n], edges @ [n, 1]))  # without the other way round
    following: dict[int, list[tuple[int, int]]] = {}
    for (start, end), triangle in zip(edges[alone].tolist(), (alone % len(faces)).tolist(), strict=True):
        following.setdefault(start, []).append((end, triangle))
    todo = sorted(following)
    done: set[int] = set()
    for first in todo:
        loop, beside, at = list[int](), list[int](), first
        while at not in done and len(following.get(at, ())) == 1:
            done.add(at)
            loop.append(at)
            at, triangle = following[at][0]
            beside.append(triangle)
        if len(loop) >= 3 and at == first:
            yield np.array(loop), np.array(beside)


def _close_hole(
    part: DividedPart, loop: IntArray, beside: IntArray, corners: FloatArray, *, tree: cKDTree
) -> tuple[int, FloatArray, IntArray] | str:
    """The label, further points (k, 3) and triangles (m, 3) of a closed hole; or why it stays.

    `beside` (n,) are the labels of the triangles beside it, `corners` (n, 3, 3) their corners, `tree`
    holds the part's points. Numbers below zero in the result count the further points, from -1.
    """
    label, n = Counter(beside.tolist()).most_common(1)[0]
    if label == 0 or n < NEARLY_ALL * len(beside):
        return "several"
    surface = part.fits[part.labels.index(label)].surface
    if not isinstance(surface, Plane | Cylinder):
        return "kind"
    uv = surface.to_uv(part.points[loop])
    if isinstance(surface, Cylinder):
        step = np.diff(np.append(uv[:, 0], uv[0, 0]))
        step -= surface.period * np.rint(step / surface.period)
        if abs(step.sum()) > surface.period / 2:
            return "outside"  # it runs around the axis
        uv[:, 0] = uv[0, 0] + np.append(0.0, np.cumsum(step)[:-1])
        if np.ptp(uv[:, 0]) > WIDEST_HOLE * surface.period:
            return "outside"
    turned = _runs_clockwise(surface, corners)
    polygon = shapely.Polygon(uv)
    if not polygon.is_valid:
        return "crossed"
    if bool(shapely.is_ccw(shapely.LinearRing(uv))) != turned:
        return "outside"  # triangles lie on its inner side
    middle = part.points[loop].mean(axis=0)
    reach = float(np.linalg.norm(part.points[loop] - middle, axis=1).max())
    near = np.setdiff1d(tree.query_ball_point(middle, reach), loop).astype(np.int64)
    members = near[part.surface[near] == label]
    if _within(polygon, surface, part.points[members]):
        return "filled"
    inner = _inner_places(polygon, part.spacing_m) if isinstance(surface, Cylinder) else np.zeros((0, 2))
    triangles = _triangulate(uv, inner, polygon)
    added = surface.from_uv(inner) if len(inner) else np.zeros((0, 3))
    corner_of = np.append(loop, -1 - np.arange(len(inner)))
    labels_beside = corner_of[triangles]
    return label, added, labels_beside[:, ::-1] if turned else labels_beside


def _runs_clockwise(surface: Plane | Cylinder, corners: FloatArray) -> bool:
    """Whether triangles (m, 3, 3) run clockwise in the chart of the surface."""
    uv = surface.to_uv(corners.reshape(-1, 3)).reshape(-1, 3, 2)
    if isinstance(surface, Cylinder):
        away = uv[:, :, 0] - uv[:, :1, 0]
        uv[:, :, 0] -= surface.period * np.rint(away / surface.period)
    return bool(_double_areas(uv.reshape(-1, 2), np.arange(3 * len(uv)).reshape(-1, 3)).sum() < 0)


def _within(polygon: shapely.Polygon, surface: Plane | Cylinder, points: FloatArray) -> bool:
    """Whether any of some points (n, 3) of the surface lies inside."""
    uv = surface.to_uv(points)
    if isinstance(surface, Cylinder):
        middle = polygon.centroid.x
        uv[:, 0] = middle + (uv[:, 0] - middle + surface.period / 2) % surface.period - surface.period / 2
    inside = shapely.contains_xy(polygon, uv)
    return bool(inside.any())


def _inner_places(polygon: shapely.Polygon, spacing_m: float) -> FloatArray:
    """Places (k, 2) inside, as far apart as the part's points are, and as far from the border."""
    low_x, low_y, high_x, high_y = polygon.bounds
    x, y = np.meshgrid(np.arange(low_x, high_x, spacing_m), np.arange(low_y, high_y, spacing_m))
    places = np.column_stack([x.ravel(), y.ravel()])
    inside = shapely.contains_xy(polygon.buffer(-spacing_m / 2), places)
    return np.asarray(places[inside])


def _triangulate(uv: FloatArray, inner: FloatArray, polygon: shapely.Polygon) -> IntArray:
    """Triangles (m, 3) over a border (n, 2) and places within (k, 2), anticlockwise, by their numbers.

    By Delaunay's where that keeps the border, else without the places within.
    """
    every = np.concatenate([uv, inner])
    if len(inner):
        triangles = np.array(Delaunay(every).simplices, dtype=np.int64)
        triangles = triangles[shapely.contains_xy(polygon, every[triangles].mean(axis=1))]
        area = _double_areas(every, triangles)
        triangles = np.where((area < 0)[:, None], triangles[:, ::-1], triangles)
        if abs(np.abs(area).sum() / 2 - polygon.area) < 1e-9 * polygon.area:
            return np.asarray(triangles)
    pieces = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    number = {tuple(place): k for k, place in enumerate(uv.tolist())}
    triangles = np.array([[number[tuple(corner)] for corner in shapely.get_coordinates(piece)[:3].tolist()]
                      for piece in pieces])  # fmt: skip
    return np.asarray(np.where((_double_areas(uv, triangles) < 0)[:, None], triangles[:, ::-1], triangles))


def _double_areas(places: FloatArray, triangles: IntArray) -> FloatArray:
    """Twice the signed area (m,) of triangles."""
    first, two = (places[triangles[:, k]] - places[triangles[:, 0]] for k in (1, 2))
    return np.asarray(first[:, 0] * two[:, 1] - first[:, 1] * two[:, 0])
