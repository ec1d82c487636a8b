# SPDX-License-Identifier: MIT
"""Rows: parallel planes and axes that may stand at one spacing, found among all of a class."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.relations.engine.classes import FAR, grouped, parallel_now
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation
from completion.relations.evidence import judge, size_of
from completion.relations.options import RelationOptions
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_LEAST_PLANES, _LEAST_AXES = (
    4,
    3,
)  # of a row: of three planes it is an equal distance
_N_SD = 4.0  # within which the next of a row is where it is expected
_MOST_SHARE = 0.25  # of a spacing that this may be: else chance puts one there
_MOST_MEMBERS = 150  # of a class, the best known, among which rows are looked for
_ROUNDING = 1e-9  # metres
_MOST_ROWS = 30  # of a class, the longest


def regular_rows(estimate: Estimate, options: RelationOptions) -> Iterator[Relation]:
    """Rows of at least four parallel planes, or three parallel axes, at one spacing.

    A row begins with any two; the next is looked for where the spacing puts it. `n_tried` counts the two that
    it might have begun with, and the surfaces that are within half a spacing of where each of the others is.
    """
    size_m = size_of(estimate.fits)
    for own in parallel_now(estimate):
        apart = [first for first, *_ in grouped(own, estimate, ("coplanar", "coaxial"))]
        planes = [one for one in apart if isinstance(estimate.fits[one].surface, Plane)]
        axes = [one for one in apart if one not in planes]
        for members, least in ((planes, _LEAST_PLANES), (axes, _LEAST_AXES)):
            if len(members) >= least:
                for row in _rows_of(members[:_MOST_MEMBERS], least, estimate):
                    told = judge(row, estimate, options, size_m)
                    if told is not None and (told.is_implied or told.evidence > 0):
                        yield row


def _rows_of(members: Sequence[int], least: int, estimate: Estimate) -> Iterator[Relation]:
    place, deviation = places_across(members, estimate)
    apart = _distinct(place, deviation)
    place, deviation = place[apart], deviation[apart]
    found: dict[frozenset[int], list[int]] = {}
    for row in _progressions(place, deviation):
        if len(row) >= least:
            found.setdefault(frozenset(row), row)
    longest = sorted(found.values(), key=lambda row: -len(row))
    kept: list[list[int]] = []
    for row in longest:
        if len(kept) < _MOST_ROWS and not any(set(row) <= set(other) for other in kept):
            kept.append(row)
    for row in kept:
        numbers = [members[apart[k]] for k in row]
        if numbers[0] > numbers[-1]:
            numbers.reverse()
        yield Relation(kind="regular", surfaces=tuple(numbers), n_tried=_n_tried(row, place))


def places_across(members: Sequence[int], estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Places (m, d) of parallel planes (d = 1) or axes (d = 2) over the first, metres; deviations (m,)."""
    first = estimate.at[members[0]]
    is_plane = isinstance(estimate.fits[members[0]].surface, Plane)
    over = first.direction[None] if is_plane else first.across
    place = np.array([over @ (estimate.at[one].point - first.point) for one in members])
    deviation = [0.0]
    for one in members[1:]:
        constraint = estimate.constraint(
            Relation(kind="coplanar" if is_plane else "coaxial", surfaces=(members[0], one))
        ).only(range(2, 2 + len(over)))
        variance = np.diag(estimate.variance(constraint)) + estimate.built_within(constraint)
        deviation.append(float(np.sqrt(max(variance.max(), 0.0))))
    return place, np.maximum(deviation, _ROUNDING)


def _distinct(place: FloatArray, deviation: FloatArray) -> list[int]:
    """Those of places (m, d) that are not one with a place before them."""
    kept: list[int] = []
    for k in range(len(place)):
        far = np.linalg.norm(place[kept] - place[k], axis=1)
        if not (far <= FAR * (deviation[kept] + deviation[k])).any():
            kept.append(k)
    return kept


def _progressions(place: FloatArray, deviation: FloatArray) -> Iterator[list[int]]:
    """Places (m, d) that follow one another at one step, as long as they go on, from any two on."""
    n, tree = len(place), cKDTree(place)
    one, two = (some.ravel() for some in np.mgrid[:n, :n])
    away = np.linalg.norm(place[two] - place[one], axis=1)
    allowed = _N_SD * np.sqrt(np.square(deviation[one]) + 4 * np.square(deviation[two]))
    far, third = tree.query(2 * place[two] - place[one])
    goes_on = (far <= np.hypot(allowed, _N_SD * deviation[third])) & (one != two)
    goes_on &= (allowed <= _MOST_SHARE * away) & (third != two)
    after = {
        (int(a), int(b)): int(c) for a, b, c in zip(*(x[goes_on] for x in (one, two, third)), strict=True)
    }
    goes_back = {(b, c) for (_, b), c in after.items()}
    for pair in after:
        if pair in goes_back:
            continue
        row = list(pair)
        while (row[-2], row[-1]) in after and len(row) < n:
            row.append(after[row[-2], row[-1]])
        yield row


def _n_tried(row: Sequence[int], place: FloatArray) -> float:
    """How many rows of as many there might have been at a row's spacing, among places (m, d)."""
    n, dimension = place.shape
    step = (place[row[-1]] - place[row[0]]) / (len(row) - 1)
    half = float(np.linalg.norm(step)) * (0.5 if dimension == 1 else 1 / np.sqrt(np.pi))
    expected = place[row[0]] + np.arange(2, len(row))[:, None] * step
    beside = (np.linalg.norm(place[None] - expected[:, None], axis=2) <= half).sum(axis=1)
    return float(n * (n - 1) / 2 * np.prod(np.maximum(1.0, beside)))
