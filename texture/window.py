# SPDX-License-Identifier: MIT
"""The window's size when none is named: by the largest feature, and by holes whose truth is known."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from texture.lattice import Lattice, find_lattice, measure_phase_error
from texture.quality import measure_distance
from texture.sampling import limits
from texture.sampling.sample import BoolArray, FloatArray, IntArray

WINDOWS = (11, 15, 23, 31)
HOLE, RIM, SURROUNDINGS = 24, 8, 96  # pixels: sides of a hole, of what is usable around it, of what is filled
SHARES = (0.0, 1.0, 0.5, 0.25, 0.75, 0.5)  # where holes lie among the places that are left
LOOKED_AT = 320  # pixels: side of the part of a sample in which features are looked for

FillPiece = Callable[[NDArray[np.uint8], BoolArray, BoolArray, int], NDArray[np.uint8]]


def choose_window(levels: IntArray, usable: BoolArray) -> int:
    """Choose a window that holds the largest regular feature of a sample.

    Along each axis the feature is as long as the sample's period, if its autocorrelation has a peak above 0.5
    within 23 pixels; otherwise twice the lag at which the autocorrelation falls below 0.2, plus one. An axis
    whose autocorrelation stays above that says nothing; if both do, the sample changes slowly, and they are
    looked for in what is left of it without its means over 47 x 47 pixels. The window is the longer feature,
    made odd and kept within 7..23. (Efros & Leung 1999: the window should be on the scale of
    the largest regular feature.) scikit-image's brick, grass and gravel get about 11, 13 and 15.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        Which pixels belong to the sample.

    Returns
    -------
    int
        Odd, 7..23.

    Examples
    --------
    >>> stripes = np.tile(np.repeat([0, 255], 6), (30, 4))[..., None]
    >>> choose_window(stripes, np.ones(stripes.shape[:2], bool))
    13
    """
    grey = levels.sum(axis=2)  # whole numbers: a constant sample varies by exactly nothing
    centred = np.where(usable, grey - grey[usable].mean(), 0.0) if usable.any() else np.zeros(grey.shape)
    feature = _find_feature(centred, usable)
    if not feature:
        weight = np.maximum(_smooth(usable.astype(np.float64)), 1e-9)
        feature = _find_feature(np.where(usable, centred - _smooth(centred) / weight, 0.0), usable)
    return int(
        np.clip(
            (feature or limits.LARGEST_CHOICE) // 2 * 2 + 1, limits.SMALLEST_CHOICE, limits.LARGEST_CHOICE
        )
    )


def _find_feature(centred: FloatArray, usable: BoolArray) -> int:
    """Return the length of the longer axis's feature; 0 if neither ends."""
    down, across = _autocorrelate(centred.T, usable.T), _autocorrelate(centred, usable)
    return max(_measure_feature(down), _measure_feature(across))


def _smooth(values: FloatArray) -> FloatArray:
    side = 2 * limits.LARGEST_CHOICE + 1
    return np.asarray(scipy.ndimage.uniform_filter(values, side, mode="constant"), dtype=np.float64)


def _autocorrelate(centred: FloatArray, usable: BoolArray) -> FloatArray:
    """Return the autocorrelation along the columns at lags 0, 1, ..., 23 or less; 0 where nothing varies."""
    lags = range(min(limits.LARGEST_CHOICE + 1, centred.shape[1]))
    correlations = np.zeros(len(lags))
    for lag in lags:
        first, second = np.s_[:, : centred.shape[1] - lag], np.s_[:, lag:]
        both = usable[first] & usable[second]
        products = (centred[first] * centred[second])[both]
        scale = np.sqrt((centred[first][both] ** 2).sum() * (centred[second][both] ** 2).sum())
        correlations[lag] = products.sum() / scale if scale > 0 else 0.0
    return correlations


def _measure_feature(correlations: FloatArray) -> int:
    """Return the length in pixels of the feature that an autocorrelation shows; 0 if it never ends."""
    below = np.flatnonzero(correlations < limits.FEATURE_END)
    if not below.size:
        return 0
    inner = np.arange(below[0] + 1, correlations.size - 1)
    is_peak = (correlations[inner] >= correlations[inner - 1]) & (
        correlations[inner] >= correlations[inner + 1]
    )
    peaks = inner[is_peak & (correlations[inner] > limits.FEATURE_RETURN)]
    return int(peaks[0]) if peaks.size else int(2 * below[0] + 1)


class WindowCheck(NamedTuple):
    """The window that was chosen, and how far its fills and those of the others were from the truth.

    Attributes
    ----------
    window : int
        The chosen one.
    distances : dict of int to float
        For each window that was tried, the mean penalty over the holes that it was tried on: the sliced
        Wasserstein distance to what was cut out, in 8-bit levels, times 1 + 5 phase errors where the texture
        has a lattice. Empty when no hole can be cut out, or no window is larger than the first: then the
        largest feature chose.
    """

    window: int
    distances: dict[int, float]


class SampleCut(NamedTuple):
    """A part of the sample (h, w, c) with a hole cut into it; known and hole have the shape (h, w)."""

    image: NDArray[np.uint8]
    known: BoolArray
    hole: BoolArray


def check_windows(levels: IntArray, usable: BoolArray, fill_piece: FillPiece | None) -> WindowCheck:
    """Fill up to six holes cut out of the sample with ever larger windows; choose the smallest good one.

    The first is the window that holds the largest regular feature (`choose_first`): a smaller one breaks it,
    which small holes do not always show. A larger one of 11, 15, 23, 31 takes its place if its penalty is
    lower on every hole, and by a tenth on average: differences on one hole are mostly chance. One that fails
    on a hole is tried on no other.

    Parameters
    ----------
    levels : array, shape (h, w, c), int64
        8-bit levels.
    usable : array, shape (h, w), bool
        The sample.
    fill_piece : callable, optional
        Fills a piece: (image, hole, known, window) to image. None: the largest feature alone chooses.
    """
    near = find_fullest_part(usable)
    lattice = find_lattice(levels[near].astype(np.uint8), usable[near])
    chosen = choose_first(levels[near], usable[near], lattice)
    larger = [window for window in WINDOWS if window > chosen]
    pieces = cut_pieces(levels, usable) if fill_piece is not None and larger else []
    if fill_piece is None or not pieces:
        return WindowCheck(chosen, {})
    lowest = [np.inf] * len(pieces)
    distances: dict[int, float] = {}
    for window in (chosen, *larger):
        penalties: list[float] = []
        for piece, to_beat in zip(pieces, lowest, strict=True):
            filled = fill_piece(piece.image, piece.hole, piece.known, window)
            penalties.append(_penalise(filled, piece, lattice))
            if penalties[-1] >= to_beat:
                break
        else:
            if np.mean(penalties) <= limits.CLEARLY_BETTER * np.mean(lowest):
                chosen, lowest = window, penalties
        distances[window] = float(np.mean(penalties))
    return WindowCheck(chosen, distances)


def choose_first(levels: IntArray, usable: BoolArray, lattice: Lattice) -> int:
    """Return the window for the largest regular feature of levels (h, w, c) that a window can hold.

    That of the autocorrelation (`texture.window.choose_window`); or, if that is larger, the one in
    which a whole period of the lattice weighs, 1.6 times its longest extent, but not more than 31. Periods
    beyond 31 pixels do not count: no window holds them.
    """
    feature = choose_window(levels, usable)
    period = float(np.abs(lattice.periods).max(initial=0))
    if period > WINDOWS[-1]:
        return feature
    return max(feature, min(2 * int(limits.PER_PERIOD * period / 2) + 1, WINDOWS[-1]))


def find_fullest_part(usable: BoolArray) -> tuple[slice, slice]:
    """Return the part of 320 x 320 pixels, or all, that holds most of a sample, to a quarter of its side."""
    best, most = np.s_[0:LOOKED_AT, 0:LOOKED_AT], -1
    for top in range(0, max(1, usable.shape[0] - LOOKED_AT + LOOKED_AT // 4), LOOKED_AT // 4):
        for left in range(0, max(1, usable.shape[1] - LOOKED_AT + LOOKED_AT // 4), LOOKED_AT // 4):
            part = np.s_[top : top + LOOKED_AT, left : left + LOOKED_AT]
            if np.count_nonzero(usable[part]) > most:
                best, most = part, int(np.count_nonzero(usable[part]))
    return best


def cut_pieces(levels: IntArray, usable: BoolArray) -> list[SampleCut]:
    """Cut holes of 24 x 24 pixels into pieces of the sample; none where it is too small."""
    pieces = []
    for row, column in list_holes(usable):
        top, left = (max(0, place - (SURROUNDINGS - HOLE) // 2) for place in (row, column))
        here = np.s_[top : top + SURROUNDINGS, left : left + SURROUNDINGS]
        hole = np.zeros(usable[here].shape, dtype=np.bool_)
        hole[row - top : row - top + HOLE, column - left : column - left + HOLE] = True
        pieces.append(SampleCut(levels[here].astype(np.uint8), usable[here] & ~hole, hole))
    return pieces


def list_holes(usable: BoolArray) -> list[tuple[int, int]]:
    """Return the upper left corners of up to six holes, apart from each other, with 8 usable pixels around.

    `usable` has the shape (h, w) of the sample.
    """
    room = HOLE + 2 * RIM
    if min(usable.shape) < room:
        return []
    total = np.pad(np.cumsum(np.cumsum(usable, axis=0), axis=1), ((1, 0), (1, 0)))
    inside = total[room:, room:] - total[:-room, room:] - total[room:, :-room] + total[:-room, :-room]
    corners = np.argwhere(inside == room**2)
    chosen: list[IntArray] = []
    for share in SHARES:
        if not corners.size:
            break
        chosen.append(corners[int(share * (len(corners) - 1))])
        corners = corners[np.abs(corners - chosen[-1]).max(axis=1) >= HOLE]
    return [(int(row) + RIM, int(column) + RIM) for row, column in chosen]


def _penalise(filled: NDArray[np.uint8], piece: SampleCut, lattice: Lattice) -> float:
    """Return how far a fill is from what was cut out, more if it is out of step."""
    distance = measure_distance(filled, piece.image, piece.hole, piece.hole, n_levels=2)
    phase_error = measure_phase_error(filled, piece.hole, piece.known, lattice)
    return distance * (1 + limits.OUT_OF_STEP_PENALTY * float(np.nan_to_num(phase_error)))
