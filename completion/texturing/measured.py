# SPDX-License-Identifier: MIT
"""Measured colour: texels over a surface's chart, as fine as its pixels, and what they show of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.extension.patch import Patch
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.scan.colour import colour_bytes, unit_colour

LARGEST_SIDE = 4096  # texels: what viewers take for one image
_MOST_PIXELS = 1_000_000  # that a texel's size is read from
_LEAST_COSINE = 0.05  # more oblique pixels say nothing of detail
_Any = TypeVar("_Any", bound=np.generic)


@dataclass(frozen=True, slots=True, eq=False)
class TexelRaster:
    """Texels over that part of a patch's chart which is measured or inferred."""

    grid: ChartGrid  # the texels; row 0 is the lowest v
    cell_rows: NDArray[np.int64]  # (rows,) the patch's row of cells that each texel's centre lies in
    cell_columns: NDArray[np.int64]  # (columns,) and the column

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
    """Texels as large as a quarter of the pixels on a measured surface at most are; or within the bound."""
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
    for observation, pixels in patch.source.sampled_by(observations, _MOST_PIXELS):
        points = observation.points_at(pixels)
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


_COARSEST = 2.0  # texels: longest side of a pixel whose colour shows a texture as fine as the chart's
_FEWEST = 0.25  # share of a surface's own texels that are sampled, however coarse
_CHUNK = 30_000  # places that cv2.remap takes in one row


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredColour:
    """What the scans say of a raster's colour."""

    image: NDArray[np.uint8]  # (rows, columns, 3) sRGB, 0 where nothing is known
    known: BoolArray  # (rows, columns) where a scan with colour measured the surface
    pure: BoolArray  # (rows, columns) known, and pixels around theirs are this surface's too
    fine: BoolArray  # (rows, columns) those of the pure ones that were seen finely enough to be samples


def measure_colour(patch: Patch, raster: TexelRaster, observations: Sequence[Observation]) -> MeasuredColour:
    """Bring the colour of all scans into a raster, each texel from the scan that sees it largest.

    Texels seen more obliquely or from farther than the raster is fine (pixels longer than two texels) are no
    samples, except the finest quarter where hardly any others are there.
    """
    shape = raster.grid.shape
    image, length = np.zeros((*shape, 3), np.uint8), np.full(shape, np.inf)
    known, pure = np.zeros((2, *shape), dtype=np.bool_)
    observed, scan_of = raster.of_cells(patch.observed), raster.of_cells(patch.evidence.scan)
    for index, (observation, pixels) in enumerate(zip(observations, patch.source.pixels, strict=True)):
        here = observed & (scan_of == index)
        if observation.scan.colour is None or not here.any():
            continue
        points = raster.centres(here)
        position = observation.scan.pixels(points)
        inside = np.isfinite(position).all(axis=1)
        if not inside.any():
            continue
        here[here] = inside
        points, position = points[inside], position[inside]
        mask, counts = pixels.mask, pixels.mask
        counts.ravel()[patch.evidence.pixel[patch.observed & (patch.evidence.scan == index)]] = True
        image[here] = _interpolate(
            observation.scan.colour, counts, position, raster.of_cells(patch.evidence.pixel)[here]
        )
        known |= here
        within = cv2.erode(mask.view(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
        nearest = np.rint(position).astype(np.int64)
        pure[here] = within[nearest[:, 0], nearest[:, 1]] > 0
        length[here] = footprint(observation, points, patch.grid.surface.normal(points))[1]
    pure = pure if pure.any() else known & raster.of_cells(patch.evidence.own)
    longest = _COARSEST * raster.texel_m
    if pure.any():
        longest = max(longest, float(np.quantile(length[pure], _FEWEST)))
    return MeasuredColour(image, known, pure, pure & (length <= longest))


def _interpolate(
    colour: NDArray[np.float32] | NDArray[np.uint8],
    counts: BoolArray,
    position: FloatArray,
    fallback: NDArray[np.int64],
) -> NDArray[np.uint8]:
    """Bilinear colours (n, 3), 0..255, at fractional rows and columns (n, 2), of the pixels that count.

    Where none does, that of the flat pixel `fallback` (n,).
    """
    found = unit_colour(colour.reshape(-1, 3)[fallback])
    if not len(found):
        return colour_bytes(found)
    near = _box(position, counts.shape)
    pixels = unit_colour(np.where(counts[near][..., None], colour[near], colour.dtype.type(0)))
    inside = position.astype(np.float32) - np.array([part.start for part in near], np.float32)  # exact
    total, weight = _remap(pixels, inside), _remap(counts[near].astype(np.float32), inside)
    enough = weight > 1e-3
    found[enough] = total[enough] / weight[enough, None]
    return np.asarray(np.rint(np.clip(found, 0, 1) * 255), dtype=np.uint8)


def _box(position: FloatArray, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The part of an image that holds all pixels beside fractional rows and columns (n, 2)."""
    low, high = np.floor(position.min(axis=0)).astype(int), np.ceil(position.max(axis=0)).astype(int)
    rows, columns = (
        slice(max(first - 1, 0), min(last + 2, size))
        for first, last, size in zip(low, high, shape, strict=True)
    )
    return rows, columns


def _remap(image: NDArray[np.float32], position: NDArray[np.float32]) -> NDArray[np.float32]:
    """Bilinear values (n,) or (n, channels) at fractional rows and columns (n, 2) inside the image."""
    parts = np.array_split(position, max(1, -(-len(position) // _CHUNK)))
    places = [(part[None, :, 1], part[None, :, 0]) for part in parts]
    found = [cv2.remap(image, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0] for at in places]
    return np.asarray(np.concatenate(found), dtype=np.float32)
