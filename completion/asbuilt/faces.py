# SPDX-License-Identifier: MIT
"""Faces of a design: planes and cylinders that its triangles make up, element by element."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from scenes.checks import BoolArray, FloatArray, freeze_arrays
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh

N_COLUMNS = 5
"""Parameters of a face: offset, two tilts and two bends of a plane; shifts, tilts, radius of a cylinder."""

_SAME_M = 1e-5  # of corners, times the scale
_TWIN_M = 1e-4  # times the scale, between two elements that are one
_MOST_PATCHES = 2_000  # of an element, that are compared with each other


@dataclass(frozen=True, slots=True, eq=False)
class DesignFaces:
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

    def __post_init__(self) -> None:
        freeze_arrays(self)

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
    corners, normals, areas = mesh.corners, mesh.face_normals(), mesh.face_areas()
    usable = areas > (1e-6 * scale) ** 2
    look = mesh.appearance
    if look is not None and look.opacity is not None:
        usable &= look.opacity >= SEE_THROUGH
    pairs = _neighbours(mesh, usable, scale)
    angle = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", *normals[pairs.T]), -1, 1)))
    patch = _components(pairs[angle < COPLANAR_DEG], len(areas))
    patch[~usable] = -1
    found = _Collected(corners, normals, areas, mesh.face_surface, scale)
    bends = pairs[(angle >= COPLANAR_DEG) & (angle < FACET_DEG)]
    found.add_cylinders(patch, bends)
    found.add_planes(patch)
    return found.faces()


def _neighbours(mesh: LabelledMesh, usable: BoolArray, scale: float) -> NDArray[np.int64]:
    """Pairs (k, 2) of triangles of one element that share an edge."""
    place = np.rint((mesh.vertices - mesh.vertices.min(axis=0)) / (_SAME_M * scale)).astype(np.int64)
    number = np.unique(place, axis=0, return_inverse=True)[1].reshape(-1)[mesh.faces]
    chosen = np.flatnonzero(usable)
    ends = np.concatenate([number[chosen][:, [k, (k + 1) % 3]] for k in range(3)])
    key = np.column_stack([np.tile(mesh.face_surface[chosen], 3), np.sort(ends, axis=1)])
    order = np.lexsort(key.T)
    same = (key[order[1:]] == key[order[:-1]]).all(axis=1)
    triangle = np.tile(chosen, 3)[order]
    return np.column_stack([triangle[:-1][same], triangle[1:][same]])


def _components(pairs: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    graph = coo_array((np.ones(len(pairs), np.bool_), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    label: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return label


class _Collected:
    """Faces as they are found."""

    def __init__(
        self,
        corners: FloatArray,
        normals: FloatArray,
        areas: FloatArray,
        element: NDArray[np.int32],
        scale: float,
    ) -> None:
        self.corners, self.normals, self.areas = corners, normals, areas
        self.element, self.scale = element, scale
        self.of_triangle = np.full(len(areas), -1, np.int32)
        self.rows: list[
            tuple[int, int, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float]
        ] = []

    def add_cylinders(self, patch: NDArray[np.int64], bends: NDArray[np.int64]) -> None:
        """Take patches that bend into each other where their corners lie on a circle about one axis."""
        whole = _components(np.concatenate([
            bends, np.column_stack([np.arange(len(patch)), _first_of(patch)])
        ]), len(patch))  # fmt: skip
        for triangles in _groups(whole, patch >= 0):
            bend = len(np.unique(patch[triangles]))
            if bend >= FEWEST_FACETS or (bend == 1 and len(triangles) > FEWEST_FACETS):
                self._try_cylinder(triangles)

    def _try_cylinder(self, triangles: NDArray[np.int64]) -> None:
        normals, areas = self.normals[triangles], self.areas[triangles]
        values, vectors = np.linalg.eigh((normals * areas[:, None]).T @ normals)
        axis = vectors[:, 0]
        if values[1] <= 1e-3 * values[2] or np.abs(normals @ axis).max() > np.sin(np.radians(COPLANAR_DEG)):
            return
        axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
        corners = self.corners[triangles].reshape(-1, 3)
        u = _across(axis)
        v = np.cross(axis, u)
        middle = corners.mean(axis=0)
        flat = (corners - middle) @ np.column_stack([u, v])
        design = np.column_stack([2 * flat, np.ones(len(flat))])
        x, y, rest = np.linalg.lstsq(design, np.square(flat).sum(axis=1), rcond=None)[0]
        radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
        misfit = np.abs(np.hypot(flat[:, 0] - x, flat[:, 1] - y) - radius).max()
        if not radius or misfit > max(ROUND * radius, COPLANAR_M * self.scale / 4):
            return
        along = (corners - middle) @ axis
        low, high = along.min(), along.max()
        centre = middle + x * u + y * v + (low + high) / 2 * axis
        outwards = self.corners[triangles].mean(axis=1) - centre
        sign = 1 if (np.einsum("ij,ij->i", outwards, normals) * areas).sum() > 0 else -1
        half = (high - low) / 2
        if areas.sum() >= LEAST_FACE_M2 * self.scale**2 and 2 * half >= LEAST_WIDTH_M * self.scale:
            self._add(triangles, sign, centre, axis, u, v, np.array([half, half]), radius)

    def add_planes(self, patch: NDArray[np.int64]) -> None:
        """Join flat patches of one element that lie in one plane."""
        free = (patch >= 0) & (self.of_triangle < 0)
        for triangles in _groups(self.element, free):
            self._planes_of(triangles, patch[triangles])

    def _planes_of(self, triangles: NDArray[np.int64], patch: NDArray[np.int64]) -> None:
        names, own = np.unique(patch, return_inverse=True)
        area = np.bincount(own, self.areas[triangles])
        weighted = self.normals[triangles] * self.areas[triangles, None]
        normal = np.column_stack([np.bincount(own, weighted[:, k]) for k in range(3)]).astype(np.float64)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        taken = np.zeros(len(names), np.bool_)
        order = np.argsort(-area, kind="stable")
        small = area[order[0]] * 1e-4
        near = order[:_MOST_PATCHES]
        corners = self.corners[triangles]
        for seed in near:
            if taken[seed] or area[seed] < small:
                continue
            ways = near[~taken[near] & (normal[near] @ normal[seed] > np.cos(np.radians(COPLANAR_DEG)))]
            if area[ways].sum() < LEAST_FACE_M2 * self.scale**2:
                continue
            held = np.isin(own, ways)
            start = corners[own == seed].reshape(-1, 3).mean(axis=0)
            off = np.zeros(len(names))
            np.maximum.at(off, own[held], np.abs((corners[held] - start) @ normal[seed]).max(axis=1))
            joined = ways[off[ways] <= COPLANAR_M * self.scale]
            if seed not in joined:
                taken[seed] = True  # not flat
                continue
            taken[joined] = True
            if area[joined].sum() >= LEAST_FACE_M2 * self.scale**2:
                self._add_plane(triangles[np.isin(own, joined)], normal[seed])

    def _add_plane(self, triangles: NDArray[np.int64], normal: FloatArray) -> None:
        corners = self.corners[triangles].reshape(-1, 3)
        u = _across(normal)
        v = np.cross(normal, u)
        flat = corners @ np.column_stack([u, v])
        low, high = flat.min(axis=0), flat.max(axis=0)
        if (high - low).min() < LEAST_WIDTH_M * self.scale:
            return
        offset = (corners @ normal).mean()
        middle = (low + high) / 2
        centre = middle[0] * u + middle[1] * v + offset * normal
        self._add(triangles, 0, centre, normal, u, v, (high - low) / 2, 0.0)

    def _add(
        self,
        triangles: NDArray[np.int64],
        sign: int,
        centre: FloatArray,
        normal: FloatArray,
        u: FloatArray,
        v: FloatArray,
        half: FloatArray,
        radius: float,
    ) -> None:
        self.of_triangle[triangles] = len(self.rows)
        self.rows.append((int(self.element[triangles[0]]), sign, centre, normal, u, v, half, radius))

    def faces(self) -> DesignFaces:
        n = len(self.rows)
        held = self.of_triangle >= 0
        element, sign, centre, normal, u, v, half, radius = zip(*self.rows, strict=True) if n else ((),) * 8
        return DesignFaces(
            of_triangle=self.of_triangle,
            element=np.array(element, np.int32),
            sign=np.array(sign, np.int8),
            centre=np.array(centre).reshape(n, 3),
            normal=np.array(normal).reshape(n, 3),
            u=np.array(u).reshape(n, 3),
            v=np.array(v).reshape(n, 3),
            half=np.array(half).reshape(n, 2),
            radius=np.array(radius, float),
            area=np.bincount(self.of_triangle[held], self.areas[held], n).astype(np.float64),
        )


def _first_of(label: NDArray[np.int64]) -> NDArray[np.int64]:
    """Place (n,) of the first that has the same label; its own where that is negative."""
    first = np.unique(label, return_index=True, return_inverse=True)
    return np.where(label >= 0, first[1][first[2].reshape(-1)], np.arange(len(label)))


def _groups(label: NDArray[np.integer], chosen: BoolArray) -> list[NDArray[np.int64]]:
    """Indices of those chosen, by label."""
    index = np.flatnonzero(chosen)
    order = index[np.argsort(label[index], kind="stable")]
    if not len(order):
        return []
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _across(axis: FloatArray) -> FloatArray:
    """A unit vector across an axis, level where there is one."""
    level = np.cross([0.0, 0.0, 1.0], axis)
    if np.linalg.norm(level) < 1e-3:
        level = np.cross([0.0, 1.0, 0.0], axis)
    return np.asarray(level / np.linalg.norm(level), dtype=np.float64)
