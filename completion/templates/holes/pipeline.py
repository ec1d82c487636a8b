# SPDX-License-Identifier: MIT
"""Hole patterns on one page: rows, grids and bolt circles of equal holes in plates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Given, Status, TemplateFit, best_first
from completion.templates.holes.bores import sharpened, walls
from completion.templates.holes.candidates import candidates
from completion.templates.holes.joint import Ground, Weighed, windowed
from completion.templates.holes.measuring.openings import openings
from completion.templates.holes.measuring.plates import plates
from completion.templates.holes.measuring.survey import survey
from completion.templates.holes.outcome import distinct, fit_of, nothing
from completion.templates.holes.patterns import KINDS, PARAMETERS
from completion.templates.holes.proposals import proposals
from completion.templates.holes.refinement import refine
from scenes.checks import InputError

_EXACT = 0.05  # spacings: how exactly the holes of a refined pattern are placed
_MOST = 3  # patterns of one kind in one plate that are refined
_HOPELESS, _FURTHER = -12.0, 0.0  # nats, before refinement, of the best and of others: what is left out


def find_holes(
    measured: Measured, kinds: Sequence[str], given: Given, *, rng: np.random.Generator, budget: int
) -> list[TemplateFit]:
    """Find rows, grids and bolt circles of equal holes in the flat parts of what was measured."""
    _check(kinds, given)
    fits, spent = list[TemplateFit](), 0
    for plate in plates(measured, rng=rng):
        # what was measured in the plate, beside it and through it
        surveyed = survey(plate)
        opened = openings(plate, measured, surveyed.spacing)
        # circles with nothing of the plate inside, and plate around
        found = candidates(surveyed, opened, given.get("radius"))
        ground = Ground(surveyed, opened, found, surveyed.area)
        for kind in kinds:
            # lattices through like circles, those that chance explains worst, and of each the best part
            begun = proposals(kind, found, surveyed.area, surveyed.spacing, given)
            for coarse in _best(windowed(one, ground, given) for one in begun):
                # all holes at once: by their rims, and by the walls of their bores where there are any
                held = np.array([name in given for name in (*PARAMETERS[kind], "radius")])
                refined = refine(coarse.pattern, surveyed, held, ~coarse.filled, rng=rng)
                found_walls = walls(refined.pattern, surveyed, opened, None)
                refined = sharpened(refined, found_walls, coarse.seen, surveyed, held) or refined
                # the whole pattern against chance
                weighed = ground.weighed(refined.pattern, coarse, _EXACT)
                fits.append(fit_of(plate, weighed, refined, found_walls, given))
                spent += refined.evaluations
                if spent >= budget:
                    return _chosen(fits, kinds, measured, is_complete=False)
    return _chosen(fits, kinds, measured, is_complete=True)


def _best(weighed: Iterable[Weighed | None]) -> list[Weighed]:
    """The most evident that have no hole in common, of those that are not hopeless."""
    best = list[Weighed]()
    for one in sorted((one for one in weighed if one is not None), key=lambda one: -one.evidence):
        taken = {number for other in best for number in other.chosen.tolist()}
        if one.evidence > (_FURTHER if best else _HOPELESS) and not taken & set(one.chosen.tolist()):
            best.append(one)
    return best[:_MOST]


def _chosen(
    fits: list[TemplateFit], kinds: Sequence[str], measured: Measured, *, is_complete: bool
) -> list[TemplateFit]:
    """Of each kind what was found or may be; else the one that came nearest, or that there is none."""
    chosen = list[TemplateFit]()
    for kind in kinds:
        own = best_first([fit for fit in fits if fit.kind == kind])
        kept = distinct([fit for fit in own if fit.status is not Status.NONE]) or own[:1]
        chosen += kept or [
            nothing(kind, len(measured.points), "no circles in any flat part are more regular than by chance")
        ]
    return best_first([replace(fit, is_complete=is_complete) for fit in chosen])


def _check(kinds: Sequence[str], given: Given) -> None:
    """Refuse unknown kinds, and values that no pattern has."""
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no pattern of holes called {unknown[0]}; there are {', '.join(KINDS)}")
    for name, value in given.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} is given as {value}; give a positive number")
