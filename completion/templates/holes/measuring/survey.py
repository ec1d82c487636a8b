# SPDX-License-Identifier: MIT
"""Survey: what was measured in a plate's chart, beside it and through it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.templates.holes.measuring.plates import Plate, density
from scenes.checks import BoolArray, FloatArray, IntArray

_CELL = 0.5  # spacings
_MOST_CELLS = 2_000_000
_WIDE = 6.0  # spacings over which the density is averaged
_LARGE = 12.0  # spacings: radius of circles for which fewer points suffice
_FEWEST = 1_000  # points
_COVERED = 1.2  # spacings from a point within which surface was measured
_INNER, _FULL, _FEW = 0.6, 0.25, 1.5  # half sides of squares, in radii; share of the points expected; points


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A plate as it was measured.

    Attributes
    ----------
    plate : Plate
        With its chart.
    spacing : float
        The side of the square that one point of the plate has to itself.
    trees : tuple of cKDTree
        Of the plate's points (m, 2), then of every fourth of them, every sixteenth ...
    corner : (2,) float
        Of the grid's first cell.
    cell : float
        Side of a cell.
    counts : (k, l) float
        Points of the plate in each cell.
    summed : (k + 1, l + 1) float
        Points in all cells before one.
    densities : (k, l) float
        Points an area near each cell, where there is surface.
    stray : float
        Density within the plate's slab of points that are not the plate's, as a share of its own.
    area : float
        Of the box round the plate.
    """

    plate: Plate
    spacing: float
    trees: tuple[cKDTree, ...]
    corner: FloatArray
    cell: float
    counts: FloatArray
    summed: FloatArray
    densities: FloatArray
    stray: float
    area: float

    def density_at(self, uv: FloatArray) -> FloatArray:
        """Return points an area of the plate about places (n, 2)."""
        cell = ((uv - self.corner) / self.cell).astype(np.int64)
        cell = np.clip(cell, 0, np.array(self.counts.shape) - 1)
        return np.asarray(self.densities[tuple(cell.T)])

    def is_no_hole(self, centres: FloatArray, radii: FloatArray) -> BoolArray:
        """Tell at which places (..., 2) no hole of radii (...) can be: the plate fills it, or ends.

        Quick, by a square within the hole: a fourth of the plate's points in it are too many.
        """
        half, shape = (_INNER * radii)[..., None], np.array(self.counts.shape)
        low = np.clip(np.rint((centres - half - self.corner) / self.cell).astype(np.int64), 0, shape)
        high = np.clip(np.rint((centres + half - self.corner) / self.cell).astype(np.int64), 0, shape)
        (i, j), (k, m) = np.moveaxis(low, -1, 0), np.moveaxis(high, -1, 0)
        within = self.summed[k, m] - self.summed[i, m] - self.summed[k, j] + self.summed[i, j]
        expected = (high - low).prod(axis=-1) * (self.cell / self.spacing) ** 2
        beside = (centres < self.corner) | (centres > self.corner + shape * self.cell)
        return np.asarray((within > np.maximum(_FEW, _FULL * expected)) | beside.any(axis=-1))

    def level(self, radii: FloatArray) -> IntArray:
        """Return how often a fourth of the points suffices for circles with radii (m,)."""
        doublings = np.log2(np.maximum(radii / (_LARGE * self.spacing), 1.0)).astype(np.int64)
        return np.asarray(np.minimum(doublings, len(self.trees) - 1))

    def near(self, centres: FloatArray, reach: FloatArray, level: int = 0) -> tuple[IntArray, FloatArray]:
        """Return the plate's points within `reach` (m,) of centres (m, 2): whose they are, and offsets."""
        tree = self.trees[level]
        lists = tree.query_ball_point(centres, reach, return_sorted=False)
        sizes = np.array([len(one) for one in lists], dtype=np.int64)
        owner = np.repeat(np.arange(len(centres)), sizes)
        members = np.concatenate([np.asarray(one, dtype=np.int64) for one in lists] or [owner])
        return owner, np.asarray(tree.data)[members] - centres[owner]


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
        plate=plate, spacing=spacing, trees=_trees(uv), corner=low, cell=cell, counts=counts,
        summed=np.pad(counts.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))),
        densities=local, stray=stray, area=area,
    )  # fmt: skip


def _trees(uv: FloatArray) -> tuple[cKDTree, ...]:
    """Of places (n, 2), in an order that no grid of pixels shows in, and of ever fewer of them."""
    mixed = uv[np.random.default_rng(0).permutation(len(uv))]
    steps = 4 ** np.arange(max(1, int(np.log2(max(len(uv) / _FEWEST, 1)) / 2) + 1))
    return tuple(cKDTree(mixed[::step]) for step in steps.tolist())


def _stray(plate: Plate, uv: FloatArray) -> float:
    """The share of stray points, from those a few slabs above and below the plate."""
    size = np.abs(plate.height)
    beside = (size > 2 * plate.slab) & (size < 5 * plate.slab)
    inside = ((plate.uv > uv.min(axis=0)) & (plate.uv < uv.max(axis=0))).all(axis=1)
    return float(np.clip((beside & inside).sum() / 3 / len(uv), 2e-3, 0.1))
