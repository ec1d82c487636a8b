# SPDX-License-Identifier: MIT
"""Filling the image of a real surface: shading apart, plain reflectance recognised, then sampled as ever."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.engine.passes import Progress
from texture.engine.plain import is_plain
from texture.pipeline import fill
from texture.result import Synthesis
from texture.sampling.arguments import (
    EngineName,
    SearchName,
    check_image,
    check_known,
    check_mask,
    check_sample_mask,
    check_time_budget,
    check_wrap,
)
from texture.sampling.front import OrderName
from texture.sampling.randomness import draw_key
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, Pixels, quantise
from texture.surface.shading import Shading, fit_shading
from texture.surface.tiling import MOST_PIXELS, SAMPLE_SIDE, Piece, densest_block, fill_tiles


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFill:
    """A filled image of a surface.

    Attributes
    ----------
    image : array, shape (h, w) or (h, w, c)
        Of the input's dtype; known pixels unchanged, filled ones reflectance times gain.
    synthesis : Synthesis
        The fill of the reflectance (float32, shape (h, w, c), 0..1): where each pixel came from, and how well
        it agrees.
    shading : Shading
        What was separated, for each channel but alpha: light differs in colour, too.
    is_plain : bool
        Whether the surface has one colour, and was filled by its mean and noise.
    """

    image: Pixels
    synthesis: Synthesis
    shading: Shading
    is_plain: bool

    def __post_init__(self) -> None:
        image = np.array(self.image)
        image.flags.writeable = False
        object.__setattr__(self, "image", image)

    def _repr_html_(self) -> str:
        """What a notebook shows: the image, and where its pixels came from."""
        return self.synthesis.to_html(self.image)


def fill_surface(
    image: ArrayLike,
    mask: ArrayLike,
    *,
    window: int | None = None,
    order: OrderName = "window",
    wrap: tuple[bool, bool] = (False, False),
    sample_mask: ArrayLike | None = None,
    known: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
    engine: EngineName = "numba",
    n_threads: int | None = None,
    progress: Progress | None = None,
    time_budget_s: float | None = None,
    search: SearchName = "exact",
) -> SurfaceFill:
    """Fill the masked pixels of a surface's image: what is matched and copied is its reflectance.

    Parameters as in `texture.fill`. Channels are grey, grey with alpha, RGB, or RGB with alpha; alpha has no
    shading. An image of more than 512 x 512 pixels is filled tile by tile (`texture.surface.tiling`), within
    memory of some 60 bytes a pixel.

    Raises
    ------
    ValueError
        As `texture.fill`.

    Examples
    --------
    A lamp's light over stripes comes back with the stripes:

    >>> stripes = np.tile(np.repeat([0.3, 0.6], 4), (40, 5)) * np.linspace(0.7, 1.3, 40)
    >>> mask = np.zeros(stripes.shape, bool)
    >>> mask[12:26, 12:26] = True
    >>> filled = fill_surface(np.where(mask, np.nan, stripes), mask, window=11, rng=0)
    >>> filled.is_plain, bool(np.abs(filled.image - stripes).max() < 0.02)
    (False, True)
    """
    pixels = check_image(image)
    hole = check_mask(mask, pixels.shape[:2])
    context = check_known(known, hole)
    usable = check_sample_mask(sample_mask, context, is_needed=bool(hole.any()))
    closes, budget = check_wrap(wrap), check_time_budget(time_budget_s)
    values = _read(pixels, context)
    n_colours = values.shape[2] if values.shape[2] in (1, 3) else values.shape[2] - 1
    shading = fit_shading(values[..., :n_colours], context, closes)
    values[..., :n_colours] /= shading.gain
    brightest = max(1.0, float(values.max()))
    values /= brightest
    block = np.ix_(*densest_block(usable, SAMPLE_SIDE))
    plain = bool(usable.any()) and is_plain(quantise(values[block], context[block]), usable[block])
    key = draw_key(np.random.default_rng(rng))

    def fill_piece(piece: Piece, side: int | None, seconds: float | None, tell: Progress | None) -> Synthesis:
        return fill(
            piece.image,
            piece.hole,
            window=side,
            order=order,
            wrap=closes if piece.number < 0 else (False, False),
            sample_mask=piece.usable,
            known=piece.known,
            rng=np.random.default_rng([key, piece.number + 1]),
            engine=engine,
            n_threads=n_threads,
            progress=tell,
            time_budget_s=seconds,
            plain=plain,
            search=search,
        )

    whole = Piece(values, hole, context, usable, -1)
    if hole.size <= MOST_PIXELS:
        made = fill_piece(whole, window, budget, progress)
    else:
        made = fill_tiles(
            whole, fill_piece, wrap=closes, window=window, progress=progress, time_budget_s=budget
        )
    lit = made.image * np.float32(brightest)
    lit[..., :n_colours] *= shading.gain
    return SurfaceFill(_put_back(pixels, lit, hole & (made.source_rows >= 0)), made, shading, plain)


def _read(pixels: Pixels, known: BoolArray) -> NDArray[np.float32]:
    """Return the image as floats 0..1 of shape (h, w, c), 0 where nothing is known."""
    if pixels.dtype != np.uint8:
        quantise(pixels, known)  # refuses what is not finite or out of range
    scale = HIGHEST_LEVEL if pixels.dtype == np.uint8 else 1
    values = pixels.reshape(*known.shape, -1).astype(np.float32) / np.float32(scale)
    return np.asarray(np.clip(np.where(known[..., None], values, 0), 0, 1), np.float32)


def _put_back(pixels: Pixels, lit: NDArray[np.float32], filled: BoolArray) -> Pixels:
    """Return the image with its filled pixels replaced, in its own type."""
    values = np.clip(lit[filled], 0, 1)
    values = np.rint(values * HIGHEST_LEVEL) if pixels.dtype == np.uint8 else values
    result = pixels.copy()
    result[filled] = values.reshape(-1, *pixels.shape[2:]).astype(pixels.dtype)
    return result
