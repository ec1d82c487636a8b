# SPDX-License-Identifier: MIT
"""Candidates for relief: connected areas that are not level with the plane, and the evidence for each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.flattening.areas import PIECE, PRICE, Areas
from completion.flattening.pieces import Labels, borders_of, joined
from scenes.checks import BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
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


def find_candidates(pieces: Labels, areas: Areas, known: BoolArray) -> list[Candidate]:
    """What stands out of the plane on a canvas of pieces (rows, columns), and what was joined to something.

    The evidence for a connected part is half the chi-square of all its levels being that of the plane, less
    the price of all borders in and around it. What lies beyond the `known` surface is left out.
    """
    n, owner = len(areas.owner), areas.owner
    first, second, length = borders_of(pieces)
    one, other = owner[first], owner[second]
    out = (one != areas.plane) & (other != areas.plane)
    part = joined(first[out], second[out], n)[1]
    size = np.bincount(pieces.ravel(), minlength=n).astype(np.float64)
    seen = np.bincount(pieces[known], minlength=n)
    found = []
    for number in np.unique(part[owner != areas.plane]):
        members = np.flatnonzero((part == number) & (owner != areas.plane))
        owners, place = np.unique(owner[members], return_inverse=True)
        step, covariance = areas.levels.height_m[owners], areas.levels.covariance[np.ix_(owners, owners)]
        square = float(step @ np.linalg.solve(covariance, step))
        inside = (part[first] == number) | (part[second] == number)
        border = float(length[inside & (one != other)].sum())
        weight = np.bincount(place, size[members]) / size[members].sum()
        evidence = square / 2 - PRICE * border - PIECE * len(owners)
        sd = float(np.sqrt(weight @ covariance @ weight))
        count = int(seen[members].sum())
        found.append(
            Candidate(
                tuple(members.tolist()), evidence, float(weight @ step), sd, n_cells=count, stands_out=True
            )
        )
    for join in areas.joins:
        count = int(seen[list(join.pieces)].sum())
        found.append(
            Candidate(join.pieces, join.evidence, join.height_m, join.sd_m, n_cells=count, stands_out=False)
        )
    return [candidate for candidate in found if candidate.n_cells]
