# SPDX-License-Identifier: MIT
"""Hole patterns on one page: rows, grids and bolt circles of equal holes in plates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.features.engine.template import Given, Measured, Status, TemplateFit, best_first
from completion.features.holes.candidates import LARGE, candidates
from completion.features.holes.lattices import lattices
from completion.features.holes.outcome import distinct, fit_of, nothing
from completion.features.holes.patterns import KINDS, PARAMETERS
from completion.features.holes.plates import Plate, plates, rim_corners, scattered
from completion.features.holes.proposals import proposals
from completion.features.holes.refinement import Refined, assigned, refine, sharpened, walls
from completion.features.holes.survey import openings, survey
from completion.features.holes.weighing import Ground, Weighed, climbed, windowed
from scenes.checks import BoolArray, InputError

_EXACT = 0.05  # spacings: how exactly the holes of a refined pattern are placed
_MOST_CLIMBED = 12  # lattices through pairs that are moved to where they are most evident
_MOST = 3  # patterns of one kind in one plate that are refined
_HOPELESS, _FURTHER = -7.0, 0.0  # nats, before refinement, of the best and of others: what is left out


def find_holes(
    measured: Measured, kinds: Sequence[str], given: Given, *, rng: np.random.Generator, budget: int
) -> list[TemplateFit]:
    """Find rows, grids and bolt circles of equal holes in the flat parts of what was measured.

    A hole is a circle with nothing of the plate inside and plate around it. So is a patch that was lost; but
    lost patches have no equal radii at equal distances, no beam comes back from behind the plate through
    them, and no wall of a bore stands on their rims. Whole patterns are weighed, never single holes.

    Parameters
    ----------
    measured : Measured
        Points, the triangles of a mesh, or a scan with its beams, in any unit.
    kinds : sequence of str
        Of "hole-row", "hole-grid" and "bolt-circle".
    given : mapping
        What is known and held: "radius", "pitch", "pitch_2", "circle_radius", "count", "count_2".
    rng : Generator
        Where the draws come from.
    budget : int
        Draws of refinement at most; what is found with them is marked as not complete.

    Returns
    -------
    list of TemplateFit
        All that was found or may be, the best first; of a kind without any, what came nearest. Each has a
        side a hole: confirmed, contradicted (measured surface fills it) or unseen.

    Raises
    ------
    InputError
        Another kind, or a value that is not positive.
    """
    _check(kinds, given)
    # a mesh is looked at as points all over it
    looked_at = scattered(measured, rng=rng)
    fits, spent = list[TemplateFit](), 0
    for plate in plates(looked_at, rng=rng):
        ground = _surveyed(plate, looked_at, given)
        for kind in kinds:
            for begun in _lattices(kind, ground, given):
                coarse, refined = _together(begun, ground, measured, given, rng=rng)
                fits.append(_against_chance(coarse, refined, ground, measured, given))
                spent += refined.evaluations
                if spent >= budget:
                    return _chosen(fits, kinds, measured, is_complete=False)
    return _chosen(fits, kinds, measured, is_complete=True)


def _surveyed(plate: Plate, looked_at: Measured, given: Given) -> Ground:
    """Step 1: the plate as it was measured, what went through it, and circles with nothing inside."""
    surveyed = survey(plate)
    opened = openings(plate, looked_at, surveyed.spacing)
    found = candidates(surveyed, opened, given.get("radius"))
    return Ground(surveyed, opened, found, surveyed.area)


def _lattices(kind: str, ground: Ground, given: Given) -> list[Weighed]:
    """Step 2: lattices through like circles, those that chance explains worst, and of each the best part."""
    begun = proposals(kind, ground.found, ground.area, ground.survey.spacing, given)
    wide = lattices(kind, ground.found, ground.survey, given)
    weighed = [[one for one in (windowed(proposal, ground, given) for proposal in some) if one is not None]
               for some in (begun, wide)]  # fmt: skip
    # two circles tell others less exactly than three: patterns through them are moved first
    promising = sorted(weighed[1], key=lambda one: -one.evidence)[:_MOST_CLIMBED]
    # ... and so are large circles, which many points hold
    wide_from = LARGE * ground.survey.spacing
    every = [climbed(one, ground, given) if one.pattern.radius > wide_from else one for one in weighed[0]]
    every += [climbed(one, ground, given) for one in promising]
    best = list[Weighed]()
    for one in sorted(every, key=lambda one: -one.evidence):
        taken = {number for other in best for number in other.chosen.tolist()}
        if one.evidence > (_FURTHER if best else _HOPELESS) and not taken & set(one.chosen.tolist()):
            best.append(one)
    return best[:_MOST]


def _together(
    coarse: Weighed, ground: Ground, measured: Measured, given: Given, *, rng: np.random.Generator
) -> tuple[Weighed, Refined]:
    """Step 3: all holes at once, by their rims; with more holes where now more of the lattice is evident."""
    held = np.array([name in given for name in (*PARAMETERS[coarse.pattern.kind], "radius")])
    refined = refine(coarse.pattern, ground.survey, held, ~coarse.filled, rng=rng)
    again = windowed(replace(coarse, pattern=refined.pattern), ground, given)
    if again is not None and again.pattern.shape != coarse.pattern.shape:
        coarse = again
        refined = refine(coarse.pattern, ground.survey, held, ~coarse.filled, rng=rng)
    return coarse, _by_walls(refined, coarse.seen, ground, measured, held)


def _by_walls(
    refined: Refined, seen: BoolArray, ground: Ground, measured: Measured, held: BoolArray
) -> Refined:
    """Step 4: by the walls of their bores, or a mesh's corners on the rims, where there are any."""
    plate = ground.survey.plate
    corners = rim_corners(measured, plate)
    on_walls = walls(refined.pattern, plate, ground.opened, measured.points if corners is None else corners)
    return sharpened(refined, on_walls, seen, ground.survey, held) or refined


def _against_chance(
    coarse: Weighed, refined: Refined, ground: Ground, measured: Measured, given: Given
) -> TemplateFit:
    """Step 5: the pattern against as many as chance makes, what is known of each hole, and the decision."""
    weighed = ground.weighed(refined.pattern, coarse, _EXACT)
    plate = ground.survey.plate
    faces = assigned(refined.pattern, plate, ground.opened, measured.points)
    return fit_of(ground.survey, weighed, refined, faces, given)


def _chosen(
    fits: list[TemplateFit], kinds: Sequence[str], measured: Measured, *, is_complete: bool
) -> list[TemplateFit]:
    """Step 6: of each kind what was found or may be; else what came nearest, or that there is none."""
    chosen = list[TemplateFit]()
    for kind in kinds:
        own = best_first([fit for fit in fits if fit.kind == kind])
        kept = distinct([fit for fit in own if fit.status is not Status.NONE]) or own[:1]
        none = nothing(
            kind, len(measured.points), "no circles in any flat part are more regular than by chance"
        )
        chosen += kept or [none]
    return best_first([replace(fit, is_complete=is_complete) for fit in chosen])


def _check(kinds: Sequence[str], given: Given) -> None:
    """Refuse unknown kinds, and values that no pattern has."""
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no pattern of holes called {unknown[0]}; there are {', '.join(KINDS)}")
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is given as {value}; give a positive number")
