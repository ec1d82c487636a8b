# SPDX-License-Identifier: MIT
"""Labelling: which surface each point is on, given the surfaces, and the surfaces given that, in turn.

After Isack and Boykov (2012), Energy-based geometric multi-model fitting: the misfit of each point, a cost
where neighbours differ, and a cost for each surface. Labels are improved point by point (iterated
conditional modes), from neighbours' labels alone, so that no surface reaches to where it is not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from completion.parts.division.adjusting import KINDS
from completion.parts.division.growing import (
    GAIN,
    GrownRegion,
    likely,
    parameter_cost,
    refine_surface,
    score_of,
)
from completion.parts.division.limits import EXPLAINED_COST, ISLAND, STEP
from completion.parts.division.neighbourhoods import Neighbourhoods
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled

_N_SWEEPS = 20
_N_ROUNDS = 6


def first_labels(about: Neighbourhoods, regions: Sequence[GrownRegion]) -> IntArray:
    """Labels (n,) by which of the surfaces that grew over a point is nearest to it; 0 for none.

    Of two about as near the one counts that was found for most of its points, not for what others left.
    """
    labels = np.zeros(len(about.points), dtype=np.int64)
    least = np.full(len(labels), np.inf)
    for number, region in sorted(enumerate(regions, start=1), key=lambda pair: -_merit(pair[1])):
        share = region.surface.distance(about.points[region.members]) / about.tolerance_m
        cost = share * share / 2
        nearer = cost < least[region.members] - EXPLAINED_COST
        labels[region.members[nearer]] = number
        least[region.members[nearer]] = cost[nearer]
    return labels


def _merit(region: GrownRegion) -> float:
    """How much likelier a region made each of its points."""
    return region.score / len(region.members)


def relabel(
    about: Neighbourhoods, surfaces: Sequence[Surface], labels: IntArray
) -> tuple[list[Surface], IntArray]:
    """Improve labels (n,), 0 for none, k + 1 for surface k, and the surfaces, in turn; both are returned."""
    surface = list(surfaces)
    for _ in range(_N_ROUNDS):
        before = labels.copy()
        cost = misfits(about, surface)
        labels = _needed(about, surface, cost, _swept(about, cost, labels))
        surface, labels = _refit(about, surface, labels)
        if len(before) == len(labels) and (before == labels).all():
            break
    return surface, with_rims(about, misfits(about, surface), labels)


def with_rims(about: Neighbourhoods, cost: FloatArray, labels: IntArray) -> IntArray:
    """Labels (n,) with the points that two neighbouring surfaces explain alike given to the smaller one.

    A large surface hardly misses its rim; a narrow one may be nothing but rims.
    """
    size = np.bincount(labels, minlength=cost.shape[1])
    new = labels.copy()
    _give_rims(about.links.indptr, about.links.indices, cost, labels, size, new, EXPLAINED_COST)
    return new


@compiled
def _give_rims(
    first: IntArray,
    beside: IntArray,
    cost: FloatArray,
    labels: IntArray,
    size: IntArray,
    new: IntArray,
    most_cost: float,
) -> None:
    """Give each point the smallest surface among its own and its neighbours' that explains it."""
    for here in range(len(labels)):
        best = labels[here]
        if best == 0 or cost[here, best] > most_cost:
            continue
        for place in range(first[here], first[here + 1]):
            label = labels[beside[place]]
            if label != 0 and cost[here, label] <= most_cost and size[label] < size[best]:
                best = label
        new[here] = best


def of_best_kind(about: Neighbourhoods, surfaces: Sequence[Surface], labels: IntArray) -> list[Surface]:
    """Each surface by the kind of most score for its points, labels (n,): a cone may become a cylinder."""
    every = [(surface, np.flatnonzero(labels == number)) for number, surface in enumerate(surfaces, start=1)]
    return [best_of_kinds(about, members, surface) or surface for surface, members in every]


def best_of_kinds(about: Neighbourhoods, members: IntArray, known: Surface | None = None) -> Surface | None:
    """The surface of most score for some points (m,), of any kind, or the one `known`; None if none fits."""
    if not len(members):
        return None
    points, best, most = about.points[members], None, -np.inf
    tried = [surface for kind in KINDS for surface in likely(about, kind, members)]
    for other in ([] if known is None else [known]) + tried:
        adapted = refine_surface(other, points, about.tolerance_m, len(points))
        score = -np.inf if adapted is None else score_of(adapted[0], points, about.tolerance_m)
        if adapted is not None and score > most:
            best, most = adapted[0], score
    return best


def misfits(about: Neighbourhoods, surfaces: Sequence[Surface]) -> FloatArray:
    """Cost (n, m + 1) of each point on each surface, and on none (column 0)."""
    cost = np.full((len(about.points), len(surfaces) + 1), GAIN, dtype=np.float64)
    for number, surface in enumerate(surfaces, start=1):
        share = surface.distance(about.points) / about.tolerance_m
        np.minimum(share * share / 2, 2 * GAIN, out=cost[:, number])
    return cost


def _swept(about: Neighbourhoods, cost: FloatArray, labels: IntArray) -> IntArray:
    new = labels.copy()
    for _ in range(_N_SWEEPS):
        if _sweep(about.links.indptr, about.links.indices, cost, new, STEP) == 0:
            break
    return new


@compiled
def _sweep(first: IntArray, beside: IntArray, cost: FloatArray, labels: IntArray, step: float) -> int:
    """Give each point in turn the label that costs least among its own, its neighbours' and none."""
    changed = 0
    for here in range(len(labels)):
        best, least = labels[here], np.inf
        for turn in range(first[here] - 2, first[here + 1]):
            if turn == first[here] - 2:
                label = labels[here]
            elif turn == first[here] - 1:
                label = 0
            else:
                label = labels[beside[turn]]
            total = cost[here, label]
            for place in range(first[here], first[here + 1]):
                if labels[beside[place]] != label:
                    total += step
            if total < least - 1e-12:
                best, least = label, total
        if best != labels[here]:
            labels[here] = best
            changed += 1
    return changed


def _needed(
    about: Neighbourhoods, surfaces: Sequence[Surface], cost: FloatArray, labels: IntArray
) -> IntArray:
    """Labels (n,) without those whose points the surfaces beside them explain nearly as well.

    A label stays where its points, and its borders, cost less by more than its parameters are worth.
    """
    labels, size = labels.copy(), np.bincount(labels, minlength=len(surfaces) + 1)
    rows = np.repeat(np.arange(len(labels)), np.diff(about.links.indptr))
    for number in np.argsort(size[1:], kind="stable") + 1:
        members = np.flatnonzero(labels == number)
        if not len(members):
            continue
        is_edge = labels[rows] == number
        inner, outer = rows[is_edge], about.links.indices[is_edge]
        beside = np.unique(labels[outer])
        beside = np.union1d(beside[beside != number], 0)
        choice = beside[np.argmin(cost[np.ix_(members, beside)], axis=1)]
        other = labels.copy()
        other[members] = choice
        inside = labels[outer] == number  # such links are met from both ends
        borders = STEP * float(
            np.sum((other[inner] != other[outer]) * np.where(inside, 0.5, 1.0)) - np.sum(~inside)
        )
        worse = float(np.sum(cost[members, choice] - cost[members, number]))
        if worse + borders <= parameter_cost(surfaces[number - 1].kind, len(members)):
            labels = other
    return labels


def _refit(
    about: Neighbourhoods, surfaces: Sequence[Surface], labels: IntArray
) -> tuple[list[Surface], IntArray]:
    """The surfaces through their points again; those that explain too little go."""
    kept, new = list[Surface](), np.zeros_like(labels)
    for number, surface in enumerate(surfaces, start=1):
        members = np.flatnonzero(labels == number)
        if not len(members):
            continue
        points = about.points[members]
        pair = refine_surface(surface, points, about.tolerance_m)
        moved = surface if pair is None else pair[0]
        if score_of(moved, points, about.tolerance_m) <= 0:
            continue
        kept.append(moved)
        new[members] = len(kept)
    return kept, new


def without_islands(about: Neighbourhoods, labels: IntArray, least: int = ISLAND) -> IntArray:
    """Labels (n,) less the connected pieces of a label that have fewer than `least` points."""
    _, piece = pieces_of(about, labels)
    count = np.bincount(piece)
    return np.where(count[piece] >= least, labels, 0)


def pieces_of(about: Neighbourhoods, labels: IntArray) -> tuple[int, IntArray]:
    """The connected pieces of equal labels (n,): how many, and which each point is in."""
    rows = np.repeat(np.arange(len(labels)), np.diff(about.links.indptr))
    links = about.links.copy()
    links.data = (labels[rows] == labels[links.indices]).astype(np.float64)
    links.eliminate_zeros()
    n, piece = connected_components(links, directed=False)
    return int(n), piece.astype(np.int64)
