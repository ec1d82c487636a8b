# SPDX-License-Identifier: MIT
"""Claims: which surfaces are continued, and which of several has a place that all of them claim unseen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.extension.limits import APART_SD, CLAIM_SLOPE, FACING_COSINE, SMALL_M2, SMALL_SHARE
from completion.extension.patch import Patch
from completion.room.planes import Role
from scenes.checks import BoolArray, FloatArray, IntArray, Value
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_KEPT = 2  # patches whose distances are remembered: those of a pair


def settle_claims(patches: Sequence[Patch], flatness_m: float) -> list[Patch]:
    """Leave each place to the most probable of the planes that claim it without having measured it.

    Planes that face alike claim one place where they are nearer to each other than a tilt of five degrees
    makes them, over the way from what was measured of either, and their deviations with the flatness, metres.
    Of cells that are as probable the surface with the smaller number keeps its own. What is cut off from the
    measured part thereby goes too.
    """
    pairs, ways = _pairs(patches), _ways(patches)
    lost = {k: np.zeros(patches[k].grid.shape, dtype=np.bool_) for pair in pairs for k in pair}
    for number, other in pairs:
        for first, second in ((number, other), (other, number)):
            cells, at = _contested_cells(first, second, patches, ways, flatness_m)
            rival = np.where(patches[second].hypothesised, patches[second].confidence, -1.0).ravel()[at]
            members = patches[first].confidence.ravel()[cells]
            gives_way = (rival > members) | ((rival == members) & (first > second))
            lost[first].ravel()[cells[gives_way]] = True
    for number, other in pairs:  # cells of two charts overlap in part
        cells, at = _contested_cells(other, number, patches, ways, flatness_m)
        both = (patches[number].hypothesised & ~lost[number]).ravel()[at] & ~lost[other].ravel()[cells]
        lost[other].ravel()[cells[both]] = True
    return [
        _without(patch, lost[k]) if k in lost and lost[k].any() else patch for k, patch in enumerate(patches)
    ]


def overlap_m2(patches: Sequence[Patch], flatness_m: float) -> float:
    """Area that is inferred of several planes at once, square metres, counted once for each further one."""
    area, ways = 0.0, _ways(patches)
    for first, second in _pairs(patches):
        _, at = _contested_cells(second, first, patches, ways, flatness_m)
        claimed = patches[first].hypothesised.ravel()[at]
        area += float(np.count_nonzero(claimed)) * patches[second].grid.cell_area
    return area


def _pairs(patches: Sequence[Patch]) -> list[tuple[int, int]]:
    """Pairs of planes that face alike and whose inferred parts may be near each other."""
    planes = [(k, patch.grid.surface) for k, patch in enumerate(patches) if _has_inferred(patch)]
    normal = {k: plane.normal_direction for k, plane in planes if isinstance(plane, Plane)}
    chosen = list(normal)
    if len(chosen) < 2:
        return []
    normals = np.array(list(normal.values()))
    boxes = np.array([_box(patches[k]) for k in chosen])
    pairs = []
    for place, k in enumerate(chosen[:-1]):
        later = slice(place + 1, None)
        reach = CLAIM_SLOPE * np.linalg.norm(boxes[place, 1] - boxes[place, 0])
        near = (boxes[later, 0] <= boxes[place, 1] + reach).all(axis=1)
        near &= (boxes[later, 1] >= boxes[place, 0] - reach).all(axis=1)
        near &= normals[later] @ normals[place] >= FACING_COSINE
        pairs += [(k, chosen[place + 1 + index]) for index in np.flatnonzero(near).tolist()]
    return pairs


def _has_inferred(patch: Patch) -> bool:
    trim()
    return bool(patch.hypothesised.any())


def _box(patch: Patch) -> FloatArray:
    """Least and greatest coordinates (2, 3) of the rectangle of the chart around what is inferred."""
    trim()
    rows, columns = (np.flatnonzero(patch.hypothesised.any(axis=axis)) for axis in (1, 0))
    corners = np.array([(row, column) for row in rows[[0, -1]] for column in columns[[0, -1]]]) + 0.5
    points = patch.grid.surface.from_uv(patch.grid.uv_of(corners[:, 0], corners[:, 1]))
    return np.array([points.min(axis=0), points.max(axis=0)])


def _ways(patches: Sequence[Patch]) -> Callable[[int], FloatArray]:
    """How far each flat cell of a patch is from what was measured of it, metres; of some patches kept."""

    @lru_cache(_KEPT)
    def way(number: int) -> FloatArray:
        patch = patches[number]
        away = ndimage.distance_transform_edt(~patch.observed, sampling=patch.grid.cell[::-1])
        return np.asarray(away).ravel()

    return way


def _contested_cells(
    number: int, rival: int, patches: Sequence[Patch], ways: Callable[[int], FloatArray], flatness_m: float
) -> tuple[IntArray, IntArray]:
    """Inferred cells (n,) of a plane at places that a rival may claim, and the rival's cells (n,) there."""
    trim()
    patch, other = patches[number], patches[rival]
    cells = np.flatnonzero(patch.hypothesised)
    row, column = np.divmod(cells, patch.grid.shape[1])
    places = patch.grid.surface.from_uv(patch.grid.uv_of(row + 0.5, column + 0.5))
    inside, at = other.grid.cells_of(places)
    cells, places = cells[inside], places[inside]
    away = ways(number)[cells] + ways(rival)[at]
    sd = np.sqrt(patch.spread.ravel()[cells] ** 2 + other.spread.ravel()[at] ** 2 + flatness_m**2)
    same = _inside(places, patch) & _inside(places, other)  # cells at a cut are in part beyond it
    same &= np.abs(other.grid.surface.distance(places)) <= CLAIM_SLOPE * away + APART_SD * sd
    return cells[same], at[same]


def _inside(places: FloatArray, patch: Patch) -> BoolArray:
    """Tell which places (n, 3) lie on a surface's side of all that it ends at."""
    inside = np.ones(len(places), dtype=np.bool_)
    for cut in patch.limits.cuts:
        inside &= cut.distance(places) >= 0
    return inside


def _without(patch: Patch, cells: BoolArray) -> Patch:
    """The patch without some inferred cells, and without what they held to the measured part."""
    kept = patch.hypothesised & ~cells
    part, _ = ndimage.label(kept | patch.observed)
    held = np.zeros(part.max() + 1, dtype=np.bool_)
    held[np.unique(part[patch.observed])] = True
    kept &= held[part]
    provenance = np.where(kept | patch.observed, patch.provenance, -1).astype(np.int8)
    return replace(patch, hypothesised=kept, provenance=provenance)


@dataclass(frozen=True, slots=True)
class Choice(Value):
    """Which surfaces are numbered and continued.

    Attributes
    ----------
    only : tuple of str
        Kinds, of `completion.observe.user_options.KINDS`; all, when empty.
    min_area_m2 : float
        Surfaces of which less was measured are left out, square metres.
    is_stated : bool
        Whether a person says so; else only planes that are no part of the room are.
    n_left_out : int
        How many were.
    """

    only: tuple[str, ...] = ()
    min_area_m2: float = 0.0
    is_stated: bool = True
    n_left_out: int = 0

    @classmethod
    def of(cls, only: Sequence[str], min_area_m2: float | None, patches: Sequence[Patch | None]) -> Choice:
        """Return what a person wants; where no least area is stated, by all that was measured."""
        if min_area_m2 is not None:
            return cls(tuple(only), min_area_m2)
        measured = sum(patch.observed_m2 for patch in patches if patch is not None)
        return cls(tuple(only), min(SMALL_SHARE * measured, SMALL_M2), is_stated=False)

    def keeps(self, patch: Patch) -> bool:
        """Tell whether a surface that an edit does not name is large enough."""
        is_minor = isinstance(patch.grid.surface, Plane) and not patch.limits.role
        return patch.observed_m2 >= self.min_area_m2 or not (self.is_stated or is_minor)


def is_chosen(surface: Surface, only: Sequence[str], role: Role = "") -> bool:
    """Tell whether a surface is of one of the kinds in `only`, by shape or role; true if `only` is empty."""
    if not only:
        return True
    if isinstance(surface, Plane):
        return "planes" in only or f"{role}s" in only
    if not isinstance(surface, Cylinder):
        return False
    return "cylinders" in only or ("pipes" in only and not surface.concave)


def numbered_anew(
    patches: Sequence[Patch | None], owners: Sequence[NDArray[np.int32]], keep: Callable[[Any], Any]
) -> tuple[list[Patch], tuple[NDArray[np.int32], ...]]:
    """Return the patches that there are, and the owners of pixels by their numbers.

    `owners`, (rows, columns) for each scan, number the surfaces from 1 with those that are None. What is said
    to hide a patch goes by the new numbers, too. `keep` puts what is made where arrays of its size are kept.
    """
    kept = np.array([patch is not None for patch in patches], dtype=np.bool_)
    if kept.all():
        return [patch for patch in patches if patch is not None], tuple(owners)
    numbers = np.append(0, np.where(kept, np.cumsum(kept), 0)).astype(np.int32)
    left = [
        keep(replace(patch, evidence=replace(patch.evidence, occluder=numbers[patch.evidence.occluder])))
        for patch in patches
        if patch is not None
    ]
    return left, tuple(keep(numbers[owner]) for owner in owners)
