# SPDX-License-Identifier: MIT
"""Webs: the plate between and around holes, which slots and notches do not have."""

from __future__ import annotations

import numpy as np

from completion.templates.holes.measuring.survey import Survey
from completion.templates.holes.patterns import CIRCLE, Pattern
from scenes.checks import BoolArray, FloatArray, IntArray

_WIDE = 0.8  # of the radius: half the width of a web that is looked at
_OPEN_SIDE, _OPEN_ALIKE = 5, 4  # sectors of 16 side by side without a rim, of one hole and of all alike
_LEAST = 4.0  # points expected of a web that can tell


def are_joined(pattern: Pattern, survey: Survey) -> bool:
    """Whether along one direction of a pattern nothing was measured between any two neighbours: slots."""
    for pairs in _neighbours(pattern):
        counted, expected = _on_webs(pattern, pairs, survey)
        telling = expected > _LEAST
        if telling.any() and (counted[telling] == 0).all():
            return True
    return False


def open_sides(rims: BoolArray) -> BoolArray:
    """Tell of which holes a whole side is open, by the sectors (n, k) in which they have a rim."""
    return _gaps(rims, _OPEN_SIDE)


def are_notches(pattern: Pattern, rims: BoolArray, seen: BoolArray) -> bool:
    """Whether all holes that were `seen` (n,) are open on the same side, or all inwards, or all outwards.

    Lost patches open each hole elsewhere; notches, slots, and circles that lie in a larger one, alike.
    """
    if not seen.any():
        return False
    offset = pattern.centres - pattern.x[:2]
    outwards = np.arctan2(offset[:, 1], offset[:, 0])
    k = rims.shape[1]
    turned = np.stack(
        [np.roll(one, -round(turn / (2 * np.pi) * k)) for one, turn in zip(rims, outwards, strict=True)]
    )
    inward_too = [rims, turned] if pattern.shape[1] > 1 or pattern.kind == CIRCLE else [rims]
    common = np.stack([np.asarray(frame[seen]).any(axis=0) for frame in inward_too])
    return bool(_gaps(common, _OPEN_ALIKE).any())


def _gaps(rims: BoolArray, size: int) -> BoolArray:
    """Tell in which rows (n, k), each a ring, `size` sectors side by side have no rim."""
    twice = np.concatenate([rims, rims], axis=1)
    runs: BoolArray = np.stack(
        [~twice[:, first : first + size].any(axis=1) for first in range(rims.shape[1])]
    )
    return np.asarray(runs.any(axis=0))


def _neighbours(pattern: Pattern) -> list[IntArray]:
    """Pairs (m, 2) of neighbours along each direction."""
    numbers = np.arange(pattern.count).reshape(pattern.shape)
    if pattern.kind == CIRCLE:
        return [np.stack([numbers.ravel(), np.roll(numbers.ravel(), -1)], axis=1)]
    along = np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=1)
    across = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)
    return [pairs for pairs in (along, across) if len(pairs)]


def _on_webs(pattern: Pattern, pairs: IntArray, survey: Survey) -> tuple[IntArray, FloatArray]:
    """Points (m,) of the plate between two holes each, and how many there should be."""
    centres, radius = pattern.centres, pattern.radius
    one, two = centres[pairs[:, 0]], centres[pairs[:, 1]]
    step = two - one
    length = np.hypot(*step.T)
    owner, offset = survey.near((one + two) / 2, length / 2)
    along = step / length[:, None]
    u = np.einsum("ij,ij->i", offset, along[owner])
    v = offset[:, 1] * along[owner, 0] - offset[:, 0] * along[owner, 1]
    inside = np.abs(v) < _WIDE * radius
    for sign in (-1, 1):
        inside &= np.hypot(u - sign * length[owner] / 2, v) > radius
    counted = np.bincount(owner[inside], minlength=len(pairs))
    # a rectangle less two segments of circles
    half = _WIDE * radius
    caps = half * np.sqrt(radius**2 - half**2) + radius**2 * np.arcsin(half / radius)
    area = np.maximum(2 * half * length - 2 * caps, 0.0)
    return counted, survey.density_at((one + two) / 2) * area
