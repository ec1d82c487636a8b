# SPDX-License-Identifier: MIT
"""Folds: the stretches of curves along which surfaces that meet share an edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.panels.fold_curve import FoldCurve, fold_curves
from completion.panels.sheet import Sheet
from scenes.checks import BoolArray, FloatArray

_REACH = 2.0  # cells between a surface's outline and a fold that it reaches
_ACROSS = (0.5, 1.0, 1.5, _REACH)  # cells beside a fold at which a surface that reaches it is looked for
_FARTHER = (3.0, 4.0)  # the same, where nothing was seen to be free between
_BESIDE = 3.0  # cells beside a fold at which a surface goes on
_BRIDGED = 4.0  # cells of a fold along which only one of the two is there
_LEAST = 3.0  # cells of a fold
_SMOOTH = 15  # samples over which a side is decided
_LEAST_CHANGE = 5.0  # cells along which a surface goes on, or ends, otherwise than before


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """An edge that two surfaces share.

    Attributes
    ----------
    first, second : int
        Numbers of the surfaces, from 1.
    curve : FoldCurve
        Where they meet, working frame.
    number : int
        Of the curve: all folds along one curve have the same.
    start, end : float
        Parameters of the curve, metres.
    sides : (2, 2) bool
        Whether the first and the second surface go on to the left and the right of it, in their own charts
        seen along the curve.
    cell_m : float
        Side of the larger cell of the two, metres.
    """

    first: int
    second: int
    curve: FoldCurve
    number: int
    start: float
    end: float
    sides: BoolArray
    cell_m: float

    @property
    def goes_on(self) -> tuple[int, ...]:
        """Numbers of those of its surfaces that go on beyond it, as a floor does under a partition."""
        both = zip((self.first, self.second), self.sides, strict=True)
        return tuple(number for number, sides in both if sides.all())

    def stations(self) -> FloatArray:
        """Parameters (n,) from start to end between which it is straight enough."""
        return self.curve.stations(self.start, self.end)


def find_folds(sheets: Sequence[Sheet]) -> list[Fold]:
    """Return the folds of all pairs of surfaces that both reach the curve in which they meet.

    A surface reaches a place of the curve where its outline is within two cells of it, or four where nothing
    is known to be free between. Gaps of four cells are
    bridged; a fold is three cells long at least. It is divided where a surface that ended there goes on. A
    fold that is known to no better than a cell is none.
    """
    boxes = [_box(sheet) for sheet in sheets]
    folds: list[Fold] = []
    n_curves = 0
    for i, one in enumerate(sheets):
        for j in range(i + 1, len(sheets)):
            slack = _REACH * max(one.cell_m, sheets[j].cell_m)
            low = np.maximum(boxes[i][0], boxes[j][0]) - slack
            high = np.minimum(boxes[i][1], boxes[j][1]) + slack
            if (low > high).any():
                continue
            box = np.stack([low, high])
            for curve in fold_curves(one.surface, sheets[j].surface):
                folds += _of_curve(one, sheets[j], curve, n_curves, box)
                n_curves += 1
    return folds


def _box(sheet: Sheet) -> tuple[FloatArray, FloatArray]:
    """Low and high corner (3,) of the box around a sheet."""
    row, column = np.argwhere(sheet.patch.provenance >= 0).T.astype(np.float64) + 0.5
    points = sheet.surface.from_uv(sheet.patch.grid.uv_of(row, column))
    return points.min(axis=0) - sheet.cell_m, points.max(axis=0) + sheet.cell_m


def _of_curve(one: Sheet, other: Sheet, curve: FoldCurve, number: int, box: FloatArray) -> list[Fold]:
    """The folds along one curve, in the box (2, 3) that both surfaces reach."""
    cell, step = max(one.cell_m, other.cell_m), min(one.cell_m, other.cell_m) / 2
    low, high = curve.span(box)
    if not low < high:
        return []
    t = np.linspace(low, high, max(2, int(np.ceil((high - low) / step)) + 1))
    step = float(t[1] - t[0])
    near = np.ones(len(t), np.bool_)
    for sheet in (one, other):
        held = np.flatnonzero(near)
        uv, left = sheet.along(curve.at(t))
        near[held] = _reaches(sheet, uv[held], left[held])
    if not near.any():
        return []
    bridged = 2 * int(_BRIDGED * cell / step / 2) + 1
    padded = np.pad(near, bridged)
    near = ndimage.binary_closing(padded, np.ones(bridged))[bridged:-bridged]
    run, n_runs = ndimage.label(near)
    found = []
    for first, last in (np.flatnonzero(run == k)[[0, -1]] for k in range(1, n_runs + 1)):
        if t[last] - t[first] < _LEAST * cell:
            continue
        stretch = t[first : last + 1]
        sides = np.stack([sides_along(sheet, curve, stretch) for sheet in (one, other)], axis=1)
        for begin, stop in _pieces(sides, int(np.ceil(_LEAST_CHANGE * cell / step))):
            start, end = float(stretch[begin]), float(stretch[min(stop, len(stretch) - 1)])
            on = sides[begin:stop].mean(axis=0) > 0.5
            if not on.any(axis=1).all() or _sd_across(one, other, curve, (start + end) / 2) > cell:
                continue
            found.append(
                Fold(
                    first=one.number,
                    second=other.number,
                    curve=curve,
                    number=number,
                    start=start,
                    end=end,
                    sides=on,
                    cell_m=cell,
                )
            )
    return found


def _sd_across(one: Sheet, other: Sheet, curve: FoldCurve, t: float) -> float:
    """Standard deviation across a fold at a parameter, metres, but for what moves both surfaces together.

    sqrt(s1^2 + s2^2 + 2 s1 s2 |cos D|) / sin D, with D the angle between the surfaces.
    """
    place = curve.at(np.array([t]))
    first, second = (float(sheet.patch.source.fit.standard_deviation(place)[0]) for sheet in (one, other))
    cosine = abs(float(one.surface.normal(place)[0] @ other.surface.normal(place)[0]))
    sine = float(np.sqrt(max(1 - cosine**2, 1e-12)))
    return float(np.sqrt(first**2 + second**2 + 2 * first * second * cosine)) / sine


def _reaches(sheet: Sheet, uv: FloatArray, left: FloatArray) -> BoolArray:
    """Whether a surface is within two cells (n,) of places (n, 2) of a curve, straight across it.

    Within four where no beam went through between: a surface that is seen obliquely has few pixels there.
    """
    found = sheet.is_within(uv, 0.0)
    for beside in (*_ACROSS, *_FARTHER):
        for sign in (1.0, -1.0):
            held = np.flatnonzero(~found)
            step = sign * sheet.cell_m * left[held]
            there = sheet.is_within(uv[held] + beside * step, 0.0)
            if beside in _FARTHER:
                between = (uv[held] + k * step for k in np.arange(beside))
                there &= ~np.logical_or.reduce([sheet.is_free(place) for place in between])
            found[held] = there
    return found


def sides_along(sheet: Sheet, curve: FoldCurve, t: FloatArray) -> BoolArray:
    """Whether a surface is to the left and the right (n, 2) of a curve at parameters (n,), in its chart.

    It is looked for three cells beside it, nearer where it is on neither side; what a few samples say against
    their neighbours does not count.
    """
    uv, left = sheet.along(curve.at(t))
    result = np.zeros((len(t), 2), np.bool_)
    for beside in (_BESIDE, _FARTHER[-1] + 0.5, *_ACROSS[::-1]):
        open_ = np.flatnonzero(~result.any(axis=1))
        for column, sign in enumerate((1.0, -1.0)):
            place = uv[open_] + sign * beside * sheet.cell_m * left[open_]
            result[open_, column] = sheet.is_within(place, 0.0)
    width = min(_SMOOTH, len(t))
    share = ndimage.uniform_filter1d(result.astype(np.float64), width, axis=0, mode="nearest")
    return np.asarray(share > 0.5, dtype=np.bool_)


def _pieces(sides: BoolArray, least: int) -> list[tuple[int, int]]:
    """First sample of each piece in which the sides (n, 2, 2) are the same, and that of the next one.

    Pieces of fewer than `least` samples join what comes before.
    """
    code: NDArray[np.int64] = sides.reshape(len(sides), -1) @ (1 << np.arange(sides[0].size))
    starts = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
    kept = [0]
    for begin, stop in pairwise(starts[1:]):
        if stop - begin >= least and code[begin] != code[kept[-1]]:
            if begin - kept[-1] < least and len(kept) == 1:
                kept = [begin]  # a short first piece joins what follows
            else:
                kept.append(begin)
    stops = [*kept[1:], len(code)]
    return [(0 if k == 0 else begin, stop) for k, (begin, stop) in enumerate(zip(kept, stops, strict=True))]
