# SPDX-License-Identifier: MIT
"""Separation of a field of heights into levels and ripple."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.flattening.areas import Areas, join_pieces
from completion.flattening.canvas import extend, fill_gaps, find_spikes, without_jumps
from completion.flattening.pieces import Labels, cut_pieces
from completion.flattening.regions import Candidate, find_candidates
from completion.flattening.ripple import Ripple
from completion.flattening.spectrum import estimate_spectrum
from completion.flattening.steps import find_steps
from scenes.checks import BoolArray, FloatArray

_WINDOWS = ((0.3, 48), (0.5, 48), (0.5, 48))
"""Which quantile of the power in windows of how many cells: before relief is known, and after."""
_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Separation:
    """Heights on a canvas and what they are made of.

    Attributes
    ----------
    heights : (rows, columns) float
        With gaps and margins filled, metres over the plane given.
    known : (rows, columns) bool
        What is neither gap nor margin.
    pieces : (rows, columns) int
        Labels from 0.
    areas : Areas
        Which pieces are one, and their levels.
    ripple : Ripple
        Of what the levels leave.
    candidates : tuple of Candidate
        Regions that may be relief.
    """

    heights: FloatArray
    known: BoolArray
    pieces: Labels
    areas: Areas
    ripple: Ripple
    candidates: tuple[Candidate, ...]

    def levels(self, kept: tuple[Candidate, ...]) -> FloatArray:
        """Levels (rows, columns) over the plane: of the regions kept, and 0 of all else."""
        height = np.zeros(len(self.areas.owner))
        for one in kept:
            members = list(one.pieces)
            height[members] = self.areas.levels.height_m[self.areas.owner[members]]
        return height[self.pieces]

    def cells(self, candidate: Candidate) -> BoolArray:
        """Which cells (rows, columns) belong to a region."""
        chosen = np.zeros(len(self.areas.owner), np.bool_)
        chosen[list(candidate.pieces)] = True
        return chosen[self.pieces]


def separate(heights: FloatArray, known: BoolArray) -> Separation:
    """Separate heights (rows, columns) over a plane, metres, into levels and ripple."""
    rows, columns = heights.shape
    # 1. Leave out what is no surface; continue the heights beyond the border and through gaps, so that they
    #    are periodic.
    known = known & ~find_spikes(heights, known)
    smooth = fill_gaps(heights, known)
    even = without_jumps(smooth)
    wide = extend(smooth, fades=True)
    seen = np.zeros(wide.shape, np.bool_)
    seen[:rows, :columns] = known

    # 2. Learn the ripple from windows without relief; find the steps that leave nothing but ripple; again
    #    from all windows, without the steps.
    ripple = Ripple.of(estimate_spectrum(even, known, *_WINDOWS[0]), wide.shape)
    steps = extend(smooth - even, fades=False)
    filled, is_first = steps + ripple.continued(extend(even, fades=True), seen), True
    for quantile, window in _WINDOWS[1:]:
        for _ in range(_ROUNDS):
            steps = find_steps(filled, ripple, None if is_first else steps)
            is_first = False
            error = ripple.continued(wide - steps, seen)
            filled = steps + error
        spectrum = estimate_spectrum(error[:rows, :columns], known, quantile, window)
        ripple = Ripple.of(spectrum, wide.shape)
        error = ripple.continued(wide - steps, seen)
        filled = steps + error
        ripple = ripple.uneven(error, seen)

    # 3. Cut the steps into pieces, and join those between which there is no evidence of a step.
    pieces = cut_pieces(steps, ripple)
    areas = join_pieces(filled, pieces, ripple, seen)
    candidates = find_candidates(pieces, areas, seen)
    return Separation(filled, seen, pieces, areas, ripple=ripple, candidates=tuple(candidates))
