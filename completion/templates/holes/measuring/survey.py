# SPDX-License-Identifier: MIT
"""Survey: what was measured in a plate's chart, beside it and through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.templates.holes.measuring.plates import Plate, density
from scenes.checks import FloatArray, IntArray

_CELL = 0.5  # spacings
_MOST_CELLS = 2_000_000
_WIDE = 6.0  # spacings over which the density is averaged
_COVERED = 1.2  # spacings from a point within which surface was measured


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A plate as it was measured.

    Attributes
    ----------
    plate : Plate
        With its chart.
    spacing : float
        The side of the square that one point of the plate has to itself.
    tree : cKDTree
        Of the plate's points (m, 2).
    corner : (2,) float
        Of the grid's first cell.
    cell : float
        Side of a cell.
    counts : (k, l) float
        Points of the plate in each cell.
    densities : (k, l) float
        Points an area near each cell, where there is surface.
    stray : float
        Density within the plate's slab of points that are not the plate's, as a share of its own.
    area : float
        Of the box round the plate.
    """

    plate: Plate
    spacing: float
    tree: cKDTree
    corner: FloatArray
    cell: float
    counts: FloatArray
    densities: FloatArray
    stray: float
    area: float

    def density_at(self, uv: FloatArray) -> FloatArray:
        """Return points an area of the plate about places (n, 2)."""
        cell = ((uv - self.corner) / self.cell).astype(np.int64)
        cell = np.clip(cell, 0, np.array(self.counts.shape) - 1)
        return np.asarray(self.densities[tuple(cell.T)])

    def near(self, centres: FloatArray, reach: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the plate's points within `reach` (m,) of centres (m, 2): whose they are, and offsets."""
        lists = self.tree.query_ball_point(centres, reach, return_sorted=False)
        sizes = np.array([len(one) for one in lists], dtype=np.int64)
        owner = np.repeat(np.arange(len(centres)), sizes)
        members = np.concatenate([np.asarray(one, dtype=np.int64) for one in lists] or [owner])
        return owner, np.asarray(self.tree.data)[members] - centres[owner]


def survey(plate: Plate) -> Survey:
    """Return what was measured of a plate."""
    uv = plate.uv[plate.is_on]
    overall = density(uv)
    spacing = 1 / np.sqrt(overall)
    low, high = uv.min(axis=0), uv.max(axis=0)
    cell = max(_CELL * spacing, float(np.sqrt(np.prod(high - low + spacing) / _MOST_CELLS)))
    shape = np.maximum(((high - low) / cell).astype(np.int64) + 1, 1)
    edges = [low[k] + cell * np.arange(shape[k] + 1) for k in range(2)]
    counts = np.histogram2d(uv[:, 0], uv[:, 1], bins=edges)[0]
    covered = ndimage.distance_transform_edt(counts == 0) * cell < _COVERED * spacing
    wide = _WIDE * spacing / cell
    mean = ndimage.gaussian_filter(counts, wide), ndimage.gaussian_filter(covered * cell**2, wide)
    local = np.divide(mean[0], mean[1], out=np.full(counts.shape, overall), where=mean[1] > 0.02 * cell**2)
    area, stray = float(np.prod(high - low)), _stray(plate, uv)
    return Survey(
        plate=plate, spacing=spacing, tree=cKDTree(uv), corner=low, cell=cell, counts=counts,
        densities=local, stray=stray, area=area,
    )  # fmt: skip


def _stray(plate: Plate, uv: FloatArray) -> float:
    """The share of stray points, from those a few slabs above and below the plate."""
    size = np.abs(plate.height)
    beside = (size > 2 * plate.slab) & (size < 5 * plate.slab)
    inside = ((plate.uv > uv.min(axis=0)) & (plate.uv < uv.max(axis=0))).all(axis=1)
    return float(np.clip((beside & inside).sum() / 3 / len(uv), 2e-3, 0.1))
