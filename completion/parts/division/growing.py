# SPDX-License-Identifier: MIT
"""Growing: a surface from where points are smooth on to where it still predicts them.

A surface fitted to a patch is known well there and badly far from it. A point joins where its distance is
within what noise and the surface's own deviation there explain, and where that deviation is small; with more
points the surface is known farther out. So it grows to the points it explains and no farther, and no radius
of search is given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from completion.fitting.result import SurfaceFit
from completion.parts.division.hypotheses import KINDS, N_PARAMETERS, adjusted, hypotheses
from completion.parts.division.neighbourhoods import Neighbourhoods
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Surface
from texture.engine.compiled import compiled


@compiled
def reached(first: IntArray, beside: IntArray, allowed: BoolArray, begin: IntArray) -> BoolArray:
    """Which points (n,) can be walked to from those in `begin`; `first`, `beside` are a sparse graph's."""
    found = np.zeros(len(allowed), dtype=np.bool_)
    stack = np.empty(len(allowed), dtype=np.int64)
    top = 0
    for one in begin:
        if allowed[one] and not found[one]:
            found[one] = True
            stack[top] = one
            top += 1
    while top > 0:
        top -= 1
        here = stack[top]
        for place in range(first[here], first[here + 1]):
            there = beside[place]
            if allowed[there] and not found[there]:
                found[there] = True
                stack[top] = there
                top += 1
    return found


CUT = 3.5  # deviations, within which a point is explained
GAIN = CUT**2 / 2  # what it is worth to explain a point, in logarithms of likelihood
_MOST_DEVIATION = 2.0  # tolerances: where a surface is known worse, it does not grow
LEAST_ANGLE = np.radians(15.0)  # between normals, below which points are told apart by their places
_N_ROUNDS = 40
_STILL = 0.01
_NEARLY_ALL = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """A surface, the points (n,) that it explains, and how much likelier it makes those that were free.

    The likelihood is given by its logarithm, less what the surface's parameters cost.
    """

    surface: Surface
    members: IntArray
    score: float


def score_of(surface: Surface, points: FloatArray, tolerance: float) -> float:
    """How much likelier a surface makes points (n, 3), less what its parameters cost (logarithms)."""
    share = surface.distance(points) / tolerance
    explained = np.maximum(GAIN - share * share / 2, 0.0)
    cost = N_PARAMETERS[surface.kind] * (GAIN + np.log(max(len(points), 2)) / 2)
    return float(explained.sum() - cost)


def grown(about: Neighbourhoods, surface: Surface, begin: IntArray, free: BoolArray) -> Grown | None:
    """Grow a surface from points `begin` (m,) over all that it explains; None where too few are `free` (n,).

    Points on the rim of two surfaces are on both: what is explained already still says where a surface is,
    but not that there is one.
    """
    tolerance, members = about.tolerance_m, begin
    seen: set[int] = set()
    n_least = N_PARAMETERS[surface.kind] + 2
    for _ in range(_N_ROUNDS):
        found = adjusted(surface, about.points[members], tolerance)
        if found is None:
            return None
        surface, covariance = found
        explained = _explained(about, surface, covariance)
        new = np.flatnonzero(reached(about.links.indptr, about.links.indices, explained, members))
        if np.count_nonzero(free[new]) < n_least:
            return None
        changed = len(np.setxor1d(new, members, assume_unique=True))
        members = new
        mark = hash(new.tobytes())
        if changed <= _STILL * len(new) or mark in seen:
            break
        seen.add(mark)
    own = members[free[members]]
    return Grown(surface, members, score_of(surface, about.points[own], tolerance))


def _explained(about: Neighbourhoods, surface: Surface, covariance: FloatArray) -> BoolArray:
    """Which points (n,) are near enough to the surface where it is known, and turned as it is."""
    tolerance = about.tolerance_m
    distance = np.abs(surface.distance(about.points))
    near = np.flatnonzero(distance <= CUT * tolerance * np.hypot(1, _MOST_DEVIATION))
    explained = np.zeros(len(about.points), dtype=np.bool_)
    if not len(near):
        return explained
    places = about.points[near]
    deviation = SurfaceFit(surface, tolerance, covariance, len(places)).standard_deviation(places)
    fits = distance[near] <= CUT * np.hypot(tolerance, deviation)
    fits &= deviation <= _MOST_DEVIATION * tolerance
    aligned = np.abs(np.einsum("ij,ij->i", surface.normal(places), about.normals[near]))
    turned = aligned < np.cos(np.minimum(np.maximum(CUT * about.normal_sd[near], LEAST_ANGLE), np.pi / 2))
    fits &= ~(turned & about.is_smooth[near])
    explained[near[fits]] = True
    return explained


def best_grown(about: Neighbourhoods, patch: IntArray, free: BoolArray) -> Grown | None:
    """The surface that explains most from a patch (m,) on, simple kinds first.

    Each kind begins from the patch, and from what the kinds before it explained with a margin of two points
    about it: a strip of a torus that a cylinder grew over begins the torus.
    """
    best: Grown | None = None
    for kind in KINDS:
        begins = [patch]
        if best is not None and len(best.members) > 1.5 * len(patch):
            begins.append(_widened(about.links, best.members))
        for begin in begins:
            for surface in likely(about, kind, begin):
                found = grown(about, surface, begin, free)
                if found is not None and found.score > 0 and (best is None or found.score > best.score):
                    best = found
    return best


def joint(about: Neighbourhoods, both: IntArray) -> Grown | None:
    """The surface of most score that explains nearly all of some points (m,), grown from them."""
    best: Grown | None = None
    everything = np.ones(len(about.points), dtype=np.bool_)
    for kind in KINDS:
        for surface in likely(about, kind, both, _NEARLY_ALL):
            found = grown(about, surface, both, everything)
            if found is not None and (best is None or found.score > best.score):
                best = found
    return best


def likely(about: Neighbourhoods, kind: str, begin: IntArray, share: float = 0.5) -> Iterator[Surface]:
    """The hypothesis of a kind that explains most of the points (m,) it is from, if that is such a share."""
    stride = max(1, len(begin) // 300)
    some = begin[::stride]
    points, normals = about.points[some], about.normals[some]
    best, most = None, share * len(some)
    for surface in hypotheses(kind, points, normals):
        moved: Surface | None = surface
        for factor in (30.0, 8.0, 2.0, 1.0):
            found = None if moved is None else adjusted(moved, points, factor * about.tolerance_m)
            moved = None if found is None else found[0]
        if moved is None:
            continue
        n_explained = int((np.abs(moved.distance(points)) <= CUT * about.tolerance_m).sum())
        if n_explained > most:
            best, most = moved, n_explained
    if best is not None:
        yield best


def _widened(links: csr_array, members: IntArray) -> IntArray:
    """The points (n,) and those within two steps of them."""
    mark = np.zeros(links.shape[0])
    mark[members] = 1.0
    for _ in range(2):
        mark = np.minimum(mark + links @ mark, 1.0)
    return np.flatnonzero(mark > 0)
