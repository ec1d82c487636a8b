# SPDX-License-Identifier: MIT
"""Flights: level patches that rise and move on equally, as the treads of stairs do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.templates.solids.upright import UprightSample
from scenes.checks import FloatArray

_LEAST_STEPS = 3
_LEAST_POINTS = 12  # of a patch
_NEIGHBOURS = 6  # that tell how far apart the points that were looked at are
_NEAR = 2.0  # of that distance: points of one patch
_SAME = 0.12  # of a rise: how far a patch may be above or below where the row has it
_ASIDE = 0.35  # of a going, how far its middle may be before or behind
_DEEP = (0.3, 2.0)  # goings: how deep treads are, a nose or what hides them counted
_SIDES = (2.0, 98.0)  # percentiles of points that a patch spans
_MARGIN = (100.0 / 96.0 - 1) / 2  # of the width between them, up to the ends
_MOST_MISSED = 1  # steps in turn that nobody saw


class Flight(NamedTuple):
    """Where structure sees a flight, in an upright frame."""

    x: FloatArray  # (5,) as the parameters of stairs
    n_steps: int
    sides: FloatArray  # (2,) least and greatest place across the way


def find_flight(sample: UprightSample, noise: float, spacing: float, given: dict[str, float]) -> Flight | str:
    """Return the flight that most level patches belong to, or why none is.

    Points of level surfaces that lie side by side at one height are a patch. Two patches give a rise and a
    move; others that lie where these lead belong to the flight, if treads are about as deep as it moves.

    Parameters
    ----------
    sample : UprightSample
        Points of an upright frame, with their normals.
    noise, spacing : float
        Of a point across its surface; between neighbouring points of all.
    given : mapping
        "rise" and "going", if they are known.
    """
    patches = _patches(sample.flat, max(4 * noise, 0.7 * spacing))
    if len(patches) < _LEAST_STEPS:
        return f"{len(patches)} level patches; a flight has {_LEAST_STEPS}"
    heights = np.array([float(np.median(one[:, 2])) for one in patches])
    middles = np.array([(one[:, :2].min(axis=0) + one[:, :2].max(axis=0)) / 2 for one in patches])
    row = _longest_row(patches, heights, middles, max(4 * noise, 0.7 * spacing), given)
    if len(row) < _LEAST_STEPS:
        told = f"{len(patches)} level patches, of which {len(row)} rise and move on equally"
        return f"{told}; a flight has {_LEAST_STEPS}"
    number, step = (np.array(some) for some in zip(*row, strict=True))
    rise = given.get("rise", float(np.median(np.diff(heights[number]) / np.diff(step))))
    move = np.median(np.diff(middles[number], axis=0) / np.diff(step)[:, None], axis=0)
    going = given.get("going", float(np.linalg.norm(move)))
    way = move / max(float(np.linalg.norm(move)), 1e-12)
    first = float(np.median(middles[number] @ way - step * going)) - going / 2
    across = np.concatenate([patches[k] for k in number])[:, :2] @ [-way[1], way[0]]
    x = np.array(
        [np.arctan2(way[1], way[0]), first, float(np.median(heights[number] - step * rise)), going, rise]
    )
    low, high = np.percentile(across, _SIDES)
    margin = _MARGIN * (high - low)
    return Flight(x, int(step[-1]) + 1, np.array([low - margin, high + margin]))


def trimmed(flight: Flight, x: FloatArray, seen: list[int]) -> Flight:
    """Return the flight from the first to the last step that was seen, with parameters x (5,) of before."""
    first, last = min(seen), max(seen)
    moved = x + first * np.array([0.0, x[3], x[4], 0.0, 0.0])
    return Flight(moved, last - first + 1, flight.sides)


def _patches(flat: FloatArray, thick: float) -> list[FloatArray]:
    """Points (n, 3) of level surfaces as patches: side by side, and no higher apart than they are thick."""
    if len(flat) <= _NEIGHBOURS:
        return []
    away, _ = cKDTree(flat[:, :2]).query(flat[:, :2], k=_NEIGHBOURS + 1)
    reach = max(_NEAR * float(np.median(away[:, -1])), 1e-12)
    tree = cKDTree(flat * [1 / reach, 1 / reach, 1 / thick])
    pairs = tree.query_pairs(1.0, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), (len(flat),) * 2)
    _, part = connected_components(graph, directed=False)
    order = np.argsort(part, kind="stable")
    groups = np.split(flat[order], np.flatnonzero(np.diff(part[order])) + 1)
    return [group for group in groups if len(group) >= _LEAST_POINTS]


def _longest_row(
    patches: list[FloatArray], heights: FloatArray, middles: FloatArray, thick: float, given: dict[str, float]
) -> list[tuple[int, int]]:
    """Patch and step of each in the row with the most patches less misses, ascending."""
    best, most = list[tuple[int, int]](), 0
    for i in range(len(patches)):
        for j in range(len(patches)):
            rise, move = heights[j] - heights[i], middles[j] - middles[i]
            going = float(np.linalg.norm(move))
            if rise < 2 * thick or going < 2 * thick or not _agrees(rise, going, given):
                continue
            if not (_is_deep(patches[i], move, going) and _is_deep(patches[j], move, going)):
                continue
            members = _members(i, heights, middles, rise, move)
            members = [one for one in members if _is_deep(patches[one[0]], move, going)]
            score = len(members) - (members[-1][1] + 1 - len(members))
            if score > most:
                best, most = members, score
    return best


def _agrees(rise: float, going: float, given: dict[str, float]) -> bool:
    """Whether a step is as large as it is known to be."""
    told = {"rise": rise, "going": going}
    return all(abs(told[name] - given[name]) < _SAME * given[name] for name in told if name in given)


def _is_deep(patch: FloatArray, move: FloatArray, going: float) -> bool:
    """Whether a patch is about as deep along a move as that is long."""
    low, high = np.percentile(patch[:, :2] @ move / going, _SIDES)
    return bool(_DEEP[0] * going <= high - low <= _DEEP[1] * going)


def _members(
    first: int, heights: FloatArray, middles: FloatArray, rise: float, move: FloatArray
) -> list[tuple[int, int]]:
    """Patches that lie where a rise and a move lead up from a first one, and their steps."""
    members, step = [(first, 0)], 0
    going, way = float(np.linalg.norm(move)), move / np.linalg.norm(move)
    while step - members[-1][1] <= _MOST_MISSED:
        step += 1
        last, before = members[-1]
        off = np.abs(heights - heights[last] - (step - before) * rise) / (_SAME * rise)
        along = np.abs((middles - middles[last] - (step - before) * move) @ way) / (_ASIDE * going)
        near = np.maximum(off, along)
        k = int(np.argmin(near))
        if near[k] < 1.0:
            members.append((k, step))
    return members
