# SPDX-License-Identifier: MIT
"""Silence: cells from which nothing came back, and how far that may be trusted to be surface.

Nothing comes back from where the projector does not light, from what is dark, clear or polished, and from
where nothing is: a window pane is a hole without return in a wall. What surrounds such a hole, how wide it
is, and what the surface is like tell which of them it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label
from scenes.checks import BoolArray, FloatArray, IntArray
from texture.engine.compiled import compiled

_PROBABLE = 0.5  # from which on silent cells are part of the rim of others
_STEP = 1.5  # from one width that is told apart to the next
_LEAST_M = 1e-6
_ALL_AROUND = np.ones((3, 3))


ENCLOSED = 0.9
"""Share of a rim that is to be measured or inferred surface: a mouth of a tenth is as wide as its part."""

MOSTLY = 0.5
"""The same for shadows on walls, of which one side may border on what is dark."""

TRUST: FloatArray = np.array([
    [[0.97, 0.2], [0.88, 0.8]],
    [[0.975, 0.45], [0.975, 0.09]],
])  # fmt: skip
"""Probability p that narrow silent cells are surface, and half width w: it is p exp(-(x / w)^2) at width x.

By what brought nothing back, unknown or a shadow of the projector, and by walls, in metres, and other
surfaces, in units of the root of their measured area. The most likely ones on the desks with seeds 1000 to
1047, rounded (`python -m benchmarks.completion.silence --fit`), but for wide holes in walls: whether they are
screens or panes depends on the house, so that they fall off in half the width that is likeliest there.
"""


@dataclass(frozen=True, slots=True, eq=False)
class SilentPart:
    """Connected cells without return, about as wide everywhere."""

    cells: NDArray[np.int64]  # (n,) flat
    half_width_m: float  # radius of the discs that cover it
    enclosed: float  # share of its rim that is measured or inferred surface


def silent_cells(evidence: Evidence, hidden: BoolArray) -> BoolArray:
    """Those of the hidden cells (rows, columns) from which nothing came back."""
    return np.asarray(hidden & np.isin(evidence.labels, (Label.NO_RETURN, Label.UNLIT)), dtype=np.bool_)


def trust(
    grid: ChartGrid,
    evidence: Evidence,
    hidden: BoolArray,
    filled: BoolArray,
    *,
    within: BoolArray,
    is_wall: bool,
) -> FloatArray:
    """Probability (rows, columns) that what brought nothing back is surface, if it goes on there; else 1.

    All (rows, columns): `hidden` cells are where the surface may be, `filled` where it is inferred for other
    reasons, and those not `within` lie beyond what it ends at. Silent cells count where surface is all
    around, to `ENCLOSED`, shadows on walls to `MOSTLY`; what is trusted counts as surface for narrower ones.
    """
    result = np.ones(grid.shape)
    for part, probability in judged_parts(grid, evidence, hidden, filled, within=within, is_wall=is_wall):
        result.ravel()[part.cells] = probability
    return result


def judged_parts(
    grid: ChartGrid,
    evidence: Evidence,
    hidden: BoolArray,
    filled: BoolArray,
    *,
    within: BoolArray,
    is_wall: bool,
) -> Iterator[tuple[SilentPart, float]]:
    """Yield a surface's silent parts and how probably they are surface; (rows, columns) as for `trust`."""
    solid, cell = evidence.observed | filled, float(grid.cell.max())
    unit = 1.0 if is_wall else float(np.sqrt(np.count_nonzero(evidence.observed) * grid.cell_area))
    for why, needed in ((Label.UNLIT, MOSTLY if is_wall else ENCLOSED), (Label.NO_RETURN, ENCLOSED)):
        start, length = TRUST[int(why == Label.UNLIT), int(not is_wall)]
        for part in silent_parts(hidden & (evidence.labels == why), solid, within, cell, wraps=grid.wraps):
            width = part.half_width_m / max(length * unit, _LEAST_M)
            probability = float(start * np.exp(-(width**2))) if part.enclosed >= needed else 0.0
            solid.ravel()[part.cells] = probability >= _PROBABLE
            yield part, probability


def silent_parts(
    silent: BoolArray, solid: BoolArray, within: BoolArray, cell_m: float, *, wraps: bool
) -> Iterator[SilentPart]:
    """Part silent cells by how wide they are there, and look at each part's rim, the widest first.

    Cells (rows, columns) that are `solid` are measured or inferred; parts that the caller adds to them count
    for narrower ones. Those that are not `within` lie beyond what the surface ends at, and say nothing; nor
    do silent cells of narrower parts.
    """
    columns, box = silent.shape[1], _box_around(silent)
    if box is None:
        return
    silent, solid, within = silent[box], solid[box], within[box]
    level = half_widths(silent)
    for one in sorted(set(level[silent].tolist()), reverse=True):
        number, n_parts = ndimage.label(level == one, _ALL_AROUND)
        row, column = np.nonzero(number)
        own = number[row, column]
        good, bad = np.zeros(n_parts + 1), _at_border(number, n_parts, wraps)
        _look_beside(number, row, column, solid, within, level, one, good, bad)
        order = np.argsort(own, kind="stable")
        ends = np.searchsorted(own[order], np.arange(n_parts + 2))
        cells = ((row + box[0].start) * columns + column + box[1].start)[order]
        for part in range(1, n_parts + 1):
            share = float(good[part] / max(good[part] + bad[part], 1.0))
            yield SilentPart(cells[ends[part] : ends[part + 1]], one * cell_m, share)


def _box_around(cells: BoolArray, margin: int = 1) -> tuple[slice, slice] | None:
    """Rows and columns of cells (rows, columns), with a margin where there is one; None without cells."""
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    row, column = (slice(max(some[0] - margin, 0), some[-1] + margin + 1) for some in (rows, columns))
    return row, column


def half_widths(silent: BoolArray) -> FloatArray:
    """Radius in cells (rows, columns) of the largest disc of cells that covers each, by steps; else 0."""
    level = silent.astype(np.float64)
    away = _away_from(np.pad(~silent, 1, constant_values=True))[1:-1, 1:-1]
    radius = _STEP
    while (box := _box_around(core := away >= radius, int(np.ceil(radius)))) is not None:
        level[box][_away_from(core[box]) < radius] = radius
        radius *= _STEP
    return np.where(silent, level, 0.0)


def _away_from(cells: BoolArray) -> NDArray[np.float32]:
    """Distance (rows, columns) to the nearest of some cells, in cells: roots of whole numbers to 1e-7.

    Powers of `_STEP` are no such roots, so that what is nearer than one does not depend on rounding.
    """
    away = cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away, dtype=np.float32)


def _at_border(number: NDArray[np.int32], n_parts: int, wraps: bool) -> FloatArray:
    """How many cells of each part (n_parts + 1,) lie at the grid's border."""
    sides = [number[0], number[-1]] + ([] if wraps else [number[:, 0], number[:, -1]])
    return np.bincount(np.concatenate(sides), minlength=n_parts + 1).astype(np.float64)


@compiled
def _look_beside(
    number: NDArray[np.int32],
    rows: IntArray,
    columns: IntArray,
    solid: BoolArray,
    within: BoolArray,
    level: FloatArray,
    one: float,
    good: FloatArray,
    bad: FloatArray,
) -> None:
    """Count for each part, of cells at rows (n,) and columns (n,), those beside that are surface, and not.

    Silent cells of a `level` below `one`, which narrower parts have, are neither.
    """
    for k in range(len(rows)):
        part = number[rows[k], columns[k]]
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            row, column = rows[k] + down, columns[k] + right
            if not (0 <= row < number.shape[0] and 0 <= column < number.shape[1]):
                continue
            if number[row, column] == part:
                continue
            if solid[row, column]:
                good[part] += 1.0
            elif within[row, column] and not 0.0 < level[row, column] < one:
                bad[part] += 1.0
