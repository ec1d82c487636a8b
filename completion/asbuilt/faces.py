# SPDX-License-Identifier: MIT
"""Faces of a design: planes and cylinders that its triangles make up, element by element."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.asbuilt.limits import (
    COPLANAR_DEG,
    COPLANAR_M,
    FACET_DEG,
    FEWEST_FACETS,
    FULL_SIZE_M,
    LEAST_FACE_M2,
    LEAST_WIDTH_M,
    ROUND,
    SEE_THROUGH,
)
from completion.observe.rays import Triple, dot, minus
from scenes.checks import ArrayValue, BoolArray, FloatArray
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from texture.engine.compiled import compiled, inlined

N_COLUMNS = 5
"""Parameters of a face: offset, two tilts and two bends of a plane; shifts, tilts, radius of a cylinder."""

_SAME_M = 1e-5  # of corners, times the scale
_TWIN_M = 1e-4  # times the scale, between two elements that are one
_MOST_PATCHES = 2_000  # of an element, that are compared with each other
_LEAST_SHARE = 1e-4  # of the largest patch of an element, of what a plane is looked for from
_COSINE = float(np.cos(np.radians(COPLANAR_DEG)))


@dataclass(frozen=True, slots=True, eq=False)
class DesignFaces(ArrayValue):
    """F planes and cylinders, and to which of them each of m triangles belongs.

    Attributes
    ----------
    of_triangle : (m,) int32
        Face of each triangle, -1 for those too small to be tested.
    element : (F,) int32
        Surface id.
    sign : (F,) int8
        0 of planes; 1 of cylinders seen from outside, -1 of holes.
    centre, normal, u, v : (F, 3) float
        Middle; outward normal of a plane, direction of an axis; and two unit vectors across it.
    half : (F, 2) float
        Half of the extents along u and v; of cylinders half the length, twice.
    radius : (F,) float
        Of cylinders; 0.
    area : (F,) float
        Square metres.
    """

    of_triangle: NDArray[np.int32]
    element: NDArray[np.int32]
    sign: NDArray[np.int8]
    centre: FloatArray
    normal: FloatArray
    u: FloatArray
    v: FloatArray
    half: FloatArray
    radius: FloatArray
    area: FloatArray

    def __len__(self) -> int:
        """How many there are."""
        return len(self.element)

    def places(self, face: NDArray[np.int32], points: FloatArray) -> FacePlaces:
        """Return where points (n, 3) are on, and how far from, one face each (n,)."""
        away = points - self.centre[face]
        along = np.einsum("ij,ij->i", away, self.normal[face])
        pu, pv = (np.einsum("ij,ij->i", away, axis[face]) for axis in (self.u, self.v))
        hu, hv = self.half[face].T
        normal, columns = self.normal[face].copy(), np.zeros((len(face), N_COLUMNS))
        sign = self.sign[face].astype(float)
        radial = np.maximum(np.hypot(pu, pv), 1e-12)
        is_round = sign != 0
        columns[:, 0], columns[:, 1], columns[:, 2] = 1.0, pu / hu, pv / hv
        uv = np.column_stack([pu / hu, pv / hv])
        distance = along.copy()
        if is_round.any():
            k = np.flatnonzero(is_round)
            cosine, sine = pu[k] / radial[k], pv[k] / radial[k]
            outwards = cosine[:, None] * self.u[face[k]] + sine[:, None] * self.v[face[k]]
            normal[k] = sign[k, None] * outwards
            distance[k] = sign[k] * (radial[k] - self.radius[face[k]])
            s = along[k] / hu[k]
            columns[k] = sign[k, None] * np.column_stack([
                cosine, sine, s * cosine, s * sine, np.ones(len(k))
            ])  # fmt: skip
            uv[k] = np.column_stack([s, np.arctan2(sine, cosine) / np.pi])
        return FacePlaces(distance, normal, columns, uv)


@dataclass(frozen=True, slots=True, eq=False)
class FacePlaces:
    """Where points are on a face each.

    Signed `distance` (n,) outwards, `normal` (n, 3) there, the derivative `columns` (n, 5) of the surface's
    place along it by the face's parameters, and the place `uv` (n, 2) on it, from -1 to 1.
    """

    distance: FloatArray
    normal: FloatArray
    columns: FloatArray
    uv: FloatArray


def elements_of(design: ElementMesh, mesh: LabelledMesh, faces: DesignFaces) -> ElementMesh:
    """Return a part as a design whose elements are its faces, the last what is on none of them.

    `mesh` is that of the design as `faces` were found on it. Holes and faces of a part have tolerances of
    their own; as one element it would be judged by its largest faces alone.
    """
    kinds = [("face", "cylinder", "hole")[sign] for sign in faces.sign.tolist()]
    names = [
        f"{kind} {k}" + (f", radius {1000 * radius:.2f} mm" if radius else "")
        for k, (kind, radius) in enumerate(zip(kinds, faces.radius.tolist(), strict=True), start=1)
    ]
    of = np.where(faces.of_triangle < 0, len(faces), faces.of_triangle).astype(np.int32)
    return ElementMesh(
        replace(mesh, face_surface=of), (*map(Element, names), Element("other surface")), design.name
    )


def scale_of(mesh: LabelledMesh) -> float:
    """By what the lengths of a building shrink for a design: 1 for what is as large as a room."""
    size = np.ptp(mesh.vertices[mesh.faces.ravel()], axis=0)
    return min(1.0, float(np.sqrt(size @ size)) / FULL_SIZE_M)


def twins_of(mesh: LabelledMesh, scale: float) -> dict[int, int]:
    """Return the elements whose surface is that of an earlier one, and which: box, area and middle agree."""
    element, areas, n = mesh.face_surface, mesh.face_areas(), int(mesh.face_surface.max()) + 1
    low, high, total = np.full((n, 3), np.inf), np.full((n, 3), -np.inf), np.bincount(element, areas, n)
    np.minimum.at(low, element, mesh.corners.min(axis=1))
    np.maximum.at(high, element, mesh.corners.max(axis=1))
    weighted = mesh.corners.mean(axis=1) * areas[:, None]
    middle = np.column_stack([np.bincount(element, weighted[:, k], n) for k in range(3)])
    there = np.flatnonzero(total > 0)
    found = np.column_stack([low, high, middle / np.maximum(total, 1e-30)[:, None], np.sqrt(total)])[there]
    twins = dict[int, int]()
    for a, b in sorted(cKDTree(found).query_pairs(_TWIN_M * scale)):
        twins.setdefault(int(there[b]), twins.get(int(there[a]), int(there[a])))
    return twins


def find_faces(mesh: LabelledMesh, scale: float) -> DesignFaces:
    """Find the planes and cylinders of all elements of a mesh; material that light passes has none."""
    given = _Triangles(mesh.corners, mesh.face_normals(), mesh.face_areas(), mesh.face_surface, scale)
    usable = given.area > (1e-6 * scale) ** 2
    look = mesh.appearance
    if look is not None and look.opacity is not None:
        usable &= look.opacity >= SEE_THROUGH
    pairs = _neighbours(mesh, usable, scale)
    angle = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", *given.normal[pairs.T]), -1, 1)))
    patch = _components(pairs[angle < COPLANAR_DEG], len(usable))
    bends = pairs[(angle >= COPLANAR_DEG) & (angle < FACET_DEG)]
    whole = _components(patch[bends], len(usable))[patch]
    patch[~usable] = -1
    of_triangle = np.full(len(usable), -1, np.int32)
    rounds = _cylinders(given, patch, whole, of_triangle)
    patch[of_triangle >= 0] = -1
    flats = _planes(given, patch, of_triangle, len(rounds.sign))
    both: Iterator[Any] = zip(rounds, flats, strict=True)
    forms = _Forms(*map(np.concatenate, both))
    held = of_triangle >= 0
    element = np.zeros(len(forms.sign), np.int32)
    element[of_triangle[held]] = given.element[held]
    area = np.bincount(of_triangle[held], given.area[held], len(element)).astype(np.float64)
    return DesignFaces(of_triangle, element, *forms, area)


class _Triangles(NamedTuple):
    """Triangles (m,) of a design of a scale: corners (m, 3, 3), unit normals, areas and elements."""

    corners: FloatArray
    normal: FloatArray
    area: FloatArray
    element: NDArray[np.int32]
    scale: float


class _Forms(NamedTuple):
    """Planes or cylinders (k,), as `DesignFaces` has them."""

    sign: NDArray[np.int8]
    centre: FloatArray
    normal: FloatArray
    u: FloatArray
    v: FloatArray
    half: FloatArray
    radius: FloatArray


_Row = tuple[int, FloatArray, FloatArray, FloatArray, FloatArray, tuple[float, float], float]
"""What `_Forms` has of one."""


class _Patches(NamedTuple):
    """Flat patches (p,) by element, the largest first: normals, areas, triangles from `start` to `end`."""

    normal: FloatArray
    area: FloatArray
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    triangles: NDArray[np.int64]  # of all


def _neighbours(mesh: LabelledMesh, usable: BoolArray, scale: float) -> NDArray[np.int64]:
    """Pairs (k, 2) of triangles of one element that share an edge."""
    place = np.rint((mesh.vertices - mesh.vertices.min(axis=0)) / (_SAME_M * scale)).astype(np.int64)
    order, number = np.lexsort(place.T), np.zeros(len(place), np.int64)
    number[order[1:]] = np.cumsum((place[order[1:]] != place[order[:-1]]).any(axis=1))
    chosen = np.flatnonzero(usable)
    corner = number[mesh.faces[chosen]]
    ends = np.concatenate([np.sort(corner[:, [k, (k + 1) % 3]], axis=1) for k in range(3)])
    edge, element = ends[:, 0] * len(place) + ends[:, 1], np.tile(mesh.face_surface[chosen], 3)
    order = np.lexsort((edge, element))
    same = (np.diff(edge[order]) == 0) & (np.diff(element[order]) == 0)
    triangle = np.tile(chosen, 3)[order]
    return np.column_stack([triangle[:-1][same], triangle[1:][same]])


def _components(pairs: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    label: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return label


def _groups(label: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order (k,) of those with a label from 0 on, by label; where each label starts in it, and the end."""
    index = np.flatnonzero(label >= 0)
    order = index[np.argsort(label[index], kind="stable")]
    return order, np.flatnonzero(np.diff(label[order], prepend=-1, append=-2))


def _cylinders(
    given: _Triangles, patch: NDArray[np.int64], whole: NDArray[np.int64], of_triangle: NDArray[np.int32]
) -> _Forms:
    """Take patches that bend into each other where their corners lie on a circle about one axis.

    `whole` (m,) is what bends together; `of_triangle` gets the numbers of cylinders.
    """
    first = np.unique(patch, return_index=True)[1]
    n_patches = np.bincount(whole[first[patch[first] >= 0]], minlength=len(patch))
    n_triangles = np.bincount(whole[patch >= 0], minlength=len(patch))
    likely = (n_patches >= FEWEST_FACETS) | ((n_patches == 1) & (n_triangles > FEWEST_FACETS))
    order, bounds = _groups(np.where((patch >= 0) & likely[whole], whole, -1))
    normal, own = given.normal[order], np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    squares = np.einsum("ni,nj,n->nij", normal, normal, given.area[order])
    values, vectors = np.linalg.eigh(np.add.reduceat(squares, bounds[:-1]))
    slope = np.abs(np.einsum("ni,ni->n", normal, vectors[own, :, 0]))
    straight = np.maximum.reduceat(slope, bounds[:-1]) <= np.sin(np.radians(COPLANAR_DEG))
    rows: list[_Row] = []
    for k in np.flatnonzero(straight & (values[:, 1] > 1e-3 * values[:, 2])).tolist():
        triangles = order[bounds[k] : bounds[k + 1]]
        row = _cylinder(given, triangles, vectors[k, :, 0])
        if row is not None:
            of_triangle[triangles] = len(rows)
            rows.append(row)
    columns: Sequence[Any] = list(zip(*rows, strict=True)) or [()] * len(_Forms._fields)
    sizes = ((), (3,), (3,), (3,), (3,), (2,), ())
    forms = (np.array(each, float).reshape(-1, *size) for each, size in zip(columns, sizes, strict=True))
    sign, *rest = forms
    return _Forms(sign.astype(np.int8), *rest)


def _cylinder(given: _Triangles, triangles: NDArray[np.int64], axis: FloatArray) -> _Row | None:
    """What `_Forms` has of the cylinder that triangles make up about an axis; None for none."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    corners = given.corners[triangles].reshape(-1, 3)
    u = _across(axis[None])[0]
    v = np.cross(axis, u)
    middle = corners.mean(axis=0)
    flat = (corners - middle) @ np.column_stack([u, v])
    design = np.column_stack([2 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(design, np.square(flat).sum(axis=1), rcond=None)[0]
    radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
    misfit = np.abs(np.hypot(flat[:, 0] - x, flat[:, 1] - y) - radius).max()
    if not radius or misfit > max(ROUND * radius, COPLANAR_M * given.scale / 4):
        return None
    along = (corners - middle) @ axis
    low, high = along.min(), along.max()
    areas, half = given.area[triangles], float(high - low) / 2
    if areas.sum() < LEAST_FACE_M2 * given.scale**2 or 2 * half < LEAST_WIDTH_M * given.scale:
        return None
    centre = middle + x * u + y * v + (low + high) / 2 * axis
    outwards = given.corners[triangles].mean(axis=1) - centre
    is_outside = (np.einsum("ij,ij->i", outwards, given.normal[triangles]) * areas).sum() > 0
    return 1 if is_outside else -1, centre, axis, u, v, (half, half), radius


def _planes(
    given: _Triangles, patch: NDArray[np.int64], of_triangle: NDArray[np.int32], first: int
) -> _Forms:
    """Join flat patches of one element that lie in one plane.

    `patch` (m,) is -1 of other triangles; `of_triangle` gets the numbers of planes, from `first` on.
    """
    triangles, bounds = _groups(patch)
    n, own = len(bounds) - 1, np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    area = np.bincount(own, given.area[triangles], n).astype(np.float64)
    weighted = given.normal[triangles] * given.area[triangles, None]
    normal = np.column_stack([np.bincount(own, weighted[:, k], n) for k in range(3)])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    element = given.element[triangles[bounds[:-1]]]
    rank = np.lexsort((-area, element))
    starts = np.flatnonzero(np.diff(element[rank], prepend=-1, append=-2))
    place = np.arange(n) - np.repeat(starts[:-1], np.diff(starts))
    rank = rank[place < _MOST_PATCHES]
    starts = np.flatnonzero(np.diff(element[rank], prepend=-1, append=-2))
    patches = _Patches(normal[rank], area[rank], bounds[:-1][rank], bounds[1:][rank], triangles)
    least = LEAST_FACE_M2 * given.scale**2
    plane, seed = _joined(patches, starts, given.corners, COPLANAR_M * given.scale, least)
    held = np.flatnonzero(plane >= 0)
    held = held[(np.bincount(plane[held], patches.area[held], len(seed)) >= least)[plane[held]]]
    of_patch, number = np.full(n, -1), np.full(len(patch), -1)
    of_patch[rank[held]] = plane[held]
    number[triangles] = of_patch[own]
    return _outlines(given, number, patches.normal[seed], of_triangle, first)


@compiled
def _joined(
    patches: _Patches, starts: NDArray[np.int64], corners: FloatArray, off_m: float, least_m2: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Number (p,) of the plane of each patch, -1 for none, and the patch (k,) whose plane each one is.

    The patches of an element are from `starts[k]` to `starts[k + 1]`.
    """
    normal, area = patches.normal, patches.area
    plane, seeds, n = np.full(area.size, -1), np.empty(area.size, np.int64), 0
    like = np.empty(area.size, np.int64)
    for element in range(starts.size - 1):
        low, high = starts[element], starts[element + 1]
        for seed in range(low, high):
            if plane[seed] != -1:
                continue
            if area[seed] < area[low] * _LEAST_SHARE:
                break
            count, total = 0, 0.0
            for k in range(low, high):
                cosine = 0.0
                for j in range(3):
                    cosine += normal[k, j] * normal[seed, j]
                if plane[k] == -1 and cosine > _COSINE:
                    like[count], count, total = k, count + 1, total + area[k]
            if total < least_m2:
                continue
            way = normal[seed, 0], normal[seed, 1], normal[seed, 2]
            near = _middle(patches, seed, corners), way, off_m
            if not _is_on(patches, seed, corners, near):
                plane[seed] = -2  # not flat
                continue
            for k in like[:count]:
                if _is_on(patches, k, corners, near):
                    plane[k] = n
            seeds[n], n = seed, n + 1
    return plane, seeds[:n]


@inlined
def _middle(patches: _Patches, patch: int, corners: FloatArray) -> Triple:
    """Mean of the corners of a patch."""
    x, y, z = 0.0, 0.0, 0.0
    for t in patches.triangles[patches.start[patch] : patches.end[patch]]:
        for j in range(3):
            x, y, z = x + corners[t, j, 0], y + corners[t, j, 1], z + corners[t, j, 2]
    n = 3 * (patches.end[patch] - patches.start[patch])
    return x / n, y / n, z / n


@inlined
def _is_on(patches: _Patches, patch: int, corners: FloatArray, near: tuple[Triple, Triple, float]) -> bool:
    """Whether all corners of a patch are near a plane, by a place on it, its normal, and how near, metres."""
    start, way, off_m = near
    for t in patches.triangles[patches.start[patch] : patches.end[patch]]:
        for j in range(3):
            corner = corners[t, j, 0], corners[t, j, 1], corners[t, j, 2]
            if not abs(dot(minus(corner, start), way)) <= off_m:
                return False
    return True


def _outlines(
    given: _Triangles,
    number: NDArray[np.int64],
    normal: FloatArray,
    of_triangle: NDArray[np.int32],
    first: int,
) -> _Forms:
    """Planes of triangles by number (m,), -1 for none, without narrow ones; their normals are (n, 3)."""
    triangles, bounds = _groups(number)
    own, normal = (
        np.repeat(np.arange(len(bounds) - 1), np.diff(bounds)),
        normal[number[triangles[bounds[:-1]]]],
    )
    u = _across(normal)
    v = np.cross(normal, u)
    corners, starts = given.corners[triangles], bounds[:-1]
    flat = np.stack([np.einsum("tkj,tj->tk", corners, axis[own]) for axis in (u, v)], axis=2)
    low, high = (
        each.reduceat(each.reduce(flat, axis=1), starts, axis=0) for each in (np.minimum, np.maximum)
    )
    offset = np.add.reduceat(np.einsum("tkj,tj->t", corners, normal[own]), starts) / (3 * np.diff(bounds))
    middle = (low + high) / 2
    centre = middle[:, :1] * u + middle[:, 1:] * v + offset[:, None] * normal
    wide = (high - low).min(axis=1) >= LEAST_WIDTH_M * given.scale
    kept = wide[own]
    of_triangle[triangles[kept]] = first + (np.cumsum(wide) - 1)[own[kept]]
    forms = _Forms(
        sign=np.zeros(len(u), np.int8), centre=centre, normal=normal, u=u, v=v, half=(high - low) / 2,
        radius=np.zeros(len(u)),
    )  # fmt: skip
    return _Forms(*(each[wide] for each in forms))


def _across(axis: FloatArray) -> FloatArray:
    """Unit vectors (n, 3) across axes, level where there are such."""
    level = np.cross([0.0, 0.0, 1.0], axis)
    upright = np.linalg.norm(level, axis=1) < 1e-3
    level[upright] = np.cross([0.0, 1.0, 0.0], axis[upright])
    return np.asarray(level / np.linalg.norm(level, axis=1, keepdims=True), dtype=np.float64)
