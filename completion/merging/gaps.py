# SPDX-License-Identifier: MIT
"""Gaps: whether what lies between two parts of a surface was hidden, or seen through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.evidence.evidence import Label, label_points
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_N_ENDS = 40  # points of either part that bridges start from
_N_STEPS = 24
_STRIP = 3  # neighbouring bridges that make a strip


def gap_is_hidden(
    surface: Surface,
    one: FloatArray,
    other: FloatArray,
    scale: float,
    observations: Sequence[Observation],
    tolerance: Tolerance,
) -> bool:
    """Tell whether a strip between two parts is wholly hidden or measured on the surface.

    Bridges run on the surface from points of one part to points of the other. They make a strip where
    `_STRIP` of them, neighbours at either end, are closed: no step lies where a beam went through, and most
    are occluded or measured. What lies beside the strip may be open: a window between two parts of a wall.

    Parameters
    ----------
    surface : Surface
        Of one of the parts.
    one, other : (n, 3), (m, 3) float
        Points of the parts, metres.
    scale : float
        Standard deviation of ranges about the surface there, metres.
    observations : sequence of Observation
        All scans.
    tolerance : Tolerance
        Along the ray.
    """
    first, second = _ends(surface, one, other)
    points = _bridges(surface, first, second)
    crossed, seen = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
    predicted_sd = np.full(len(points), scale)
    for observation in observations:
        found = label_points(surface, points, predicted_sd, observation, tolerance)
        seen |= found.label >= Label.OCCLUDED
        crossed |= found.through
    shape = len(first), len(second), _N_STEPS
    closed = ~crossed.reshape(shape).any(axis=2) & (seen.reshape(shape).mean(axis=2) > 0.5)
    return _has_strip(closed, first, second)


def _ends(surface: Surface, one: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Chart coordinates of the points of both parts that bridges run between, those that face the other."""
    start, end = surface.to_uv(one), surface.to_uv(other)
    if np.isfinite(surface.period):
        end[:, 0] += np.rint((start[:, 0].mean() - end[:, 0]) / surface.period) * surface.period
    return _facing(start, end), _facing(end, start)


def _facing(uv: FloatArray, other: FloatArray) -> FloatArray:
    """The nearest of `uv` to the other part, and as many from all over the rest of it."""
    distance, _ = cKDTree(other).query(uv)
    order = np.argsort(distance, kind="stable")
    half = _N_ENDS // 2
    if len(order) <= _N_ENDS:
        return uv
    rest = order[half:]
    chosen: FloatArray = uv[np.concatenate([order[:half], rest[:: max(1, len(rest) // half)][:half]])]
    return chosen


def _bridges(surface: Surface, first: FloatArray, second: FloatArray) -> FloatArray:
    """Points on the bridges between all pairs of ends, bridge by bridge."""
    along = (np.arange(_N_STEPS) + 0.5) / _N_STEPS
    way = second[None, :] - first[:, None]
    bridges: FloatArray = first[:, None, None, :] + along[None, None, :, None] * way[:, :, None, :]
    points: FloatArray = surface.from_uv(bridges.reshape(-1, 2))
    return points


def _has_strip(closed: BoolArray, first: FloatArray, second: FloatArray) -> bool:
    """Tell whether some closed bridge has closed neighbours: from the ends next to its own."""
    if not closed.any():
        return False
    n = min(_STRIP, *closed.shape)
    near_first = cKDTree(first).query(first, k=n)[1].reshape(len(first), n)
    near_second = cKDTree(second).query(second, k=n)[1].reshape(len(second), n)
    along_first = closed[near_first].all(axis=1)  # the same end in the second part
    along_second = closed[:, near_second].all(axis=2)
    return bool((along_first & along_second).any())
