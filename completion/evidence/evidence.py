# SPDX-License-Identifier: MIT
"""Evidence: what all scans say about each place on a surface, observed free space being a veto."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.free_space import free_cells
from completion.observe.observation import Observation
from completion.observe.tolerance import EvidenceOptions, ray_tolerance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Surface

_LIMB_PIXELS = 2.0  # how wide a beam may be and still be half on the surface
_STRAY_CELLS = 3  # from the surface's own pixels, within which pixels of no surface count as its own


class Label(IntEnum):
    """What the scans say of a place, weakest first; the strongest word of all scans counts."""

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
        Cells that some beam seems to have passed: the pixel at their centre measured farther. Too little for
        a veto, but nothing that a surface hides behind.
    limb : (rows, columns) bool
        Cells so oblique to some scan that its beams may have met what lies behind as well: what they say
        of free space there is no word on whether the surface goes on.
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
        """Cells that beams passed, by a veto or seemingly, the limb apart."""
        return np.asarray(((self.labels == Label.FREE) | self.through) & ~self.limb, dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class PointLabels:
    """What one scan says of points of a surface.

    Attributes
    ----------
    label : (n,) int8
        A `Label`; never FREE, which only beams can say.
    pixel : (n,) int64
        Flat pixel that sees each point, -1 outside the field of view.
    cosine : (n,) float
        Of the incidence angle, without sign; 1 outside the field of view.
    sure : (n,) bool
        Whether the tolerance was small enough to tell surfaces apart.
    through : (n,) bool
        Whether that pixel measured farther than the point by more than the tolerance.
    """

    label: NDArray[np.int8]
    pixel: NDArray[np.int64]
    cosine: FloatArray
    sure: BoolArray
    through: BoolArray


def weigh(
    grid: ChartGrid,
    spread: FloatArray,
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    owner: int,
    options: EvidenceOptions,
) -> Evidence:
    """Label the cells of a grid from all scans.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    spread : (rows * columns,) float
        Predicted standard deviation of the surface along its normal at each cell, metres.
    observations : sequence of Observation
        All scans.
    owners : sequence of (rows, columns) int32
        For each scan, the surface that each pixel belongs to, 0 for none.
    owner : int
        This surface's number in `owners`.
    options : EvidenceOptions
        Tolerances.
    """
    centres = grid.centres()
    n_cells = len(centres)
    labels = np.full(n_cells, Label.OUT, np.int8)
    pixel, scan = np.full(n_cells, -1, np.int64), np.full(n_cells, -1, np.int32)
    own = np.zeros(n_cells, dtype=np.bool_)
    observed, through, limb = (np.zeros(n_cells, dtype=np.bool_) for _ in range(3))
    footprint, occluder = np.full(n_cells, np.inf), np.zeros(n_cells, np.int32)
    for index, observation in enumerate(observations):
        found = label_points(grid.surface, centres, spread, observation, options)
        said, seen_by, sure = found.label, found.pixel, found.sure
        belongs = np.zeros(n_cells, dtype=np.bool_)
        visible = said == Label.VISIBLE
        owned_by = owners[index].ravel()[seen_by[visible]]
        belongs[visible] = (owned_by == owner) | ((owned_by == 0) & sure[visible])
        said[visible & ~sure & ~belongs] = Label.NO_RETURN
        size = np.where(
            belongs, np.square(_range_to(observation, centres)) / np.maximum(found.cosine, 1e-3), np.inf
        )
        better = belongs & (size < footprint)
        footprint[better], pixel[better], scan[better] = size[better], seen_by[better], index
        observed |= belongs
        own[visible] |= owned_by == owner
        through |= found.through & sure & (found.cosine > limb_cosine(grid.surface, observation, centres))
        limb |= found.cosine < limb_cosine(grid.surface, observation, centres, _LIMB_PIXELS)
        hides = said == Label.OCCLUDED
        occluder[hides] = owners[index].ravel()[seen_by[hides]]
        labels = np.maximum(labels, said)
    observed &= _beside(own, grid) | own
    vetoed = free_cells(grid, spread, observations, options)
    labels[vetoed & ~observed] = Label.FREE
    shape = grid.shape
    return Evidence(
        labels=labels.reshape(shape),
        observed=observed.reshape(shape),
        own=own.reshape(shape),
        pixel=pixel.reshape(shape),
        scan=scan.reshape(shape),
        occluder=occluder.reshape(shape),
        through=(through & ~observed).reshape(shape),
        limb=(limb & ~observed).reshape(shape),
    )


def _beside(own: BoolArray, grid: ChartGrid) -> BoolArray:
    """Cells that hang together with its own ones: stray returns on the plane of a surface are none of it."""
    near = binary_dilation(own.reshape(grid.shape), np.ones((3, 3)), iterations=_STRAY_CELLS)
    return np.asarray(near.ravel(), dtype=np.bool_)


def label_points(
    surface: Surface,
    points: FloatArray,
    spread: FloatArray,
    observation: Observation,
    options: EvidenceOptions,
) -> PointLabels:
    """Label points of a surface by one scan."""
    scan = observation.scan
    n = len(points)
    said, pixels = np.full(n, Label.OUT, np.int8), np.full(n, -1, np.int64)
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
    oblique = distance * scan.projection.pixel_angle * _tangent(cosine) / 2
    tolerance = ray_tolerance(sigma, spread[inside], cosine, options) + oblique
    behind = distance - measured  # positive where something stands before the surface
    word = np.where(
        behind > tolerance, Label.OCCLUDED, np.where(behind < -tolerance, Label.FREE, Label.VISIBLE)
    )
    # A cell's centre is not its beam: free space is claimed by the beams themselves, in free_cells.
    said[inside] = np.where(~np.isfinite(measured) | (word == Label.FREE), Label.NO_RETURN, word)
    pixels[inside], cosines[inside] = pixel, cosine
    is_sure[inside] = tolerance <= options.max_tolerance_m
    goes_through[inside] = np.isfinite(measured) & (word == Label.FREE)
    return PointLabels(said, pixels, cosines, is_sure, goes_through)


def limb_cosine(
    surface: Surface, observation: Observation, points: FloatArray, pixels: float = 0.5
) -> FloatArray:
    """|cos| of incidence (n,) under which a ray so many pixels away may miss the surface; 0 on planes."""
    if not isinstance(surface, Cylinder):
        return np.zeros(len(points))
    pixel = _range_to(observation, points) * observation.scan.projection.pixel_angle
    return np.asarray(np.sqrt(np.minimum(2 * pixels * pixel / surface.radius, 1.0)), dtype=np.float64)


def _tangent(cosine: FloatArray) -> FloatArray:
    safe = np.maximum(cosine, 1e-3)
    return np.asarray(np.sqrt(np.maximum(1 - safe**2, 0.0)) / safe, dtype=np.float64)


def _range_to(observation: Observation, points: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(points - observation.scan.origin, axis=1), dtype=np.float64)
