# SPDX-License-Identifier: MIT
"""Self-check: which window fills holes best that are cut out of the known part, where the truth is known."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from texture.quality import measure_distance
from texture.window import choose_window

WINDOWS = (7, 11, 15, 23)
HOLE, SURROUNDINGS = 32, 112  # pixels: sides of a hole and of the piece that it is cut out of

FillPiece = Callable[[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.bool_], int], NDArray[np.uint8]]


class WindowCheck(NamedTuple):
    """The window that was chosen, and how far its fills and those of the others were from the truth.

    Attributes
    ----------
    window : int
        The best one.
    distances : dict of int to float
        For each window that was tried, the mean sliced Wasserstein distance to what was cut out, in 8-bit
        levels. Empty when no hole can be cut out, or one window alone comes into
        question: then the autocorrelation chose.
    """

    window: int
    distances: dict[int, float]


def check_windows(
    levels: NDArray[np.int64], usable: NDArray[np.bool_], fill_piece: FillPiece | None
) -> WindowCheck:
    """Fill holes of 32 x 32 pixels in up to three pieces of the sample with each window; choose the best.

    Tried are the window that holds the largest regular feature by the autocorrelation
    (`texture.window.choose_window`: a smaller one breaks it, which small holes do not always show) and the
    larger ones of 7, 11, 15, 23.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        The sample.
    fill_piece : callable, optional
        Fills a piece: (image, hole, known, window) to image. None: the autocorrelation chooses.
    """
    smallest = choose_window(levels, usable)
    windows = [smallest, *(window for window in WINDOWS if window > smallest)]
    holes = list_holes(usable) if fill_piece is not None and len(windows) > 1 else []
    if fill_piece is None or not holes:
        return WindowCheck(smallest, {})
    distances = dict.fromkeys(windows, 0.0)
    for row, column in holes:
        top, left = max(0, row - SURROUNDINGS // 2), max(0, column - SURROUNDINGS // 2)
        here = np.s_[top : top + SURROUNDINGS, left : left + SURROUNDINGS]
        image, known = levels[here].astype(np.uint8), usable[here]
        hole = np.zeros(known.shape, dtype=np.bool_)
        hole[row - top : row - top + HOLE, column - left : column - left + HOLE] = True
        for window in windows:
            filled = fill_piece(image, hole, known & ~hole, window)
            distances[window] += measure_distance(filled, image, hole, hole, n_levels=2) / len(holes)
    return WindowCheck(min(distances, key=lambda window: distances[window]), distances)


def list_holes(usable: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """List the upper left corners of up to three holes, apart from each other, with usable pixels around.

    A hole may lie where the square of twice its side around it is wholly usable.
    """
    room, rim = 2 * HOLE, HOLE // 2
    if min(usable.shape) < room:
        return []
    total = np.pad(np.cumsum(np.cumsum(usable, axis=0), axis=1), ((1, 0), (1, 0)))
    inside = total[room:, room:] - total[:-room, room:] - total[room:, :-room] + total[:-room, :-room]
    corners = np.argwhere(inside == room**2)
    chosen: list[NDArray[np.int64]] = []
    for share in (0.0, 1.0, 0.5):  # of those that are left: the first, the last, the middle one
        if not corners.size:
            break
        chosen.append(corners[int(share * (len(corners) - 1))])
        corners = corners[np.abs(corners - chosen[-1]).max(axis=1) >= HOLE]
    return [(int(row) + rim, int(column) + rim) for row, column in chosen]
