# SPDX-License-Identifier: MIT
"""The page to read first: fill a hole, or grow a texture, pixel by pixel from a sample.

The method is non-parametric sampling (Efros & Leung 1999). A pixel on the rim of the known region looks at
the known part of the square window around it, finds every place of the sample that looks nearly as similar as
the best one does, and copies the centre of one of them, drawn uniformly. Pass by pass the rim moves inwards
until nothing is unfilled.

References
----------
.. [1] A. A. Efros and T. K. Leung, "Texture synthesis by non-parametric sampling", ICCV 1999, sections 2, 3;
   and the pseudocode on Efros's page of the paper (MaxErrThreshold, ErrThreshold, sigma).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.engine.passes import Progress, Way, can_compile, count_threads, fill_coarse_to_fine, synthesise
from texture.reflectance import fill_plainly
from texture.result import Synthesis, collect
from texture.sampling.arguments import (
    EngineName,
    SearchName,
    check_engine,
    check_image,
    check_known,
    check_mask,
    check_order,
    check_sample_mask,
    check_search,
    check_shape,
    check_time_budget,
    check_window,
    check_wrap,
)
from texture.sampling.canvas import Canvas, OrderName, plant_seed
from texture.sampling.limits import SMALLEST_CHOICE
from texture.sampling.randomness import draw_key
from texture.sampling.sample import BoolArray, IntArray, Sample, quantise
from texture.window import WindowCheck, check_windows


def fill(
    image: ArrayLike,
    mask: ArrayLike,
    *,
    window: int | None = None,
    order: OrderName = "paper",
    wrap: tuple[bool, bool] = (False, False),
    sample_mask: ArrayLike | None = None,
    known: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
    engine: EngineName = "numba",
    n_threads: int | None = None,
    progress: Progress | None = None,
    time_budget_s: float | None = None,
    plain: bool = False,
    search: SearchName = "exact",
) -> Synthesis:
    """Fill the masked pixels of an image with its own texture.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c), c = 1..4
        uint8, or float in 0..1. Floats are compared after rounding to 8 bits, and copied as they are. Only
        known pixels must be finite: the others may hold NaN.
    mask : array, shape (h, w)
        Non-zero where the pixel is to be filled; wins over `known`.
    window : int, optional
        Odd side of the comparison window, 3..99 pixels. None chooses 7..31 by the largest feature of the
        sample and, where it has room for them and numba compiles, by filling holes cut out of it
        (`texture.window`); the result says which.
    order : {"paper", "window"}
        "paper": a pass visits the whole rim, most filled 8-neighbours first. "window": it visits the best
        eighth of the rim, most filled pixels in the whole window first: much more reliable on structured
        texture.
    wrap : (bool, bool)
        Whether rows and columns close on themselves, in the templates and in the sample: the angle of a
        cylinder.
    sample_mask : array, shape (h, w), optional
        Non-zero where the pixel may be copied; default: every known pixel. Known pixels outside it still
        count as surroundings.
    known : array, shape (h, w), optional
        Non-zero where the image holds a value; default: everywhere outside `mask`. Pixels neither known nor
        masked stay untouched and count as unknown.
    rng : numpy.random.Generator, int or None
        Same seed, same bytes, whichever engine and number of threads.
    engine : {"numba", "reference"}
        The compiled scan or the readable reference; the results are identical. Without numba, or with its
        compiler disabled, the reference serves.
    n_threads : int, optional
        Threads of the compiled engine; the result is the same for any. None: one for each processor.
    progress : callable, optional
        Called after each pass with (pixels filled so far, pixels to fill); what it raises ends the synthesis.
    time_budget_s : float, optional
        Seconds after which no further pass begins: then the result is what is filled so far, says so
        (`Synthesis.is_complete`), and depends on the machine.
    plain : bool
        Whether the sample is one colour and noise (`texture.reflectance.is_plain`): random ones of its usual
        pixels fill the hole, and nothing is matched: no window is chosen.

    Returns
    -------
    Synthesis
        The filled image, and where each pixel came from. An empty mask returns the image unchanged.

    Raises
    ------
    ValueError
        When an argument has a wrong shape, type or range, or when there is no pixel to sample from.

    Notes
    -----
    A masked region that touches no known pixel gets one random sample pixel (with those around it) as a seed,
    as if it were grown; `Synthesis.n_seeds` counts them.

    Examples
    --------
    Stripes come back exactly:

    >>> import numpy as np
    >>> from texture import fill
    >>> stripes = np.tile(np.array([20, 20, 220, 220], np.uint8), (16, 4))
    >>> mask = np.zeros(stripes.shape, bool)
    >>> mask[5:11, 5:11] = True
    >>> filled = fill(np.where(mask, 0, stripes).astype(np.uint8), mask, window=5, rng=0, engine="reference")
    >>> bool((filled.image == stripes).all())
    True
    """
    rng = np.random.default_rng(rng)
    pixels = check_image(image)
    hole = check_mask(mask, pixels.shape[:2])
    context = check_known(known, hole)
    usable = check_sample_mask(sample_mask, context, is_needed=bool(hole.any()))
    levels = quantise(pixels, context)
    is_matched = bool(hole.any()) and not plain
    given = SMALLEST_CHOICE if window is None and not is_matched else window
    is_budgeted = check_search(search) == "budget" and can_compile()
    check = _choose_window(given, levels, usable, check_order(order), n_threads, is_checked=not is_budgeted)
    key = draw_key(rng)

    sample = Sample(levels, usable, check_wrap(wrap), radius=check.window // 2)
    canvas = Canvas.around_hole(levels, context, hole, sample.wrap, check.window)
    how = Way(check_engine(engine), order, key, count_threads(n_threads), check_time_budget(time_budget_s))
    if plain:
        fill_plainly(canvas, sample, key)
    filled_by = fill_coarse_to_fine if is_budgeted else synthesise
    tally = filled_by(canvas, sample, how, progress)
    return collect(canvas, sample, pixels=pixels, background=pixels, tally=tally, check=check)


def grow(
    sample: ArrayLike,
    shape: tuple[int, int],
    *,
    window: int | None = None,
    order: OrderName = "paper",
    wrap: tuple[bool, bool] = (False, False),
    sample_mask: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
    engine: EngineName = "numba",
    n_threads: int | None = None,
    progress: Progress | None = None,
    time_budget_s: float | None = None,
) -> Synthesis:
    """Grow a texture of any size from a sample, starting at a random 3 x 3 seed in the centre.

    Parameters
    ----------
    sample : array, shape (h, w) or (h, w, c), c = 1..4
        uint8, or float in 0..1, as the image of `fill`.
    shape : (int, int)
        Rows and columns of the texture to grow.
    window, order, rng, engine, n_threads, progress, time_budget_s
        As in `fill`.
    wrap : (bool, bool)
        Whether rows and columns of the *grown* texture close on themselves, so that it tiles. The sample is
        never wrapped: a piece cut out of an image does not close.
    sample_mask : array, shape (h, w), optional
        Non-zero where the sample may be copied; default: everywhere.

    Returns
    -------
    Synthesis
        An image of `shape`; its provenance map indexes `sample`.

    Raises
    ------
    ValueError
        When an argument has a wrong shape, type or range, or when there is no pixel to sample from.

    Examples
    --------
    >>> import numpy as np
    >>> from texture import grow
    >>> checks = np.indices((8, 8)).sum(axis=0) % 2 * np.uint8(255)
    >>> grown = grow(checks.astype(np.uint8), (9, 7), window=5, rng=1, engine="reference")
    >>> grown.image.shape, bool((np.diff(grown.image.astype(int), axis=0) != 0).all())
    ((9, 7), True)
    """
    rng = np.random.default_rng(rng)
    pixels, size = check_image(sample, "sample"), check_shape(shape)
    usable = check_sample_mask(sample_mask, np.ones(pixels.shape[:2], dtype=np.bool_))
    levels = quantise(pixels, usable)
    check = _choose_window(window, levels, usable, check_order(order), n_threads)
    key = draw_key(rng)

    source = Sample(levels, usable, wrap=(False, False), radius=check.window // 2)
    canvas = Canvas.empty(size, levels.shape[2], check_wrap(wrap), check.window)
    plant_seed(canvas, source, (size[0] // 2, size[1] // 2), key)
    how = Way(check_engine(engine), order, key, count_threads(n_threads), check_time_budget(time_budget_s))
    tally = synthesise(canvas, source, how, progress)
    background = np.zeros((*size, *pixels.shape[2:]), dtype=pixels.dtype)
    return collect(
        canvas,
        source,
        pixels=pixels,
        background=background,
        tally=tally._replace(n_seeds=tally.n_seeds + 1),
        check=check,
    )


def _choose_window(
    window: int | None,
    levels: IntArray,
    usable: BoolArray,
    order: OrderName,
    n_threads: int | None,
    is_checked: bool = True,
) -> WindowCheck:
    """Return the caller's window, or the one that a self-check, or else the largest feature, chooses."""
    if window is not None:
        return WindowCheck(check_window(window), {})

    def fill_piece(
        image: NDArray[np.uint8], hole: BoolArray, known: BoolArray, side: int
    ) -> NDArray[np.uint8]:
        filled = fill(image, hole, known=known, window=side, order=order, rng=0, n_threads=n_threads)
        return np.asarray(filled.image)

    return check_windows(levels, usable, fill_piece if is_checked and can_compile() else None)
