# SPDX-License-Identifier: MIT
"""Tessellated models: meshes whose vertices lie exactly on the surfaces of a CAD model, divided at its faces.

Triangles that lie in one plane are a patch. Patches that turn a little from one to the next are chords of a
curved surface, if one holds all their corners exactly; what is left over are planes. A scanner's mesh has no
such surfaces, and so is told from a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.parts.division import limits
from completion.parts.division.adjusting import N_PARAMETERS
from completion.parts.division.growing import hypotheses, reachable, refine_surface, walked
from completion.parts.division.patches import Patches, most_turn, patches_of, ranges
from completion.parts.division.whole_faces import join_slivers, whole_faces
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.surfaces.catalogue import Plane, Surface

_KINDS = "plane", "cylinder", "cone", "sphere", "torus"  # the simplest first
_ROUNDS = 20
_LEAST_CHORDS = {"cone": 4}  # mirrored ones of three are always on one
_STARTING = 2  # of these until a start must be right
_SURELY_MANY = 30  # triangles on one surface
_DEEPEST = 3  # neighbours that a start looks at
_TRIED = 24  # seeds, by which tolerances are compared
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
    tolerance_m : float
        How far vertices may be off their surface.
    """

    labels: IntArray
    surfaces: tuple[Surface, ...]
    free_form: float
    tolerance_m: float


def divide_tessellated(mesh: LabelledMesh, tolerances_m: Sequence[float]) -> Tessellation | None:
    """Divide a mesh where the faces of its model are; None where it is no model's.

    Parameters
    ----------
    mesh : LabelledMesh
        Metres; triangles of neighbours share their vertices.
    tolerances_m : sequence of float
        How far vertices may be off their surface, ascending: the first is the file's precision. A larger one
        is taken where it explains much that no smaller one does.
    """
    tried = list[_Division]()
    for tolerance_m in tolerances_m:
        tried.append(_Division(patches_of(mesh, tolerance_m)))
        tried[-1].grow(_TRIED)
        if tried[0].explained <= 1 - limits.SCANNED:  # noise is explained by a loose precision, too
            return None
        if tried[-1].failed <= limits.FREE_FORM or tried[0].failed >= limits.SCANNED:
            break
    most = max(limits.FREE_FORM, limits.HARDLY_MORE * min(division.failed for division in tried))
    chosen = next(division for division in tried if division.failed <= most)
    chosen.grow()
    return chosen.result() if chosen.explained >= limits.MODEL_SHARE else None


class _Division:
    """Curved surfaces of patches as they are found.

    `face` (p,) is that of each patch in `surfaces`, -1 for none.
    """

    def __init__(self, patches: Patches) -> None:
        self.patches, self.surfaces = patches, list[Surface]()
        self.face: IntArray = np.full(len(patches.area), -1, dtype=np.int64)
        is_seed = patches.is_seed & (np.diff(patches.bends.indptr) > 0)
        self._is_tried = np.zeros(len(is_seed), np.bool_)
        seeds = np.lexsort((-patches.area, -_depths(patches)))
        seeds = seeds[is_seed[seeds]]
        self._chain = _chains(patches, is_seed)
        chain = self._chain[seeds]
        by_chain = np.argsort(chain, kind="stable")
        turn = np.empty(len(seeds), dtype=np.int64)
        turn[by_chain] = np.arange(len(seeds)) - np.searchsorted(chain[by_chain], chain[by_chain])
        self._seeds = iter(seeds[np.argsort(turn, kind="stable")].tolist())  # one of each chain in turn

    def grow(self, most: int | None = None) -> None:
        """Grow surfaces from seeds, so many at most."""
        patches, n_failed = self.patches, 0
        untried = (seed for seed in self._seeds if self.face[seed] < 0 and not self._is_tried[seed])
        for seed in islice(untried, most):
            found = _grown_from(patches, seed, self.face < 0)
            if found is not None:
                self.face[found.members] = len(self.surfaces)
                self.surfaces.append(found.surface)
                continue
            self._is_tried[seed] = True
            for ring in _rings(patches, seed, self.face < 0)[:2]:
                self._is_tried[ring[patches.n_triangles[ring] == 1]] = True
            n_failed += 1
            if n_failed == _MOST_FAILED and self.explained < limits.MODEL_SHARE:
                break

    @property
    def explained(self) -> float:
        """Share of the area on curved surfaces and in planes of several triangles: any triangle is flat."""
        patches, is_known = self.patches, self.face >= 0
        is_known |= (patches.n_triangles > 1) & ~_is_free_form(patches, self.face)
        return float(patches.area[is_known].sum() / patches.area.sum())

    @property
    def failed(self) -> float:
        """Share of the area that is so in chains where a seed found nothing."""
        area, is_tried = self.patches.area, np.zeros(len(self.face), np.bool_)
        is_tried[self._chain[self._is_tried]] = True
        return float(area[_is_free_form(self.patches, self.face) & is_tried[self._chain]].sum() / area.sum())

    def result(self) -> Tessellation:
        """What was found and planes of the rest, joined."""
        patches, face, surfaces = self.patches, self.face, self.surfaces
        flat = np.flatnonzero((face < 0) & ~_is_free_form(patches, face) & ~patches.is_thin)
        face[flat] = len(surfaces) + np.arange(len(flat))
        surfaces += [Plane(patches.centroid[patch], patches.normal[patch]) for patch in flat]
        surfaces = _absorbed(patches, surfaces, face)
        join_slivers(patches, face)
        labels, surfaces = whole_faces(patches, face[patches.of], surfaces)
        free_form = float(patches.areas[labels < 0].sum() / patches.area.sum())
        return Tessellation(labels + 1, tuple(surfaces), free_form, patches.tolerance_m)


def _chains(patches: Patches, left: BoolArray) -> IntArray:
    """A number (p,) equal for patches left that bend on from one to the next, and are about as large."""
    first, other = np.repeat(np.arange(len(left)), np.diff(patches.bends.indptr)), patches.bends.indices
    size = np.log(np.maximum(patches.area, 1e-300))
    goes_on = left[first] & left[other] & (np.abs(size[first] - size[other]) < limits.FACET_SIZES)
    chain = coo_array((np.ones(goes_on.sum()), (first[goes_on], other[goes_on])), shape=(len(left),) * 2)
    return np.asarray(connected_components(chain, directed=False)[1], dtype=np.int64)


def _is_free_form(patches: Patches, face: IntArray) -> BoolArray:
    """Which patches (p,) are on no surface, and one of a few alike that bend on."""
    left = (face < 0) & (patches.area > 0)
    chain = _chains(patches, left)
    return np.asarray((left & (np.bincount(chain)[chain] >= limits.CHAIN)) | ((face < 0) & ~left))


def _absorbed(patches: Patches, surfaces: Sequence[Surface], face: IntArray) -> list[Surface]:
    """Give what lies on a larger surface beside it to that, in `face` (p,); return the surfaces that stay."""
    area = np.array([patches.area[face == k].sum() for k in range(len(surfaces))])
    for k in np.argsort(-area, kind="stable"):
        members = np.flatnonzero(face == k)
        if not len(members):
            continue
        smaller = (face < 0) | (area[face] < area[k]) | (face == k)
        mask = _held(patches, surfaces[k], smaller, members[:1], slope=limits.FACET_TURN)
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


def _depths(patches: Patches) -> IntArray:
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


def _grown_from(patches: Patches, seed: int, free: BoolArray) -> _Grown | None:
    """The surface that holds most around a patch, and its patches (k,)."""
    best: _Grown | None = None
    rings = _rings(patches, seed, free)
    while rings:
        ring = rings.pop(0)
        before = best
        for kind in _KINDS:
            for start in _starts(patches, ring, kind):
                grown = _grow(patches, seed, ring, start, free)
                if grown is not None and grown.is_better(best):
                    best = grown
        if best is not None and (
            before is None or best.area > 1.05 * before.area
        ):  # which tell all kinds better than a few do
            rings.insert(0, _around(patches, best.members, free, seed))
        elif best is not None and best.is_whole(patches):
            break
    return best


def _around(patches: Patches, some: IntArray, free: BoolArray, seed: int) -> IntArray:
    """Some patches and their free neighbours that are about as large as the seed."""
    every = np.unique(np.concatenate([some, patches.bends[some].indices]))
    alike = np.abs(np.log(np.maximum(patches.area[every], 1e-300) / patches.area[seed])) < limits.FACET_SIZES
    return np.asarray(every[free[every] & alike])


def _starts(patches: Patches, ring: IntArray, kind: str) -> list[Surface]:
    """Surfaces of a kind near patches: through their middles, and through their corners.

    In a band of triangles between two circles, the triangles based on either circle have slightly different
    normals. The mean over neighbours removes the difference, so that it determines a cone's axis.
    """
    corners, normals = _corners_of(patches, ring)
    found = hypotheses(kind, patches.centroid[ring], patches.normal[ring]) + hypotheses(
        kind, corners, normals
    )
    if kind != "cone":
        return found
    between = coo_array(patches.bends[ring][:, ring])
    pair = np.arange(len(between.row))
    for place, by, at in (
        (patches.centroid[ring], np.concatenate([pair, pair]), np.concatenate([between.row, between.col])),
        (corners, np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1), np.arange(len(corners))),
    ):
        way = normals if place is corners else patches.normal[ring]
        count = np.maximum(np.bincount(by), 1)[:, None]
        means = [np.stack([np.bincount(by, one) for one in of[at].T], axis=1) / count for of in (place, way)]
        several = count[:, 0] > 1
        found += hypotheses(kind, *(mean[several] for mean in means))
    return found


class _Grown(NamedTuple):
    """A surface, its patches (k,), their area, and how far they lie off it between their corners."""

    surface: Surface
    members: IntArray
    area: float
    sag: float

    def is_whole(self, patches: Patches) -> bool:
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
        if self.area < 0.95 * other.area or other.surface.kind == "plane" or self.sag > 1.25 * other.sag:
            return False
        is_simpler = _KINDS.index(self.surface.kind) < _KINDS.index(other.surface.kind)
        return is_simpler or self.sag < 0.8 * other.sag


def _rings(patches: Patches, seed: int, free: BoolArray) -> list[IntArray]:
    """Patches around a seed, to start from: its neighbours, and theirs.

    Of a chord of several triangles its neighbours are enough, two of them where others are of another
    surface; a single triangle bends both ways, and needs more.
    """
    one = _around(patches, np.array([seed]), free, seed)
    two = _around(patches, one, free, seed)
    if patches.n_triangles[seed] > 1:
        rings = [one, two]
    else:
        three = _around(patches, two, free, seed)
        five = _around(patches, _around(patches, three, free, seed), free, seed)
        rings = [two, three, five]
    beside = one[one != seed]
    turn = np.arccos(np.clip(patches.normal[beside] @ patches.normal[seed], -1, 1))
    order = beside[np.argsort(turn, kind="stable")]
    if patches.n_triangles[seed] > 1 and len(order) > 2:
        rings += [np.array([seed, *pair]) for pair in pairwise(order[:4])]
    return [ring for ring in rings if len(ring) >= 3]


def _corners_of(patches: Patches, some: IntArray) -> tuple[FloatArray, FloatArray]:
    """Corners (k, 3) of patches, each with its patch's normal (k, 3)."""
    place, which = ranges(patches.first, some)
    return patches.mesh.vertices[patches.corner[place]], patches.normal[some[which]]


def _grow(
    patches: Patches,
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
        new = np.flatnonzero(_held(patches, surface, free, np.array([seed])))
        if not len(new):
            return None
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
    if len(kept) < _LEAST_CHORDS.get(surface.kind, 3) or len(corners) < N_PARAMETERS[surface.kind] + 2:
        return None
    triangles = patches.triangles_of(kept)
    sags, area = patches.sags(triangles, surface), patches.areas[triangles]
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


def _chords(patches: Patches, surface: Surface, some: IntArray, members: IntArray) -> BoolArray:
    """Which of some patches (k,) lie as near to a surface between their corners as its members do: (p,)."""
    triangles = patches.triangles_of(np.union1d(some, members))
    sag, turn = np.zeros(len(patches.area)), np.zeros(len(patches.area))
    np.maximum.at(sag, patches.of[triangles], patches.sags(triangles, surface))
    np.maximum.at(turn, patches.of[triangles], patches.turns(triangles, surface))
    most_m = limits.SAG_RATIO * float(np.median(sag[members])) + patches.tolerance_m
    most = most_turn(turn[members], patches.area[members], surface, patches.n_triangles[some])
    chords = np.zeros(len(patches.area), np.bool_)
    chords[some] = (sag[some] <= most_m) & ((turn[some] <= most) | patches.is_thin[some])
    return chords


def _held(
    patches: Patches,
    surface: Surface,
    free: BoolArray,
    begin: IntArray,
    *,
    slope: float = limits.FACET_SLOPE,
) -> BoolArray:
    """Which patches (p,) have all corners on a surface, look its way, and can be walked to from some (k,)."""

    def holds(some: IntArray) -> BoolArray:
        place, which = ranges(patches.first, some)
        off = np.abs(surface.distance(patches.mesh.vertices[patches.corner[place]])) > patches.tolerance_m
        n_off = np.bincount(which[off], minlength=len(some))
        ahead = np.abs(np.einsum("ij,ij->i", surface.normal(patches.centroid[some]), patches.normal[some]))
        return np.asarray((n_off == 0) & ((ahead > np.cos(slope)) | patches.is_thin[some]))

    return walked(patches.bends, free, begin, holds)
