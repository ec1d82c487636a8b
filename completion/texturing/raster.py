# SPDX-License-Identifier: MIT
"""Raster: texels over a surface's chart, as fine as the pixels that measured it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.extension.patch import Patch
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray

LARGEST_SIDE = 4096  # texels: what viewers take for one image
_LEAST_COSINE = 0.05  # more oblique pixels say nothing of detail
_Any = TypeVar("_Any", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class TexelRaster:
    """Texels over that part of a patch's chart which is measured or inferred.

    Attributes
    ----------
    grid : ChartGrid
        The texels; row 0 is the lowest v.
    cell_rows, cell_columns : (rows,), (columns,) int64
        The patch's cell that each texel's centre lies in.
    """

    grid: ChartGrid
    cell_rows: NDArray[np.int64]
    cell_columns: NDArray[np.int64]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.grid.shape

    @property
    def texel_m(self) -> float:
        """Side of a texel, metres: the root of its area."""
        return float(np.sqrt(self.grid.cell_area))

    def of_cells(self, values: NDArray[_Any]) -> NDArray[_Any]:
        """Values (rows, columns) of the texels from those of the patch's cells."""
        return values[np.ix_(self.cell_rows, self.cell_columns)]

    def centres(self, texels: BoolArray) -> FloatArray:
        """Points (n, 3) at the centres of the given texels, in raster order."""
        row, column = (index.astype(np.float64) + 0.5 for index in np.nonzero(texels))
        return self.grid.surface.from_uv(self.grid.uv_of(row, column))


def lay_texels(patch: Patch, observations: Sequence[Observation], max_texels: int) -> TexelRaster:
    """Texels as large as a quarter of the pixels on the surface at most are; larger ones within the bound.

    Parameters
    ----------
    patch : Patch
        The surface; something of it is measured.
    observations : sequence of Observation
        All scans.
    max_texels : int
        Most texels of the raster.
    """
    cells = patch.grid
    rows, columns = _used(patch)
    extent = np.array([len(columns), len(rows)]) * cells.cell
    texel = max(_texel_size(patch, observations), float(np.sqrt(extent.prod() / max_texels)))
    texel = max(texel, float(extent.max()) / LARGEST_SIDE)
    count = np.maximum(np.floor(extent / texel + 1e-6), 1).astype(np.int64)
    corner = cells.uv_of(*np.array([rows[0], columns[0]], dtype=np.float64))
    grid = ChartGrid(cells.surface, corner, extent / count, (int(count[1]), int(count[0])), cells.wraps)
    return TexelRaster(grid, rows[_share(len(rows), count[1])], columns[_share(len(columns), count[0])])


def footprint(
    observation: Observation, points: FloatArray, normals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Side of the square with a pixel's area (n,), and the pixel's longer side (n,), on a surface, metres."""
    ray = points - observation.scan.origin
    distance = np.linalg.norm(ray, axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", ray, normals)) / np.maximum(distance, 1e-12)
    cosine = np.maximum(cosine, _LEAST_COSINE)
    side = distance * observation.scan.projection.pixel_angle
    return side / np.sqrt(cosine), side / cosine


def _texel_size(patch: Patch, observations: Sequence[Observation]) -> float:
    """The quartile of the sizes of the surface's pixels, metres."""
    sizes = []
    for observation, mask in zip(observations, patch.source.masks, strict=True):
        points = observation.points[mask]
        sizes.append(footprint(observation, points, patch.grid.surface.normal(points))[0])
    return float(np.quantile(np.concatenate(sizes), 0.25))


def _used(patch: Patch) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns of cells that hold something; all columns where they close."""
    used = patch.observed | patch.hypothesised
    rows, columns = np.flatnonzero(used.any(axis=1)), np.flatnonzero(used.any(axis=0))
    rows = np.arange(rows[0], rows[-1] + 1)
    return rows, np.arange(used.shape[1]) if patch.grid.wraps else np.arange(columns[0], columns[-1] + 1)


def _share(n_cells: int, n_texels: int) -> NDArray[np.int64]:
    """Number of the cell that the centre of each texel lies in."""
    return np.minimum(((np.arange(n_texels) + 0.5) * n_cells / n_texels).astype(np.int64), n_cells - 1)
