# SPDX-License-Identifier: MIT
"""Assertion: surface that a symmetry implies and no beam refutes, with its standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.backs.limits import ASSERTED_CELL, MOST_SD, PASSED_SHARE, SUPPORTED, TOLERANCE_SD, VETO
from completion.backs.probability import Element
from completion.backs.seeing import is_possible, see
from completion.backs.symmetry import move, one_a_cell
from completion.backs.views import Scale, Setting, Sight
from scenes.checks import BoolArray, FloatArray, Value


@dataclass(frozen=True, slots=True, eq=False)
class Asserted(Value):
    """Inferred surface as points.

    Attributes
    ----------
    points, normals : (n, 3) float
        Metres; normals point out of the thing.
    origin : (n,) uint8
        1 by a mirror, 2 by a turn.
    sd_m : (n,) float
        Standard deviation along the normal, from the symmetry's covariance and the range noise, metres.
    probability : (n,) float
        Of the symmetry.
    """

    points: FloatArray
    normals: FloatArray
    origin: NDArray[np.uint8]
    sd_m: FloatArray
    probability: FloatArray


def assert_surface(
    sights: Sequence[Sight], elements: Sequence[Element], setting: Setting, scale: Scale, *, least: float
) -> Asserted:
    """Return measured surface moved by symmetries of at least a probability, where nothing was measured.

    Left out: what a beam passed, what lies below the support or behind a wall, what was measured there, and
    what the symmetry's own standard deviation makes uncertain by more than `MOST_SD` of the size.
    """
    known = [sight.thing & (sight.normals != 0).any(axis=1) for sight in sights]
    points = np.concatenate([sight.points[one] for sight, one in zip(sights, known, strict=True)])
    normals = np.concatenate([sight.normals[one] for sight, one in zip(sights, known, strict=True)])
    slack = max(VETO * scale.size, TOLERANCE_SD * setting.sigma_m)
    round_ = [element.isometry for element in elements if element.origin == 2]
    if round_:
        supported = _turn_freely(sights, np.stack(round_), points, normals, scale)
        points, normals = points[supported], normals[supported]
    parts: list[tuple[FloatArray, ...]] = []
    for element in elements:
        if element.probability < least:
            continue
        moved, facing = move(element.isometry, points), normals @ element.isometry[:, :3].T
        sd = np.hypot(element.spread(points, normals), setting.sigma_m)
        keep = sd <= max(MOST_SD * scale.size, 2 * setting.sigma_m)
        keep[keep] = is_possible(sights, moved[keep], setting, slack)
        seen = see(sights, element.isometry[None], points[keep], normals[keep], scale.tolerance)
        keep[keep] = (seen.matched[0] < 0.5) & (seen.free[0] <= 0)
        n = int(keep.sum())
        parts.append((
            moved[keep], facing[keep], np.full(n, element.origin), sd[keep], np.full(n, element.probability)
        ))  # fmt: skip
    empty = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0)
    at, facing, origin, sd, likely = (np.concatenate(one) for one in zip(*parts, empty, strict=True))
    order = np.argsort(-likely, kind="stable")
    order = order[one_a_cell(at[order], ASSERTED_CELL * scale.size)] if len(order) else order
    return Asserted(at[order], facing[order], origin[order].astype(np.uint8), sd[order], likely[order])


def _turn_freely(
    sights: Sequence[Sight], turns: FloatArray, points: FloatArray, normals: FloatArray, scale: Scale
) -> BoolArray:
    """Tell which points (n, 3) were measured at some of many turns (k, 3, 4), and refuted at few."""
    seen = see(sights, turns, points, normals, scale.tolerance)
    matched, free = (seen.matched > 0.5).sum(axis=0), (seen.free > 0.5).sum(axis=0)
    return np.asarray(
        (matched >= min(SUPPORTED, len(turns) // 8)) & (free <= PASSED_SHARE * (matched + free))
    )
