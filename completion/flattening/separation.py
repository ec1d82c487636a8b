# SPDX-License-Identifier: MIT
"""Separation of a field of heights into levels and ripple."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from completion.flattening.areas import Areas, Labels, borders_of, cut_pieces, join_pieces, label_components
from completion.flattening.limits import FIRST_PRICE, PIECE, PRICE
from completion.flattening.ripple import (
    Ripple,
    estimate_spectrum,
    extend,
    fill_gaps,
    find_spikes,
    without_jumps,
)
from scenes.checks import BoolArray, FloatArray
from texture.engine.compiled import compiled

_NEIGHBOURS = ((0, 1, 0.41), (1, 0, 0.41), (1, 1, 0.29), (1, -1, 0.29))
"""Rows and columns to a neighbour, and its share in the length of a border (Cauchy-Crofton)."""


def find_steps(
    heights: FloatArray, ripple: Ripple, start: FloatArray | None = None, turns: int = 20
) -> FloatArray:
    """The field of steps (rows, columns) of heights on a canvas, metres.

    It minimises half the whitened square of what it leaves, and a price of its steps that grows with the
    logarithm of their size, so that it is constant between them: a sum of absolute steps, weighed anew each
    round by 1 / (step + e) (Candes, Wakin & Boyd 2008), where e is the step that pays for its border. Each
    round is solved by alternating directions (Goldstein & Osher 2009), exact in the waves of the canvas.
    """
    shape = heights.shape
    energy = ripple.step_energy()
    paying = np.sqrt(2 / energy) * ripple.strength
    inverse = 1 / ripple.power
    seen = inverse * fft.rfft2(heights)
    rows, columns = fft.fftfreq(shape[0])[:, None], fft.rfftfreq(shape[1])[None]
    both = sum(2 - 2 * np.cos(2 * np.pi * (a * rows + b * columns)) for a, b, _ in _NEIGHBOURS)
    penalty = 0.5 * FIRST_PRICE * energy / np.sqrt(2)
    solved = 1 / (inverse + penalty * both + 1e-12 * inverse.max())
    steps = np.zeros((len(_NEIGHBOURS), *shape))
    if start is None:
        field = np.zeros(shape)
        price = np.stack(
            [FIRST_PRICE * np.sqrt(energy) * share * ripple.strength for *_, share in _NEIGHBOURS]
        )
    else:
        field = start
        for step, (a, b, _) in zip(steps, _NEIGHBOURS, strict=True):
            step[:] = np.roll(start, (-a, -b), (0, 1)) - start
        shares = np.array([share for *_, share in _NEIGHBOURS])[:, None, None]
        price = 2 * shares * ripple.strength**2 / (np.abs(steps) + paying)
    off, pulled, limit = np.zeros_like(steps), np.zeros(shape), price / penalty
    for _ in range(turns):
        _pull(steps, off, pulled)
        field = fft.irfft2((seen + penalty * fft.rfft2(pulled)) * solved, s=shape)
        _shrink(field, limit, steps, off)
    return field


@compiled
def _pull(steps: FloatArray, off: FloatArray, pulled: FloatArray) -> None:
    """The transpose of the differences to the neighbours, of steps less what they are off."""
    rows, columns = pulled.shape
    pulled[:] = 0.0
    for k in range(len(_NEIGHBOURS)):
        a, b = _NEIGHBOURS[k][0], _NEIGHBOURS[k][1]
        for i in range(rows):
            other = (i + a) % rows
            for j in range(columns):
                step = steps[k, i, j] - off[k, i, j]
                pulled[i, j] -= step
                pulled[other, (j + b) % columns] += step


@compiled
def _shrink(field: FloatArray, limit: FloatArray, steps: FloatArray, off: FloatArray) -> None:
    """Steps of a field that are worth their price, and by how much the field is off them, added up."""
    rows, columns = field.shape
    for k in range(len(_NEIGHBOURS)):
        a, b = _NEIGHBOURS[k][0], _NEIGHBOURS[k][1]
        for i in range(rows):
            other = (i + a) % rows
            for j in range(columns):
                value = off[k, i, j] + field[other, (j + b) % columns] - field[i, j]
                most = limit[k, i, j]
                off[k, i, j] = min(max(value, -most), most)
                steps[k, i, j] = value - off[k, i, j]


@dataclass(frozen=True, slots=True, eq=False)
class ReliefCandidate:
    """Pieces that are connected and may be relief.

    `evidence` in nats, mean height and its sd in metres, `n_cells` of the surface; `stands_out` is False
    where the pieces were joined to what is around them, since nothing spoke against it.
    """

    pieces: tuple[int, ...]
    evidence: float
    height_m: float
    sd_m: float
    n_cells: int
    stands_out: bool


def find_candidates(pieces: Labels, areas: Areas, known: BoolArray) -> list[ReliefCandidate]:
    """What stands out of the plane on a canvas of pieces (rows, columns), and what was joined to something.

    The evidence for a connected part is half the chi-square of all its levels being that of the plane, less
    the price of all borders in and around it. What lies beyond the `known` surface is left out.
    """
    n, owner = len(areas.owner), areas.owner
    first, second, length = borders_of(pieces)
    indices, other = owner[first], owner[second]
    out = (indices != areas.plane) & (other != areas.plane)
    part = label_components(first[out], second[out], n)[1]
    size = np.bincount(pieces.ravel(), minlength=n).astype(np.float64)
    seen = np.bincount(pieces[known], minlength=n)
    candidates = []
    for number in np.unique(part[owner != areas.plane]):
        members = np.flatnonzero((part == number) & (owner != areas.plane))
        owners, place = np.unique(owner[members], return_inverse=True)
        step, covariance = areas.levels.height_m[owners], areas.levels.covariance[np.ix_(owners, owners)]
        square = float(step @ np.linalg.solve(covariance, step))
        inside = (part[first] == number) | (part[second] == number)
        border = float(length[inside & (indices != other)].sum())
        weight = np.bincount(place, size[members]) / size[members].sum()
        evidence = square / 2 - PRICE * border - PIECE * len(owners)
        sd = float(np.sqrt(weight @ covariance @ weight))
        count = int(seen[members].sum())
        candidates.append(
            ReliefCandidate(
                tuple(members.tolist()), evidence, float(weight @ step), sd, n_cells=count, stands_out=True
            )
        )
    for join in areas.joins:
        count = int(seen[list(join.pieces)].sum())
        candidates.append(
            ReliefCandidate(
                join.pieces, join.evidence, join.height_m, join.sd_m, n_cells=count, stands_out=False
            )
        )
    return [candidate for candidate in candidates if candidate.n_cells]


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
    candidates: tuple[ReliefCandidate, ...]

    def levels(self, kept: tuple[ReliefCandidate, ...]) -> FloatArray:
        """Levels (rows, columns) over the plane: of the regions kept, and 0 of all else."""
        height = np.zeros(len(self.areas.owner))
        for candidate in kept:
            members = list(candidate.pieces)
            height[members] = self.areas.levels.height_m[self.areas.owner[members]]
        return height[self.pieces]

    def cells(self, candidate: ReliefCandidate) -> BoolArray:
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
    filled, is_first = steps + ripple.extrapolate(extend(even, fades=True), seen), True
    for quantile, window in _WINDOWS[1:]:
        for _ in range(_ROUNDS):
            steps = find_steps(filled, ripple, None if is_first else steps)
            is_first = False
            error = ripple.extrapolate(wide - steps, seen)
            filled = steps + error
        spectrum = estimate_spectrum(error[:rows, :columns], known, quantile, window)
        ripple = Ripple.of(spectrum, wide.shape)
        error = ripple.extrapolate(wide - steps, seen)
        filled = steps + error
        ripple = ripple.with_local_strength(error, seen)

    # 3. Cut the steps into pieces, and join those between which there is no evidence of a step.
    pieces = cut_pieces(steps, ripple)
    areas = join_pieces(filled, pieces, ripple, seen)
    candidates = find_candidates(pieces, areas, seen)
    return Separation(filled, seen, pieces, areas, ripple=ripple, candidates=tuple(candidates))
