# SPDX-License-Identifier: MIT
"""Neighbours: which of many places a surface may pass by, found in a tree over their normals and places."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import int64
from numpy.typing import NDArray

from completion.evidence.form import Form
from completion.observe.triple import dot, minus, plus
from scenes.checks import FloatArray, IntArray
from texture.engine.compiled import compiled, inlined

_LEAF = 8  # places that are not told apart any further
_NARROW = 0.5  # of a normal's component: parts of the tree that differ by more are split by it
_SLACK = 1e-6  # of rounding: metres, and a share


class Spots(NamedTuple):
    """Balls in space that a surface may pass by, and the normals there; also those around several of them."""

    middle: FloatArray  # (n, 3) metres
    radius: FloatArray  # (n,) metres
    reach: FloatArray  # (n,) metres beside a ball that a surface may be and still count
    low: FloatArray  # (n, 3) least components of the normals
    high: FloatArray  # (n, 3) greatest ones


class Tree(NamedTuple):
    """Spots, and balls around ever fewer of them, each before its own parts."""

    spots: Spots  # in the tree's order
    number: NDArray[np.int64]  # (n,) which they were
    around: Spots  # (m,) the balls
    start: NDArray[np.int64]  # (m,) the first spot in each
    end: NDArray[np.int64]  # (m,) the one after the last
    after: NDArray[np.int64]  # (m,) the ball that follows its parts


def plant(spots: Spots) -> Tree:
    """Return the tree of at least one spot, split by normals first and then by place, at the median."""
    order = np.arange(len(spots.radius))
    limits: list[tuple[int, int]] = []
    after: list[int] = []

    def split(start: int, end: int) -> None:
        ball, here = len(limits), order[start:end]
        limits.append((start, end))
        after.append(0)
        if end - start > _LEAF:
            order[start:end] = here[np.argsort(_widest(spots, here), kind="stable")]
            middle = (start + end) // 2
            split(start, middle)
            split(middle, end)
        after[ball] = len(limits)

    split(0, len(order))
    balls = [_around(spots, order[start:end]) for start, end in limits]
    start, end = np.array(limits).T
    return Tree(
        spots=Spots(*(one[order] for one in spots)),
        number=order,
        around=Spots(*(np.array(one) for one in zip(*balls, strict=True))),
        start=start.copy(),
        end=end.copy(),
        after=np.array(after),
    )


def _widest(spots: Spots, here: IntArray) -> FloatArray:
    """The component (n,) of the normals, or where they are alike of the places, that varies most."""
    normal, place = (spots.low + spots.high)[here] / 2, spots.middle[here]
    varied = normal if np.ptp(normal, axis=0).max() > _NARROW else place
    return np.asarray(varied[:, np.argmax(np.ptp(varied, axis=0))])


def _around(spots: Spots, here: IntArray) -> tuple[FloatArray, ...]:
    """One ball around some spots."""
    place = spots.middle[here]
    middle = (place.min(axis=0) + place.max(axis=0)) / 2
    radius = np.linalg.norm(place - middle, axis=1) + spots.radius[here]
    low, high = spots.low[here].min(axis=0), spots.high[here].max(axis=0)
    return middle, radius.max(), spots.reach[here].max(), low, high


@compiled
def find_near(
    tree: Tree, form: Form, spread: tuple[float, float, float], least_cosine: float
) -> NDArray[np.int64]:
    """Return the numbers of the spots that a surface may pass by; all that do, and perhaps others.

    It passes by a ball where its distance is at most the ball's `reach` and f (a + b d), with `spread` f, a
    and b, and d the distance from its own point, metres. A plane's normal and that of the spot are to have
    at least this cosine.
    """
    found, n = np.empty(tree.number.size, np.int64), 0
    ball = int64(0)
    while ball < tree.start.size:
        if not _may_pass(tree.around, ball, form, spread, least_cosine):
            ball = tree.after[ball]
            continue
        if tree.after[ball] == ball + 1:
            for spot in range(tree.start[ball], tree.end[ball]):
                if _may_pass(tree.spots, spot, form, spread, least_cosine):
                    found[n] = tree.number[spot]
                    n += 1
        ball += 1
    return found[:n]


@inlined
def _may_pass(
    spots: Spots, k: int, form: Form, spread: tuple[float, float, float], least_cosine: float
) -> bool:
    """Tell whether a surface may pass by anything in the k-th ball."""
    place = spots.middle[k, 0], spots.middle[k, 1], spots.middle[k, 2]
    offset = minus(place, form.point)
    along = dot(offset, form.axis)
    height = abs(along)
    if form.is_curved:
        across = plus(offset, -along, form.axis)
        height = abs(np.sqrt(dot(across, across)) - form.radius)
    else:
        cosine = 0.0
        for axis in range(3):
            component = form.axis[axis]
            cosine += max(component * spots.low[k, axis], component * spots.high[k, axis])
        if cosine < least_cosine - _SLACK:
            return False
    farthest = np.sqrt(dot(offset, offset)) + spots.radius[k]
    allowed = spots.reach[k] + spread[0] * (spread[1] + spread[2] * farthest)
    return not height - spots.radius[k] > allowed * (1.0 + _SLACK) + _SLACK
