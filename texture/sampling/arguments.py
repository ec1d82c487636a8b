# SPDX-License-Identifier: MIT
"""Arguments checked at the door: each function returns the checked value, or raises with the cure."""

from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from texture.sampling.canvas import OrderName
from texture.sampling.sample import BoolArray, Pixels

EngineName: TypeAlias = Literal["numba", "reference"]
SearchName: TypeAlias = Literal["exact", "budget"]
LARGEST_WINDOW = 99  # keeps every distance below the compiled scan's mark for "not in the sample"


def check_image(image: ArrayLike, name: str = "image") -> Pixels:
    """Return the image of shape (h, w) or (h, w, c), c = 1..4, uint8 or float; raise ValueError otherwise."""
    pixels = np.asarray(image)
    if pixels.ndim not in (2, 3) or 0 in pixels.shape or (pixels.ndim == 3 and pixels.shape[2] > 4):
        raise ValueError(f"{name}: expected shape (h, w) or (h, w, c) with c = 1..4, got {pixels.shape}")
    if pixels.dtype != np.uint8 and not np.issubdtype(pixels.dtype, np.floating):
        raise ValueError(f"{name}: expected uint8, or float in 0..1, got {pixels.dtype}; convert it first")
    return pixels


def check_mask(mask: ArrayLike, shape: tuple[int, ...], name: str = "mask") -> BoolArray:
    """Return a mask of an image's (h, w) as booleans: non-zero is True; raise ValueError for other shapes."""
    checked = np.asarray(mask)
    if checked.shape != shape:
        raise ValueError(f"{name}: expected the image's shape {shape}, got {checked.shape}")
    if checked.dtype.kind == "f" and np.isnan(checked).any():
        n_unclear = np.count_nonzero(np.isnan(checked))
        raise ValueError(f"{name}: {n_unclear} of {checked.size} values are NaN, neither zero nor not")
    return np.asarray(checked != 0, dtype=np.bool_)


def check_known(known: ArrayLike | None, hole: BoolArray) -> BoolArray:
    """Return which pixels (h, w) hold a value: `known` without the hole, or all outside it."""
    return ~hole if known is None else check_mask(known, hole.shape, "known") & ~hole


def check_sample_mask(
    sample_mask: ArrayLike | None, known: BoolArray, *, is_needed: bool = True
) -> BoolArray:
    """Return which pixels (h, w) may be copied: all known ones, or the selected ones, which must be known.

    Raises ValueError: nothing is known or selected though something is needed, or the selection holds unknown
    pixels.
    """
    if is_needed and not known.any():
        raise ValueError(
            f"image: none of the {known.size} pixels is known, so there is nothing to sample from; "
            "leave some pixels out of `mask`, or use `grow` with a sample image"
        )
    usable = known if sample_mask is None else check_mask(sample_mask, known.shape, "sample_mask")
    n_unknown = np.count_nonzero(usable & ~known)
    if n_unknown:
        raise ValueError(
            f"sample_mask: {n_unknown} of its {np.count_nonzero(usable)} pixels hold no known value; "
            "pass `sample_mask & known & ~mask`"
        )
    if is_needed and not usable.any():
        raise ValueError(
            "sample_mask: selects no pixel, so there is nothing to sample from; pass None for all"
        )
    return usable


def check_window(window: int) -> int:
    """Return the window's side, an odd number 3..99."""
    if not isinstance(window, int | np.integer) or window % 2 == 0 or not 3 <= window <= LARGEST_WINDOW:
        raise ValueError(
            f"window: expected an odd whole number 3..{LARGEST_WINDOW} (pixels), got {window!r}; "
            "a window has a centre pixel, and None chooses one"
        )
    return int(window)


def check_wrap(wrap: Iterable[bool]) -> tuple[bool, bool]:
    """Return whether rows and columns close on themselves."""
    flags = tuple(wrap) if isinstance(wrap, Iterable) else (wrap,)
    if len(flags) != 2 or not all(isinstance(flag, bool | np.bool_) for flag in flags):
        raise ValueError(f"wrap: expected two booleans (rows close, columns close), got {wrap!r}")
    return bool(flags[0]), bool(flags[1])


def check_shape(shape: Sequence[int]) -> tuple[int, int]:
    """Return the rows and columns of the texture to grow."""
    sides = tuple(shape) if isinstance(shape, Iterable) else (shape,)
    if len(sides) != 2 or not all(isinstance(side, int | np.integer) and side > 0 for side in sides):
        raise ValueError(f"shape: expected two positive whole numbers (rows, columns), got {shape!r}")
    return int(sides[0]), int(sides[1])


def check_order(order: OrderName) -> OrderName:
    """Return the name of the order in which the rim is visited."""
    if order not in get_args(OrderName):
        raise ValueError(f"order: expected one of {get_args(OrderName)}, got {order!r}")
    return order


def check_engine(engine: EngineName) -> EngineName:
    """Return the engine's name."""
    if engine not in get_args(EngineName):
        raise ValueError(f"engine: expected one of {get_args(EngineName)}, got {engine!r}")
    return engine


def check_search(search: SearchName) -> SearchName:
    """Return how candidates are searched for."""
    if search not in get_args(SearchName):
        raise ValueError(f"search: expected one of {get_args(SearchName)}, got {search!r}")
    return search


def check_time_budget(seconds: float | None) -> float | None:
    """Return the time budget in seconds, more than 0, or None for no end."""
    if seconds is not None and not seconds > 0:
        raise ValueError(f"time_budget_s: expected more than 0 seconds, got {seconds!r}; None is no end")
    return seconds
