# SPDX-License-Identifier: MIT
"""Texturing on one page: a surface's measured colour in its chart, continued over what is inferred."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.chart import ChartGrid
from completion.extension import Patch
from completion.observation import Observation
from completion.texturing.light import cast_shadows
from completion.texturing.measured import MeasuredColour, measure_colour
from completion.texturing.raster import TexelRaster, lay_texels
from completion.texturing.samples import RIM, choose_samples, distance_to
from scenes.checks import BoolArray, FloatArray, check_options
from texture import fill_surface, measure_verbatim_share

GREY = 158  # of a texel of which nothing is known
MARGIN = 2  # texels around what is coloured that repeat its colour
_USUAL_WINDOW = 23  # that a budget counts with when the window is chosen later
_DOUBTFUL = 0.5  # mean confidence below which a fill is called garbage


@dataclass(frozen=True, kw_only=True, slots=True)
class TexturingOptions:
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
    """

    max_texels: int = 4_000_000
    max_samples: int = 30_000
    min_samples: int = 6_000
    max_comparisons: int = 200_000_000_000
    window: int | None = None

    def __post_init__(self) -> None:
        counts = ("max_texels", "max_samples", "min_samples", "max_comparisons")
        check_options(self, window=(3, 99), **dict.fromkeys(counts, (1, np.inf)))

    def share_out(self, n_hidden: int) -> tuple[int, float]:
        """Return how many texels are sampled, and how much coarser texels are, where so many are hidden."""
        affordable = self.max_comparisons / (max(n_hidden, 1) * (self.window or _USUAL_WINDOW) ** 2)
        n_samples = min(self.max_samples, max(self.min_samples, int(affordable)))
        return n_samples, float(np.sqrt(max(1.0, n_samples / affordable)))


@dataclass(frozen=True, slots=True, eq=False)
class ChartTexture:
    """Colour of a surface's chart.

    Attributes
    ----------
    image : (rows, columns, 3) uint8
        sRGB, grey where nothing is known; row 0 is the chart's lowest v.
    grid : ChartGrid
        Its texels.
    measured, synthesised : (rows, columns) bool
        Texels that scans coloured, and those made by sampling.
    synthesised_m : float
        Side of what was sampled as one texel, metres: a larger one than the grid's where there was too much.
    n_samples : int
        Texels of that size that were sampled from.
    window : int
        Side of the Efros-Leung window, 0 where nothing was synthesised.
    is_plain : bool
        Whether the surface has one colour, and was filled by its mean and noise.
    confidence : float
        Mean over the synthesised texels of how well their surroundings agree (`texture.Synthesis`).
    verbatim_share : float
        Share of them copied in one piece (`texture.measure_verbatim_share`).
    """

    image: NDArray[np.uint8]
    grid: ChartGrid
    measured: BoolArray
    synthesised: BoolArray
    synthesised_m: float = 0.0
    n_samples: int = 0
    window: int = 0
    is_plain: bool = False
    confidence: float = 1.0
    verbatim_share: float = 0.0

    @property
    def n_synthesised(self) -> int:
        """Texels made by sampling."""
        return int(np.count_nonzero(self.synthesised))

    @property
    def is_doubtful(self) -> bool:
        """Whether the surroundings of what was synthesised agree less than half as well as copies do."""
        return self.confidence < _DOUBTFUL

    def texels(self, uv: FloatArray) -> FloatArray:
        """Fractional rows and columns (n, 2) of chart coordinates (n, 2); integers are texel corners."""
        return np.asarray((uv - self.grid.corner)[:, ::-1] / self.grid.cell[::-1], dtype=np.float64)

    def colour_at(self, uv: FloatArray) -> NDArray[np.uint8]:
        """Colours (n, 3) of the texels that chart coordinates (n, 2) lie in, of the nearest ones outside."""
        index = np.floor(self.texels(uv)).astype(np.int64)
        row, column = np.clip(index, 0, np.array(self.grid.shape) - 1).T
        return np.asarray(self.image[row, column], dtype=np.uint8)


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
        Budgets.
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
    if not wanted.any() or not measured.known.any():
        image = spread_colour(measured.image, measured.known, raster.grid.wraps)
        return ChartTexture(image, raster.grid, measured.known, np.zeros_like(measured.known))
    light = cast_shadows(measured.image, measured.pure, raster.grid.wraps)
    task = _task(raster, measured, wanted, light, options)
    filled = fill_surface(
        task.image,
        task.hole,
        window=options.window,
        wrap=(False, raster.grid.wraps),
        known=task.known,
        sample_mask=task.samples,
        rng=seed,
        n_threads=1,
    )
    made = filled.synthesis
    image = measured.image.copy()
    image[wanted] = np.rint(_resized(filled.image, wanted.shape)[wanted] * light[wanted])
    return ChartTexture(
        spread_colour(image, measured.known | wanted, raster.grid.wraps),
        raster.grid,
        measured.known & ~wanted,
        wanted,
        raster.texel_m * task.coarseness,
        int(np.count_nonzero(task.samples)),
        made.window,
        filled.is_plain,
        float(made.confidence[task.hole].mean()),
        measure_verbatim_share(made.source_rows, made.source_cols, task.hole),
    )


class _Task(NamedTuple):
    """What is filled: the raster without its shadows, or a coarser one where there is too much to fill."""

    image: NDArray[np.uint8]
    hole: BoolArray
    known: BoolArray
    samples: BoolArray
    coarseness: float


def _task(
    raster: TexelRaster,
    measured: MeasuredColour,
    wanted: BoolArray,
    light: FloatArray,
    options: TexturingOptions,
) -> _Task:
    wraps = raster.grid.wraps
    lit = replace(measured, image=np.rint(np.clip(measured.image / light, 0, 255)).astype(np.uint8))
    distance = distance_to(wanted, wraps)
    n_samples, coarseness = options.share_out(int(np.count_nonzero(wanted)))
    samples, known = choose_samples(lit, (light == 1).all(axis=2), distance, wraps, n_samples)
    hole = wanted | (measured.known & ~known & (distance <= RIM))  # these keep their colour all the same
    if coarseness == 1.0:
        return _Task(lit.image, hole, known, samples, coarseness)
    rows, columns = (max(1, round(size / coarseness)) for size in wanted.shape)
    weight = _resized(known.astype(np.float32), (rows, columns))
    colour = _resized(np.where(known[..., None], lit.image, 0).astype(np.float32), (rows, columns))
    image = np.rint(colour / np.maximum(weight, 1e-6)[..., None]).clip(0, 255).astype(np.uint8)
    unknown = (_resized(hole.astype(np.float32), (rows, columns)) > 0) & (weight < 0.5)
    sampled = (_resized(samples.astype(np.float32), (rows, columns)) > 0.5) & (weight >= 0.5)
    return _Task(image, unknown, weight >= 0.5, sampled, coarseness)


def _resized(image: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """The image with so many rows and columns: means of what a coarser texel covers, else interpolated."""
    if image.shape[:2] == shape:
        return image
    way = cv2.INTER_AREA if shape[0] < image.shape[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, (shape[1], shape[0]), interpolation=way))


def spread_colour(image: NDArray[np.uint8], known: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    """Repeat the colour of known texels in those beside them, so that interpolation at edges stays in it."""
    sides = ((MARGIN, MARGIN), (MARGIN, MARGIN))
    done, result = np.pad(known, sides), np.pad(np.where(known[..., None], image, GREY), (*sides, (0, 0)))
    if wraps:
        for padded in (done, result):
            padded[:, :MARGIN], padded[:, -MARGIN:] = (
                padded[:, -2 * MARGIN : -MARGIN],
                padded[:, MARGIN : 2 * MARGIN],
            )
    for _ in range(MARGIN):
        weight = cv2.blur(done.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
        coloured = np.where(done[..., None], result, 0).astype(np.float32)
        mean = cv2.blur(coloured, (3, 3), borderType=cv2.BORDER_CONSTANT)
        new = ~done & (weight > 0.01)
        result[new] = np.rint(mean[new] / weight[new, None])
        done |= new
    return np.ascontiguousarray(result[MARGIN:-MARGIN, MARGIN:-MARGIN], dtype=np.uint8)
