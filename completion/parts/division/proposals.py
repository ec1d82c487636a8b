# SPDX-License-Identifier: MIT
"""Proposals: surfaces grown from where points are smooth, then from what those leave unexplained."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.parts.division.growing import GAIN, LEAST_ANGLE, Grown, best_grown, joint, score_of
from completion.parts.division.labelling import first_labels
from completion.parts.division.neighbourhoods import Neighbourhoods
from completion.parts.division.thinning import LEAST
from scenes.checks import BoolArray, IntArray
from scenes.run.steps import Progress

_PATCHES = (12, 24, 48)  # points about a seed, where what is left is several surfaces
_MOST_SEEDS = 6  # of them in a rest


def proposals(about: Neighbourhoods, tell: Progress) -> list[Grown]:
    """Return surfaces that explain the points, each with points of its own, as they were found.

    `tell` hears how many of the points are explained.
    """
    free = np.ones(len(about.points), dtype=np.bool_)
    tree = cKDTree(about.points)
    found = _joined(about, _from_smooth(about, free, tree, tell), free)
    return _joined(about, found + _from_rests(about, free, tell), free)


def _from_smooth(about: Neighbourhoods, free: BoolArray, tree: cKDTree, tell: Progress) -> list[Grown]:
    """From seeds whose neighbourhoods are largest on."""
    found: list[Grown] = []
    untried = about.is_smooth.copy()
    for seed in np.lexsort((np.arange(len(free)), -about.reach)):
        if not (untried[seed] and free[seed]):
            continue
        near = np.atleast_1d(tree.query(about.points[seed], k=int(about.reach[seed]))[1])
        inner = near[: max(LEAST, len(near) // 2)]  # what does not fit lies at the border
        untried[inner] = False
        patch = inner[free[inner]]
        if len(patch) < max(LEAST, len(inner) // 2):
            continue
        best = best_grown(about, patch, free)
        if best is not None:
            found.append(best)
            free[best.members] = False
            tell("grow", len(free) - int(np.count_nonzero(free)), len(free))
    return found


def _from_rests(about: Neighbourhoods, free: BoolArray, tell: Progress) -> list[Grown]:
    """From what is left, piece by piece: as a whole, or about seeds in it."""
    found: list[Grown] = []
    failed: set[bytes] = set()
    while True:
        new: list[Grown] = []
        for rest in _pieces(about, free):
            if rest.tobytes() in failed:
                continue
            best = best_grown(about, rest, free)
            if best is None or len(best.members) < 0.8 * len(rest):
                best = _better(best, _about_seeds(about, rest, free))
            if best is None:
                failed.add(rest.tobytes())
            else:
                new.append(best)
                free[best.members] = False
                tell("grow", len(free) - int(np.count_nonzero(free)), len(free))
        if not new:
            return found
        found += new


def _joined(about: Neighbourhoods, found: list[Grown], free: BoolArray) -> list[Grown]:
    """The surfaces with neighbours replaced by one surface where that makes all points likelier.

    What grew from a patch across a border is of a wrong kind and small; two of them together tell the kind.
    """
    tolerance, tried = about.tolerance_m, set[tuple[int, int]]()
    names = dict(enumerate(found))
    owner = _owners(about, names)
    waiting = _beside(about, names, owner)
    while waiting:
        pair = waiting.pop(0)
        if pair in tried:
            continue
        tried.add(pair)
        new = joint(about, np.flatnonzero(np.isin(owner, pair)))
        if new is None:
            continue
        taken = np.zeros(len(owner), dtype=np.bool_)
        taken[new.members] = True
        touched = [number for number in names if taken[owner == number].any()]
        before, after = 0.0, 0.0
        for number in touched:
            points = about.points[owner == number]
            rest = about.points[(owner == number) & ~taken]
            before += score_of(names[number].surface, points, tolerance)
            after += max(score_of(names[number].surface, rest, tolerance), 0.0)
        mine = new.members[np.isin(owner[new.members], [*touched, -1])]
        after += score_of(new.surface, about.points[mine], tolerance)
        gone = [
            number
            for number in touched
            if score_of(names[number].surface, about.points[(owner == number) & ~taken], tolerance) <= 0
        ]
        if after <= before + GAIN or len(gone) < 2:
            continue
        for number in gone:
            del names[number]
        names[max([*names, *(one for pair in tried for one in pair)]) + 1] = new
        owner = _owners(about, names)
        waiting = _beside(about, names, owner)
    free[:] = owner < 0
    return list(names.values())


def _owners(about: Neighbourhoods, names: dict[int, Grown]) -> IntArray:
    """Which surface each point (n,) is on, by its number; -1 for none."""
    numbers = np.array([*names, -1])
    labels = first_labels(about, list(names.values()))
    return numbers[labels - 1]


def _beside(about: Neighbourhoods, names: dict[int, Grown], owner: IntArray) -> list[tuple[int, int]]:
    """Pairs of surfaces that go over into each other without an edge, the smallest first."""
    rows = np.repeat(np.arange(len(owner)), np.diff(about.links.indptr))
    one, two = owner[rows], owner[about.links.indices]
    differ = np.flatnonzero((one >= 0) & (one < two))
    normals = np.zeros_like(about.points)
    for number, grown in names.items():
        own = owner == number
        normals[own] = grown.surface.normal(about.points[own])
    turned = np.abs(np.einsum("ij,ij->i", normals[rows[differ]], normals[about.links.indices[differ]]))
    smooth = differ[turned > np.cos(LEAST_ANGLE)]
    pairs, count = np.unique(np.column_stack([one, two])[smooth], axis=0, return_counts=True)
    size = np.bincount(owner[owner >= 0], minlength=int(owner.max(initial=0)) + 1)
    order = np.argsort(size[pairs].max(axis=1), kind="stable")
    return [(int(pairs[k, 0]), int(pairs[k, 1])) for k in order if count[k] >= 3]


def _pieces(about: Neighbourhoods, free: BoolArray) -> list[IntArray]:
    """The connected pieces of what is free, largest first."""
    places = np.flatnonzero(free)
    links = about.links[places][:, places]
    n, label = connected_components(links, directed=False)
    order = np.argsort(label, kind="stable")
    bounds = np.cumsum(np.bincount(label, minlength=n))[:-1]
    pieces = [places[some] for some in np.split(order, bounds)]
    return sorted(
        (piece for piece in pieces if len(piece) >= LEAST), key=lambda piece: (-len(piece), piece[0])
    )


def _about_seeds(about: Neighbourhoods, rest: IntArray, free: BoolArray) -> Grown | None:
    """The best surface from patches about points of a piece."""
    tree, best = cKDTree(about.points[rest]), None
    for seed in rest[np.linspace(0, len(rest) - 1, min(_MOST_SEEDS, len(rest))).astype(np.int64)]:
        for size in _PATCHES:
            if size > len(rest):
                break
            near = rest[tree.query(about.points[seed], k=size)[1]]
            best = _better(best, best_grown(about, near, free))
            if best is not None and np.count_nonzero(free[best.members]) >= 0.8 * len(rest):
                return best
    return best


def _better(one: Grown | None, two: Grown | None) -> Grown | None:
    if one is None or two is None:
        return one or two
    return two if two.score > one.score else one
