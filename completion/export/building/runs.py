# SPDX-License-Identifier: MIT
"""Runs of pipes: straight segments that go on in one another, or lie side by side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.export.building import limits
from completion.export.building.model import CylinderElement
from scenes.checks import FloatArray


def segments_in_runs(segments: Sequence[CylinderElement]) -> frozenset[int]:
    """Return the numbers of the cylinders that are segments of a run of pipes.

    Segments of one radius are linked where one goes on in the axis of the other, across a gap no longer than
    the longer of them, or where both end at a bend: their axes meet within a radius, at most
    `limits.BEND_DIAMETERS` beyond an end of each. What is linked is a chain. A chain is a run where it is at
    least `limits.RUN_DIAMETERS` long, and has two segments or another such chain at its side: parallel, of
    the same radius, at most `limits.PITCH_DIAMETERS` away, along half of the shorter one. A lone cylinder is
    none, however long: nothing tells a pipe from a rail, a leg or a lamp.
    """
    if not segments:
        return frozenset()
    chain = _chains(segments)
    length = np.bincount(chain, [segment.length_m for segment in segments])
    thick = np.array([2 * segment.radius_m for segment in segments])
    is_long = length[chain] >= limits.RUN_DIAMETERS * thick
    has_link = np.bincount(chain)[chain] > 1
    for k, m in combinations(np.flatnonzero(is_long).tolist(), 2):
        if chain[k] != chain[m] and _lies_beside(segments[k], segments[m]):
            has_link |= np.isin(chain, chain[[k, m]])
    return frozenset(segments[k].number for k in np.flatnonzero(is_long & has_link).tolist())


def _chains(segments: Sequence[CylinderElement]) -> NDArray[np.int64]:
    """Number (n,) of the chain of each segment, from 0."""
    n = len(segments)
    pairs = [(k, m) for k, m in combinations(range(n), 2) if _goes_on(segments[k], segments[m])]
    rows, columns = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(pairs), np.int8), (rows, columns)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _same_radius(one: CylinderElement, other: CylinderElement) -> bool:
    """Whether radii agree within a tenth, or three standard deviations."""
    spread = limits.N_SIGMA * np.hypot(one.radius_sd_m, other.radius_sd_m)
    share = limits.SAME_RADIUS * max(one.radius_m, other.radius_m)
    return abs(one.radius_m - other.radius_m) <= max(float(spread), share)


def _goes_on(one: CylinderElement, other: CylinderElement) -> bool:
    """Whether a segment goes on in the axis of another, or both end at one bend."""
    if not _same_radius(one, other):
        return False
    first, second = _along(one), _along(other)
    radius = max(one.radius_m, other.radius_m)
    if abs(float(first @ second)) >= limits.PARALLEL:
        off = other.ends.mean(axis=0) - one.ends.mean(axis=0)
        across = float(np.linalg.norm(off - (off @ first) * first))
        gap = abs(float(off @ first)) - (one.length_m + other.length_m) / 2
        return across <= radius and gap <= max(one.length_m, other.length_m)
    return _meet_at_a_bend(one, other, radius)


def _meet_at_a_bend(one: CylinderElement, other: CylinderElement, radius: float) -> bool:
    """Whether the axes meet within a radius, not far beyond an end of each."""
    first, second = _along(one), _along(other)
    off = other.ends[0] - one.ends[0]
    places = np.linalg.lstsq(np.column_stack([first, -second]), off, rcond=None)[0]
    nearest = np.stack([one.ends[0] + places[0] * first, other.ends[0] + places[1] * second])
    reach = 2 * radius * limits.BEND_DIAMETERS
    return bool(
        np.linalg.norm(nearest[1] - nearest[0]) <= radius
        and all(
            np.linalg.norm(segment.ends - place, axis=1).min() <= reach
            for segment, place in zip((one, other), nearest, strict=True)
        )
    )


def _lies_beside(one: CylinderElement, other: CylinderElement) -> bool:
    """Whether two segments are parallel, of one radius, and near each other along half of the shorter."""
    first = _along(one)
    if not _same_radius(one, other) or abs(float(first @ _along(other))) < limits.PARALLEL:
        return False
    off = other.ends.mean(axis=0) - one.ends.mean(axis=0)
    across = float(np.linalg.norm(off - (off @ first) * first))
    shared = (one.length_m + other.length_m) / 2 - abs(float(off @ first))
    near = across <= 2 * limits.PITCH_DIAMETERS * max(one.radius_m, other.radius_m)
    return near and shared >= limits.MAJORITY * min(one.length_m, other.length_m)


def _along(segment: CylinderElement) -> FloatArray:
    """Unit direction (3,) of the axis."""
    return np.asarray((segment.ends[1] - segment.ends[0]) / segment.length_m)
