# SPDX-License-Identifier: MIT
"""Closing: the closed shape of a thing, carved by measured and virtual beams, each face with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError
from skimage.measure import marching_cubes

from completion.backs.limits import CELL, CORNER_APART, FOOT, GRID, MOST_CELLS, SKIN, SPECK, THIN_CELLS
from completion.backs.probability import Element
from completion.backs.seeing import moved_by
from completion.backs.symmetry import move, one_a_cell
from completion.backs.views import Scale, Setting, Sight
from completion.evidence.sight import Eye, pixel_of
from scenes.checks import BoolArray, FloatArray, Value
from texture.engine.compiled import compiled

MEASURED, SYMMETRY, TURN, SUPPORT, WALL, HULL, BOUND = range(7)
"""Why a face of a closed mesh is where it is; only 1 and 2 may count as inferred surface."""
ORIGINS = ("measured", "symmetry", "turn", "support", "wall", "hull", "bound")
_IDENTITY = np.eye(3, 4)


@dataclass(frozen=True, slots=True, eq=False)
class ClosedShape(Value):
    """A watertight mesh of a thing.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int
        Counter-clockwise seen from outside.
    origin : (m,) uint8
        0 measured, 1 symmetry, 2 turn, 3 support, 4 wall, 5 hull, 6 bound of the shadow.
    probability : (m,) float
        Of the symmetry that puts a face there: below `BackOptions.least` the face is unknown. 1 where
        measured, 0 of origins 3 to 6.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    origin: NDArray[np.uint8]
    probability: FloatArray

    @property
    def volume_m3(self) -> float:
        """Enclosed volume, cubic metres."""
        a, b, c = np.moveaxis(self.vertices[self.faces], 1, 0)
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def close(
    sights: Sequence[Sight], elements: Sequence[Element], moved: FloatArray, setting: Setting, *, scale: Scale
) -> ClosedShape:
    """Close a thing's shape.

    F(x) is the least depth of x behind what views measured, over all views and all isometries of the group:
    the thing is where F > 0, above the support, before walls, in the convex hull of measured points, moved
    ones (n, 3) and feet. Just behind measured surface virtual beams do not carve. Marching cubes of F.
    """
    measured = np.concatenate([sight.points[sight.thing] for sight in sights])
    hull = _hull(np.concatenate([measured, moved]), setting, scale)
    low, cell, shape = _grid(measured, moved, setting, scale)
    index = np.indices(shape).reshape(3, -1).T
    places = low + index * cell
    cap = 3 * cell
    value = np.minimum(_inside(hull, places) + cell / 2, places[:, 2] - setting.support_m)
    for wall in setting.walls:
        value = np.minimum(value, places @ wall[:3] - wall[3])
    value = np.clip(value, -cap, cap)
    open_ = np.flatnonzero(value > -cap)
    value[open_] = np.minimum(value[open_], _depths(sights, elements, places[open_], cap, SKIN * scale.size))
    field = _without_specks(value.reshape(shape), cap)
    field = np.where(np.abs(field) < CORNER_APART * cell, np.copysign(CORNER_APART * cell, field), field)
    if not (field > 0).any():
        return ClosedShape(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.uint8), np.zeros(0))
    vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
    vertices = low + np.asarray(vertices, dtype=np.float64) * cell
    faces = np.asarray(faces, dtype=np.int32)
    if ClosedShape(vertices, faces, np.zeros(0, np.uint8), np.zeros(0)).volume_m3 < 0:
        faces = faces[:, ::-1]
    centre = vertices[faces].mean(axis=1)
    origin, likely = _origins(sights, elements, centre, hull, setting, cell=cell)
    return ClosedShape(vertices, faces, origin, likely)


def _grid(
    measured: FloatArray, moved: FloatArray, setting: Setting, scale: Scale
) -> tuple[FloatArray, float, tuple[int, ...]]:
    """First corner, cell and shape of the grid; its outermost layer lies outside the thing."""
    points = np.concatenate([measured, moved])
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = min(low[2], setting.support_m) if low[2] < setting.support_m + FOOT * scale.size else low[2]
    extent = high - low
    cell = min(GRID * scale.size, max(float(extent.min()) / THIN_CELLS, GRID * scale.size / 3))
    while np.prod(extent / cell + 5) > MOST_CELLS:
        cell *= 1.1
    n = np.ceil(extent / cell).astype(int) + 5
    return low - 2 * cell, cell, tuple(n.tolist())


def _hull(points: FloatArray, setting: Setting, scale: Scale) -> FloatArray:
    """Planes (k, 4) of the convex hull of points and of their feet on the support: n x + d <= 0 inside."""
    feet = points[points[:, 2] < setting.support_m + FOOT * scale.size].copy()
    feet[:, 2] = setting.support_m
    few = np.concatenate([one[one_a_cell(one, CELL * scale.size)] for one in (points, feet)])
    try:
        planes = ConvexHull(few).equations
    except QhullError:
        planes = ConvexHull(few + scale.tolerance * np.random.default_rng(0).normal(size=few.shape)).equations
    return np.unique(planes.round(9), axis=0)


def _inside(planes: FloatArray, points: FloatArray) -> FloatArray:
    """How deep points (n, 3) lie within planes (k, 4), negative outside."""
    found = np.empty(len(points))
    _least_depth(np.ascontiguousarray(planes), np.ascontiguousarray(points), found)
    return found


@compiled
def _least_depth(planes: FloatArray, points: FloatArray, found: FloatArray) -> None:
    """Write into found (n,) how deep points lie within planes."""
    for i in range(len(points)):
        most = -np.inf
        for k in range(len(planes)):
            height = (
                planes[k, 0] * points[i, 0]
                + planes[k, 1] * points[i, 1]
                + planes[k, 2] * points[i, 2]
                + planes[k, 3]
            )
            most = max(most, height)
        found[i] = -most


def _depths(
    sights: Sequence[Sight], elements: Sequence[Element], places: FloatArray, cap: float, skin: float
) -> FloatArray:
    """F (n,) of places (n, 3), within -cap..cap."""
    own, virtual = np.full(len(places), cap), np.full(len(places), cap)
    is_skin = np.zeros(len(places), dtype=np.bool_)
    for sight in sights:
        _carve(
            sight.eye, sight.angles, sight.ranges, sight.thing, sight.points, sight.normals,
            _IDENTITY[None], places, cap, skin, sight.is_whole, own, is_skin,
        )  # fmt: skip
    if elements:
        no_skin = np.zeros(len(places), dtype=np.bool_)
        isometries = np.stack([_inverse(element.isometry) for element in elements])
        open_ = np.flatnonzero((own > -cap) & ~is_skin)
        some, lowest, none = places[open_], virtual[open_], no_skin[open_]
        for sight in sights:
            _carve(
                sight.eye, sight.angles, sight.ranges, sight.thing, sight.points, sight.normals,
                isometries, some, cap, skin, sight.is_whole, lowest, none,
            )  # fmt: skip
        virtual[open_] = lowest
    return np.asarray(np.minimum(own, virtual))


def _inverse(isometry: FloatArray) -> FloatArray:
    turn = isometry[:, :3].T
    return np.concatenate([turn, -(turn @ isometry[:, 3:])], axis=1)


@compiled
def _carve(
    eye: Eye,
    angles: FloatArray,
    ranges: FloatArray,
    thing: BoolArray,
    measured: FloatArray,
    normals: FloatArray,
    isometries: FloatArray,
    places: FloatArray,
    cap: float,
    skin: float,
    is_whole: bool,
    lowest: FloatArray,
    is_skin: BoolArray,
) -> None:
    """Lower `lowest` (n,) to the least depth of moved places in a view; mark those just behind surface."""
    for i in range(len(places)):
        px, py, pz = places[i, 0], places[i, 1], places[i, 2]
        for k in range(len(isometries)):
            x, y, z = moved_by(isometries[k], px, py, pz)
            pixel = pixel_of(eye, angles, (x, y, z))
            depth = cap
            if pixel < 0:
                depth = -cap if is_whole else cap
            elif np.isfinite(ranges[pixel]):
                dx, dy, dz = x - eye.origin[0], y - eye.origin[1], z - eye.origin[2]
                depth = np.sqrt(dx * dx + dy * dy + dz * dz) - ranges[pixel]
                if thing[pixel]:
                    fx, fy, fz = normals[pixel, 0], normals[pixel, 1], normals[pixel, 2]
                    if abs(depth) < cap and fx * fx + fy * fy + fz * fz > 0:
                        depth = -(
                            fx * (x - measured[pixel, 0])
                            + fy * (y - measured[pixel, 1])
                            + fz * (z - measured[pixel, 2])
                        )
                    if 0 < depth < skin:
                        is_skin[i] = True
            lowest[i] = min(lowest[i], max(depth, -cap))
            if lowest[i] <= -cap:
                break


def _without_specks(field: FloatArray, cap: float) -> FloatArray:
    """The field with small separate pieces taken out."""
    label, n = ndimage.label(field > 0)
    if n > 1:
        size = np.bincount(label.ravel())
        size[0] = 0
        small = size < SPECK * size.max()
        small[0] = False
        field = np.where(small[label], -cap / 3, field)
    edge = np.ones(field.shape, dtype=np.bool_)
    edge[1:-1, 1:-1, 1:-1] = False
    return np.where(edge, np.minimum(field, -cap / 3), field)


def _origins(
    sights: Sequence[Sight],
    elements: Sequence[Element],
    places: FloatArray,
    hull: FloatArray,
    setting: Setting,
    *,
    cell: float,
) -> tuple[NDArray[np.uint8], FloatArray]:
    """Why faces with these centres (n, 3) are where they are, and how probable that is."""
    origin = np.full(len(places), BOUND, dtype=np.uint8)
    origin[np.abs(_inside(hull, places) + cell / 2) < cell] = HULL
    for wall in setting.walls:
        origin[np.abs(places @ wall[:3] - wall[3]) < cell] = WALL
    likely = np.zeros(len(places))
    own = (1.0, MEASURED, _IDENTITY)
    weaker = [(element.probability, element.origin, _inverse(element.isometry)) for element in elements]
    for probability, kind, isometry in [*sorted(weaker, key=lambda one: one[0]), own]:
        at, there = move(isometry, places), np.zeros(len(places), dtype=np.bool_)
        for sight in sights:
            _mark(sight.eye, sight.angles, sight.thing, sight.points, sight.normals, at, cell, there)
        origin[there], likely[there] = kind, probability
    origin[(places[:, 2] - setting.support_m < cell) & (origin >= HULL)] = SUPPORT
    return origin, likely


@compiled
def _mark(
    eye: Eye,
    angles: FloatArray,
    thing: BoolArray,
    measured: FloatArray,
    normals: FloatArray,
    places: FloatArray,
    cell: float,
    there: BoolArray,
) -> None:
    """Write into there (n,) True where a view measured the thing within a cell of a place."""
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        pixel = pixel_of(eye, angles, (x, y, z))
        if pixel < 0 or not thing[pixel]:
            continue
        ax, ay, az = x - measured[pixel, 0], y - measured[pixel, 1], z - measured[pixel, 2]
        fx, fy, fz = normals[pixel, 0], normals[pixel, 1], normals[pixel, 2]
        off = abs(fx * ax + fy * ay + fz * az)
        if off < cell and ax * ax + ay * ay + az * az < 9 * cell * cell and fx * fx + fy * fy + fz * fz > 0:
            there[i] = True
