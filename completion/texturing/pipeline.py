# SPDX-License-Identifier: MIT
"""Texturing on one page: a surface's measured colour in its chart, continued over what is inferred.

What is handed to the synthesis for one surface, and the samples it goes by, keep within a budget.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.texturing.chart_texture import ChartTexture, spread_colour
from completion.texturing.limits import BEYOND_CELLS, FEWEST_TEXELS, FULL_SHARE, MOSTLY, RIM_TEXELS
from completion.texturing.material import (
    MeasuredColour,
    TexelRaster,
    cast_shadows,
    is_among,
    lay_texels,
    measure_colour,
    same_material,
)
from scenes.checks import BoolArray, FloatArray, InputError, Value, check_options
from texture import fill_surface, measure_verbatim_share
from texture.sampling.arguments import SearchName

_USUAL_WINDOW = 23  # that a budget counts with when the window is chosen later
_BLOCK = 48  # texels: side of the blocks that samples are taken in


@dataclass(frozen=True, kw_only=True, slots=True)
class TexturingOptions(Value):
    """How hypothesised area gets its colour.

    Attributes
    ----------
    max_texels : int
        Texels of one surface; a larger one gets coarser ones than its pixels are.
    max_samples : int
        Measured texels that may be sampled, those near the hypothesised area.
    min_samples : int
        Fewest that a budget may leave.
    max_comparisons : int
        Hypothesised texels times samples times the window's texels, for one surface: where that is more,
        there are fewer samples; where these would be too few, what is synthesised is coarser than what is
        measured.
    window : int, optional
        Side of the Efros-Leung window in texels, odd; None chooses it for each surface.
    search : "auto", "exact" or "budget"
        As in `texture.fill`; by a budget, texels are as fine as pixels however much is hidden. "auto" is
        exact up to `exact_texels`.
    exact_texels : int
        Hidden texels for each scan.

    Raises
    ------
    InputError
        An unknown search, or a number out of range.
    """

    max_texels: int = 4_000_000
    max_samples: int = 30_000
    min_samples: int = 6_000
    max_comparisons: int = 200_000_000_000
    window: int | None = None
    search: Literal["auto", "exact", "budget"] = "auto"
    exact_texels: int = 20_000

    def __post_init__(self) -> None:
        if self.search not in ("auto", "exact", "budget"):
            raise InputError(f"search must be auto, exact or budget, got {self.search!r}")
        counts = ("max_texels", "max_samples", "min_samples", "max_comparisons", "exact_texels")
        check_options(self, window=(3, 99), **dict.fromkeys(counts, (1, np.inf)))

    def share_out(self, n_hidden: int) -> tuple[int, float]:
        """Return how many texels are sampled, and how much coarser texels are, where so many are hidden."""
        if self.search == "budget":
            return self.max_samples, 1.0
        affordable = self.max_comparisons / (max(n_hidden, 1) * (self.window or _USUAL_WINDOW) ** 2)
        n_samples = min(self.max_samples, max(self.min_samples, int(affordable)))
        fewer = max(1.0, n_samples / affordable)  # texels, each of so many
        return int(n_samples * fewer), float(np.sqrt(fewer))


class Task(NamedTuple):
    """What is filled: the raster without its shadows, or a coarser one where there is too much to fill."""

    image: NDArray[np.uint8]
    hole: BoolArray
    known: BoolArray
    samples: BoolArray
    coarseness: float


def set_task(
    raster: TexelRaster,
    measured: MeasuredColour,
    wanted: BoolArray,
    light: FloatArray,
    options: TexturingOptions,
) -> Task:
    """Set the task of one surface, some of which was measured, within the budget of the options.

    Hidden texels are `wanted`, (rows, columns); `light` (rows, columns, 3) are shadows (`cast_shadows`),
    which are taken out.
    """
    wraps = raster.grid.wraps
    lit = replace(measured, image=np.rint(np.clip(measured.image / light, 0, 255)).astype(np.uint8))
    distance = distance_to(wanted, wraps)
    n_samples, coarseness = options.share_out(int(np.count_nonzero(wanted)))
    samples, known = choose_samples(lit, (light == 1).all(axis=2), distance, wraps, n_samples)
    hole = wanted | (
        measured.known & ~known & (distance <= RIM_TEXELS)
    )  # these keep their colour all the same
    if coarseness == 1.0:
        return Task(lit.image, hole, known, samples, coarseness)
    rows, columns = (max(1, round(size / coarseness)) for size in wanted.shape)
    weight = resize_image(known.astype(np.float32), (rows, columns))
    colour = resize_image(np.where(known[..., None], lit.image, 0).astype(np.float32), (rows, columns))
    image = np.rint(colour / np.maximum(weight, 1e-6)[..., None]).clip(0, 255).astype(np.uint8)
    known = weight >= min(MOSTLY, float(weight.max()))
    unknown = (resize_image(hole.astype(np.float32), (rows, columns)) > 0) & ~known
    share = np.where(known, resize_image(samples.astype(np.float32), (rows, columns)), 0.0)
    return Task(image, unknown, known, share >= min(MOSTLY, float(share.max())), coarseness)


def resize_image(image: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Return an image (rows, columns, ...) of another shape: means over coarser texels, else interpolated."""
    if image.shape[:2] == shape:
        return image
    way = cv2.INTER_AREA if shape[0] < image.shape[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (shape[1], shape[0]), interpolation=way))


def find_foreign(measured: MeasuredColour, distance: FloatArray) -> BoolArray:
    """Texels at the rim of hidden area whose colour the surface does not have anywhere further in.

    Cameras blur colour across a jump edge, and depth and colour never agree to the pixel: these texels may
    show the occluder. `distance` (rows, columns) is that to the nearest hidden texel, texels.
    """
    rim = measured.known & (distance <= RIM_TEXELS)
    inner = measured.pure & (distance > RIM_TEXELS)
    if not rim.any() or np.count_nonzero(inner) < FEWEST_TEXELS:
        return rim & ~measured.pure
    return np.asarray(rim & ~is_among(measured.image, inner), dtype=np.bool_)


def choose_samples(
    measured: MeasuredColour, lit: BoolArray, distance: FloatArray, wraps: bool, max_samples: int
) -> tuple[BoolArray, BoolArray]:
    """Choose the texels that may be copied to the hidden ones, and those that they are to go on from.

    What is gone on from is not the occluder's (`find_foreign`), and of a material that the hidden area mostly
    borders on (`same_material`); samples are also fine enough (`measure_colour`), and in the light.

    Parameters
    ----------
    measured : MeasuredColour
        Of the whole raster.
    lit : (rows, columns) bool
        Texels in no shadow.
    distance : (rows, columns) float
        To the nearest hidden texel, texels.
    wraps : bool
        Whether columns close.
    max_samples : int
        At most about so many, in the blocks nearest to the hidden ones.

    Returns
    -------
    samples, context : (rows, columns) bool
    """
    genuine = ~find_foreign(measured, distance)
    fine = measured.fine if measured.fine.any() else measured.known
    lit_fine = _likely_samples(_likely_samples(fine, genuine), lit)
    is_same = same_material(measured.image, lit_fine, distance, wraps)
    chosen = _likely_samples(lit_fine, is_same)
    return _near_blocks(chosen, distance, max_samples), measured.known & genuine & is_same | chosen


def distance_to(wanted: BoolArray, wraps: bool) -> FloatArray:
    """Distance (rows, columns) of each texel to the nearest wanted one, texels; infinite for none."""
    if not wanted.any():
        return np.full(wanted.shape, np.inf)
    width = wanted.shape[1]
    around = np.concatenate([wanted] * 3, axis=1) if wraps else wanted
    distance = cv2.distanceTransform((~around).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(distance[:, width : 2 * width] if wraps else distance, dtype=np.float64)


def _near_blocks(texels: BoolArray, distance: FloatArray, most: int) -> BoolArray:
    """About so many of the texels: whole blocks of them, near ones first; a window sees little in a strip."""
    if np.count_nonzero(texels) <= most:
        return texels
    rows, columns = (-(-size // _BLOCK) for size in texels.shape)
    row, column = np.nonzero(texels)
    block = row // _BLOCK * columns + column // _BLOCK
    count = np.bincount(block, minlength=rows * columns)
    nearest = np.full(rows * columns, np.inf)
    np.minimum.at(nearest, block, distance[texels])
    order = np.lexsort((nearest, count < FULL_SHARE * _BLOCK**2))
    n_blocks = 1 + int(np.searchsorted(np.cumsum(count[order]), most))
    kept = np.zeros(rows * columns, dtype=np.bool_)
    kept[order[:n_blocks]] = True
    chosen = np.zeros_like(texels)
    chosen[row, column] = kept[block]
    return chosen


def _likely_samples(texels: BoolArray, likely: BoolArray) -> BoolArray:
    """Those of the texels that are likely samples, or all if hardly any are."""
    both = texels & likely
    return both if np.count_nonzero(both) >= FEWEST_TEXELS else texels


def choose_search(
    options: TexturingOptions, patches: Sequence[Patch], observations: Sequence[Observation]
) -> TexturingOptions:
    """Return the options with the search that serves for these patches: by how many texels are hidden."""
    if options.search != "auto" or all(seen.scan.colour is None for seen in observations):
        return options
    n_hidden = sum(
        np.count_nonzero(lay_texels(patch, observations, options.max_texels).of_cells(patch.hypothesised))
        for patch in patches
        if patch.hypothesised.any() and patch.observed.any()
    )
    few = n_hidden <= options.exact_texels * len(observations)
    return replace(options, search="exact" if few else "budget")


def texture_patch(
    patch: Patch, observations: Sequence[Observation], options: TexturingOptions, seed: int
) -> ChartTexture | None:
    """Colour a patch: measured texels from the pixels that see them best, inferred ones by Efros-Leung.

    Texels are as fine as the pixels; what is sampled are this surface's own measured texels, those that show
    it finely, in the light, and of the material that the hidden area borders on (`choose_samples`). Hidden
    texels lie in a shadow where the nearest measured ones do.

    Parameters
    ----------
    patch : Patch
        The surface.
    observations : sequence of Observation
        All scans.
    options : TexturingOptions
        Budgets, the search settled (`choose_search`).
    seed : int
        Seed of the sampling.

    Returns
    -------
    ChartTexture or None
        None when no scan has colour, or nothing of the surface was measured.
    """
    if all(seen.scan.colour is None for seen in observations) or not patch.observed.any():
        return None
    raster = lay_texels(patch, observations, options.max_texels)
    measured = measure_colour(patch, raster, observations)
    wanted = raster.of_cells(patch.hypothesised)
    reach = int(np.ceil(BEYOND_CELLS * patch.grid.cell.max() / raster.texel_m))
    if not wanted.any() or not measured.known.any():
        image = spread_colour(measured.image, measured.known, raster.grid.wraps, reach)
        return ChartTexture(image, raster.grid, measured.known, np.zeros_like(measured.known))
    light = cast_shadows(measured.image, measured.pure, raster.grid.wraps)
    search: SearchName = "budget" if options.search == "budget" else "exact"
    task = set_task(raster, measured, wanted, light, options)
    filled = fill_surface(
        task.image,
        task.hole,
        window=options.window,
        wrap=(False, raster.grid.wraps),
        known=task.known,
        sample_mask=task.samples,
        rng=seed,
        n_threads=1,
        search=search,
    )
    made = filled.synthesis
    image = measured.image.copy()
    image[wanted] = np.rint(resize_image(filled.image, wanted.shape)[wanted] * light[wanted])
    return ChartTexture(
        image=spread_colour(image, measured.known | wanted, raster.grid.wraps, reach),
        grid=raster.grid,
        measured=measured.known & ~wanted,
        synthesised=wanted,
        synthesised_m=raster.texel_m * task.coarseness,
        n_samples=int(np.count_nonzero(task.samples)),
        window=made.window,
        search=search,
        is_plain=filled.is_plain,
        confidence=float(made.confidence[task.hole].mean()) if task.hole.any() else 0.0,
        verbatim_share=measure_verbatim_share(made.source_rows, made.source_cols, task.hole),
    )
