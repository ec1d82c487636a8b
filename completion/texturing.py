# SPDX-License-Identifier: MIT
"""Texturing: measured colour brought into a surface's chart, and continued over its hypothesised cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.extension import Patch
from completion.observation import Observation
from scenes.checks import BoolArray, check_options
from texture import fill

_GREY = 0.62
_RIM = 4  # cells from the hidden area within which colour may be mixed with the occluder's


@dataclass(frozen=True, kw_only=True, slots=True)
class TexturingOptions:
    """How hypothesised area gets its colour.

    Attributes
    ----------
    max_texels : int
        Hypothesised texels that are synthesised for one surface; a larger area gets coarser ones.
    max_sample : int
        Observed texels that may be sampled; the nearest to the hypothesised area are kept.
    window : int
        Side of the Efros-Leung window in texels, odd.
    """

    max_texels: int = 4000
    max_sample: int = 20_000
    window: int = 9

    def __post_init__(self) -> None:
        check_options(self, max_texels=(1, np.inf), max_sample=(1, np.inf), window=(3, 99))


@dataclass(frozen=True, slots=True, eq=False)
class ChartTexture:
    """Colour of a chart's cells.

    Attributes
    ----------
    image : (rows, columns, 3) float
        sRGB in 0..1, grey where nothing is known; row 0 is the chart's lowest v.
    coarseness : int
        Cells along the side of a synthesised texel.
    n_synthesised : int
        Texels made by sampling.
    """

    image: NDArray[np.float32]
    coarseness: int
    n_synthesised: int


def texture_patch(
    patch: Patch, observations: Sequence[Observation], options: TexturingOptions, seed: int
) -> ChartTexture | None:
    """Colour a patch: measured cells from the pixels that see them best, hypothesised ones by Efros-Leung.

    Only the surface's own measured texels are sampled. Returns None when no scan has colour.

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
    """
    if all(observation.scan.colour is None for observation in observations):
        return None
    image, known = _measured_colour(patch, observations)
    wanted = patch.hypothesised
    if not wanted.any() or not known.any():
        return ChartTexture(_with_margin(image, known | False), 1, 0)
    clean = known & ~_contaminated(image, known & patch.evidence.own, wanted)
    coarseness = max(1, int(np.ceil(np.sqrt(wanted.sum() / options.max_texels))))
    small, small_known = _coarser(image, clean, coarseness)
    small_wanted = _any_in_block(wanted | (known & ~clean), coarseness) & ~small_known
    own = _coarser(image, clean & patch.evidence.own, coarseness)[1] & small_known
    sample = _near(own if own.any() else small_known, small_wanted, options.max_sample)
    result = fill(
        small,
        small_wanted,
        window=options.window,
        order="window",
        wrap=(False, patch.grid.wraps),
        known=small_known,
        sample_mask=sample,
        rng=seed,
    )
    synthesised = np.repeat(np.repeat(result.image, coarseness, axis=0), coarseness, axis=1)
    image[wanted] = synthesised[: image.shape[0], : image.shape[1]][wanted]
    return ChartTexture(_with_margin(image, known | wanted), coarseness, int(small_wanted.sum()))


def _measured_colour(
    patch: Patch, observations: Sequence[Observation]
) -> tuple[NDArray[np.float32], BoolArray]:
    """Colour of each observed cell from its best pixel, small gaps between pixels closed."""
    image = np.full((*patch.grid.shape, 3), _GREY, np.float32)
    known = np.zeros(patch.grid.shape, dtype=np.bool_)
    centres = patch.grid.centres().reshape(*patch.grid.shape, 3)
    for index, observation in enumerate(observations):
        here = patch.observed & (patch.evidence.scan == index)
        if observation.scan.colour is None or not here.any():
            continue
        position = observation.scan.pixels(centres[here])
        image[here] = _bilinear(observation.scan.colour, position)
        known |= here
    return image, known


def _contaminated(image: NDArray[np.float32], own: BoolArray, wanted: BoolArray) -> BoolArray:
    """Texels at the rim of the hidden area whose colour is the occluder's.

    Cameras blur colour across a jump edge, and depth and colour never agree to the pixel. Rim texels that
    lie outside what the surface shows a little further in, by its median and median absolute deviation, say
    nothing about it.
    """
    distance = cv2.distanceTransform((~wanted).astype(np.uint8), cv2.DIST_L2, 3)
    rim = own & (distance <= _RIM)
    inner = own & (distance > _RIM) & (distance <= 5 * _RIM)
    if not rim.any() or inner.sum() < 50:
        return np.zeros_like(own)
    middle = np.median(image[inner], axis=0)
    spread = 1.4826 * np.median(np.abs(image[inner] - middle), axis=0)
    strange = np.zeros_like(own)
    strange[rim] = (np.abs(image[rim] - middle) > 3 * spread + 2 / 255).any(axis=1)
    return strange


def _bilinear(colour: NDArray[np.float32], position: NDArray[np.float64]) -> NDArray[np.float32]:
    """Interpolated colours (n, 3) at fractional rows and columns (n, 2) inside the image."""
    column = position[:, 1].astype(np.float32).reshape(1, -1)
    row = position[:, 0].astype(np.float32).reshape(1, -1)
    if column.shape[1] < 32_000:
        return np.asarray(
            cv2.remap(colour, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0], np.float32
        )
    halves = np.array_split(position, int(np.ceil(len(position) / 30_000)))
    return np.concatenate([_bilinear(colour, half) for half in halves])


def _coarser(
    image: NDArray[np.float32], known: BoolArray, factor: int
) -> tuple[NDArray[np.float32], BoolArray]:
    """Mean colour of blocks of cells, known where more than half of the block is."""
    if factor == 1:
        return image.copy(), known.copy()
    rows, columns = (-(-size // factor) for size in known.shape)
    padded = np.zeros((rows * factor, columns * factor, 4), np.float64)
    padded[: known.shape[0], : known.shape[1], 3] = known
    padded[: known.shape[0], : known.shape[1], :3] = np.where(known[..., None], image, 0.0)
    total = padded.reshape(rows, factor, columns, factor, 4).sum(axis=(1, 3))
    count = total[..., 3]
    mean = total[..., :3] / np.maximum(count, 1.0)[..., None]
    return mean.astype(np.float32), np.asarray(count > factor * factor / 2, dtype=np.bool_)


def _any_in_block(cells: BoolArray, factor: int) -> BoolArray:
    rows, columns = (-(-size // factor) for size in cells.shape)
    padded = np.zeros((rows * factor, columns * factor), dtype=np.bool_)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(padded.reshape(rows, factor, columns, factor).any(axis=(1, 3)), dtype=np.bool_)


def _near(known: BoolArray, wanted: BoolArray, most: int) -> BoolArray:
    """The known texels nearest to the wanted ones, at most so many of them."""
    if known.sum() <= most:
        return known.copy()
    distance = cv2.distanceTransform((~wanted).astype(np.uint8), cv2.DIST_L2, 3)
    reach = np.partition(distance[known], most)[most]
    return np.asarray(known & (distance <= reach), dtype=np.bool_)


def _with_margin(image: NDArray[np.float32], known: BoolArray) -> NDArray[np.float32]:
    """Spread the colours of known cells by two cells, so that interpolation at edges stays in colour."""
    result, done = image.copy(), known.copy()
    for _ in range(2):
        weight = cv2.blur(done.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
        mean = cv2.blur(
            np.where(done[..., None], result, 0).astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT
        )
        new = ~done & (weight > 0.01)
        result[new] = mean[new] / weight[new, None]
        done |= new
    return result
