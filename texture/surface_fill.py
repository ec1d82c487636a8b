# SPDX-License-Identifier: MIT
"""Filling the image of a real surface: shading apart, plain reflectance recognised, then sampled as ever.

A hole too large for memory is filled tile by tile, each from what its neighbours hold by then. A tile sees
the known pixels and the finished tiles around it, as the rim of a hole does, so that nothing shows where
tiles meet. All are sampled from one block, the one of its size that holds most of the sample.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import monotonic
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.engine.passes import Progress
from texture.pipeline import fill
from texture.reflectance import Shading, fit_shading, is_plain
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
from texture.sampling.canvas import OrderName
from texture.sampling.randomness import draw_key
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, IntArray, Pixels, quantise

SIDE = 192  # pixels: of a tile
SAMPLE_SIDE = 256  # of the block that is sampled
MOST_PIXELS = 512 * 512  # of an image that is filled in one piece
MARGIN = 49  # the largest window's reach

Block: TypeAlias = tuple[IntArray, IntArray]


class Tile(NamedTuple):
    """A tile with its surroundings.

    Attributes
    ----------
    block : Block
        The image's rows and columns, a margin around the tile included; some twice where an axis closes.
    inner : array, shape (rows, columns), bool
        Which of the block's pixels are the tile's.
    """

    block: Block
    inner: BoolArray


class TilePiece(NamedTuple):
    """What one tile is filled from: the tile with its surroundings, a gap, and the sampled block beside it.

    Attributes
    ----------
    image : array, shape (h, w, c)
        Pixels, meaningless where not known.
    hole, known, usable : arrays, shape (h, w), bool
        What to fill, what holds a value, and what may be copied: pixels of the sampled block alone.
    number : int
        Of the tile, in the order in which they are filled.
    """

    image: Pixels
    hole: BoolArray
    known: BoolArray
    usable: BoolArray
    number: int


FillPiece: TypeAlias = Callable[[TilePiece, int | None, float | None, Progress | None], Synthesis]


def fill_tiles(
    whole: TilePiece,
    fill_piece: FillPiece,
    *,
    wrap: tuple[bool, bool],
    window: int | None,
    progress: Progress | None = None,
    time_budget_s: float | None = None,
) -> Synthesis:
    """Fill a large hole; memory beyond the arrays given and returned does not grow with it.

    Parameters
    ----------
    whole : Piece
        The image, shape (h, w, c), and what of it to fill, is known, and may be copied.
    fill_piece : callable
        Fills a `TilePiece` with a window and a time budget, in seconds, and tells its progress.
    wrap : (bool, bool)
        Whether rows and columns close on themselves.
    window : int, optional
        Of the comparison; None: the one that the first tile chooses.
    progress, time_budget_s
        As in `texture.fill`.
    """
    hole, known, usable = whole.hole, whole.known, whole.usable
    image, done = whole.image.copy(), known.copy()
    places = np.indices(hole.shape, dtype=np.int32)
    rows, columns = (np.where(known, index, -1).astype(np.int32) for index in places)
    error, confidence = np.zeros(hole.shape, np.float32), known.astype(np.float32)
    sampled = densest_block(usable, SAMPLE_SIDE)
    n_to_fill, deadline = int(np.count_nonzero(hole)), _deadline(time_budget_s)
    totals, n_before = np.zeros(2, np.int64), 0
    window_distances: dict[int, float] = {}
    for number, tile in enumerate(_in_order(hole, done, wrap)):
        left = deadline - monotonic()
        if number and left <= 0:
            break
        piece = _piece(image, hole, done=done, usable=usable, tile=tile, sampled=sampled, number=number)
        tell = None if progress is None else _onward(progress, n_before, n_to_fill)
        made = fill_piece(piece, window, None if np.isinf(left) else max(left, 1e-3), tell)
        window, window_distances = made.window, window_distances or made.window_distances
        totals += [made.n_relaxed, made.n_seeds]

        filled = piece.hole & (made.source_rows >= 0)
        at_row, at_column = np.nonzero(filled)
        at = tile.block[0][at_row], tile.block[1][at_column]
        rows[at] = sampled[0][made.source_rows[filled]]
        columns[at] = sampled[1][made.source_cols[filled] - (filled.shape[1] - len(sampled[1]))]
        image[at], done[at] = made.image[filled], True
        error[at], confidence[at] = made.error[filled], made.confidence[filled]
        n_before += at_row.size
    return Synthesis(
        image=image,
        source_rows=rows,
        source_cols=columns,
        error=error,
        confidence=confidence,
        n_relaxed=int(totals[0]),
        n_seeds=int(totals[1]),
        window=window or 0,
        window_distances=window_distances,
        is_complete=n_before == n_to_fill,
    )


def densest_block(usable: BoolArray, side: int) -> Block:
    """Return rows and columns of the block with most usable pixels; its side is this or the image's.

    Examples
    --------
    >>> mask = np.zeros((5, 9), bool)
    >>> mask[2:, 6:] = True
    >>> densest_block(mask, 3)
    (array([2, 3, 4]), array([6, 7, 8]))
    """
    height, width = (min(side, size) for size in usable.shape)
    total = np.pad(np.cumsum(np.cumsum(usable, axis=0, dtype=np.int32), axis=1), ((1, 0), (1, 0)))
    inside = (
        total[height:, width:] - total[:-height, width:] - total[height:, :-width] + total[:-height, :-width]
    )
    top, left = np.unravel_index(int(inside.argmax()), inside.shape)
    return np.arange(top, top + height), np.arange(left, left + width)


def _in_order(hole: BoolArray, done: BoolArray, wrap: tuple[bool, bool]) -> Iterator[Tile]:
    """Yield the tiles that hold part of the hole, the one around which most is done by then first."""
    waiting: dict[int, Tile] = {}
    for top in range(0, hole.shape[0], SIDE):
        for left in range(0, hole.shape[1], SIDE):
            if hole[top : top + SIDE, left : left + SIDE].any():
                rows, first_row = _reach(top, hole.shape[0], wrap[0])
                columns, first_column = _reach(left, hole.shape[1], wrap[1])
                inner = np.zeros((len(rows), len(columns)), dtype=np.bool_)
                inner[first_row : first_row + SIDE, first_column : first_column + SIDE] = True
                inner[first_row + hole.shape[0] - top :] = False
                inner[:, first_column + hole.shape[1] - left :] = False
                waiting[len(waiting)] = Tile((rows, columns), inner)
    while waiting:
        shares = {key: done[np.ix_(*tile.block)].mean() for key, tile in waiting.items()}
        yield waiting.pop(max(shares, key=lambda key: shares[key]))


def _reach(start: int, size: int, wraps: bool) -> tuple[IntArray, int]:
    """Return the indices of a tile with its margin along an axis, and at which of them the tile starts."""
    reach = np.arange(start - MARGIN, min(start + SIDE, size) + MARGIN)
    if wraps:
        return reach % size, MARGIN
    return reach[(reach >= 0) & (reach < size)], min(start, MARGIN)


def _piece(
    image: Pixels,
    hole: BoolArray,
    done: BoolArray,
    usable: BoolArray,
    tile: Tile,
    sampled: Block,
    number: int,
) -> TilePiece:
    """Return what a tile is filled from."""
    here, there = np.ix_(*tile.block), np.ix_(*sampled)
    (height, width), (sample_height, sample_width) = tile.inner.shape, (len(sampled[0]), len(sampled[1]))
    shape = (max(height, sample_height), width + MARGIN + sample_width)
    left, right = np.s_[:height, :width], np.s_[:sample_height, -sample_width:]
    pixels = np.zeros((*shape, *image.shape[2:]), image.dtype)
    to_fill, known, may_copy = (np.zeros(shape, dtype=np.bool_) for _ in range(3))
    pixels[left], pixels[right] = image[here], image[there]
    to_fill[left] = hole[here] & ~done[here] & tile.inner
    known[left], known[right] = done[here], usable[there]
    may_copy[right] = usable[there]
    return TilePiece(pixels, to_fill, known, may_copy, number)


def _onward(progress: Progress, n_before: int, n_to_fill: int) -> Progress:
    """Return a callback that turns the progress of one tile into that of the whole hole, in pixels."""
    return lambda done, _total: progress(n_before + done, n_to_fill)


def _deadline(time_budget_s: float | None) -> float:
    return np.inf if time_budget_s is None else monotonic() + time_budget_s


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

    def __repr__(self) -> str:
        return f"SurfaceFill({'plain' if self.is_plain else 'textured'}, {self.synthesis!r})"

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
    shading. An image of more than 512 x 512 pixels is filled tile by tile (`texture.surface_fill`), within
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

    def fill_piece(
        piece: TilePiece, side: int | None, seconds: float | None, tell: Progress | None
    ) -> Synthesis:
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

    whole = TilePiece(values, hole, context, usable, -1)
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
