# SPDX-License-Identifier: MIT
"""Labels of drawings: texts beside dots and on places, none on another, with lines where they stand apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from scenes.checks import ArrayValue, FloatArray, IntArray

_AROUND = np.array(
    [[1, 1], [-1, 1], [1, -1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=np.float64
)  # the best known first (Christensen, Marks & Shieber 1995)
_FARTHER = 0.02  # what a place farther down that list costs, where all of a text costs 1
_SWEEPS = 3


def beside(points: FloatArray, sizes: FloatArray, gap: float, taken: FloatArray) -> FloatArray:
    """Return the middles (n, 2) of texts of `sizes` (n, 2) beside `points` (n, 2).

    Each takes the one of eight places around its point, `gap` away from it, where it covers least of the
    rectangles `taken` (k, 2, 2), lower and upper corners, and of the other texts. All in one unit.
    """
    offsets = _AROUND[None] * (sizes[:, None] / 2 + gap * np.sqrt(0.5))
    places, fixed = points[:, None] + offsets, taken.reshape(-1, 2, 2)
    texts = np.full((len(points), 2, 2), np.nan)
    for _ in range(_SWEEPS):
        for number in range(len(points)):
            texts[number] = np.nan
            known = np.concatenate([fixed, texts[~np.isnan(texts[:, 0, 0])]])
            mine = boxes(places[number], np.broadcast_to(sizes[number], places[number].shape))
            cost = _overlap_shares(mine, known).sum(axis=1) + _FARTHER * np.arange(len(mine))
            texts[number] = mine[int(np.argmin(cost))]
    return np.asarray(texts.mean(axis=1))


def boxes(middles: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return rectangles (n, 2, 2), lower and upper corners, by their middles and sizes (n, 2)."""
    return np.stack([middles - sizes / 2, middles + sizes / 2], axis=1)


def _overlap_shares(mine: FloatArray, known: FloatArray) -> FloatArray:
    """Common area (m, k) of rectangles (m, 2, 2) and known ones (k, 2, 2), in shares of the smaller."""
    low = np.maximum(mine[:, None, 0], known[None, :, 0])
    high = np.minimum(mine[:, None, 1], known[None, :, 1])
    common = np.maximum(high - low, 0.0).prod(axis=2)
    area, other = ((extents[:, 1] - extents[:, 0]).prod(axis=1) for extents in (mine, known))
    return np.asarray(common / np.minimum(area[:, None], other[None]))


_RINGS = (0.0, 0.4, 0.8, 1.5, 2.5, 3.5, 5.0)  # heights of a line by which a text may stand off
_RING_COST = 0.12  # of each
_SPOKES = np.radians(np.arange(0, 360, 22.5))
_GAP_PT, _CLEAR_PT = 0.8, 2.5  # between a dot and its text, and between two texts
_APART_PT = 3.0  # from here on a line leads to a text
_INK_COST, _INK_COST_ON_PLACE = 1.5, 2.5  # of lines under all of a text, beside a dot or on its place
_CELL_PT = 2.0  # of the raster of lines that texts keep clear of
_STEP_PT = 1.0
_MOST_STEPS = 20_000  # along a line
_WIDE, _HIGH = 0.7, 1.2  # of a letter and a line, in units of the font's size


@dataclass(frozen=True, slots=True, eq=False)
class Label(ArrayValue):
    """A text at a place (2,) of axes: beside a dot that is `dot_pt` points across, or on the place."""

    text: str
    place: FloatArray
    colour: str
    font_pt: float
    dot_pt: float | None = None
    is_bold: bool = False
    ground: str | None = None

    @property
    def size_pt(self) -> FloatArray:
        """About how wide and how high (2,) it is, points."""
        lines = self.text.split("\n")
        return self.font_pt * np.array([_WIDE * max(map(len, lines)), _HIGH * len(lines)])


def write_labels(axes: Axes, labels: Sequence[Label], lines: Sequence[FloatArray] = ()) -> int:
    """Write texts where they cover neither each other nor dots, and lines as little as may be.

    A text that finds no such place is left out. The limits of the axes must stand.

    Parameters
    ----------
    axes : Axes
        What to write on.
    labels : sequence of Label
        The texts, the most important first; those with a dot keep others off it.
    lines : sequence of (k, 2) float
        Walls and ways, which texts avoid where others places are near.

    Returns
    -------
    int
        How many texts were left out.
    """
    if not labels:
        return 0
    figure: Any = axes.figure
    figure.draw_without_rendering()  # settles the layout: how large a metre is
    point = 72.0 / figure.dpi
    to_pt, to_data = axes.transData, axes.transData.inverted()
    at = np.asarray(to_pt.transform([label.place for label in labels])) * point
    frame = np.asarray(axes.get_window_extent().get_points()) * point
    ink = _Ink.of([np.asarray(to_pt.transform(line)) * point for line in lines if len(line)], frame)
    middles = place_texts(at, labels, ink, frame)
    sizes = np.array([label.size_pt for label in labels])
    for label, here, middle, size in zip(labels, at, middles, sizes, strict=True):
        if np.isnan(middle).any():
            continue
        end = np.clip(here, middle - size / 2, middle + size / 2)
        if np.linalg.norm(end - here) > _APART_PT + (label.dot_pt or 0.0) / 2:
            way = to_data.transform(np.stack([here, end]) / point)
            axes.plot(*way.T, color=label.colour, linewidth=0.5, alpha=0.8, zorder=3.5)
            if label.dot_pt is None:
                axes.plot(*way[0], ".", color=label.colour, markersize=2.5, zorder=3.5)
        x, y = to_data.transform(middle / point)
        text = axes.text(
            x, y, label.text, ha="center", va="center", fontsize=label.font_pt, color=label.colour,
            fontweight="bold" if label.is_bold else "normal", zorder=6 if label.dot_pt else 5.5,
            bbox=None if label.ground is None else {"facecolor": label.ground, "edgecolor": "none",
                                                    "alpha": 0.88, "pad": 0.6},
        )  # fmt: skip
        text.set_in_layout(False)
    return int(np.isnan(middles[:, 0]).sum())


def place_texts(
    points: FloatArray, labels: Sequence[Label], ink: _Ink | None, frame: FloatArray
) -> FloatArray:
    """Return the middles (n, 2) of texts at `points` (n, 2) within `frame` (2, 2), NaN for those left out."""
    sizes = np.array([label.size_pt for label in labels]).reshape(-1, 2)
    dotted = [k for k, label in enumerate(labels) if label.dot_pt is not None]
    across = np.array([[labels[k].dot_pt] * 2 for k in dotted], dtype=np.float64).reshape(-1, 2)
    dots = boxes(points[dotted], across)
    able = [_able(point, label, ink, frame) for point, label in zip(points, labels, strict=True)]
    texts = np.full((len(labels), 2, 2), np.nan)
    for _ in range(_SWEEPS):
        for number, (middles, costs) in enumerate(able):
            texts[number] = np.nan
            others = texts[~np.isnan(texts[:, 0, 0])] + np.array([[-_CLEAR_PT], [_CLEAR_PT]])
            known = np.concatenate([dots, others])
            mine = boxes(middles, np.broadcast_to(sizes[number], middles.shape))
            free = np.where(_overlap_shares(mine, known).max(axis=1, initial=0.0) > 0, np.inf, costs)
            if len(free) and np.isfinite(free.min()):
                texts[number] = mine[int(np.argmin(free))]
    return np.asarray(texts.mean(axis=1))


def _able(
    point: FloatArray, label: Label, ink: _Ink | None, frame: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Places (m, 2) at which a text may stand, within the frame, and what each costs (m,)."""
    half, line = label.size_pt / 2, _HIGH * label.font_pt
    spokes = np.column_stack([np.cos(_SPOKES), np.sin(_SPOKES)])
    spokes = np.concatenate([_AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True), spokes[1::2]])
    gap, offsets, costs = 0.0, [], []
    if label.dot_pt is None:
        offsets, costs = [np.zeros((1, 2)), half * _AROUND], [np.zeros(1), np.full(8, _RING_COST)]
    else:
        gap = label.dot_pt / 2 + _GAP_PT
    reach = half * np.clip(spokes * np.sqrt(2.0), -1.0, 1.0)
    for number, ring in enumerate(_RINGS):
        offsets.append(reach + (gap + ring * line) * spokes)
        first = 0.0 if label.dot_pt is not None else 2 * _RING_COST
        costs.append(first + number * _RING_COST + _FARTHER * np.arange(len(spokes)) / (number + 1))
    middles, cost = point + np.concatenate(offsets), np.concatenate(costs)
    mine = boxes(middles, np.broadcast_to(2 * half, middles.shape))
    inside = ((mine[:, 0] >= frame[0]) & (mine[:, 1] <= frame[1])).all(axis=1)
    if ink is not None:
        cost = cost + (_INK_COST_ON_PLACE if label.dot_pt is None else _INK_COST) * ink.shares(mine)
    return middles[inside], cost[inside]


@dataclass(frozen=True, slots=True, eq=False)
class _Ink:
    """Where lines lie: summed area table (w + 1, h + 1) of cells that one passes, and their lower corner."""

    summed: IntArray
    low: FloatArray

    @classmethod
    def of(cls, lines: Sequence[FloatArray], frame: FloatArray) -> _Ink:
        """Draw lines (k, 2), points, within a frame (2, 2)."""
        shape = np.maximum(np.ceil((frame[1] - frame[0]) / _CELL_PT).astype(np.int64), 1)
        filled = np.zeros(tuple(shape.tolist()), np.int64)
        pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        start, end = np.moveaxis(np.concatenate([np.zeros((0, 2, 2)), *pieces]), 1, 0)
        steps = np.minimum(np.linalg.norm(end - start, axis=1) / _STEP_PT, _MOST_STEPS).astype(np.int64) + 2
        first = np.repeat(np.cumsum(steps) - steps, steps)
        along = (np.arange(len(first)) - first) / np.repeat(steps - 1, steps)
        places = np.repeat(start, steps, axis=0) + along[:, None] * np.repeat(end - start, steps, axis=0)
        cell = np.floor((places - frame[0]) / _CELL_PT).astype(np.int64)
        cell = cell[((cell >= 0) & (cell < shape)).all(axis=1)]
        filled[cell[:, 0], cell[:, 1]] = 1
        return cls(np.pad(filled.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0))), frame[0])

    def shares(self, rectangles: FloatArray) -> FloatArray:
        """Share (m,) of the cells of rectangles (m, 2, 2) that a line passes."""
        top = np.array(self.summed.shape) - 1
        low = np.clip(np.floor((rectangles[:, 0] - self.low) / _CELL_PT).astype(np.int64), 0, top)
        high = np.clip(np.ceil((rectangles[:, 1] - self.low) / _CELL_PT).astype(np.int64), 0, top)
        (a, b), (c, d) = low.T, high.T
        passed = self.summed[c, d] - self.summed[a, d] - self.summed[c, b] + self.summed[a, b]
        return np.asarray(passed / np.maximum((c - a) * (d - b), 1))
