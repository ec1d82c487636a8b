# SPDX-License-Identifier: MIT
"""Filling the image of a real surface: shading apart, plain reflectance recognised, then sampled as ever."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.arguments import check_image, check_known, check_mask, check_sample_mask, check_wrap
from texture.engine import EngineName
from texture.levels import HIGHEST_LEVEL, Pixels, quantise
from texture.order import OrderName
from texture.passes import Progress
from texture.pipeline import fill
from texture.plain import is_plain
from texture.shading import Shading, fit_shading
from texture.synthesis import Synthesis


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFill:
    """A filled image of a surface.

    Attributes
    ----------
    image : array, shape (h, w) or (h, w, c)
        Of the input's dtype; known pixels unchanged, filled ones reflectance times gain.
    synthesis : Synthesis
        The fill of the reflectance (float, 0..1): where each pixel came from, and how well it agrees.
    shading : Shading
        What was separated.
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
) -> SurfaceFill:
    """Fill the masked pixels of a surface's image: what is matched and copied is its reflectance.

    Parameters as in `texture.fill`. Channels are grey, grey with alpha, RGB, or RGB with alpha; alpha has no
    shading.

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
    quantise(pixels, context)  # refuses what is not finite or out of range
    scale = HIGHEST_LEVEL if pixels.dtype == np.uint8 else 1
    values = pixels.reshape(*hole.shape, -1).astype(np.float64) / scale
    values = np.clip(np.where(context[..., None], values, 0), 0, 1)
    n_colours = values.shape[2] if values.shape[2] in (1, 3) else values.shape[2] - 1
    shading = fit_shading(values[..., :n_colours].mean(axis=2), usable, check_wrap(wrap))
    gain = np.ones(values.shape)
    gain[..., :n_colours] = shading.gain[..., None]
    reflectance = values / gain
    brightest = max(1.0, float(reflectance.max()))
    plain = bool(usable.any()) and is_plain(quantise(reflectance / brightest, context), usable)
    made = fill(
        (reflectance / brightest).astype(np.float32).reshape(pixels.shape),
        hole,
        window=window,
        order=order,
        wrap=wrap,
        sample_mask=usable,
        known=context,
        rng=rng,
        engine=engine,
        n_threads=n_threads,
        progress=progress,
        time_budget_s=time_budget_s,
        plain=plain,
    )
    lit = np.clip(made.image.reshape(gain.shape).astype(np.float64) * gain * brightest, 0, 1)
    return SurfaceFill(_put_back(pixels, lit, hole & (made.source_rows >= 0)), made, shading, plain)


def _put_back(pixels: Pixels, lit: NDArray[np.float64], filled: NDArray[np.bool_]) -> Pixels:
    """Return the image with its filled pixels replaced, in its own type."""
    values = np.rint(lit * HIGHEST_LEVEL) if pixels.dtype == np.uint8 else lit
    result = pixels.copy()
    result[filled] = values.reshape(pixels.shape)[filled].astype(pixels.dtype)
    return result
