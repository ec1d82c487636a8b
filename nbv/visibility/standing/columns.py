# SPDX-License-Identifier: MIT
"""Columns: all surfaces that vertical lines over a scene meet, and the free spans between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from texture.engine.compiled import compiled

_CELL_M = 0.1  # half the depth of a stair's tread, and less than the foot of a tripod
_LEAST_CELLS = 60  # along the longer side: small scenes get smaller cells
_MOST_COLUMNS = 4_000_000  # large ones get larger cells
_ASIDE = np.array([0.413, 0.387])  # of a cell: lines that avoid walls at round coordinates
_STEP_OVER = 1e-6  # of the extent: how far below a surface the next one is looked for
_MOST_SURFACES = 400  # that one line meets; what lies lower is left out
LEAST_SPAN_M = 0.05  # lower free space is nobody's


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Free spans of vertical lines over a lattice of cells, sorted by cell and then from above.

    Attributes
    ----------
    low : (2,) float
        Corner of the lattice, metres.
    shape : (int, int)
        Cells along x and y.
    cell_m : float
        Side of a cell, metres.
    start : (n_cells + 1,) int64
        The spans of cell c (number x * shape[1] + y) are start[c] to start[c + 1].
    cell : (n,) int64
        The cell of each span.
    bottom, top : (n,) float
        Heights of the surfaces below and above; top is inf under the open sky, metres.
    slope : (n,) float
        Cosine between the normal of the surface below and the vertical.
    shows_back : (n,) bool
        Whether that surface turns its back to the span, as the inside of a solid does.
    face : (n,) int32
        The face below.
    is_partial : bool
        Whether a line without spans was not seen, rather than filled.
    """

    low: FloatArray
    shape: tuple[int, int]
    cell_m: float
    start: NDArray[np.int64]
    cell: NDArray[np.int64]
    bottom: FloatArray
    top: FloatArray
    slope: FloatArray
    shows_back: BoolArray
    face: NDArray[np.int32]
    is_partial: bool = False

    def places(self, cells: NDArray[np.int64]) -> FloatArray:
        """Where the lines of cells (n,) stand (n, 2), metres."""
        x, y = np.divmod(cells, self.shape[1])
        return np.asarray(self.low + (np.column_stack([x, y]) + _ASIDE) * self.cell_m)

    def cells_of(self, places: FloatArray) -> NDArray[np.int64]:
        """Cell (n,) in which each of the places (n, 2) lies, -1 outside."""
        at = np.floor((places - self.low) / self.cell_m).astype(np.int64)
        inside = ((at >= 0) & (at < np.array(self.shape))).all(axis=1)
        return np.where(inside, at[:, 0] * self.shape[1] + at[:, 1], -1)

    def seen_from_one_side(self) -> Columns:
        """Return the spans for surface as scans show it, from one side and not all of it.

        There is nothing to stand on where it turns its back, and lines without spans were not seen.
        """
        kept = ~self.shows_back
        counts = np.bincount(self.cell[kept], minlength=len(self.start) - 1)
        parts = {name: getattr(self, name)[kept] for name in ("cell", "bottom", "top", "slope", "face")}
        start, backs = np.append(0, np.cumsum(counts)), self.shows_back[kept]
        return replace(self, start=start, shows_back=backs, is_partial=True, **parts)

    def neighbours(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs (m,), (m,) of spans of cells side by side that are open to each other, by heights alone."""
        one, other = _beside(self.shape, self.start, self.bottom, self.top, LEAST_SPAN_M)
        return one, other


def cut_columns(mesh: LabelledMesh, caster: RayCaster) -> Columns:
    """Cut the space over and within a scene into columns of free spans.

    Cells are 0.1 m, smaller in small scenes, larger where there would be more than four million. What lies
    below the lowest surface of a line is no span.
    """
    low, high = mesh.bounds()
    extent = np.maximum((high - low)[:2], 1e-6)
    cell = max(min(_CELL_M, extent.max() / _LEAST_CELLS), float(np.sqrt(np.prod(extent) / _MOST_COLUMNS)))
    n_x, n_y = (int(n) for n in np.ceil(extent / cell) + 1)
    corner = (low + high)[:2] / 2 - cell * np.array([n_x, n_y]) / 2
    x, y = np.divmod(np.arange(n_x * n_y), n_y)
    places = corner + (np.column_stack([x, y]) + _ASIDE) * cell
    above = float(high[2] + 0.1 * (high[2] - low[2]) + 1.0)
    cells, heights, faces = _crossings(caster, places, above, float(np.ptp(mesh.bounds(), axis=0).max()))
    vertical = mesh.face_normals()[faces, 2]
    first = np.append(True, cells[1:] != cells[:-1]) if len(cells) else np.zeros(0, np.bool_)
    top = np.where(first, np.inf, np.append(np.inf, heights[:-1])) if len(cells) else heights
    kept = top - heights >= LEAST_SPAN_M
    counts = np.bincount(cells[kept], minlength=n_x * n_y)
    return Columns(
        low=corner, shape=(n_x, n_y), cell_m=cell,
        start=np.append(0, np.cumsum(counts)), cell=cells[kept], bottom=heights[kept], top=top[kept],
        slope=np.abs(vertical[kept]), shows_back=vertical[kept] < 0, face=faces[kept],
    )  # fmt: skip


def _crossings(
    caster: RayCaster, places: FloatArray, above: float, extent: float
) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int32]]:
    """Cells (n,), heights (n,) and faces (n,) of all that lines down at places (c, 2) meet, in order."""
    going, height = np.arange(len(places)), np.full(len(places), above)
    found = []
    for _ in range(_MOST_SURFACES):
        origins = np.column_stack([places[going], height])
        hits = caster.first_hit(origins, np.broadcast_to(np.array([0.0, 0.0, -1.0]), origins.shape))
        met = hits.hit
        if not met.any():
            break
        going, height = going[met], height[met] - hits.ranges[met]
        found.append((going, height, hits.face[met]))
        height = height - _STEP_OVER * extent
    if not found:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int32)
    cells, heights, faces = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(cells, kind="stable")  # of each line from above already
    return cells[order], heights[order], faces[order]


@compiled
def _beside(
    shape: tuple[int, int],
    start: NDArray[np.int64],
    bottom: FloatArray,
    top: FloatArray,
    least: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of spans of cells side by side that share at least so much of their heights."""
    one, other = [np.int64(0) for _ in range(0)], [np.int64(0) for _ in range(0)]
    for x in range(shape[0]):
        for y in range(shape[1]):
            here = x * shape[1] + y
            for there in (here + shape[1], here + 1):
                if (there == here + 1 and y + 1 == shape[1]) or there >= shape[0] * shape[1]:
                    continue
                if there == here + shape[1] and x + 1 == shape[0]:
                    continue
                a, b = start[here], start[there]
                while a < start[here + 1] and b < start[there + 1]:
                    if min(top[a], top[b]) - max(bottom[a], bottom[b]) >= least:
                        one.append(np.int64(a))
                        other.append(np.int64(b))
                    if bottom[a] >= bottom[b]:
                        a += 1
                    else:
                        b += 1
    return np.array(one, dtype=np.int64), np.array(other, dtype=np.int64)
