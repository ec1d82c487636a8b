# SPDX-License-Identifier: MIT
"""Candidates: the pairs of parts that come into question at all, found in a tree over normals and places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import int64
from numpy.typing import NDArray

from completion.evidence.form import Form
from completion.merging.agreement import FittedPart
from completion.merging.limits import CANDIDATE_SD, LEAST_COSINE, LEAST_FACING
from completion.observe.rays import dot, minus, plus
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.run.mapping import trim
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
        spots=Spots(*(spot[order] for spot in spots)),
        number=order,
        around=Spots(*(np.array(column) for column in zip(*balls, strict=True))),
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
    neighbours, n = np.empty(tree.number.size, np.int64), 0
    ball = int64(0)
    while ball < tree.start.size:
        if not _may_pass(tree.around, ball, form, spread, least_cosine):
            ball = tree.after[ball]
            continue
        if tree.after[ball] == ball + 1:
            for spot in range(tree.start[ball], tree.end[ball]):
                if _may_pass(tree.spots, spot, form, spread, least_cosine):
                    neighbours[n] = tree.number[spot]
                    n += 1
        ball += 1
    return neighbours[:n]


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


def find_candidates(parts: Sequence[FittedPart]) -> IntArray:
    """Return the pairs (k, 2), ascending, each of whose surfaces passes near the other's middle.

    Both are of one kind; planes face alike. Parts of one plane are a pair however far apart they are.
    """
    if not parts:
        return np.zeros((0, 2), dtype=np.int64)
    middles = np.array([part.middle() for part in parts])
    variances = np.array([
        part.variance_at(middle[None], part.own_doubt())[0]
        for part, middle in zip(parts, middles, strict=True)
    ])  # fmt: skip
    normals = np.array([part.fit.surface.normal(m[None])[0] for part, m in zip(parts, middles, strict=True)])
    curved = np.array([part.form.is_curved for part in parts])
    none = np.zeros(len(parts))
    tree = plant(_spots(middles, none, CANDIDATE_SD * np.sqrt(variances), normals, curved))
    passed = []
    for i, part in enumerate(parts):
        trim()
        near = find_near(tree, part.form, (CANDIDATE_SD, *part.spread()), LEAST_COSINE)
        near = near[(curved[near] == part.form.is_curved) & (near != i)]
        height, variance = (
            part.fit.surface.distance(middles[near]),
            part.variance_at(middles[near], part.own_doubt()),
        )
        passes = np.square(height) <= CANDIDATE_SD**2 * (variance + variances[near])
        if not part.form.is_curved:
            passes &= ~(normals[near] @ normals[i] < LEAST_COSINE)
        passed.append(i * len(parts) + near[passes])
    first, second = np.divmod(np.concatenate(passed), len(parts))
    both = np.intersect1d(first * len(parts) + second, second * len(parts) + first)
    pairs = np.stack(np.divmod(both, len(parts)), axis=1)
    return np.asarray(pairs[pairs[:, 0] < pairs[:, 1]], dtype=np.int64)


def find_hosts(small: Sequence[FittedPart], parts: Sequence[FittedPart]) -> list[list[int]]:
    """Return for each small part the parts, ascending, that it may lie on: all of these and some others."""
    hosts: list[list[int]] = [[] for _ in small]
    if not small:
        return hosts
    middles = np.array([part.points.mean(axis=0) for part in small])
    radii = np.array(
        [np.linalg.norm(part.points - m, axis=1).max() for part, m in zip(small, middles, strict=True)]
    )
    normals = np.array([part.fit.surface.normal(m[None])[0] for part, m in zip(small, middles, strict=True)])
    curved = np.array([part.form.is_curved for part in small])
    factor = float(np.sqrt(max(1 + part.slack for part in small)))
    scales = np.array([np.hypot(part.scale, part.doubt.shift_m) for part in small])
    tree = plant(_spots(middles, radii, factor * scales, normals, curved))
    for i, part in enumerate(parts):
        trim()
        for j in find_near(tree, part.form, (factor, *part.spread()), LEAST_FACING).tolist():
            hosts[j].append(i)
    return hosts


def _spots(
    middles: FloatArray, radii: FloatArray, reaches: FloatArray, normals: FloatArray, curved: BoolArray
) -> Spots:
    """Spots of parts; a curved one has all normals."""
    low, high = np.where(curved[:, None], -1.0, normals), np.where(curved[:, None], 1.0, normals)
    return Spots(middles, radii, reaches, low, high)
