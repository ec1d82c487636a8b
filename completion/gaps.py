# SPDX-License-Identifier: MIT
"""Gaps: whether what lies between two parts of a surface was hidden, or seen through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.evidence import EvidenceOptions, Label, label_points
from completion.observation import Observation
from scenes.checks import FloatArray
from scenes.surfaces import Surface

_N_BRIDGES = 24
_N_STEPS = 24
_STRIP = 3  # neighbouring bridges that make a strip


def gap_is_hidden(
    surface: Surface,
    one: FloatArray,
    other: FloatArray,
    scale: float,
    observations: Sequence[Observation],
    options: EvidenceOptions,
) -> bool:
    """Tell whether a strip between two parts is wholly hidden or measured on the surface.

    Bridges run on the surface between facing points of the parts, shortest first; on three of them, nearest
    neighbours of each other, no step may lie where a beam went through and most must be occluded or
    measured; and beams may cross a tenth of all bridges at most.

    Parameters
    ----------
    surface : Surface
        Of one of the parts.
    one, other : (n, 3), (m, 3) float
        Points of the parts, metres.
    scale : float
        What the surface may stray by there, metres.
    observations : sequence of Observation
        All scans.
    options : EvidenceOptions
        Tolerances.
    """
    points, n_bridges = _bridges(surface, one, other)
    crossed, seen = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
    spread = np.full(len(points), scale)
    for observation in observations:
        said, pixel, _, _ = label_points(surface, points, spread, observation, options)
        seen |= said >= Label.OCCLUDED
        measured = observation.scan.ranges.ravel()[pixel]
        beyond = measured - np.linalg.norm(points - observation.scan.origin, axis=1)
        crossed |= (pixel >= 0) & np.isfinite(measured) & (beyond > 0) & (said == Label.NO_RETURN)
    open_, known = crossed.reshape(n_bridges, -1), seen.reshape(n_bridges, -1)
    closed = ~open_.any(axis=1) & (known.mean(axis=1) > 0.5)
    return int(closed.sum()) >= min(_STRIP, n_bridges) and float(open_.mean()) < 0.1


def _bridges(surface: Surface, one: FloatArray, other: FloatArray) -> tuple[FloatArray, int]:
    """Points on the shortest bridges, bridge by bridge, and how many there are."""
    distance, nearest = cKDTree(other).query(one)
    order = np.argsort(distance, kind="stable")[:_N_BRIDGES]
    start, end = surface.to_uv(one[order]), surface.to_uv(other[nearest[order]])
    if np.isfinite(surface.period):
        end[:, 0] += np.rint((start[:, 0] - end[:, 0]) / surface.period) * surface.period
    along = (np.arange(_N_STEPS) + 0.5) / _N_STEPS
    bridges = start[:, None, :] + along[None, :, None] * (end - start)[:, None, :]
    return surface.from_uv(bridges.reshape(-1, 2)), len(order)
