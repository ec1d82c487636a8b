# SPDX-License-Identifier: MIT
"""Material: what a surface is made of, by the median colour of a neighbourhood, and shadows cast on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.evidence.chart_grid import ChartGrid
from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.texturing import limits
from scenes.checks import BoolArray, FloatArray
from scenes.scan.colour import colour_bytes, unit_colour
from texture.reflectance import fit_shading

NEIGHBOURHOOD = 31  # texels: side of the square whose median colour is a material's
_SHAPE = (
    int(100 / limits.BIN) + 4,
    int(256 / limits.BIN) + 4,
    int(256 / limits.BIN) + 4,
)  # bins of colours, one around them
_EDGE_TEXELS = 3


def median_colour(image: NDArray[np.uint8], members: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    """Median colour (rows, columns, 3) around each texel of an sRGB image (rows, columns, 3).

    Medians change at once where one material ends and another begins. Texels that are not the surface's
    `members`, (rows, columns), count as the nearest one that is; some are. `wraps`: columns close.
    """
    nearest = ndimage.distance_transform_edt(~members, return_distances=False, return_indices=True)
    levels, around = image[tuple(nearest)], NEIGHBOURHOOD // 2
    if wraps:
        levels = np.concatenate([levels[:, -around:], levels, levels[:, :around]], axis=1)
    median = cv2.medianBlur(np.ascontiguousarray(levels), NEIGHBOURHOOD)
    return np.asarray(median[:, around:-around] if wraps else median, dtype=np.uint8)


def same_material(
    image: NDArray[np.uint8], members: BoolArray, distance: FloatArray, wraps: bool
) -> BoolArray:
    """Texels of the materials that make two thirds of what is found beside the hidden area.

    `image`, `members` and `wraps` as in `median_colour`; `distance` (rows, columns) to the nearest hidden
    texel, texels.
    """
    beside = members & (distance <= NEIGHBOURHOOD)
    if np.count_nonzero(members) < limits.FEWEST_TEXELS or not beside.any():
        return np.ones_like(members)
    even = _without_shading(image, members, wraps)
    bins = _bins(to_lab(median_colour(even, members, wraps)))
    count = _histogram(bins, members)
    number, n_materials = ndimage.label(
        count >= max(1.0, limits.RARE_SHARE * count.sum()), np.ones((3, 3, 3))
    )
    share = np.bincount(number[tuple(bins[beside].T)], minlength=n_materials + 1)
    share[0] = 0  # of colours too rare for a material
    ranked = np.argsort(-share, kind="stable")
    n_kept = 1 + int(np.searchsorted(np.cumsum(share[ranked]), limits.MATERIALS_SHARE * share.sum()))
    kept = np.zeros(n_materials + 1, dtype=np.bool_)
    kept[ranked[:n_kept]] = True
    its_colours = _dilate_bins(kept[number]) & (kept[number] | (number == 0))
    is_same = np.asarray(its_colours[tuple(np.moveaxis(bins, -1, 0))], dtype=np.bool_)
    strange = is_same & ~_is_common(_bins(to_lab(even)), is_same & members)
    return is_same & ~np.asarray(
        ndimage.binary_opening(strange, np.ones((limits.SPECK_TEXELS, limits.SPECK_TEXELS))), dtype=np.bool_
    )


def _without_shading(image: NDArray[np.uint8], members: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    values = image / np.float32(255)
    values /= fit_shading(values.mean(axis=2), members, (False, wraps)).gain[..., None]
    return np.asarray(np.rint(np.clip(values, 0, 1) * 255), dtype=np.uint8)


def _is_common(bins: NDArray[np.int32], among: BoolArray) -> BoolArray:
    """Texels whose colour is found in many neighbourhoods of a material.

    Mortar is found wherever there are bricks; glass, in a strip or a corner too narrow for a median, is not.
    """
    row, column = np.nonzero(among)
    block = row // NEIGHBOURHOOD * among.shape[1] + column // NEIGHBOURHOOD
    n_bins = int(np.prod(_SHAPE))
    flat = np.ravel_multi_index(tuple(bins[among].T), _SHAPE)
    pairs = np.unique(block * n_bins + flat)
    n_blocks = len(np.unique(block))
    steps = np.ravel_multi_index((1, 1, 1), _SHAPE) - np.ravel_multi_index(
        tuple(np.indices((3, 3, 3)).reshape(3, -1)), _SHAPE
    )
    near = np.unique((pairs[:, None] + steps).ravel())
    share = np.bincount(near % n_bins, minlength=n_bins) / n_blocks
    return np.asarray(
        share.reshape(_SHAPE)[tuple(np.moveaxis(bins, -1, 0))] >= limits.COMMON_SHARE, dtype=np.bool_
    )


def is_among(image: NDArray[np.uint8], among: BoolArray) -> BoolArray:
    """Tell which texels of an image (rows, columns, 3) nearly have a colour of the texels `among`."""
    bins = _bins(to_lab(image))
    near = _dilate_bins(_histogram(bins, among) > 0)
    return np.asarray(near[tuple(np.moveaxis(bins, -1, 0))], dtype=np.bool_)


def to_lab(image: NDArray[np.uint8]) -> FloatArray:
    """Return CIELAB colours (..., 3) of sRGB colours (..., 3): lightness 0 to 100, then a and b."""
    colour = np.asarray(image / np.float32(255), dtype=np.float32)
    return np.asarray(cv2.cvtColor(colour, cv2.COLOR_RGB2LAB), dtype=np.float64)


def _bins(lab: FloatArray) -> NDArray[np.int32]:
    """Bin (rows, columns, 3) of each colour."""
    return np.asarray(np.floor((lab + np.array([0, 128, 128])) / limits.BIN) + 1, dtype=np.int32)


def _histogram(bins: NDArray[np.int32], texels: BoolArray) -> NDArray[np.int64]:
    """How many of the texels have each colour."""
    flat = np.ravel_multi_index(tuple(bins[texels].T), _SHAPE)
    return np.bincount(flat, minlength=int(np.prod(_SHAPE))).reshape(_SHAPE)


def _dilate_bins(bins: BoolArray) -> BoolArray:
    """The bins and their neighbours along the three axes in turn."""
    for axis in range(3):
        bins = bins | np.roll(bins, 1, axis) | np.roll(bins, -1, axis)
    return bins


def cast_shadows(image: NDArray[np.uint8], members: BoolArray, wraps: bool) -> FloatArray:
    """Relative brightness (rows, columns, 3) of texels of an image like it: 1 in the light, less in a shadow.

    In a shadow is what is much darker than most of the surface, of its hue, and at once so, by the median of
    a neighbourhood. The shadow's depth is the ratio of the medians in it and around. Texels that are not
    `members`, (rows, columns), are lit as those around them are, the more evenly the farther off these are.
    `wraps`: columns close.
    """
    gain = np.ones((*members.shape, 3))
    if np.count_nonzero(members) < limits.FEWEST_TEXELS:
        return gain
    material = to_lab(median_colour(image, members, wraps))
    luminance, usual = _luminance(material), np.median(material[members], axis=0)
    hue = np.hypot(*np.moveaxis(material[..., 1:] - usual[1:], -1, 0))
    dark = members & (luminance < limits.SHADOW_LUMINANCE * _luminance(usual)) & (hue <= limits.SAME_CHROMA)
    if not dark.any():
        return gain
    luminance = _luminance(to_lab(image))
    dark = _to_edges(dark, members, luminance)
    if np.count_nonzero(dark) > np.count_nonzero(members) / 2:
        return gain  # the surface itself is dark, in parts
    number, n_shadows = ndimage.label(dark)
    in_light = np.median(image[members & (number == 0)], axis=0)
    for shadow in range(1, n_shadows + 1):
        inside = number == shadow
        if _has_edge(inside, members, luminance):
            gain[inside] = np.clip(np.median(image[inside], axis=0) / np.maximum(in_light, 1), 1 / 255, 1)
    return np.where(members[..., None], gain, np.exp(_fill_from_pyramid(np.log(gain), members)))


def _to_edges(dark: BoolArray, members: BoolArray, luminance: FloatArray) -> BoolArray:
    """Grow shadows over what is dark itself, into corners and strips where most of a neighbourhood is lit."""
    between = np.sqrt(np.median(luminance[dark]) * np.median(luminance[members & ~dark]))
    square, mask = np.ones((3, 3)), dark | members & (luminance < between)
    grown = ndimage.binary_propagation(dark, square, mask)
    closed = ndimage.binary_closing(grown, square, iterations=_EDGE_TEXELS) & members
    return np.asarray(grown | closed, dtype=np.bool_)


def _has_edge(dark: BoolArray, members: BoolArray, luminance: FloatArray) -> bool:
    """Whether brightness jumps at the border of a dark part that is large enough for a shadow."""
    if np.count_nonzero(dark) < limits.FEWEST_TEXELS:
        return False
    square = np.ones((3, 3))
    inside = dark & ~ndimage.binary_erosion(dark | ~members, square, iterations=_EDGE_TEXELS)
    outside = members & ~dark & ndimage.binary_dilation(dark, square, iterations=_EDGE_TEXELS)
    if not inside.any() or not outside.any():
        return False
    return bool(np.median(luminance[inside]) < limits.EDGE_LUMINANCE * np.median(luminance[outside]))


def _fill_from_pyramid(values: FloatArray, members: BoolArray) -> FloatArray:
    """Carry values (rows, columns, 3) into what is not own: by a pyramid, each level from the next coarser.

    References
    ----------
    .. [1] Gortler et al. 1996, "The lumigraph", section 3.4 (pull and push).
    """
    if members.all() or min(members.shape) < 2:
        return np.where(members[..., None], values, 0.0)
    rows, columns = (-(-size // 2) for size in members.shape)
    weight = cv2.resize(members.astype(np.float64), (columns, rows), interpolation=cv2.INTER_AREA)
    total = cv2.resize(
        np.where(members[..., None], values, 0.0), (columns, rows), interpolation=cv2.INTER_AREA
    )
    coarse = _fill_from_pyramid(total / np.maximum(weight, 1e-9)[..., None], weight > 0)
    finer = cv2.resize(coarse, members.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.where(members[..., None], values, finer)


def _luminance(lab: FloatArray) -> FloatArray:
    """Luminance, 0..1, of CIELAB colours."""
    return np.asarray(((lab[..., 0] + 16) / 116) ** 3, dtype=np.float64)


LARGEST_SIDE = 4096  # texels: what viewers take for one image
_MOST_PIXELS = 1_000_000  # that a texel's size is read from
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
    rows, columns = _window_of_cells(patch)
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
    cosine = np.maximum(cosine, limits.LEAST_COSINE)
    side = distance * observation.scan.projection.pixel_angle
    return side / np.sqrt(cosine), side / cosine


def _texel_size(patch: Patch, observations: Sequence[Observation]) -> float:
    """The quartile of the sizes of the surface's pixels, metres."""
    sizes = []
    for observation, pixels in patch.source.sampled_by(observations, _MOST_PIXELS):
        points = observation.points_at(pixels)
        sizes.append(footprint(observation, points, patch.grid.surface.normal(points))[0])
    return float(np.quantile(np.concatenate(sizes), 0.25))


def _window_of_cells(patch: Patch) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns of cells that hold something; all columns where they close."""
    used = patch.observed | patch.hypothesised
    rows, columns = np.flatnonzero(used.any(axis=1)), np.flatnonzero(used.any(axis=0))
    rows = np.arange(rows[0], rows[-1] + 1)
    return rows, np.arange(used.shape[1]) if patch.grid.wraps else np.arange(columns[0], columns[-1] + 1)


def _share(n_cells: int, n_texels: int) -> NDArray[np.int64]:
    """Number of the cell that the centre of each texel lies in."""
    return np.minimum(((np.arange(n_texels) + 0.5) * n_cells / n_texels).astype(np.int64), n_cells - 1)


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
    pure = pure if pure.any() else known & raster.of_cells(patch.evidence.is_own)
    longest = limits.COARSEST_TEXELS * raster.texel_m
    if pure.any():
        longest = max(longest, float(np.quantile(length[pure], limits.FEWEST_SHARE)))
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
    colours = unit_colour(colour.reshape(-1, 3)[fallback])
    if not len(colours):
        return colour_bytes(colours)
    near = _box(position, counts.shape)
    pixels = unit_colour(np.where(counts[near][..., None], colour[near], colour.dtype.type(0)))
    inside = position.astype(np.float32) - np.array([part.start for part in near], np.float32)  # exact
    total, weight = _remap(pixels, inside), _remap(counts[near].astype(np.float32), inside)
    enough = weight > 1e-3
    colours[enough] = total[enough] / weight[enough, None]
    return np.asarray(np.rint(np.clip(colours, 0, 1) * 255), dtype=np.uint8)


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
    channels = [cv2.remap(image, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0] for at in places]
    return np.asarray(np.concatenate(channels), dtype=np.float32)
