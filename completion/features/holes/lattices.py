# SPDX-License-Identifier: MIT
"""Lattices: patterns through two or three candidates whose other holes the plate leaves room for.

A hole of which a third is seen is no circle by itself: its centre and radius are too uncertain to be met by
a lattice through others. Two that are seen well tell where it is. Of the lattices through all pairs of like
candidates few have no plate where a hole should be; these are weighed as wholes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from completion.features.holes.candidates import Candidates
from completion.features.holes.patterns import CIRCLE, GRID, ROW, Pattern
from completion.features.holes.proposals import ALIKE, Proposal, Search, pairs
from completion.features.holes.survey import Survey
from scenes.checks import BoolArray, FloatArray, IntArray

_COUNTS = range(4, 17)  # of a circle
_WEB = 0.8  # spacings between neighbouring rims at least
_NEAR = 0.7  # spacings between a third candidate and its place in a grid, and of candidates from places
_MOST_BEYOND = 4  # places beyond either end of a pattern that are looked at
_MOST_WIDE = 3  # steps of a grid between its first candidates


def lattices(kind: str, found: Candidates, survey: Survey, given: Mapping[str, float]) -> list[Proposal]:
    """Return the patterns of a kind through pairs (triples, of a grid) that have room for three holes.

    Each is as small as the candidates that it goes through allow: a window of its lattice is sought by
    whoever weighs it. Candidates at its other places are among those that it is said to hold.
    """
    if len(found) < 2:
        return []
    search = Search.of(found, survey.area, survey.spacing, given)
    begun = {ROW: _rows, GRID: _grids, CIRCLE: _circles}[kind](search, survey)
    return [Proposal(one, *matches(one, found, survey.spacing), 0.0) for one in begun]


def matches(pattern: Pattern, found: Candidates, spacing: float) -> tuple[IntArray, IntArray]:
    """Return the places (m,) of a pattern at which candidates are, and their numbers (m,)."""
    if not len(found):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    off = np.linalg.norm(pattern.centres[:, None] - found.centres, axis=2)
    apart = np.abs(found.radii - pattern.radius)
    unlike = (off > _NEAR * spacing) | (apart > ALIKE[0] * spacing + ALIKE[1] * pattern.radius)
    cost = np.where(unlike, np.inf, off + apart)
    places = np.flatnonzero(np.isfinite(cost.min(axis=1)))
    return places, cost[places].argmin(axis=1)


def count_range(pattern: Pattern, seen: BoolArray, survey: Survey) -> tuple[int, int]:
    """Return how many holes a pattern has at least and at most, where `seen` (count,) of them were.

    At least those from the first to the last that were seen. At most as many more as there is room for: an
    end hole whose place is lost can be counted by nobody.
    """
    if pattern.kind == CIRCLE or not seen.any():
        return pattern.count, pattern.count
    least = [int(np.ptp(at)) + 1 for at in np.nonzero(seen.reshape(pattern.shape))]
    (n, m), most = pattern.shape, list(pattern.shape)
    # the first line beyond each end, the way on, and its shape
    lines = [((-1, 0), (-1, 0), (1, m)), ((n, 0), (1, 0), (1, m)),
             ((0, -1), (0, -1), (n, 1)), ((0, m), (0, 1), (n, 1))]  # fmt: skip
    for number, (first, way, shape) in enumerate(lines if pattern.kind == GRID else lines[:2]):
        for k in range(_MOST_BEYOND):
            beyond = pattern.resized((first[0] + k * way[0], first[1] + k * way[1]), shape)
            if survey.is_no_hole(beyond.centres, np.full(beyond.count, pattern.radius)).any():
                break
            most[number // 2] += 1
    return least[0] * least[1], most[0] * most[1]


def _steps(search: Search, survey: Survey) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Pairs (m,) of like candidates, the pitch (m, 2) and the radius (m,), with room for holes between."""
    one, two, pitch = pairs(search)
    radius = (search.found.radii[one] + search.found.radii[two]) / 2
    room = np.hypot(*pitch.T) > 2 * radius + _WEB * search.spacing
    for place in (search.found.centres[one] + pitch, search.found.centres[two] - pitch):
        room &= ~survey.is_no_hole(place, radius)
    return one[room], two[room], pitch[room], radius[room]


def _rows(search: Search, survey: Survey) -> Iterator[Pattern]:
    """Rows with room for a third hole beside the first two, or between."""
    one, two, pitch, radius = _steps(search, survey)
    first, last = search.found.centres[one], search.found.centres[two]
    length = np.hypot(*pitch.T)
    count = np.rint(np.hypot(*(last - first).T) / length).astype(np.int64) + 1
    beside = ~(survey.is_no_hole(first - pitch, radius) & survey.is_no_hole(last + pitch, radius))
    for k in np.flatnonzero(beside | (count > 2)):
        middle, angle = (first[k] + last[k]) / 2, np.arctan2(pitch[k, 1], pitch[k, 0])
        size = search.given.get("pitch", float(length[k]))
        radius_k = search.given.get("radius", float(radius[k]))
        pattern = Pattern(ROW, (int(count[k]), 1), np.array([*middle, angle, size]), radius_k)
        low = -int(count[k] == 2 and not survey.is_no_hole(first[k] - pitch[k], radius[k]))
        yield pattern.resized((low, 0), (max(pattern.shape[0], 3), 1))


def _grids(search: Search, survey: Survey) -> Iterator[Pattern]:
    """Grids through pairs and a third candidate across, with room in all of the rectangle of these."""
    one, two, pitch, radius = _steps(search, survey)
    found = search.found
    length = np.hypot(*pitch.T)
    for k in range(len(one)):
        along = pitch[k] / length[k]
        across = np.array([-along[1], along[0]])
        offset = (found.centres - found.centres[one[k]]) @ np.stack([along, across], axis=1)
        steps = np.rint(offset[:, 0] / length[k]).astype(np.int64)
        n_along = int(np.rint(np.hypot(*(found.centres[two[k]] - found.centres[one[k]])) / length[k]))
        least = 2 * radius[k] + _WEB * search.spacing
        near = np.abs(offset[:, 0] - steps * length[k]) < _NEAR * search.spacing * (1 + 0.25 * np.abs(steps))
        near &= (np.abs(offset[:, 1]) > least) & search.alike(one[k], np.arange(len(found)))
        near &= (steps >= -_MOST_WIDE) & (steps <= n_along + _MOST_WIDE)
        for third in np.flatnonzero(near):
            for n_across in range(1, _MOST_WIDE + 1):
                width = abs(float(offset[third, 1])) / n_across
                if width < least:
                    break
                low, high = min(0, int(steps[third])), max(n_along, int(steps[third]))
                shape = (high - low + 1, n_across + 1)
                middle = found.centres[one[k]] + (low + high) / 2 * pitch[k] + offset[third, 1] / 2 * across
                x = np.array([*middle, np.arctan2(along[1], along[0]), length[k], width])
                x[3:] = [search.given.get(name, value)
                         for name, value in zip(("pitch", "pitch_2"), x[3:], strict=True)]  # fmt: skip
                pattern = Pattern(GRID, shape, x, search.given.get("radius", float(radius[k])))
                if not survey.is_no_hole(pattern.centres, np.full(pattern.count, radius[k])).any():
                    yield pattern


def _circles(search: Search, survey: Survey) -> Iterator[Pattern]:
    """Bolt circles through pairs, any share of a turn apart, with room for all holes."""
    one, two, pitch, radius = _steps(search, survey)
    first, last = search.found.centres[one], search.found.centres[two]
    whole = np.hypot(*(pitch - (last - first)).T) < 1e-9  # each pair once
    first, last, radius = first[whole], last[whole], radius[whole]
    half, longest = np.hypot(*(last - first).T) / 2, np.sqrt(search.area) / 2
    across = np.column_stack([first[:, 1] - last[:, 1], last[:, 0] - first[:, 0]]) / (2 * half[:, None])
    for n in _COUNTS if "count" not in search.given else [round(search.given["count"])]:
        for step in range(1, n // 2 + 1):
            size = half / np.sin(np.pi * step / n)
            fits = (2 * size * np.sin(np.pi / n) > 2 * radius + _WEB * search.spacing) & (size < longest)
            if "circle_radius" in search.given:
                fits &= np.abs(size - search.given["circle_radius"]) < 2 * _NEAR * search.spacing
            high = np.sqrt(np.maximum(size**2 - half**2, 0.0))
            for side in (1, -1) if 2 * step != n else (1,):
                k = np.flatnonzero(fits)
                middle = (first[k] + last[k]) / 2 + side * high[k, None] * across[k]
                begin = np.arctan2(*(first[k] - middle).T[::-1])
                turn = begin[:, None] + 2 * np.pi * np.arange(n) / n
                ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
                places = middle[:, None] + size[k, None, None] * ring
                radii = np.broadcast_to(radius[k, None], turn.shape)
                for m in np.flatnonzero(~survey.is_no_hole(places, radii).any(axis=1)):
                    circle = search.given.get("circle_radius", float(size[k[m]]))
                    x = np.array([*middle[m], begin[m], circle])
                    yield Pattern(CIRCLE, (n, 1), x, search.given.get("radius", float(radius[k[m]])))
