# SPDX-License-Identifier: MIT
"""Calibration of silence: the most likely constants of `TRUST` on simulated desks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from benchmarks.completion.ledger.entries import is_there
from benchmarks.completion.silence.desks import desk_case
from completion import CompletionOptions, Patch, complete
from completion.evidence.evidence import Label
from completion.extension.confidence import estimate
from completion.extension.silence import ENCLOSED, MOSTLY, TRUST, judged_parts
from scenes.checks import BoolArray, FloatArray

_MOST_CELLS = 300  # of a part that are looked at
_PROBABLE = 0.5  # that the surface goes on there at all
_PRIOR = 3e-3  # of a mean log likelihood, what a change of a constant by one logarithmic unit has to be worth


class Part(NamedTuple):
    """A silent part of some desk, and how much of it is surface."""

    seed: int
    is_unlit: bool
    is_wall: bool
    width: float  # half of it, metres or in units of the root of the surface's measured area
    goes_on: float  # probability that the surface goes on there
    area_m2: float
    right: float  # share


def parts_of(seed: int) -> list[Part]:
    """Complete a desk and compare its silent parts with the truth."""
    case = desk_case(seed)
    (view,) = case.views
    caster = case.scene.ray_caster()
    completed = complete(case.scans(view.sensor.effects, seed), CompletionOptions(texture=False), rng=seed)
    world, found = completed.world_from_reference, []
    for patch in completed.patches:
        hidden, evidence, is_wall = patch.shadows.region >= 0, patch.evidence, patch.limits.encloses
        goes_on = estimate(patch.grid, patch.shadows, patch.labelling, patch.limits, evidence).ravel()
        filled, unit = _occluded(patch), 1.0 if is_wall else max(float(np.sqrt(patch.observed_m2)), 1e-6)
        centres = patch.grid.centres()
        for part, _ in judged_parts(
            patch.grid, evidence, hidden, filled, within=patch.is_within, is_wall=is_wall
        ):
            is_unlit = bool(evidence.labels.ravel()[part.cells[0]] == Label.UNLIT)
            sure = float(goes_on[part.cells].mean())
            if sure < _PROBABLE or part.enclosed < (MOSTLY if is_unlit and is_wall else ENCLOSED):
                continue
            points = centres[part.cells[:: -(-len(part.cells) // _MOST_CELLS)]]
            right = is_there(
                world.apply(points), world.rotate(patch.grid.surface.normal(points)), caster
            ).mean()
            area = len(part.cells) * patch.grid.cell_area
            found.append(Part(seed, is_unlit, is_wall, part.half_width_m / unit, sure, area, float(right)))
    return found


def most_likely(parts: Sequence[Part]) -> FloatArray:
    """The constants (2, 2, 2) that make the parts most likely, parts weighted by the root of their area."""
    result = TRUST.copy()
    for is_unlit in (False, True):
        for is_wall in (True, False):
            some = [one for one in parts if (one.is_unlit, one.is_wall) == (is_unlit, is_wall)]
            if some:
                result[int(is_unlit), int(not is_wall)] = _fit(some, TRUST[int(is_unlit), int(not is_wall)])
    return result


def _fit(parts: Sequence[Part], used: FloatArray) -> FloatArray:
    width, goes_on, area, right = np.array([one[3:] for one in parts]).T
    start = np.array([np.log(used[0] / (1 - used[0])), np.log(used[1])])

    def cost(x: FloatArray) -> float:
        told = goes_on / (1 + np.exp(-x[0])) * np.exp(-((width / np.exp(x[1])) ** 2))
        told = np.clip(told, 0.003, 0.997)
        likely = right * np.log(told) + (1 - right) * np.log(1 - told)
        return -float(np.average(likely, weights=np.sqrt(area))) + _PRIOR * float(np.square(x - start).sum())

    x = minimize(cost, start, method="Nelder-Mead").x
    return np.array([1 / (1 + np.exp(-x[0])), np.exp(x[1])])


def _occluded(patch: Patch) -> BoolArray:
    """Inferred cells (rows, columns) that something stood before."""
    return np.asarray(patch.hypothesised & (patch.evidence.labels == Label.OCCLUDED), dtype=np.bool_)
