# SPDX-License-Identifier: MIT
"""Things: what stands in the rooms of a building: closed shapes, and surfaces that touch each other."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.backs.closed_things import ClosedThing
from completion.backs.intervals import Extents, VolumeInterval
from completion.export.building import limits
from scenes.checks import FloatArray, IntArray

if TYPE_CHECKING:
    from completion.export.building.model import BuildingModel

ThingState = Literal["measured", "inferred", "unknown"]
STATES: tuple[ThingState, ThingState, ThingState] = ("measured", "inferred", "unknown")
"""What a face of a closed shape is, by its number."""
_MOST_SAMPLES = 200_000  # for the area of all facets
_BESIDE, _SMOOTH = 0.03, 0.01  # of the diagonal: from an outline to a face that makes it; straightened to
_STRETCH = 5  # pieces of an outline, half as long as the first of these, over which its state is a median


@dataclass(frozen=True, slots=False, eq=False)
class BuildingThing:
    """What stands in a room, closed, in coordinates of drawings, z up.

    Attributes
    ----------
    number : int
        As in things.json, from 1.
    vertices : (n, 3) float
        Of its closed shape, metres.
    faces : (m, 3) int
        Counter-clockwise seen from outside.
    state : (m,) int
        Of each face: 0 measured, 1 inferred, 2 unknown.
    extents : Extents
        Width, depth and height, with intervals.
    volume : VolumeInterval
        What it takes up, with an 80 % interval.
    surfaces : tuple of int
        Completed surfaces, from 1, most of which are of it.
    """

    number: int
    vertices: FloatArray
    faces: NDArray[np.int32]
    state: IntArray
    extents: Extents
    volume: VolumeInterval
    surfaces: tuple[int, ...]

    @cached_property
    def outline(self) -> tuple[tuple[ThingState, FloatArray], ...]:
        """Its outline seen from above: polylines (k, 2), each with what the nearest faces are."""
        up = self.vertices[self.faces]
        area = np.cross(up[:, 1] - up[:, 0], up[:, 2] - up[:, 0])[:, 2]
        whole = shapely.union_all(shapely.polygons(up[area > 0][..., :2]), grid_size=1e-4)
        size = float(np.linalg.norm(np.ptp(self.vertices, axis=0)))
        centre, near = up[..., :2].mean(axis=1), _BESIDE * size
        trees = [cKDTree(centre[self.state == k]) for k in (0, 1) if (self.state == k).any()]
        kinds = [k for k in (0, 1) if (self.state == k).any()]
        lines = []
        for part in shapely.get_parts(whole).tolist():
            ring = shapely.get_coordinates(
                shapely.segmentize(part.exterior.simplify(_SMOOTH * size), near / 2)
            )
            middle, state = (ring[1:] + ring[:-1]) / 2, np.full(len(ring) - 1, 2)
            for kind, tree in reversed([*zip(kinds, trees, strict=True)]):
                state[tree.query(middle)[0] < near] = kind
            state = ndimage.median_filter(state, min(_STRETCH, len(state)), mode="wrap")
            cuts = np.flatnonzero(np.diff(state)) + 1
            for start, end in pairwise([0, *cuts.tolist(), len(state)]):
                lines.append((STATES[int(state[start])], ring[start : end + 1]))
        return tuple(lines)

    def corners_of(self, k: int) -> FloatArray:
        """Both ends (2, 3) of its width (0), depth (1) or height (2), through its middle."""
        extent = (self.extents.width, self.extents.depth, self.extents.height)[k]
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        middle, way = (low + high) / 2, np.array(extent.way)
        along = (self.vertices - middle) @ way
        return np.asarray(middle + np.array([[along.min()], [along.max()]]) * way)


def building_things(things: Sequence[ClosedThing]) -> Iterator[BuildingThing]:
    """Yield the things that were closed, as drawings have them."""
    for one in things:
        if one.back is not None:
            yield BuildingThing(
                number=one.thing.index + 1,
                vertices=one.back.shape.vertices,
                faces=one.back.shape.faces,
                state=one.face_states,
                extents=one.back.extents,
                volume=one.back.volume,
                surfaces=tuple(number + 1 for number in one.thing.surfaces),
            )


def find_things(model: BuildingModel, structure: Collection[int]) -> tuple[tuple[int, ...], ...]:
    """Return the surfaces outside `structure` in groups, each a thing, by their least number.

    Surfaces are of one thing where their facets come within `limits.NEAR_FACE_M` of each other, or are linked
    by others so. What stands on a floor or against a wall is linked by neither, since these are structure.
    What no surface explains (number 0) takes no part. Two things that touch are one.
    """
    is_loose = ~np.isin(model.surface, [0, *structure])
    numbers = np.unique(model.surface[is_loose])
    if not len(numbers):
        return ()
    places, facet = _samples(model.vertices[model.faces[is_loose]])
    owner = np.searchsorted(numbers, model.surface[is_loose])[facet]
    trees = [cKDTree(places[owner == k]) for k in range(len(numbers))]
    low, high = np.array([tree.mins for tree in trees]), np.array([tree.maxes for tree in trees])
    graph = np.triu((low[:, None] <= high + limits.NEAR_FACE_M).all(axis=2), 1)
    graph &= (low <= high[:, None] + limits.NEAR_FACE_M).all(axis=2)
    for one, other in np.argwhere(graph).tolist():  # boxes that meet
        graph[one, other] = trees[one].count_neighbors(trees[other], limits.NEAR_FACE_M) > 0
    n_things, thing = connected_components(graph, directed=False)
    groups = (tuple(numbers[thing == k].tolist()) for k in range(n_things))
    return tuple(sorted(groups))


def _samples(corners: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Places (k, 3) all over triangles (m, 3, 3), and the triangle (k,) of each.

    They are so near to each other that triangles which meet have samples within `limits.NEAR_FACE_M`, unless
    the area is so large that there would be too many.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(sides, axis=2)
    base = np.argmax(length, axis=1)
    rows = np.arange(len(corners))
    start, side, apex = corners[rows, base], sides[rows, base], corners[rows, base - 1]
    long = length[rows, base]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    step = max(limits.NEAR_FACE_M / 2, float(np.sqrt(area.sum() / _MOST_SAMPLES)))
    high = 2 * area / np.maximum(long, step)
    counts = np.ceil(np.column_stack([long, high]) / step).astype(np.int64) + 1
    places, facets = [], []
    for n, m in np.unique(counts, axis=0).tolist():  # places along the longest side, and towards the apex
        own = np.flatnonzero((counts == (n, m)).all(axis=1))
        along, up = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, m)))
        on_base = start[own, None] + along[:, None] * side[own, None]
        places.append((on_base + up[:, None] * (apex[own, None] - on_base)).reshape(-1, 3))
        facets.append(np.repeat(own, len(along)))
    return np.concatenate(places), np.concatenate(facets)
