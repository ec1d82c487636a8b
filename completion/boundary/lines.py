# SPDX-License-Identifier: MIT
"""Lines: the line that most boundary pixels agree with, in runs, found by voting, in compiled loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled, inlined, sort_order

MIN_POINTS = 8
"""Points of a run: fewer say nothing about a direction."""
GAP = 3.5
"""Steps between pixels that a run may lack."""
SLACK = (0.6, 0.15)
"""How far a point may lie from a curve, of its step across it and of its whole step: half, and some noise."""
_N_DIRECTIONS = 180
_MOST_VOTES = 40
_LEAST_LENGTH = 3.0  # steps of a run
_REFITS = 2  # of a line, with the weights that it gives itself


def best_line(uv: FloatArray, step: FloatArray, left: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the line that most of the points `left` (n,) agree with, in runs, and those points (n,).

    Points and steps `uv` and `step` are (n, 2). A line is (4,): a place on it and its unit direction. Without
    one, no point is marked.
    """
    line, vote = np.zeros(4), left.copy()
    members = np.zeros(len(left), np.bool_)
    for _ in range(_MOST_VOTES):
        if np.count_nonzero(vote) < MIN_POINTS:
            break
        line, width = _voted(uv, step, vote)
        for slack in (2.0 * width, width, 0.0, 0.0):
            chosen = near_line(line, uv, step, slack) & left
            if np.count_nonzero(chosen) < MIN_POINTS:
                break
            line = line_through(uv, step, chosen)
        members = in_runs(line, uv, step, near_line(line, uv, step, 0.0) & left)
        if members.any():
            break
        vote &= ~near_line(line, uv, step, width)
    return line, members


@compiled
def near_line(line: FloatArray, uv: FloatArray, step: FloatArray, least: float) -> BoolArray:
    """Which points (n, 2) lie on a line (4,) as far as their steps (n, 2) tell, or within `least` metres."""
    near = np.empty(len(uv), np.bool_)
    for i in range(len(uv)):
        across = abs(line[2] * (uv[i, 1] - line[1]) - line[3] * (uv[i, 0] - line[0]))
        near[i] = across <= max(_slack(line, step[i, 0], step[i, 1]), least)
    return near


@compiled
def line_through(uv: FloatArray, step: FloatArray, chosen: BoolArray) -> FloatArray:
    """The line (4,) by least squares through the chosen (n,) of points (n, 2).

    They are weighted by what a pixel's step (n, 2) says about them.
    """
    line = np.zeros(4)
    for refit in range(1 + _REFITS):
        total, u, v = 0.0, 0.0, 0.0
        for i in range(len(uv)):
            if chosen[i]:
                weight = 1 / _slack(line, step[i, 0], step[i, 1]) ** 2 if refit else 1.0
                total, u, v = total + weight, u + weight * uv[i, 0], v + weight * uv[i, 1]
        u, v = u / total, v / total
        moment = np.zeros((2, 2))
        for i in range(len(uv)):
            if chosen[i]:
                weight = 1 / _slack(line, step[i, 0], step[i, 1]) ** 2 if refit else 1.0
                right, up = uv[i, 0] - u, uv[i, 1] - v
                moment[0, 0] += weight * right * right
                moment[1, 0] += weight * right * up
                moment[1, 1] += weight * up * up
        moment[0, 1] = moment[1, 0]
        vectors = np.linalg.eigh(moment)[1]
        line[0], line[1], line[2], line[3] = u, v, vectors[0, 1], vectors[1, 1]
    return line


@compiled
def in_runs(line: FloatArray, uv: FloatArray, step: FloatArray, members: BoolArray) -> BoolArray:
    """Which members (n,) stand in a run along a line (4,) of enough points, over three steps long."""
    index = _marked(members)
    n, kept = len(index), np.zeros(len(members), np.bool_)
    along, size = np.empty(n), np.empty(n)
    for k in range(n):
        i = index[k]
        along[k] = (uv[i, 0] - line[0]) * line[2] + (uv[i, 1] - line[1]) * line[3]
        size[k] = np.sqrt(step[i, 0] ** 2 + step[i, 1] ** 2)
    order = np.empty(n, np.int64)
    sort_order(along, order, np.empty(n, np.int64))
    first = 0
    for k in range(1, n + 1):
        if k < n:
            gap = GAP * max(size[order[k]], size[order[k - 1]])
            if along[order[k]] - along[order[k - 1]] <= gap:
                continue
        if k - first >= MIN_POINTS:
            sizes = np.empty(k - first)
            for at in range(first, k):
                sizes[at - first] = size[order[at]]
            if along[order[k - 1]] - along[order[first]] > _LEAST_LENGTH * _median(sizes):
                for at in range(first, k):
                    kept[index[order[at]]] = True
        first = k
    return kept


@inlined
def _marked(members: BoolArray) -> NDArray[np.int64]:
    """The indices (k,) of those that are marked."""
    index, n = np.empty(len(members), np.int64), 0
    for i in range(len(members)):
        if members[i]:
            index[n] = i
            n += 1
    return index[:n]


@inlined
def _median(values: FloatArray) -> float:
    """The median of numbers (n,)."""
    n, order = len(values), np.empty(len(values), np.int64)
    sort_order(values, order, np.empty(n, np.int64))
    middle = values[order[n // 2]]
    return float(middle if n % 2 else (values[order[n // 2 - 1]] + middle) / 2)


@inlined
def _slack(line: FloatArray, right: float, up: float) -> float:
    """How far a point with this step may lie from a line (4,)."""
    across = abs(line[2] * up - line[3] * right)
    return float(SLACK[0] * across + SLACK[1] * np.sqrt(right * right + up * up))


@compiled
def _voted(uv: FloatArray, step: FloatArray, vote: BoolArray) -> tuple[FloatArray, float]:
    """The line with the most votes of the points that `vote` (n,) marks, and how wide its slot is.

    Every point (n, 2), with its step (n, 2), votes for an offset in each direction (Duda & Hart 1972).
    """
    index = _marked(vote)
    u, v, size = 0.0, 0.0, np.empty(len(index))
    for k in range(len(index)):
        u, v = u + uv[index[k], 0], v + uv[index[k], 1]
        size[k] = np.sqrt(step[index[k], 0] ** 2 + step[index[k], 1] ** 2)
    u, v, width = u / len(index), v / len(index), _median(size)
    right, up = np.empty(len(index)), np.empty(len(index))
    for k in range(len(index)):
        right[k], up[k] = uv[index[k], 0] - u, uv[index[k], 1] - v
    offset, low, high = np.empty((_N_DIRECTIONS, len(index))), np.inf, -np.inf
    for turn in range(_N_DIRECTIONS):
        angle = turn * np.pi / _N_DIRECTIONS
        sine, cosine = np.sin(angle), np.cos(angle)
        for k in range(len(index)):
            offset[turn, k] = cosine * up[k] - sine * right[k]
            low, high = min(low, offset[turn, k]), max(high, offset[turn, k])
    n_slots = int(np.rint((high - low) / width)) + 2
    most, best, place = -1, 0, 0
    count: NDArray[np.int64] = np.zeros(n_slots + 1, np.int64)
    for turn in range(_N_DIRECTIONS):
        count[:] = 0
        for k in range(len(index)):
            count[int(np.rint((offset[turn, k] - low) / width))] += 1
        for slot in range(n_slots):  # neighbouring slots together: a line may lie on their border
            if count[slot] + count[slot + 1] > most:
                most, best, place = count[slot] + count[slot + 1], turn, slot
    angle = best * np.pi / _N_DIRECTIONS
    sine, cosine, middle = np.sin(angle), np.cos(angle), low + (place + 0.5) * width
    line = np.empty(4)
    line[0], line[1], line[2], line[3] = u - middle * sine, v + middle * cosine, cosine, sine
    return line, width
