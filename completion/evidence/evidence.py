# SPDX-License-Identifier: MIT
"""Evidence: what all scans say about each place on a surface, observed free space being a veto."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.ndimage import label as connected_parts

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.free_space import free_cells
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Surface

_LIMB_PIXELS = 2.0  # how wide a beam may be and still be half on the surface
_NEAR_CELLS = 3  # from the surface's own pixels, within which pixels of no surface count as its own


class Label(IntEnum):
    """What the scans say of a place, weakest first; the strongest label of all scans counts."""

    OUT = 0  # in no scan's field of view
    NO_RETURN = 1  # looked at without an echo, or too obliquely to tell: evidence of nothing
    OCCLUDED = 2  # something nearer stood before it
    VISIBLE = 3  # measured there
    FREE = 4  # a beam went through: nothing can be there


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Labels of a chart grid's cells.

    Attributes
    ----------
    labels : (rows, columns) int8
        A `Label` for each cell.
    observed : (rows, columns) bool
        Cells where the surface was measured: by its own pixels or by pixels of no surface within tolerance.
    own : (rows, columns) bool
        Cells measured by its own pixels; only these are samples of its texture.
    pixel : (rows, columns) int64
        Flat pixel that sees each observed cell best, -1 elsewhere.
    scan : (rows, columns) int32
        The scan it belongs to, -1 elsewhere.
    occluder : (rows, columns) int32
        Number of the surface that stands before each occluded cell, 0 for none known.
    through : (rows, columns) bool
        Cells that some beam seems to have passed: the pixel at their centre measured farther. That is too
        little for a veto, but the surface is not hidden there.
    limb : (rows, columns) bool
        Cells so oblique to some scan that its beams may have met what lies behind as well. Free space there
        does not tell whether the surface goes on.
    """

    labels: NDArray[np.int8]
    observed: BoolArray
    own: BoolArray
    pixel: NDArray[np.int64]
    scan: NDArray[np.int32]
    occluder: NDArray[np.int32]
    through: BoolArray
    limb: BoolArray

    @property
    def open(self) -> BoolArray:
        """Cells (rows, columns) that beams passed, by a veto or seemingly, the limb apart."""
        return np.asarray(((self.labels == Label.FREE) | self.through) & ~self.limb, dtype=np.bool_)

    def rings_passed(self) -> BoolArray:
        """Tell at which rows (rows,) of a cylinder's chart beams say that it is not there, or has ended.

        A pipe or a column has one cross-section along its axis. Where beams passed more of a ring than was
        measured of it, the pipe is not there, and its hidden back is not either; nor are rings beyond, unless
        some part of it was measured again.
        """
        passed = np.count_nonzero(self.labels == Label.FREE, axis=1)
        measured = np.count_nonzero(self.own, axis=1)
        part, n_parts = connected_parts(passed <= measured)
        is_measured = np.bincount(part, measured, minlength=n_parts + 1) > 0
        is_measured[0] = False
        return np.asarray(~is_measured[part], dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """All scans, and what is needed to hold a surface against them."""

    observations: tuple[Observation, ...]  # the scans, working frame
    owners: tuple[NDArray[np.int32], ...]  # (rows, columns): surface of each pixel, from 1; 0 for none
    tolerance: Tolerance  # along the ray


@dataclass(frozen=True, slots=True, eq=False)
class PointLabels:
    """What one scan says of points of a surface."""

    label: NDArray[np.int8]  # (n,) a `Label`; never FREE, which only beams can say
    pixel: NDArray[np.int64]  # (n,) flat pixel that sees each point, -1 outside the field of view
    cosine: FloatArray  # (n,) of the incidence angle, without sign; 1 outside the field of view
    sure: BoolArray  # (n,) whether the tolerance was small enough to tell surfaces apart
    through: BoolArray  # (n,) whether that pixel measured farther than the point by more than the tolerance


def weigh(grid: ChartGrid, predicted_sd: FloatArray, scans: Scans, owner: int) -> Evidence:
    """Label the cells of a grid from all scans; a beam that went through a cell is a veto.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    predicted_sd : (rows * columns,) float
        Standard deviation of the surface along its normal at each cell, metres.
    scans : Scans
        All scans.
    owner : int
        This surface's number in `scans.owners`.
    """
    surface, centres, n_cells = grid.surface, grid.centres(), len(predicted_sd)
    labels, occluder = np.full(n_cells, Label.OUT, np.int8), np.zeros(n_cells, np.int32)
    pixel, scan = np.full(n_cells, -1, np.int64), np.full(n_cells, -1, np.int32)
    observed, own, through, limb = np.zeros((4, n_cells), dtype=np.bool_)
    footprint = np.full(n_cells, np.inf)
    for index, (seen, owners) in enumerate(zip(scans.observations, scans.owners, strict=True)):
        # 1. Label the cells' centres by the pixels that see them.
        found = label_points(surface, centres, predicted_sd, seen, scans.tolerance)
        label, visible = found.label, found.label == Label.VISIBLE

        # 2. A cell is measured by the surface's own pixels, or surely by pixels of no surface.
        owned_by = owners.ravel()[found.pixel[visible]]
        measured = np.zeros(n_cells, dtype=np.bool_)
        measured[visible] = (owned_by == owner) | ((owned_by == 0) & found.sure[visible])
        label[visible & ~found.sure & ~measured] = Label.NO_RETURN
        observed |= measured
        own[visible] |= owned_by == owner

        # 3. Of several pixels that measured a cell, keep the one with the smallest footprint.
        size = np.square(_range_to(seen, centres)) / np.maximum(found.cosine, 1e-3)
        better = measured & (size < footprint)
        footprint[better], pixel[better], scan[better] = size[better], found.pixel[better], index

        # 4. Note cells that beams seem to have passed, and those too oblique to tell.
        through |= found.through & found.sure & (found.cosine > limb_cosine(surface, seen, centres))
        limb |= found.cosine < limb_cosine(surface, seen, centres, _LIMB_PIXELS)

        # 5. Keep the strongest label of all scans, and what stands before a hidden cell.
        hidden = label == Label.OCCLUDED
        occluder[hidden] = owners.ravel()[found.pixel[hidden]]
        labels = np.maximum(labels, label)

    # 6. Drop measured cells far from the surface's own pixels: they are of something else on its plane.
    near = binary_dilation(own.reshape(grid.shape), np.ones((3, 3)), iterations=_NEAR_CELLS)
    observed &= near.ravel() | own

    # 7. Veto: nothing is where beams went through, but what was measured.
    vetoed = free_cells(grid, predicted_sd, scans.observations, scans.tolerance)
    labels[vetoed & ~observed] = Label.FREE
    return Evidence(
        labels=labels.reshape(grid.shape),
        observed=observed.reshape(grid.shape),
        own=own.reshape(grid.shape),
        pixel=pixel.reshape(grid.shape),
        scan=scan.reshape(grid.shape),
        occluder=occluder.reshape(grid.shape),
        through=(through & ~observed).reshape(grid.shape),
        limb=(limb & ~observed).reshape(grid.shape),
    )


def label_points(
    surface: Surface,
    points: FloatArray,
    predicted_sd: FloatArray,
    observation: Observation,
    tolerance: Tolerance,
) -> PointLabels:
    """Label points of a surface by one scan.

    Parameters
    ----------
    surface : Surface
        On which they lie, working frame.
    points : (n, 3) float
        Working frame, metres.
    predicted_sd : (n,) float
        Standard deviation of the surface along its normal at each, metres.
    observation : Observation
        The scan.
    tolerance : Tolerance
        Along the ray.
    """
    scan = observation.scan
    n = len(points)
    labels, pixels = np.full(n, Label.OUT, np.int8), np.full(n, -1, np.int64)
    cosines, is_sure, goes_through = np.ones(n), np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    position = scan.pixels(points)
    inside = np.flatnonzero(np.isfinite(position[:, 0] + position[:, 1]))
    row, column = np.rint(position[inside]).astype(np.int64).T
    pixel = row * scan.shape[1] + column
    points = points[inside]
    ray = points - scan.origin
    distance = np.sqrt(np.einsum("ij,ij->i", ray, ray))
    cosine = np.abs(np.einsum("ij,ij->i", ray, surface.normal(points))) / np.maximum(distance, 1e-12)
    measured = scan.ranges.ravel()[pixel]
    sigma = np.nan_to_num(observation.sigma.ravel()[pixel])
    safe = np.maximum(cosine, 1e-3)
    tangent = np.sqrt(np.maximum(1 - safe**2, 0.0)) / safe
    oblique = distance * scan.projection.pixel_angle * tangent / 2
    allowed = tolerance.along_ray(sigma, predicted_sd[inside], cosine) + oblique
    behind = distance - measured  # positive where something stands before the surface
    label = np.where(behind > allowed, Label.OCCLUDED, np.where(behind < -allowed, Label.FREE, Label.VISIBLE))
    # A cell's centre is not its beam: free space is claimed by the beams themselves, in free_cells.
    labels[inside] = np.where(~np.isfinite(measured) | (label == Label.FREE), Label.NO_RETURN, label)
    pixels[inside], cosines[inside] = pixel, cosine
    is_sure[inside] = allowed <= tolerance.max_m
    goes_through[inside] = np.isfinite(measured) & (label == Label.FREE)
    return PointLabels(labels, pixels, cosines, is_sure, goes_through)


def limb_cosine(
    surface: Surface, observation: Observation, points: FloatArray, pixels: float = 0.5
) -> FloatArray:
    """|cos| of incidence (n,) under which a ray so many pixels away may miss the surface; 0 on planes."""
    if not isinstance(surface, Cylinder):
        return np.zeros(len(points))
    pixel = _range_to(observation, points) * observation.scan.projection.pixel_angle
    return np.asarray(np.sqrt(np.minimum(2 * pixels * pixel / surface.radius, 1.0)), dtype=np.float64)


def _range_to(observation: Observation, points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(points - observation.scan.origin, axis=1), dtype=np.float64)
