# SPDX-License-Identifier: MIT
"""Texturing on one page: a surface's measured colour in its chart, continued over what is inferred."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.texturing.chart_texture import ChartTexture, spread_colour
from completion.texturing.material import cast_shadows, lay_texels, measure_colour
from completion.texturing.problem import TexturingOptions, resized, set_task
from texture import fill_surface, measure_verbatim_share
from texture.sampling.arguments import SearchName

_BEYOND = 5.0  # cells beyond what is covered that facets may reach, up to the fold where they end


def settled(
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
        Budgets, the search settled (`settled`).
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
    reach = int(np.ceil(_BEYOND * patch.grid.cell.max() / raster.texel_m))
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
    image[wanted] = np.rint(resized(filled.image, wanted.shape)[wanted] * light[wanted])
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
