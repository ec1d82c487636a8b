# SPDX-License-Identifier: MIT
"""Extra surface: what was measured where the design has nothing, in cells, joined to things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.asbuilt import limits
from completion.asbuilt.beams import EXTRA, Evidence
from completion.asbuilt.findings import Extra
from completion.observe.observation import Observation
from scenes.checks import ArrayValue, FloatArray, IntArray
from scenes.mesh.design import ElementMesh
from scenes.mesh.triangle_distance import TriangleTree

_JOINED = 2.3  # cells: neighbours, and those over a gap of one
_BITS = 21  # of a cell's number along each axis


@dataclass(frozen=True, slots=True, eq=False)
class ExtraCells(ArrayValue):
    """Cells (c,) with extra surface, ascending by `key`.

    Mean `points` (c, 3), `area` in square metres, the `thing` (c,) of each, -1 for none, and which
    `scans` (c, s) measured it; cells have `size_m`, from `low` (3,) on.
    """

    size_m: float
    low: FloatArray
    key: NDArray[np.int64]
    points: FloatArray
    area: FloatArray
    thing: NDArray[np.int32]
    scans: NDArray[np.bool_]

    def thing_at(self, points: FloatArray) -> NDArray[np.int32]:
        """Return the thing (n,) at points (n, 3), -1 for none."""
        if not len(self.key):
            return np.full(len(points), -1, np.int32)
        wanted = _keys(points, self.low, self.size_m)
        at = np.minimum(np.searchsorted(self.key, wanted), len(self.key) - 1)
        return np.where(self.key[at] == wanted, self.thing[at], -1).astype(np.int32)


def _keys(points: FloatArray, low: FloatArray, size: float) -> NDArray[np.int64]:
    cell = np.floor((points - low) / size).astype(np.int64)
    return np.asarray((cell[:, 0] << 2 * _BITS) + (cell[:, 1] << _BITS) + cell[:, 2], dtype=np.int64)


def find_cells(
    observations: Sequence[Observation],
    pixels: Sequence[IntArray],
    evidence: Sequence[Evidence],
    design: ElementMesh,
    *,
    scale: float,
    gate_m: float,
) -> ExtraCells:
    """Find the cells (c,) of all beams on nothing of the design, and join them to things, largest first."""
    size = limits.CELL_M * scale
    held = [np.flatnonzero(found.label == EXTRA) for found in evidence]
    points = [seen.points_at(flat[k]) for seen, flat, k in zip(observations, pixels, held, strict=True)]
    every = np.concatenate([*points, np.zeros((0, 3))])
    low = every.min(axis=0) - size if len(every) else np.zeros(3)
    key, place = np.unique(_keys(every, low, size), return_inverse=True)
    own = place.reshape(-1)
    count = np.maximum(np.bincount(own, minlength=len(key)), 1)
    sums = [np.bincount(own, every[:, k], len(key)) / count for k in range(3)]
    middle: FloatArray = np.column_stack(sums).astype(np.float64)
    area, by = np.zeros(len(key)), np.zeros((len(key), len(evidence)), np.bool_)
    ends = np.cumsum([len(part) for part in points])
    for number, (found, k, mine) in enumerate(zip(evidence, held, np.split(own, ends[:-1]), strict=True)):
        seen_area: FloatArray = np.bincount(mine, found.area[k], len(key)).astype(np.float64)
        area = np.maximum(area, seen_area)
        by[:, number] = seen_area > 0
    area = np.minimum(area, 2 * size**2)
    free = TriangleTree.of(design.mesh.corners).distances(middle) > gate_m if len(key) else np.zeros(0, bool)
    thing = np.full(len(key), -1, np.int32)
    thing[free] = _things(middle[free], area[free], size, limits.LEAST_EXTRA_M2 * scale**2)
    return ExtraCells(size_m=size, low=low, key=key, points=middle, area=area, thing=thing, scans=by)


def _things(points: FloatArray, area: FloatArray, size: float, least_m2: float) -> NDArray[np.int32]:
    """Number (n,) of the thing that each cell is of, largest first, -1 for those of small ones."""
    if not len(points):
        return np.zeros(0, np.int32)
    pairs = cKDTree(points).query_pairs(_JOINED * size, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.bool_), tuple(pairs.T)), shape=(len(points),) * 2)
    label = connected_components(graph, directed=False)[1]
    total = np.bincount(label, area)
    order = np.argsort(-total, kind="stable")
    number = np.full(len(total), -1, np.int32)
    number[order] = np.arange(len(order))
    number[total < least_m2] = -1
    return np.asarray(number[label])


def things_of(cells: ExtraCells, names: Sequence[str], elements: ElementMesh) -> tuple[Extra, ...]:
    """Return the things of cells, largest first, by their names, with the scans that saw them."""
    order = np.argsort(cells.thing, kind="stable")
    order = order[cells.thing[order] >= 0]
    if not len(order):
        return ()
    starts = np.flatnonzero(np.diff(cells.thing[order]))
    tree, middle = TriangleTree.of(elements.mesh.corners), elements.mesh.corners.mean(axis=1)
    things = []
    for number, mine in enumerate(np.split(order, starts + 1)):
        points = cells.points[mine]
        near, index = tree.tree.query(points, k=1)
        touches = ""
        if len(near):
            at = int(np.argmin(near))
            own = elements.mesh.face_surface[np.argmin(np.linalg.norm(middle - points[at], axis=1))]
            touches = elements.elements[int(own)].name if index[at] >= 0 else ""
        scans = tuple(np.array(names)[cells.scans[mine].any(axis=0)].tolist())
        things.append(
            Extra(
                name=f"extra-{number + 1}",
                box_m=np.stack([points.min(axis=0), points.max(axis=0)]),
                area_m2=float(cells.area[mine].sum()),
                points=points,
                stations=scans,
                near=touches,
            )
        )
    return tuple(things)
