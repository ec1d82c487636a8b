# SPDX-License-Identifier: MIT
"""Junctions on one page: all points as one, or patches, pairs of them, and a fit for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from completion.templates.engine.fit import NOTHING
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Given, Status, TemplateFit, best_first
from completion.templates.junctions.bend import fit_elbow
from completion.templates.junctions.candidates import Candidate, crossing, touching
from completion.templates.junctions.patches import Cloud, cloud_of, find_patches
from completion.templates.junctions.starts import Unit, at_unit
from completion.templates.junctions.tangent import fit_junction
from scenes.checks import InputError, IntArray

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
