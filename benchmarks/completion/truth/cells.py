# SPDX-License-Identifier: MIT
"""True cells: what the scans see, and what they miss, of a true surface in its chart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmarks.completion.truth.sight import Sight, noise_free_ranges, sight_of
from benchmarks.completion.truth.truth import TrueChart, TrueModel
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_EXACT_M = 1e-3  # facets stray from a true cylinder by less


@dataclass(frozen=True, slots=True, eq=False)
class TrueCells:
    """One true surface in its chart, as the scans see it.

    Attributes
    ----------
    chart : TrueChart
        Where the surface is.
    sight : (rows, columns) int8
        A `Sight` for each cell, by noise-free rays to its centre.
    occluder : (rows, columns) int32
        Object that hides a cell, -1 where none does.
    reachable : (rows, columns) bool
        Hidden part of the surface that is connected with a visible one.
    faces_away : (rows, columns) bool
        Where the surface shows its back to every scan.
    """

    chart: TrueChart
    sight: NDArray[np.int8]
    occluder: NDArray[np.int32]
    reachable: BoolArray
    faces_away: BoolArray

    @property
    def visible(self) -> BoolArray:
        """Where the surface is seen."""
        return np.asarray(self.chart.present & (self.sight == Sight.VISIBLE), dtype=np.bool_)

    @property
    def in_view(self) -> BoolArray:
        """Cells that are hidden or looked through, whether the surface is there or not."""
        return np.asarray((self.sight == Sight.HIDDEN) | (self.sight == Sight.FREE), dtype=np.bool_)

    @property
    def hidden(self) -> BoolArray:
        """Where it is in the view of some scan and blocked in all of them."""
        return np.asarray(self.chart.present & (self.sight == Sight.HIDDEN), dtype=np.bool_)


def look(
    model: TrueModel,
    charts: Sequence[TrueChart],
    scans: Sequence[RangeImage],
    *,
    min_pixels: int = 50,
    n_threads: int | None = None,
) -> tuple[TrueCells, ...]:
    """Return the cells of every charted surface, as the scans see it.

    Parameters
    ----------
    model : TrueModel
        The truth.
    charts : sequence of TrueChart
        Its charts.
    scans : sequence of RangeImage
        Simulated scans: poses, projections and truth channels count, not the measured ranges.
    min_pixels : int
        A surface with fewer pixels in all scans is reachable nowhere.
    n_threads : int, optional
        Threads that cast.

    Raises
    ------
    InputError
        A scan without truth.
    """
    caster = RayCaster(model.mesh.vertices, model.mesh.faces, n_threads)
    objects = model.objects()
    pixels = np.zeros(len(model.surfaces), np.int64)
    for scan in scans:
        met = np.isfinite(noise_free_ranges(scan))
        if scan.truth is not None:
            pixels += np.bincount(scan.truth.surface[met], minlength=len(pixels))
    result = []
    for chart in charts:
        centres = chart.grid.centres()
        normals = chart.grid.surface.normal(centres)
        seen = sight_of(centres, scans, caster, _EXACT_M, normals)
        occluder = np.full(len(centres), -1, np.int32)
        hides = seen.blocker >= 0
        occluder[hides] = objects[model.mesh.face_surface[seen.blocker[hides]]]
        shape = chart.grid.shape
        enough = bool(pixels[chart.surface] >= min_pixels)
        away = np.ones(len(centres), dtype=np.bool_)
        for scan in scans:
            away &= np.einsum("ij,ij->i", scan.origin - centres, normals) <= 0
        cells = _cells_of(chart, seen.sight.reshape(shape), occluder.reshape(shape), enough, away)
        result.append(cells)
    return tuple(result)


def _cells_of(
    chart: TrueChart,
    sight: NDArray[np.int8],
    occluder: NDArray[np.int32],
    seen_enough: bool,
    away: BoolArray,
) -> TrueCells:
    visible, hidden = chart.present & (sight == Sight.VISIBLE), chart.present & (sight == Sight.HIDDEN)
    part = pieces(visible | hidden, chart.grid.wraps)
    reached = np.zeros(int(part.max(initial=0)) + 1, dtype=np.bool_)
    reached[np.unique(part[visible])] = seen_enough
    reached[0] = False
    reachable = np.asarray(hidden & reached[part], dtype=np.bool_)
    return TrueCells(chart, sight, occluder, reachable, away.reshape(chart.grid.shape))


def pieces(mask: BoolArray, wraps: bool) -> NDArray[np.int32]:
    """Number of the connected piece (8 neighbours) that each cell of `mask` is in; 0 outside."""
    part, n_parts = ndimage.label(mask, structure=np.ones((3, 3)))
    if not wraps or n_parts < 2:
        return np.asarray(part, dtype=np.int32)
    both = (part[:, 0] > 0) & (part[:, -1] > 0)
    graph = coo_array((np.ones(both.sum()), (part[both, 0], part[both, -1])), shape=(n_parts + 1,) * 2)
    joined = 1 + connected_components(graph, directed=False)[1]
    joined[0] = 0
    return np.asarray(joined[part], dtype=np.int32)


def grown(mask: BoolArray, wraps: bool) -> BoolArray:
    """The mask and its eight neighbours, across the seam where the chart wraps."""
    around = np.pad(mask, ((0, 0), (1, 1)), mode="wrap" if wraps else "constant")
    return np.asarray(ndimage.binary_dilation(around, np.ones((3, 3)))[:, 1:-1], dtype=np.bool_)


def nearest_index(mask: BoolArray, cell: FloatArray) -> NDArray[np.int64]:
    """Flat index of the cell of `mask` that is nearest to each cell; `mask` must hold one."""
    rows, columns = ndimage.distance_transform_edt(
        ~mask, sampling=cell[::-1], return_distances=False, return_indices=True
    )
    return np.asarray(rows * mask.shape[1] + columns, dtype=np.int64)
