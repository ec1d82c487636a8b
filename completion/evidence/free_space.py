# SPDX-License-Identifier: MIT
"""Free space: the cells of a surface that observed beams went through, in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import convolve1d

from completion.evidence.chart_grid import ChartGrid
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface


def free_cells(
    grid: ChartGrid, predicted_sd: FloatArray, observations: Sequence[Observation], tolerance: Tolerance
) -> BoolArray:
    """Tell for each cell, flat, whether observed beams went through it.

    Every beam is intersected with the surface in closed form. Without noise one beam is a veto; with noise
    it takes two in the cell's 3 x 3 neighbourhood, one of them in the cell itself. On a curved surface the
    neighbours of a vetoed cell are vetoed too, since facets lie off the surface by less than a cell.
    """
    count = np.zeros(grid.shape)
    noisy = False
    for observation in observations:
        valid = observation.valid
        noisy |= observation.is_noisy
        rays, measured, sigma = (
            observation.rays[valid],
            observation.scan.ranges[valid],
            observation.sigma[valid],
        )
        origin = observation.scan.origin
        for face in _both_faces(grid.surface):
            expected = face.ray_ranges(origin, rays)
            through = np.flatnonzero(np.isfinite(expected) & (expected < measured))
            points = origin + expected[through, None] * rays[through]
            index, cell = grid.cells_of(points)
            hit = through[index]
            cosine = np.abs(np.einsum("ij,ij->i", rays[hit], face.normal(points[index])))
            allowed = tolerance.along_ray(sigma[hit], predicted_sd[cell], cosine)
            beyond = (measured[hit] - expected[hit] > allowed) & (allowed <= tolerance.max_m)
            count += np.bincount(cell[beyond], minlength=count.size).reshape(grid.shape)
    vetoed = count > 0
    if noisy:
        vetoed &= _neighbourhood_sum(count, grid.wraps) >= 2
    if np.isfinite(grid.surface.period):
        vetoed = _neighbourhood_sum(vetoed.astype(np.float64), grid.wraps) > 0
    return np.asarray(vetoed.ravel(), dtype=np.bool_)


def _both_faces(surface: Surface) -> tuple[Surface, ...]:
    """The surface as rays meet it from either side."""
    if isinstance(surface, Plane):
        return surface, surface.flipped()
    if isinstance(surface, Cylinder):
        return tuple(
            Cylinder(surface.point, surface.direction, surface.radius, surface.zero_direction, concave)
            for concave in (False, True)
        )
    return (surface,)


def _neighbourhood_sum(count: FloatArray, wraps: bool) -> FloatArray:
    ones = np.ones(3)
    across = convolve1d(count, ones, axis=1, mode="wrap" if wraps else "constant")
    return np.asarray(convolve1d(across, ones, axis=0, mode="constant"), dtype=np.float64)
