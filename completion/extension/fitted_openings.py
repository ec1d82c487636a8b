# SPDX-License-Identifier: MIT
"""Fitted openings: the exact sides of holes that were fitted whole, in what is inferred of a surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from completion.edits.edit import SurfaceEdits, outline_uv
from completion.edits.fitted import FittedOpening
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray

_GOES_ON = 0.95  # probability of surface just past a side that was seen: of openings fitted so, all had it
_RIGHT, _SIDEWAYS = 1, (1, 3)
_INWARDS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])  # of bottom, right, top, left


def lay_openings(
    grid: ChartGrid,
    hidden: BoolArray,
    filled: BoolArray,
    confidence: FloatArray,
    *,
    open_: BoolArray,
    edits: SurfaceEdits,
    least: float,
) -> tuple[BoolArray, FloatArray, SurfaceEdits]:
    """Lay the fitted openings of a surface into what was inferred of it.

    A side that was seen holds behind the occluder too: up to it all is open, past it the surface goes on. One
    that nobody saw goes as far as the hole does without it, but an opening seen over a length s goes on for e
    more with probability s / (s + e) only (Gott 1993), save down to the floor.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    hidden, filled, open_ : (rows, columns) bool
        Cells where the surface may be, unseen; those of them where it is inferred; those that beams passed.
    confidence : (rows, columns) float
        Probability of surface.
    edits : SurfaceEdits
        With the openings.
    least : float
        Probability from which on a cell is filled.

    Returns
    -------
    filled, confidence, edits
        As given, with the openings in place; their outlines as they are laid.
    """
    if not edits.fitted:
        return filled, confidence, edits
    filled, confidence, laid = filled.copy(), confidence.copy(), []
    hole = (hidden & ~filled) | open_
    for one in edits.fitted:
        at, size = _local(grid, one)
        part = _touching(hole, _within(at, np.zeros(2), size))
        low, high = _reaching(one, at, size, part, step=float(grid.cell.max()))
        inside, past = _within(at, low, high), _past_seen(one, at, low, high, step=float(grid.cell.max()))
        surface = np.where(
            part & hidden & past, _GOES_ON, _ended(one, at, size, (low[1], high[1])) * (hidden & ~filled)
        )
        beside = (surface >= least) & (surface > confidence)
        filled[beside], confidence[beside] = True, surface[beside]
        filled[inside & hidden] = False
        confidence[inside & hidden] = np.minimum(confidence[inside & hidden], 1 - _GOES_ON)
        laid.append(_moved(one, low, high, size))
    return filled, confidence, replace(edits, fitted=tuple(laid))


def _local(grid: ChartGrid, one: FittedOpening) -> tuple[FloatArray, FloatArray]:
    """Places of all cells (rows, columns, 2) from the first corner, along the sides, and the size (2,)."""
    corners = outline_uv(grid.surface, one.outline)
    sides = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    size = np.linalg.norm(sides, axis=1)
    return (grid.centres_uv() - corners[0]) @ (sides / size[:, None]).T, size


def _within(at: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    return np.asarray(((at > low) & (at < high)).all(axis=-1))


def _touching(cells: BoolArray, others: BoolArray) -> BoolArray:
    """The parts of some cells (rows, columns) that reach into others."""
    part, _ = ndimage.label(cells)
    numbers = np.unique(part[others & cells])
    return np.asarray(np.isin(part, numbers[numbers > 0]))


def _reaching(
    one: FittedOpening, at: FloatArray, size: FloatArray, hole: BoolArray, *, step: float
) -> tuple[FloatArray, FloatArray]:
    """Corners (2,), (2,) of the opening with unseen sides where the hole ends that it lies in.

    For every cell along such a side, how far the hole goes on; the median of them, as far as it may be.
    """
    low, high = np.zeros(2), size.copy()
    for side in range(4):
        inwards, outwards = one.slack[side]
        if one.seen[side] > 0 or inwards + outwards == 0:
            continue
        axis, sign = int(np.argmax(np.abs(_INWARDS[side]))), -_INWARDS[side].sum()
        edge = (high if sign > 0 else low)[axis]
        out, along = sign * (at[..., axis] - edge), at[..., 1 - axis]
        beside = (along > 0) & (along < size[1 - axis]) & (out > 0)
        column = np.floor(along / step).astype(np.int64)
        ends = np.full(int(np.ceil(size[1 - axis] / step)) + 1, np.inf)
        np.minimum.at(ends, column[beside & ~hole], out[beside & ~hole])
        known = ends[np.isfinite(ends)]
        reach = min(float(np.median(known)) - step / 2, outwards) if len(known) else 0.0
        reach = min(reach, size[axis]) if side in _SIDEWAYS else reach
        (high if sign > 0 else low)[axis] += sign * max(reach, 0.0)
    return low, high


def _ended(one: FittedOpening, at: FloatArray, size: FloatArray, band: tuple[float, float]) -> FloatArray:
    """Probability (rows, columns) that the opening has ended past a side that nobody saw; 0 elsewhere.

    Elsewhere are also places below and above the `band` of it.
    """
    out = np.zeros(at.shape[:2])
    for side in _SIDEWAYS:
        if one.seen[side] > 0:
            continue
        beyond = at[..., 0] - size[0] if side == _RIGHT else -at[..., 0]
        past = (beyond > 0) & (at[..., 1] > band[0]) & (at[..., 1] < band[1])
        out[past] = beyond[past] / (size[0] + beyond[past])
    return out


def _past_seen(
    one: FittedOpening, at: FloatArray, low: FloatArray, high: FloatArray, *, step: float
) -> BoolArray:
    """Cells (rows, columns) past sides that were seen, or are known to two cells, and past no other."""
    beyond = [at[..., 1] < low[1], at[..., 0] > high[0], at[..., 1] > high[1], at[..., 0] < low[0]]
    known = (one.seen > 0) | (one.slack.sum(axis=1) < 2 * step)
    seen = [cells for cells, is_known in zip(beyond, known, strict=True) if is_known]
    unseen = [cells for cells, is_known in zip(beyond, known, strict=True) if not is_known]
    none = np.zeros(at.shape[:2], dtype=np.bool_)
    return np.asarray(np.any([none, *seen], axis=0) & ~np.any([none, *unseen], axis=0))


def _moved(one: FittedOpening, low: FloatArray, high: FloatArray, size: FloatArray) -> FittedOpening:
    """The opening with its sides at these places, and what may still be off of those that nobody saw."""
    first = one.outline[0]
    along = (one.outline[1] - first) / size[0], (one.outline[3] - first) / size[1]
    places: Sequence[tuple[float, float]] = (
        (low[0], low[1]),
        (high[0], low[1]),
        (high[0], high[1]),
        (low[0], high[1]),
    )
    outline = np.stack([first + a * along[0] + b * along[1] for a, b in places])
    shifts = np.array([-low[1], high[0] - size[0], high[1] - size[1], -low[0]])
    slack = np.stack([one.slack[:, 0] + shifts, np.maximum(one.slack[:, 1] - shifts, 0.0)], axis=1)
    return replace(one, outline=outline, slack=slack)
