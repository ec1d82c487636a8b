# SPDX-License-Identifier: MIT
"""Features on one page: from scans, points or a mesh to objects fitted whole, with what speaks for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from completion.features.engine.feature_set import Features
from completion.features.engine.options import KNOWN, OPENINGS
from completion.features.engine.template import Given, Measured, TemplateFit, best_first
from completion.features.holes.pipeline import find_holes
from completion.features.junctions.pipeline import find_junctions
from completion.features.material import of_scans
from completion.features.openings.scans import find_openings_of_scans
from completion.features.solids.pipeline import find_solids
from scenes.checks import InputError, check_rng
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage

KINDS = tuple(KNOWN)
"""What can be found."""

_BUDGET = 200_000
_FINDERS = {
    **dict.fromkeys(("hole-row", "hole-grid", "bolt-circle"), find_holes),
    **dict.fromkeys(("junction", "elbow"), find_junctions),
    **dict.fromkeys(("stairs", "column"), find_solids),
}


def find_features(
    material: Sequence[RangeImage] | Measured,
    kinds: Sequence[str],
    *,
    given: Mapping[str, Given] | None = None,
    evaluations: int = _BUDGET,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
    journal: Journal = NO_JOURNAL,
) -> Features:
    """Find objects of several faces by what is known of them (after Fisher, section 3).

    Each is fitted whole, from whatever fragments show of it. It is accepted where what was measured speaks
    for it, and refused, with the reason, where it speaks against it; what nobody saw of it is said. An
    interrupt, or the end of the budget, leaves the best so far, marked as such.

    Parameters
    ----------
    material : sequence of RangeImage, or Measured
        Registered scans; or points or a mesh (`material.of_points`). Doorways, windows and niches need scans:
        points do not say where beams went on.
    kinds : sequence of str
        Some of `KINDS`.
    given : mapping, optional
        What a person knows of each kind, by name (`given.KNOWN`). It is held exactly.
    evaluations : int
        Of each search at most.
    rng : Generator, int or None
        Seed of the searches.
    n_threads, progress, journal
        As in `complete`.

    Raises
    ------
    InputError
        No material, an unknown kind, openings asked of points, fewer than 20 points.
    """
    _check(material, kinds)
    known, draws = given or {}, check_rng(rng)
    is_whole, found, doubts = True, list[TemplateFit](), list[str]()
    openings = [kind for kind in kinds if kind in OPENINGS]
    others = [kind for kind in kinds if kind not in OPENINGS]
    try:
        # 1. Openings: doorways, windows and niches in every upright plane, by beams that go on or stop.
        if openings and not isinstance(material, Measured):
            sizes = [scan.ranges.size for scan in material]
            with Steps.over(sizes, n_threads, progress, journal) as steps:
                fits, told = find_openings_of_scans(material, openings, known, steps)
            found, doubts = [*found, *fits], [*doubts, *told]

        # 2. Others: solids, patterns of holes and junctions, in the points of all scans together.
        if others:
            measured = material if isinstance(material, Measured) else of_scans(material)
        for done, kind in enumerate(others):
            if progress is not None:
                progress("features", done, len(others))
            found += _FINDERS[kind](measured, [kind], known.get(kind, {}), rng=draws, budget=evaluations)
    except KeyboardInterrupt:
        is_whole = False

    # 3. Order: found, ambiguous, refused, the most evident of each first.
    n_points = (
        len(material.points)
        if isinstance(material, Measured)
        else sum(int(np.count_nonzero(scan.valid)) for scan in material)
    )
    is_whole = is_whole and all(fit.is_complete for fit in found)
    return Features(tuple(best_first(found)), n_points, is_complete=is_whole, doubts=tuple(doubts))


def _check(material: Sequence[RangeImage] | Measured, kinds: Sequence[str]) -> None:
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"there is no feature called {kind!r}; there are {', '.join(KINDS)}")
    if not kinds:
        raise InputError(f"say what to find: {', '.join(KINDS)}")
    openings = [kind for kind in kinds if kind in OPENINGS]
    if isinstance(material, Measured):
        if openings:
            raise InputError(
                f"a {openings[0]} is seen by beams that go through it, and points have none: give scans, or "
                "say where points were measured from (--origin X,Y,Z)"
            )
    elif not len(material):
        raise InputError("no scans: give at least one")
