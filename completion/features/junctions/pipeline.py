# SPDX-License-Identifier: MIT
"""Junctions on one page: all points as one, or patches, pairs of them, and a fit for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.features.engine.template import Given, Measured, Status, TemplateFit, best_first
from completion.features.engine.template_fit import NOTHING
from completion.features.junctions.bend import fit_elbow
from completion.features.junctions.models import Unit, at_unit
from completion.features.junctions.patches import Cloud, Patch, cloud_of, find_patches
from completion.features.junctions.tangent import fit_junction
from scenes.checks import FloatArray, InputError, IntArray

_LEAST_TOUCHING = 6  # pairs of neighbours
_PARALLEL, _ACROSS, _TANGENT = np.cos(np.radians(15.0)), np.sin(np.radians(15.0)), np.cos(np.radians(25.0))
_ALIKE = 0.2  # of a radius, by which two tubes of a pipe may differ
_LEAST_TURN = np.sin(np.radians(8.0))
_MISS, _FAR, _OUT, _ARM = 0.8, 9.0, 2.2, 8.0  # radii: axes apart, corner away, bend off the axes, arms
_LEAST_POINTS = 60


class Candidate(NamedTuple):
    """Where a feature may be: its kind, and points (n, 3) about it, by truth (n,) of the cloud."""

    kind: str
    members: IntArray
    worth: float  # points of the smaller patch: the order in which they are tried


def touching(cloud: Cloud, patches: list[Patch]) -> list[Candidate]:
    """Return pairs of patches that lie side by side with one normal at their border."""
    label = np.full(len(cloud.points), -1)
    for k, patch in enumerate(patches):
        label[patch.members] = k
    found = []
    for (i, j), border in _borders(cloud, label).items():
        first, second = patches[i], patches[j]
        if len(border) < _LEAST_TOUCHING or (first.is_flat and second.is_flat):
            continue
        if not _are_tangent(first, second, cloud.points[border]):
            continue
        members = _about(cloud, first, second, border)
        if len(members) >= _LEAST_POINTS:
            found.append(Candidate("junction", members, float(min(len(first.members), len(second.members)))))
    return sorted(found, key=lambda one: -one.worth)


def _borders(cloud: Cloud, label: IntArray) -> dict[tuple[int, int], IntArray]:
    """Points (b,) of pairs that have a neighbour of another patch; narrow gaps of free points are closed."""
    closed = label.copy()
    for _ in range(2):
        free = np.flatnonzero(closed < 0)
        around = closed[cloud.neighbours[free]]
        for one in around.T:
            take = (closed[free] < 0) & (one >= 0)
            closed[free[take]] = one[take]
    row, column = np.nonzero(closed[cloud.neighbours] != closed[:, None])
    other = closed[cloud.neighbours[row, column]]
    own = closed[row]
    good = (own >= 0) & (other >= 0)
    pairs: dict[tuple[int, int], list[int]] = {}
    for a, b, point in zip(own[good], other[good], row[good], strict=True):
        pairs.setdefault((int(min(a, b)), int(max(a, b))), []).append(int(point))
    return {pair: np.unique(points) for pair, points in sorted(pairs.items())}


def _are_tangent(first: Patch, second: Patch, border: FloatArray) -> bool:
    """Whether both surfaces have one direction along, and one normal at points (b, 3) of the border."""
    axes = [patch.fit.model.turn[2] for patch in (first, second)]
    normals = [patch.fit.model.section(border).slope @ patch.fit.model.turn for patch in (first, second)]
    agree = np.abs(np.einsum("ij,ij->i", *normals))
    if first.is_flat or second.is_flat:
        flat, round_ = (0, 1) if first.is_flat else (1, 0)
        is_along = abs(float(np.median(normals[flat] @ axes[round_]))) < _ACROSS
    else:
        is_along = abs(float(axes[0] @ axes[1])) > _PARALLEL
    return bool(is_along and np.median(agree) > _TANGENT)


def _about(cloud: Cloud, first: Patch, second: Patch, border: IntArray) -> IntArray:
    """Points (m,) of both patches, and free ones, as far from the border as the narrower patch is wide."""
    tree = cKDTree(cloud.points[border])
    widths = [float(tree.query(cloud.points[patch.members])[0].max()) for patch in (first, second)]
    reach = 1.2 * min(widths) + 2 * cloud.spacing
    both = np.union1d(first.members, second.members)
    return np.asarray(both[tree.query(cloud.points[both])[0] <= reach])


def crossing(cloud: Cloud, patches: list[Patch]) -> list[Candidate]:
    """Return pairs of tubes of like radii whose axes cross not far from both."""
    tubes = [patch for patch in patches if not patch.is_flat and len(patch.members) >= _LEAST_POINTS // 2]
    found = []
    for i, first in enumerate(tubes):
        for second in tubes[:i]:
            if abs(first.radius - second.radius) > _ALIKE * max(first.radius, second.radius):
                continue
            members = _pipe(cloud, first, second)
            if len(members) >= _LEAST_POINTS:
                worth = float(min(len(first.members), len(second.members)))
                found.append(Candidate("elbow", members, worth))
    return sorted(found, key=lambda one: -one.worth)


def _pipe(cloud: Cloud, first: Patch, second: Patch) -> IntArray:
    """Points (m,) about the axes of two tubes, from where these cross; none where they do not."""
    none = np.zeros(0, dtype=np.int64)
    radius = (first.radius + second.radius) / 2
    axes = [_axis(patch) for patch in (first, second)]
    (p, a), (q, b) = axes
    sine = float(np.linalg.norm(np.cross(a, b)))
    if sine < _LEAST_TURN or abs(float((q - p) @ np.cross(a, b))) / sine > _MISS * radius:
        return none
    along = float(a @ b)
    s, t = np.linalg.solve([[1.0, -along], [along, -1.0]], [(q - p) @ a, (q - p) @ b])
    corner = (p + s * a + q + t * b) / 2
    on = np.zeros(len(cloud.points), dtype=np.bool_)
    for patch, axis in ((first, a), (second, b)):
        reach = (cloud.points[patch.members] - corner) @ axis
        way = np.sign(np.median(reach)) * axis
        if np.quantile(np.abs(reach), 0.05) > _FAR * radius or np.median(reach) == 0:
            return none
        local = cloud.points - corner
        height = np.clip(local @ way, 0.0, max(_ARM * radius, float(np.quantile(np.abs(reach), 0.5))))
        on |= np.linalg.norm(local - height[:, None] * way, axis=1) < _OUT * radius
    return np.flatnonzero(on)


def _axis(patch: Patch) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of a tube's axis, and its direction (3,)."""
    model = patch.fit.model
    return model.origin - model.turn[0] / model.shape[0], model.turn[2]


KINDS = ("junction", "elbow")
_FITS = {"junction": fit_junction, "elbow": fit_elbow}
_CANDIDATES = {"junction": touching, "elbow": crossing}
_MOST_POINTS = 6_000  # that one fit looks at
_WHOLE = 0.5  # of all points, that are on a feature which is all of them
_SAME = 0.5  # of the smaller radius, between the joints of two fits that are one


def find_junctions(
    measured: Measured,
    kinds: Sequence[str],
    given: Given = NOTHING,
    *,
    rng: np.random.Generator,
    budget: int = 200_000,
) -> list[TemplateFit]:
    """Find where surfaces run into each other: tangent junctions (fillets among them) and elbows of pipes.

    Parameters
    ----------
    measured : Measured
        Points (n, 3) of a junction, or of a whole part or pipe.
    kinds : sequence of str
        Of "junction", "elbow".
    given : mapping
        What is known, held exactly: "radius_1", "radius_2" (inf for a plane); "bend_radius", "tube_radius",
        "angle" (radians).
    rng : Generator
        Which points a fit looks at where there are more than it needs.
    budget : int
        Evaluations at most; the candidates that are left then are not tried, and no fit is complete.

    Returns
    -------
    list of TemplateFit
        The best first; where nothing is found, what is told of all points as one.

    Raises
    ------
    InputError
        Another kind; a given value that is not above 0.
    """
    _check(kinds, given)
    whole = [_fit(kind, measured, np.arange(len(measured.points)), given, rng=rng) for kind in kinds]
    # what all points leave open, some of them cannot decide: a patch hides what speaks against it
    told = [one for one in whole if one.status is not Status.NONE]
    at_once = [one for one in told if (one.assignment > 0).mean() > _WHOLE]
    if at_once:
        return best_first(at_once)

    # 1. Patches: where points are one plane or cylinder.
    unit = at_unit(measured)
    cloud = cloud_of(unit)
    patches = find_patches(cloud)

    # 2. Candidates: pairs that touch along a line, or whose axes cross; each is fitted by its points.
    tried = [one for kind in kinds for one in _CANDIDATES[kind](cloud, patches)]
    found, spent, is_complete = [], sum(one.evaluations for one in whole), True
    for candidate in tried:
        if spent >= budget:
            is_complete = False
            break
        fit = _fit(candidate.kind, measured, _members(unit, cloud, candidate), given, rng=rng)
        spent += fit.evaluations
        if fit.status is not Status.NONE:
            found.append(fit)

    # 3. One of each: of fits that are the same, the one with more evidence.
    kept = _distinct(best_first(found)) if found else whole
    return [replace(one, is_complete=is_complete) for one in best_first(kept)]


def _check(kinds: Sequence[str], given: Given) -> None:
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no junction {unknown[0]}; there are {', '.join(KINDS)}")
    wrong = [name for name, value in given.items() if not value > 0]
    if wrong:
        raise InputError(f"{wrong[0]} is given as {given[wrong[0]]}; give a number above 0")


def _members(unit: Unit, cloud: Cloud, candidate: Candidate) -> IntArray:
    """The points (m,) of all about a candidate, by number: those beside its points of the cloud."""
    if len(cloud.points) == len(unit.points):
        return cloud.which[candidate.members]
    apart, _ = cKDTree(cloud.points[candidate.members]).query(
        unit.points, distance_upper_bound=1.5 * cloud.spacing
    )
    return np.flatnonzero(np.isfinite(apart))


def _fit(
    kind: str, measured: Measured, members: IntArray, given: Given, *, rng: np.random.Generator
) -> TemplateFit:
    """The fit to some points (m,), told of all."""
    chosen = members
    if len(members) > _MOST_POINTS:
        chosen = np.sort(rng.choice(members, _MOST_POINTS, replace=False))
    spacing = measured.spacing * np.sqrt(max(1.0, len(members) / max(len(chosen), 1)))
    part = replace(measured, points=measured.points[chosen], spacing=spacing, beam_of_point=None, faces=None)
    fit = _FITS[kind](part, given)
    assignment = np.zeros(len(measured.points), dtype=np.int64)
    if len(chosen) and fit.status is not Status.NONE:
        _, nearest = cKDTree(measured.points[chosen]).query(measured.points[members])
        assignment[members] = fit.assignment[nearest]
    return replace(fit, assignment=assignment)


def _distinct(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """Those whose joint is not that of one before."""
    kept: list[TemplateFit] = []
    for fit in fits:
        if not any(_are_same(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _are_same(first: TemplateFit, second: TemplateFit) -> bool:
    """Whether two fits of a kind have their joints in one place."""
    if first.kind != second.kind:
        return False
    ends = [np.asarray(one.geometry["joint"]) for one in (first, second)]
    radii = [np.asarray(one.geometry["radii"]) for one in (first, second)]
    size = min(float(r[np.isfinite(r)].min()) for r in radii)
    if first.kind == "elbow":
        middles = [one.x[3:6] for one in (first, second)]
        return bool(np.linalg.norm(middles[0] - middles[1]) < 2 * _SAME * size)
    axis = (ends[0][1] - ends[0][0]) / max(float(np.linalg.norm(ends[0][1] - ends[0][0])), 1e-300)
    gap = ends[1].mean(axis=0) - ends[0].mean(axis=0)
    across = float(np.linalg.norm(gap - (gap @ axis) * axis))
    length = float(np.linalg.norm(ends[0][1] - ends[0][0]) + np.linalg.norm(ends[1][1] - ends[1][0])) / 2
    return bool(across < _SAME * size and abs(float(gap @ axis)) < length)
