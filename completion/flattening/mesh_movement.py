# SPDX-License-Identifier: MIT
"""Movement of vertices onto planes: along the normal or along rays, never so that a face flips or crosses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.flattening.limits import GRAZING_COSINE, USUAL_SD
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane
from texture.engine.compiled import compiled, inlined

_SPAN = 2.0  # cells of the search in usual faces
_MOST = 64  # cells along each axis that one face is entered in


def new_crossings(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32], moved: BoolArray
) -> BoolArray:
    """Faces (m,) that take part in a crossing after and not before: an edge of one runs through another.

    `before`, `after` (n, 3) are the vertices; pairs with a `moved` (m,) face are tested exactly, except those
    that share a vertex. Faces that touch, or lie in one plane, do not cross.
    """
    crossing = np.zeros(len(faces), np.bool_)
    if not moved.any():
        return crossing
    corners = after[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    size = max(float(_SPAN * np.median((high - low).max(axis=1))), 1e-9 * float(np.ptp(after)) + 1e-300)
    near = np.all((high >= low[moved].min(axis=0)) & (low <= high[moved].max(axis=0)), axis=1)
    chosen = np.flatnonzero(near)
    first = np.floor(low[chosen] / size).astype(np.int64)
    count = np.minimum(np.floor(high[chosen] / size).astype(np.int64) - first + 1, _MOST)
    number = count.prod(axis=1)
    entry = np.repeat(np.arange(len(chosen)), number)
    within = np.arange(len(entry)) - np.repeat(np.cumsum(number) - number, number)
    across = count[entry]
    step = np.stack(
        [
            within // (across[:, 1] * across[:, 2]),
            within // across[:, 2] % across[:, 1],
            within % across[:, 2],
        ],
        axis=1,
    )
    place = first[entry] + step
    place -= place.min(axis=0)
    key = (place[:, 0] * (place[:, 1].max() + 1) + place[:, 1]) * (place[:, 2].max() + 1) + place[:, 2]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(key[order]) != 0, True])
    starts[-1] = len(order)
    _mark(before, after, faces, moved, low, high, chosen[entry[order]], starts, crossing)
    return crossing


@compiled
def _mark(
    before: FloatArray,
    after: FloatArray,
    faces: NDArray[np.int32],
    moved: BoolArray,
    low: FloatArray,
    high: FloatArray,
    entries: NDArray[np.int64],
    starts: NDArray[np.int64],
    crossing: BoolArray,
) -> None:
    """Mark the faces that cross newly; `entries` from each start to the next are the faces of one cell."""
    for cell in range(len(starts) - 1):
        for i in range(starts[cell], starts[cell + 1]):
            entry = entries[i]
            for j in range(i + 1, starts[cell + 1]):
                other = entries[j]
                if not (moved[entry] or moved[other]) or (crossing[entry] and crossing[other]):
                    continue
                apart = False
                for k in range(3):
                    if low[entry, k] > high[other, k] or low[other, k] > high[entry, k]:
                        apart = True
                    for m in range(3):
                        if faces[entry, k] == faces[other, m]:
                            apart = True
                if apart:
                    continue
                if _cross(after, faces, entry, other) and not _cross(before, faces, entry, other):
                    crossing[entry] = True
                    crossing[other] = True


@inlined
def _cross(points: FloatArray, faces: NDArray[np.int32], first: int, second: int) -> bool:
    """Whether an edge of one face runs through the other."""
    for k in range(3):
        if _pierces(points, faces[second], faces[first, k], faces[first, (k + 1) % 3]):
            return True
        if _pierces(points, faces[first], faces[second, k], faces[second, (k + 1) % 3]):
            return True
    return False


@inlined
def _pierces(points: FloatArray, face: NDArray[np.int32], start: int, end: int) -> bool:
    """Whether an edge runs through a face: its ends on either side, the face's edges around it."""
    a, b, c, p, q = points[face[0]], points[face[1]], points[face[2]], points[start], points[end]
    above, below = _volume(a, b, c, p), _volume(a, b, c, q)
    if above * below >= 0:
        return False
    first, second, third = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (first > 0 and second > 0 and third > 0) or (first < 0 and second < 0 and third < 0)


@inlined
def _volume(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    """Six times the signed volume of a tetrahedron; 0 where it is no more than rounding."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    u, v, w = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    volume: float = x * (q * w - r * v) - y * (p * w - r * u) + z * (p * v - q * u)
    scale: float = (abs(x) + abs(y) + abs(z)) * (abs(p) + abs(q) + abs(r)) * (abs(u) + abs(v) + abs(w))
    return volume if abs(volume) > 1e-12 * scale else 0.0


def move_onto(
    vertices: FloatArray, plane: Plane, height: FloatArray, origin: FloatArray | None
) -> FloatArray:
    """Vertices (n, 3) moved to heights (n,) over a plane: along its normal, or the rays from `origin`."""
    rise = height - plane.distance(vertices)
    if origin is None:
        return vertices + rise[:, None] * plane.normal_direction
    rays = vertices - origin
    reach = np.maximum(np.linalg.norm(rays, axis=1), 1e-30)
    rays = rays / reach[:, None]
    along = rays @ plane.normal_direction
    steep = np.abs(along) >= GRAZING_COSINE
    length = np.where(steep, rise / np.where(steep, along, 1.0), 0.0)
    length[length <= -reach] = 0.0  # the plane is behind the sensor
    out: FloatArray = vertices + length[:, None] * rays
    return out


def move_creases(
    vertices: FloatArray,
    moved: FloatArray,
    faces: NDArray[np.int32],
    flat: NDArray[np.int64],
    planes: dict[int, tuple[Plane, float]],
) -> FloatArray:
    """Flattened vertices that lie on a neighbouring plane too go to where both meet, or all three.

    `flat` (n,) is the label of the plane that a vertex was moved onto, 0 for others; `planes` has each
    plane with the rms of its residuals. A vertex lies on a plane if an edge joins it to a vertex of that
    plane, it is no farther from it than three rms, and nearer than the other end is to its own: of the two
    ends of an edge one alone goes to the crease, or the faces between would collapse.
    """
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = pairs[np.all(flat[pairs] > 0, axis=1) & (flat[pairs[:, 0]] != flat[pairs[:, 1]])]
    off = np.stack([_off_others(vertices, pairs[:, ::way], flat, planes) for way in (1, -1)], axis=1)
    nearer = np.argmin(off, axis=1)
    every = np.arange(len(pairs))
    beside = np.stack([pairs[every, nearer], flat[pairs[every, 1 - nearer]]], axis=1)
    beside = np.unique(beside[off[every, nearer] <= 1.0], axis=0)
    also = dict[int, list[int]]()
    for vertex, label in beside.tolist():
        also.setdefault(vertex, [int(flat[vertex])]).append(label)
    out = moved.copy()
    for vertex, labels in also.items():
        normals = np.stack([planes[label][0].normal_direction for label in labels[:3]])
        away = np.array([planes[label][0].distance(vertices[vertex][None])[0] for label in labels[:3]])
        if np.linalg.svd(normals, compute_uv=False)[-1] > 0.1:
            out[vertex] = vertices[vertex] - np.linalg.lstsq(normals, away, rcond=None)[0]
    return out


def _off_others(
    vertices: FloatArray,
    pairs: NDArray[np.int32],
    flat: NDArray[np.int64],
    planes: dict[int, tuple[Plane, float]],
) -> FloatArray:
    """How far the first of each pair (m, 2) is off the plane of the second, over what is still on it."""
    off = np.full(len(pairs), np.inf)
    for label, (plane, rms) in planes.items():
        pairs_here = np.flatnonzero(flat[pairs[:, 1]] == label)
        reach = [
            USUAL_SD * max(rms, planes[int(surface_number)][1])
            for surface_number in flat[pairs[pairs_here, 0]]
        ]
        off[pairs_here] = np.abs(plane.distance(vertices[pairs[pairs_here, 0]])) / np.maximum(reach, 1e-300)
    return off


def hold_back(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32]
) -> tuple[FloatArray, BoolArray]:
    """Vertices (n, 3) after a movement in which no face turns over or crosses anew; (n,) which stayed.

    The vertices of a face that would are left where they were, until there is none.
    """
    held = np.zeros(len(before), np.bool_)
    after = after.copy()
    changed = np.any(after != before, axis=1)
    tested = changed.copy()
    while True:
        flipped = np.zeros(len(faces), np.bool_)
        near = changed[faces].any(axis=1)
        flipped[near] = _flipped_faces(before, after, faces[near])
        wrong = flipped if flipped.any() else new_crossings(before, after, faces, tested[faces].any(axis=1))
        if not wrong.any():
            return after, held
        back = np.unique(faces[wrong])
        back = back[changed[back]]
        after[back], held[back], changed[back] = before[back], True, False
        if not flipped.any():
            tested[:] = False
            tested[back] = True


def wrong_faces(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32], origin: FloatArray | None = None
) -> tuple[int, int]:
    """How many faces turned over, and how many cross others anew, of all whose vertices (n, 3) moved.

    Where `origin` (n, 3) says from where they were measured, a face turned over if it shows its other side
    there.
    """
    moved = np.any(after != before, axis=1)[faces].any(axis=1)
    sample = faces[moved]
    if origin is None:
        turned = _flipped_faces(before, after, sample)
    else:
        old, new = (np.linalg.det((at - origin)[sample]) for at in (before, after))
        turned = (old * new <= 0) & (old != 0)
    return int(turned.sum()), int(new_crossings(before, after, faces, moved).sum())


def _flipped_faces(before: FloatArray, after: FloatArray, faces: NDArray[np.int32]) -> BoolArray:
    """Faces whose normals turn by more than a right angle, or that collapse."""
    old, new = (
        np.cross(at[faces[:, 1]] - at[faces[:, 0]], at[faces[:, 2]] - at[faces[:, 0]])
        for at in (before, after)
    )
    turned: BoolArray = (np.sum(old * new, axis=1) <= 0) & np.any(old != 0, axis=1)
    return turned


_MOST_CELLS_A_FACE = 4096
_N_NEIGHBOURS = 8  # neighbours within which the density of points is told


@dataclass(frozen=True, slots=True, eq=False)
class HeightGrid:
    """Heights on cells in a plane.

    Attributes
    ----------
    heights : (rows, columns) float
        Over the plane, metres, NaN where there is no mesh.
    cell_m : float
        Side of a cell.
    places : (n, 2) float
        Rows and columns of the vertices, cells.
    """

    heights: FloatArray
    cell_m: float
    places: FloatArray


def grid_of(
    vertices: FloatArray, faces: NDArray[np.int32], plane: Plane, cell_m: float | None, most_cells: int
) -> HeightGrid:
    """Heights of a mesh (n, 3), (m, 3) over a plane, along the principal axes of its vertices in it.

    A cell has the mean height of the vertices in it, or that of the face over its middle. Without faces its
    side is such that two points lie in a usual one.
    """
    places = _principal(plane.to_uv(vertices))
    height = plane.distance(vertices)
    spans = np.ptp(places, axis=0)
    if cell_m is None:
        edges = places[faces] - places[np.roll(faces, 1, axis=1)]
        cell_m = float(np.median(np.linalg.norm(edges, axis=2))) if len(faces) else _side_of_two(places)
    area = 0.5 * np.abs(
        _plane_cross(places[faces[:, 1]] - places[faces[:, 0]], places[faces[:, 2]] - places[faces[:, 0]])
    )
    least = np.sqrt(max(float(area.sum()), float(np.prod(spans)) / 4) / most_cells)
    cell_m = max(cell_m, float(least), 1e-9 * float(spans.max()) + 1e-30)
    places = (places - places.min(axis=0)) / cell_m + 0.5
    shape = (int(places[:, 0].max()) + 1, int(places[:, 1].max()) + 1)
    row, column = np.minimum(places.astype(np.int64), np.array(shape) - 1).T
    cell = row * shape[1] + column
    count = np.bincount(cell, minlength=shape[0] * shape[1])
    total = np.bincount(cell, height, minlength=len(count))
    where, value = _cells_of_faces(places, height, faces, shape)
    n_faces = np.bincount(where, minlength=len(count))
    from_faces = np.bincount(where, value, minlength=len(count))
    with np.errstate(invalid="ignore"):
        heights = np.where(count > 0, total / count, from_faces / n_faces)
    return HeightGrid(heights.reshape(shape), cell_m, places - 0.5)


def _side_of_two(places: FloatArray) -> float:
    """Side of the square that two of the points (n, 2) share, where they lie as densely as usual."""
    near = min(_N_NEIGHBOURS, len(places) - 1)
    away = cKDTree(places).query(places, k=[near + 1])[0]
    return float(np.median(away) * np.sqrt(2 * np.pi / near)) if near else 0.0


def _principal(uv: FloatArray) -> FloatArray:
    """Chart coordinates (n, 2) along the principal axes, the longer last, each from its heavier side."""
    away = uv - uv.mean(axis=0)
    axes = np.linalg.eigh(away.T @ away)[1]
    turned = away @ axes
    side = np.sign(np.sum(turned**3, axis=0))
    out: FloatArray = turned * np.where(side == 0, 1, side)
    return out


def _cells_of_faces(
    places: FloatArray, height: FloatArray, faces: NDArray[np.int32], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Cells (k,) whose middles lie under faces, and the heights of these there."""
    corners = places[faces] - 0.5
    low = np.maximum(np.ceil(corners.min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corners.max(axis=1)), np.array(shape) - 1).astype(np.int64)
    sides = np.maximum(high - low + 1, 0)
    number = sides[:, 0] * sides[:, 1]
    number[number > _MOST_CELLS_A_FACE] = 0
    face = np.repeat(np.arange(len(faces)), number)
    within = np.arange(len(face)) - np.repeat(np.cumsum(number) - number, number)
    at = np.stack([within // sides[face, 1], within % sides[face, 1]], axis=1) + low[face]
    a, b, c = (corners[face, k] for k in range(3))
    whole = _plane_cross(b - a, c - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        second, third = _plane_cross(at - a, c - a) / whole, _plane_cross(b - a, at - a) / whole
    inside: BoolArray = (second >= 0) & (third >= 0) & (second + third <= 1)
    corner = height[faces[face[inside]]]
    share = np.stack([1 - second - third, second, third], axis=1)[inside]
    return at[inside, 0] * shape[1] + at[inside, 1], np.sum(corner * share, axis=1)


def _plane_cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Cross product of plane vectors (n, 2)."""
    out: FloatArray = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    return out
