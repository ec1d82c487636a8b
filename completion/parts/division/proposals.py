# SPDX-License-Identifier: MIT
"""Proposals: surfaces that explain the points, grown from smooth places, then from what those leave.

A surface is worth what it explains and no other does: points that noise puts beside one are no sign of
another of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.parts.division.growing import GAIN, GrownRegion, best_grown, joint, rings_around, score_of
from completion.parts.division.labelling import first_labels
from completion.parts.division.limits import LEAST_ANGLE, LEAST_OF_MANY, LEAST_POINTS, MANY_FACES
from completion.parts.division.neighbourhoods import N_LINKS, Neighbourhoods
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.run.steps import Progress

_HALF = GAIN / 2  # what another surface explains worse may be of one of its own
_N_BESIDE = 2  # neighbours from a surface's points, to which it may explain others
_N_FIRST = 8  # surfaces that tell how alike neighbours err
_LEAST_TELLING, _MOST_TELLING, _N_ASKED = 40, 200, 1_000  # neighbours that say so, and of how many points
_PATCHES = (12, 24, 48)  # points about a seed, where what is left is several surfaces
_MOST_SEEDS = 6  # of them in a rest


def proposals(about: Neighbourhoods, tell: Progress) -> list[GrownRegion]:
    """Return surfaces that explain the points, each with points of its own, as they were found.

    `tell` hears how many of the points are explained. Of a free form (`is_free_form`) only those that
    grew before it was known for one.
    """
    tree, worth = cKDTree(about.points), np.full(len(about.points), GAIN)
    about = _with_alike(about, tree)
    regions = from_smooth(about, worth, tree, tell)
    if is_free_form(len(regions), worth > 0):
        return regions
    regions = _join_neighbours(about, regions)
    worth = _worth(about, regions)
    return _join_neighbours(about, regions + _from_rests(about, worth, tell))


def _with_alike(about: Neighbourhoods, tree: cKDTree) -> Neighbourhoods:
    """How alike neighbours err, by what the first surfaces say that grow without asking for it.

    Scanners smooth, and err alike over a few points: the mean of these says less then than of others. What
    the mean of the nearest is off that of many about them counts: a surface that grew too far is off both.
    By the quarter of the surfaces that say least.
    """
    every = np.full(len(about.points), GAIN)
    first = from_smooth(about, every, tree, lambda *_: None, lambda regions, _: len(regions) >= _N_FIRST)
    ratios = []
    for points, surface in ((about.points[region.members], region.surface) for region in first):
        n = min(len(points) // 4, _MOST_TELLING)
        if n < _LEAST_TELLING:
            continue
        off = surface.distance(points)
        if not np.median(np.abs(off)):
            continue
        near = off[cKDTree(points).query(points[:: max(1, len(points) // _N_ASKED)], k=n)[1]]
        apart = near[:, : N_LINKS + 1].mean(axis=1) - near.mean(axis=1)
        ratio = np.median(apart**2) / np.median(near[:, 0] ** 2) / (1 / (N_LINKS + 1) - 1 / n)
        ratios.append(float(ratio))
    alike = float(np.quantile(ratios, 0.25)) if ratios else 1.0
    return replace(about, alike=max(alike, 1.0))


def _worth(about: Neighbourhoods, regions: Sequence[GrownRegion]) -> FloatArray:
    """What it is worth to explain each point (n,) that surfaces leave."""
    worth = np.full(len(about.points), GAIN)
    for region in regions:
        _take(about, region, worth)
    return worth


def _take(about: Neighbourhoods, region: GrownRegion, worth: FloatArray) -> None:
    """Lower what it is worth to explain points (n,): a surface explains its own, and somehow those beside.

    Near an edge normals are of neither side where noise hides it: such points are left out, but are no sign
    of a surface of their own.
    """
    links = about.links
    near = rings_around(links.indptr, links.indices, worth > 0, region.members, _N_BESIDE)
    share = region.surface.distance(about.points[near]) / about.tolerance_m
    worth[near] = np.minimum(worth[near], share * share / 2)
    worth[region.members] = 0.0


def is_free_form(n_regions: int, free: BoolArray) -> bool:
    """Whether so many regions leave so many points (n,) free that these are of no part.

    Seeds come by the size of their smooth neighbourhood, so that the largest faces grow first.
    """
    return n_regions >= MANY_FACES and float(free.mean()) > 1 - LEAST_OF_MANY


def from_smooth(
    about: Neighbourhoods,
    worth: FloatArray,
    tree: cKDTree,
    tell: Progress,
    ends: Callable[[list[GrownRegion], BoolArray], bool] = lambda regions, free: is_free_form(
        len(regions), free
    ),
) -> list[GrownRegion]:
    """Return surfaces grown from seeds whose neighbourhoods are largest on.

    It is `worth` (n,) less to explain what they do. `ends` tells of the surfaces and what is free whether
    these are enough.
    """
    regions: list[GrownRegion] = []
    untried = about.is_smooth.copy()
    for seed in np.lexsort((np.arange(len(worth)), -about.reach)):
        if not (untried[seed] and worth[seed] > _HALF):
            continue
        near = np.atleast_1d(tree.query(about.points[seed], k=int(about.reach[seed]))[1])
        inner = near[: max(LEAST_POINTS, len(near) // 2)]  # what does not fit lies at the border
        untried[inner] = False
        patch = inner[worth[inner] > 0]
        if len(patch) < max(LEAST_POINTS, len(inner) // 2):
            continue
        best = best_grown(about, patch, worth)
        if best is not None:
            regions.append(best)
            _take(about, best, worth)
            tell("grow", len(worth) - int(np.count_nonzero(worth)), len(worth))
            if ends(regions, worth > 0):
                break
    return regions


def _from_rests(about: Neighbourhoods, worth: FloatArray, tell: Progress) -> list[GrownRegion]:
    """From what is left, piece by piece: as a whole, or about seeds in it."""
    rests: list[GrownRegion] = []
    failed: set[bytes] = set()
    while True:
        new: list[GrownRegion] = []
        for piece in _pieces(about, worth > _HALF):
            if piece.tobytes() in failed:
                continue
            best = best_grown(about, piece, worth)
            if best is None or len(best.members) < 0.8 * len(piece):
                best = _better(best, _about_seeds(about, piece, worth))
            if best is None:
                failed.add(piece.tobytes())
            else:
                new.append(best)
                _take(about, best, worth)
                tell("grow", len(worth) - int(np.count_nonzero(worth)), len(worth))
        if not new:
            return rests
        rests += new


def _join_neighbours(about: Neighbourhoods, regions: list[GrownRegion]) -> list[GrownRegion]:
    """The surfaces with neighbours replaced by one surface where that makes all points likelier.

    What grew from a patch across a border is of a wrong kind and small; two of them together tell the kind.
    """
    tolerance, tried = about.tolerance_m, set[tuple[int, int]]()
    names = dict(enumerate(regions))
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
            remaining = about.points[(owner == number) & ~taken]
            before += score_of(names[number].surface, points, tolerance)
            after += max(score_of(names[number].surface, remaining, tolerance), 0.0)
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
        names[max([*names, *(number for pair in tried for number in pair)]) + 1] = new
        owner = _owners(about, names)
        waiting = _beside(about, names, owner)
    return list(names.values())


def _owners(about: Neighbourhoods, names: dict[int, GrownRegion]) -> IntArray:
    """Which surface each point (n,) is on, by its number; -1 for none."""
    numbers = np.array([*names, -1])
    labels = first_labels(about, list(names.values()))
    return numbers[labels - 1]


def _beside(about: Neighbourhoods, names: dict[int, GrownRegion], owner: IntArray) -> list[tuple[int, int]]:
    """Pairs of surfaces that go over into each other without an edge, the smallest first."""
    rows = np.repeat(np.arange(len(owner)), np.diff(about.links.indptr))
    first, two = owner[rows], owner[about.links.indices]
    differ = np.flatnonzero((first >= 0) & (first < two))
    normals = np.zeros_like(about.points)
    for number, grown in names.items():
        is_member = owner == number
        normals[is_member] = grown.surface.normal(about.points[is_member])
    turned = np.abs(np.einsum("ij,ij->i", normals[rows[differ]], normals[about.links.indices[differ]]))
    smooth = differ[turned > np.cos(LEAST_ANGLE)]
    pairs, count = np.unique(np.column_stack([first, two])[smooth], axis=0, return_counts=True)
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
    pieces = [places[group] for group in np.split(order, bounds)]
    return sorted(
        (piece for piece in pieces if len(piece) >= LEAST_POINTS), key=lambda piece: (-len(piece), piece[0])
    )


def _about_seeds(about: Neighbourhoods, piece: IntArray, worth: FloatArray) -> GrownRegion | None:
    """The best surface from patches about points of a piece."""
    tree, best = cKDTree(about.points[piece]), None
    for seed in piece[np.linspace(0, len(piece) - 1, min(_MOST_SEEDS, len(piece))).astype(np.int64)]:
        for size in _PATCHES:
            if size > len(piece):
                break
            near = piece[tree.query(about.points[seed], k=size)[1]]
            best = _better(best, best_grown(about, near, worth))
            if best is not None and np.count_nonzero(worth[best.members]) >= 0.8 * len(piece):
                return best
    return best


def _better(region: GrownRegion | None, two: GrownRegion | None) -> GrownRegion | None:
    if region is None or two is None:
        return region or two
    return two if two.score > region.score else region
