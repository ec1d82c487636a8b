# SPDX-License-Identifier: MIT
"""Things: what stands in the rooms of a building, closed, and its outline seen from above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.backs.closed_things import ClosedThing
from completion.backs.intervals import Extents, VolumeInterval
from scenes.checks import FloatArray, IntArray, Value

ThingState = Literal["measured", "inferred", "unknown"]
STATES: tuple[ThingState, ThingState, ThingState] = ("measured", "inferred", "unknown")
"""What a face of a closed shape is, by its number."""
_BESIDE, _SMOOTH = 0.03, 0.01  # of the diagonal: from an outline to a face that makes it; straightened to
_STRETCH = 5  # pieces of an outline, half as long as the first of these, over which its state is a median


@dataclass(frozen=True, eq=False)
class BuildingThing(Value):
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
