# SPDX-License-Identifier: MIT
"""Tessellated models: meshes whose vertices lie exactly on the surfaces of a CAD model, divided at its faces.

Triangles that lie in one plane are a patch. Patches that turn a little from one to the next are chords of a
curved surface, if one holds all their corners exactly; what is left over are planes. A scanner's mesh has no
such surfaces, and so is told from a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from completion.parts.division import limits
from completion.parts.division.growing import N_PARAMETERS, hypotheses, reachable, refine_surface
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.surfaces.catalogue import Plane, Surface

_CURVED = "cylinder", "cone", "sphere", "torus"  # the simplest first
_ROUNDS = 20
_STARTING = 2  # of these until a start must be right
_SURELY_MANY = 30  # triangles on one surface
_END = 0.05  # of an edge
_DEEPEST = 3  # neighbours that a start looks at
_MOST_FAILED = 20  # seeds without a surface, before a mesh that has explained little counts as scanned


@dataclass(frozen=True, slots=True, eq=False)
class Tessellation:
    """Faces of a tessellated model.

    Attributes
    ----------
    labels : (m,) int
        Face of each triangle, from 1; 0 for what is on no surface of a known kind.
    surfaces : tuple of Surface
        One a face.
    free_form : float
        Share of the area that is on none.
    """

    labels: IntArray
    surfaces: tuple[Surface, ...]
    free_form: float


class _Patches(NamedTuple):
    """Patches (p,) of coplanar triangles.

    `of` (m,) is that of each triangle, `corner` (k,) are vertices, those of patch i from `first[i]` to
    `first[i + 1]`; `bends` (p, p) links neighbours that turn little; `n_triangles` in each; `is_thin`: its normal
    says nothing; `is_inner`: it has no sharp edge.
    """

    of: IntArray
    area: FloatArray
    normal: FloatArray
    centroid: FloatArray
    first: IntArray
    corner: IntArray
    bends: csr_array
    n_triangles: IntArray
    is_seed: BoolArray
    is_thin: BoolArray
    is_inner: BoolArray
    mesh: LabelledMesh
    tolerance_m: float


def divide_tessellated(mesh: LabelledMesh, tolerance_m: float) -> Tessellation | None:
    """Divide a mesh where the faces of its model are; None where it is no model's.

    Parameters
    ----------
    mesh : LabelledMesh
        Metres; triangles of neighbours share their vertices.
    tolerance_m : float
        How far vertices may be off their surface: the file's precision.
    """
    patches = _patches_of(mesh, tolerance_m)
    face, surfaces = np.full(len(patches.area), -1, dtype=np.int64), list[Surface]()
    is_tried, n_bends = ~patches.is_seed, np.diff(patches.bends.indptr)
    total, n_failed = float(patches.area.sum()), 0
    for seed in np.lexsort((-patches.area, -_depths(patches))):
        if face[seed] >= 0 or is_tried[seed] or not n_bends[seed]:
            continue
        found = _grown_from(patches, int(seed), face < 0)
        if found is None:
            is_tried[seed] = True
            for ring in _rings(patches, int(seed), face < 0)[:2]:
                is_tried[ring[patches.n_triangles[ring] == 1]] = True
            n_failed += 1
            if n_failed == _MOST_FAILED and _explained(patches, face) < limits.MODEL_SHARE * total:
                return None
            continue
        face[found.members] = len(surfaces)
        surfaces.append(found.surface)
    surfaces = _absorbed(patches, surfaces, face)
    if _explained(patches, face) < limits.MODEL_SHARE * total:
        return None
    for patch in np.flatnonzero((face < 0) & ~_is_free_form(patches, face)):
        corners = mesh.vertices[patches.corner[patches.first[patch] : patches.first[patch + 1]]]
        face[patch] = len(surfaces)
        surfaces.append(Plane(corners.mean(axis=0), patches.normal[patch]))
    free_form = float(patches.area[face < 0].sum()) / total
    return Tessellation(face[patches.of] + 1, tuple(surfaces), free_form)


def _explained(patches: _Patches, face: IntArray) -> float:
    """Area on curved surfaces, and in planes of several triangles."""
    return float(patches.area[(face >= 0) | (patches.n_triangles > 1)].sum())


def _is_free_form(patches: _Patches, face: IntArray) -> BoolArray:
    """Which patches (p,) are single triangles that turn little to others of their like, on no surface."""
    left = (face < 0) & (patches.n_triangles == 1)
    first = np.repeat(np.arange(len(left)), np.diff(patches.bends.indptr))
    beside = np.bincount(first, left[patches.bends.indices], minlength=len(left))
    return np.asarray((left & (beside > 0)) | ((face < 0) & (patches.area <= 0)))


def _patches_of(mesh: LabelledMesh, tolerance_m: float) -> _Patches:
    """Triangles joined where they lie in one plane."""
    n, areas, normals = len(mesh.faces), mesh.face_areas(), mesh.face_normals()
    a, b, over = _pairs(mesh)
    large, small = np.where(areas[a] >= areas[b], a, b), np.where(areas[a] >= areas[b], b, a)
    other = np.where(areas[a] >= areas[b], over[:, 1], over[:, 0])
    height = np.einsum("ij,ij->i", mesh.vertices[other] - mesh.vertices[mesh.faces[large, 0]], normals[large])
    is_flat = np.abs(height) <= tolerance_m
    same = np.einsum("ij,ij->i", normals[a], normals[b])
    is_thin = 2 * areas <= limits.THIN * tolerance_m * _longest(mesh)
    wide = 2 * areas / np.maximum(_longest(mesh), 1e-300)
    unsure = limits.EXACTLY_FLAT + limits.ROUNDED * tolerance_m / np.maximum(wide[small], 1e-300)
    is_flat &= (np.arccos(np.clip(same, -1, 1)) <= unsure) & ~is_thin[small]
    graph = coo_array((np.ones(is_flat.sum()), (a[is_flat], b[is_flat])), shape=(n, n))
    of = connected_components(graph, directed=False)[1].astype(np.int64)
    p = int(of.max()) + 1
    area: FloatArray = np.bincount(of, areas, minlength=p).astype(np.float64)
    normal: FloatArray = np.column_stack([np.bincount(of, areas * way, minlength=p) for way in normals.T])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    middle = mesh.corners.mean(axis=1)
    centroid: FloatArray = np.column_stack([np.bincount(of, areas * one, minlength=p) for one in middle.T])
    centroid = centroid / np.maximum(area[:, None], 1e-300)
    pairs = _outline_corners(mesh, of, tolerance_m)
    first = np.searchsorted(pairs[:, 0], np.arange(p + 1))
    i, j = of[a], of[b]
    apart = i != j
    i, j = i[apart], j[apart]
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normal[i], normal[j]), -1, 1))
    inner = np.ones(p, np.bool_)
    inner[np.concatenate([i[turn >= limits.FACET_TURN], j[turn >= limits.FACET_TURN]])] = False
    thin = np.ones(p, np.bool_)
    np.logical_and.at(thin, of, is_thin)
    bent = (turn < limits.FACET_TURN) | thin[i] | thin[j]
    both = np.concatenate([i[bent], j[bent]]), np.concatenate([j[bent], i[bent]])
    bends = csr_array((np.ones(len(both[0])), both), shape=(p, p))
    count = np.bincount(of, minlength=p)
    is_seed = (area > 0) & ~thin
    return _Patches(
        of, area, normal, centroid, first=first, corner=pairs[:, 1], bends=bends, n_triangles=count,
        is_seed=is_seed, is_thin=thin, is_inner=inner, mesh=mesh, tolerance_m=tolerance_m,
    )  # fmt: skip


def _outline_corners(mesh: LabelledMesh, of: IntArray, tolerance_m: float) -> IntArray:
    """Patch and vertex (k, 2), ascending, where outlines of patches turn: not within a side, nor inside."""
    faces, n = mesh.faces.astype(np.int64), len(mesh.vertices)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    patch = np.repeat(of, 3)
    key = (patch * n + np.minimum(start, end)) * n + np.maximum(start, end)
    _, place, count = np.unique(key, return_inverse=True, return_counts=True)
    outer = count[place.reshape(-1)] == 1
    start, end, patch = start[outer], end[outer], patch[outer]
    at = np.concatenate([patch * n + start, patch * n + end])
    other = np.concatenate([end, start])
    order = np.argsort(at, kind="stable")
    at, other = at[order], other[order]
    known, first, count = np.unique(at, return_index=True, return_counts=True)
    vertex = known % n
    last = np.minimum(first + 1, len(other) - 1)
    sides = [mesh.vertices[other[place]] - mesh.vertices[vertex] for place in (first, last)]
    across = np.linalg.norm(np.cross(*sides), axis=1)
    chord = np.linalg.norm(sides[0] - sides[1], axis=1)
    is_straight = (count == 2) & (across <= tolerance_m * chord)
    is_straight &= np.einsum("ij,ij->i", *sides) < 0
    return np.asarray(np.column_stack([known // n, vertex])[~is_straight])


def _longest(mesh: LabelledMesh) -> FloatArray:
    """Longest edge (m,) of each triangle."""
    return np.asarray(np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2).max(axis=1))


def _pairs(mesh: LabelledMesh) -> tuple[IntArray, IntArray, IntArray]:
    """Triangles (e,), (e,) beside edges, and the corner (e, 2) of each that is not on it."""
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    triangle, opposite = np.repeat(np.arange(len(mesh.faces)), 3), mesh.faces[:, [2, 0, 1]].ravel()
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, triangle, opposite = edges[order], triangle[order], opposite[order]
    start = np.flatnonzero(np.concatenate([[True], (edges[1:] != edges[:-1]).any(axis=1)]))
    twice = start[np.diff(np.append(start, len(edges))) == 2]
    return triangle[twice], triangle[twice + 1], np.column_stack([opposite[twice], opposite[twice + 1]])


def _absorbed(patches: _Patches, surfaces: Sequence[Surface], face: IntArray) -> list[Surface]:
    """Give what lies on a larger surface beside it to that, in `face` (p,); return the surfaces that stay."""
    area = np.array([patches.area[face == k].sum() for k in range(len(surfaces))])
    for k in np.argsort(-area, kind="stable"):
        members = np.flatnonzero(face == k)
        if not len(members):
            continue
        smaller = (face < 0) | (area[face] < area[k]) | (face == k)
        held = _held(patches, surfaces[k], smaller, slope=limits.FACET_TURN)
        mask = reachable(patches.bends.indptr, patches.bends.indices, held, members[:1])
        mask &= _chords(patches, surfaces[k], np.flatnonzero(mask), members)
        inside = np.bincount(face[mask & (face >= 0)], patches.area[mask & (face >= 0)], minlength=len(area))
        is_taken = inside >= limits.NEARLY_ALL * area
        is_taken[k] = True
        face[mask & ((face < 0) | is_taken[face])] = k
    left = np.unique(face[face >= 0])
    number = np.full(len(surfaces) + 1, -1, dtype=np.int64)
    number[left] = np.arange(len(left))
    face[:] = number[face]
    return [surfaces[k] for k in left]


def _depths(patches: _Patches) -> IntArray:
    """Steps (p,) from each patch to where its surface may end: sharp edges, patches of another size."""
    size = np.log(np.maximum(patches.area, 1e-300))
    first, other = np.repeat(np.arange(len(size)), np.diff(patches.bends.indptr)), patches.bends.indices
    alike = np.abs(size[first] - size[other]) < limits.FACET_SIZES
    is_deep = patches.is_inner & (np.bincount(first, ~alike, minlength=len(size)) == 0)
    depth = is_deep.astype(np.int64)
    for _ in range(_DEEPEST):
        is_deep = is_deep & (np.bincount(first, ~is_deep[other], minlength=len(size)) == 0)
        depth += is_deep
    return np.asarray(depth)


def _grown_from(patches: _Patches, seed: int, free: BoolArray) -> _Grown | None:
    """The curved surface that holds most around a patch, and its patches (k,)."""
    best: _Grown | None = None
    rings = _rings(patches, seed, free)
    while rings:
        ring = rings.pop(0)
        before = best
        for kind in _CURVED:
            for start in _starts(patches, ring, kind):
                grown = _grow(patches, seed, ring, start, free)
                if grown is not None and grown.is_better(best):
                    best = grown
        if best is not None and best is not before:  # which tell all kinds better than a few do
            rings.insert(0, _around(patches, best.members, free, seed))
        elif best is not None and best.is_whole(patches):
            break
    return best


def _around(patches: _Patches, some: IntArray, free: BoolArray, seed: int) -> IntArray:
    """Some patches and their free neighbours that are about as large as the seed."""
    every = np.unique(np.concatenate([some, patches.bends[some].indices]))
    alike = np.abs(np.log(np.maximum(patches.area[every], 1e-300) / patches.area[seed])) < limits.FACET_SIZES
    return np.asarray(every[free[every] & alike])


def _starts(patches: _Patches, ring: IntArray, kind: str) -> list[Surface]:
    """Surfaces of a kind near patches: through their middles, and through their corners."""
    found = hypotheses(kind, patches.centroid[ring], patches.normal[ring])
    return found + hypotheses(kind, *_corners_of(patches, ring))


class _Grown(NamedTuple):
    """A surface, its patches (k,), their area, and how far they lie off it between their corners."""

    surface: Surface
    members: IntArray
    area: float
    sag: float

    def is_whole(self, patches: _Patches) -> bool:
        """Whether nothing beside it goes on as it does."""
        inside = np.zeros(len(patches.area), np.bool_)
        inside[self.members] = True
        beside = np.unique(patches.bends[self.members].indices)
        beside = beside[~inside[beside]]
        typical = np.log(float(np.median(patches.area[self.members])))
        sizes = np.log(np.maximum(patches.area[beside], 1e-300))
        return not (np.abs(sizes - typical) < limits.FACET_SIZES).any()

    def is_better(self, other: _Grown | None) -> bool:
        """Whether it holds clearly more, or as much and that more closely."""
        if other is None or self.area > 1.05 * other.area:
            return True
        if self.area < 0.95 * other.area or self.sag > 1.25 * other.sag:
            return False
        is_simpler = _CURVED.index(self.surface.kind) < _CURVED.index(other.surface.kind)
        return is_simpler or self.sag < 0.8 * other.sag


def _rings(patches: _Patches, seed: int, free: BoolArray) -> list[IntArray]:
    """Patches around a seed, to start from: its neighbours, and theirs.

    Of a chord of several triangles its neighbours are enough, two of them where others are of another
    surface; a single triangle bends both ways, and needs more.
    """
    one = _around(patches, np.array([seed]), free, seed)
    two = _around(patches, one, free, seed)
    rings = [one, two] if patches.n_triangles[seed] > 1 else [two, _around(patches, two, free, seed)]
    beside = one[one != seed]
    turn = np.arccos(np.clip(patches.normal[beside] @ patches.normal[seed], -1, 1))
    order = beside[np.argsort(turn, kind="stable")]
    if patches.n_triangles[seed] > 1 and len(order) > 2:
        rings += [np.array([seed, *pair]) for pair in pairwise(order[:4])]
    return [ring for ring in rings if len(ring) >= 3]


def _corners_of(patches: _Patches, some: IntArray) -> tuple[FloatArray, FloatArray]:
    """Corners (k, 3) of patches, each with its patch's normal (k, 3)."""
    parts = [patches.corner[patches.first[k] : patches.first[k + 1]] for k in some]
    normals = np.repeat(patches.normal[some], [len(part) for part in parts], axis=0)
    return patches.mesh.vertices[np.concatenate(parts)], normals


def _grow(
    patches: _Patches,
    seed: int,
    ring: IntArray,
    surface: Surface,
    free: BoolArray,
) -> _Grown | None:
    """Adjust a surface to the patches that it holds, from a seed on."""
    members = ring
    for turn in range(_ROUNDS):
        corners = np.unique(_corners_of(patches, members)[0], axis=0)
        if len(members) < 3 or len(corners) < N_PARAMETERS[surface.kind] + 2:
            return None
        loose = max(3 * float(np.median(np.abs(surface.distance(corners)))), patches.tolerance_m)
        better = refine_surface(surface, corners, loose)
        if better is None:
            return None
        surface = better[0]
        off = float(np.median(np.abs(surface.distance(corners))))
        if off > patches.tolerance_m:  # not yet determined: stay with these
            if turn >= _STARTING or off > limits.HOPELESS * patches.tolerance_m:
                return None
            continue
        held = _held(patches, surface, free)
        if not held[seed]:
            return None
        new = np.flatnonzero(reachable(patches.bends.indptr, patches.bends.indices, held, np.array([seed])))
        if len(new) == len(members) and (new == members).all():
            break
        members = new
    else:
        return None
    is_chord = _chords(patches, surface, members, members)
    if not is_chord[seed]:
        return None
    kept = np.flatnonzero(reachable(patches.bends.indptr, patches.bends.indices, is_chord, np.array([seed])))
    corners = np.unique(_corners_of(patches, kept)[0], axis=0)
    if len(kept) < 3 or len(corners) < N_PARAMETERS[surface.kind] + 2:
        return None
    triangles = np.flatnonzero(np.isin(patches.of, kept))
    sags, area = _sags(patches.mesh, triangles, surface), patches.mesh.face_areas()[triangles]
    rms = float(np.sqrt(np.mean(np.square(surface.distance(corners)))))
    if (
        len(kept) < _SURELY_MANY
        and np.median(patches.n_triangles[kept]) == 1
        and rms > limits.EXACT * patches.tolerance_m
    ):
        return None  # a few triangles of a free form lie on some sphere, nearly
    if patches.area[kept].max() > limits.MOST_OF_SURFACE * patches.area[kept].sum():
        return None
    return _Grown(surface, kept, float(patches.area[kept].sum()), float(area @ sags / area.sum()))


def _chords(patches: _Patches, surface: Surface, some: IntArray, members: IntArray) -> BoolArray:
    """Which of some patches (k,) lie as near to a surface between their corners as its members do: (p,)."""
    triangles = np.flatnonzero(np.isin(patches.of, np.union1d(some, members)))
    sag, turn = np.zeros(len(patches.area)), np.zeros(len(patches.area))
    np.maximum.at(sag, patches.of[triangles], _sags(patches.mesh, triangles, surface))
    np.maximum.at(turn, patches.of[triangles], _turns(patches.mesh, triangles, surface))
    most_m = limits.SAG_RATIO * float(np.median(sag[members])) + patches.tolerance_m
    most = min(limits.TURN_RATIO * float(np.median(turn[members])) + limits.FLAT_ANGLE, limits.MOST_TURN)
    chords = np.zeros(len(patches.area), np.bool_)
    chords[some] = (sag[some] <= most_m) & ((turn[some] <= most) | patches.is_thin[some])
    return chords


def _turns(mesh: LabelledMesh, triangles: IntArray, surface: Surface) -> FloatArray:
    """Largest angle (k,) that a surface turns by along an edge of triangles, radians."""
    one, two = mesh.corners[triangles], np.roll(mesh.corners[triangles], 1, axis=1)
    inner = [(1 - t) * one + t * two for t in (_END, 1 - _END)]  # not at an apex, where there is no normal
    ends = [surface.normal(points.reshape(-1, 3)).reshape(-1, 3, 3) for points in inner]
    turn = np.arccos(np.clip(np.einsum("kij,kij->ki", *ends), -1, 1)).max(axis=1) / (1 - 2 * _END)
    return np.asarray(turn)


def _sags(mesh: LabelledMesh, triangles: IntArray, surface: Surface) -> FloatArray:
    """How far triangles (k,) lie off a surface at most, at the middles of their edges."""
    corners = mesh.corners[triangles]
    middles = (corners + np.roll(corners, 1, axis=1)) / 2
    return np.asarray(np.abs(surface.distance(middles.reshape(-1, 3))).reshape(-1, 3).max(axis=1))


def _held(
    patches: _Patches,
    surface: Surface,
    free: BoolArray,
    *,
    slope: float = limits.FACET_SLOPE,
) -> BoolArray:
    """Which patches (p,) have all corners on a surface, and look its way."""
    off = np.abs(surface.distance(patches.mesh.vertices)) > patches.tolerance_m
    is_off = np.add.reduceat(off[patches.corner].astype(np.int64), patches.first[:-1]) > 0
    ahead = np.abs(np.einsum("ij,ij->i", surface.normal(patches.centroid), patches.normal))
    return np.asarray(free & ~is_off & ((ahead > np.cos(slope)) | patches.is_thin))
