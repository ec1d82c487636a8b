# SPDX-License-Identifier: MIT
"""Evolution: an anytime search by differential evolution, for objectives that beams or votes make jump.

Where residuals are smooth, least squares is faster and better: evolve only to find where to begin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from scenes.checks import FloatArray, InputError

Objective = Callable[[FloatArray], FloatArray]
"""From several places (n, d) to their values (n,), less is better; each by itself."""

_LEAST_SIZE, _BY_DIMENSION = 16, 8  # members of a population
_WEIGHT, _CROSSING = (
    (0.4, 0.9),
    0.9,
)  # of differences, drawn for each generation, and share of what is crossed
_TOWARDS_BEST = 0.5  # of members that step from themselves to the best


class Progress(NamedTuple):
    """The best so far."""

    evaluations: int
    place: FloatArray  # (d,)
    value: float
    violation: float  # of the constraints there; 0 where they hold


def search(
    objective: Objective,
    lower: FloatArray,
    upper: FloatArray,
    *,
    rng: np.random.Generator,
    budget: int,
    starts: FloatArray | None = None,
    violation: Objective | None = None,
) -> Iterator[Progress]:
    """Yield the best place after each generation, never a worse one than before; close it to interrupt.

    Differential evolution (Storn & Price 1997) in a box. What obeys the constraints beats what does not, and
    of two that do not the one that breaks them less (Deb 2000). The same generator gives the same places.

    Parameters
    ----------
    objective : callable
        From places (n, d) to values (n,); less is better.
    lower, upper : (d,) float
        The box.
    rng : Generator
        Where its draws come from.
    budget : int
        Evaluations at most.
    starts : (m, d) float, optional
        Members to begin with; the others are drawn from the box.
    violation : callable, optional
        From places (n, d) to how far each breaks the constraints (n,), 0 where it does not.

    Raises
    ------
    InputError
        A box whose sides are not finite or lie the wrong way round.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if not np.isfinite([lower, upper]).all() or (lower > upper).any():
        raise InputError(f"a search needs a box with finite sides, got {lower.tolist()} to {upper.tolist()}")
    size = max(_LEAST_SIZE, _BY_DIMENSION * len(lower))
    drawn = rng.uniform(lower, upper, (size, len(lower)))
    given = np.zeros((0, len(lower))) if starts is None else np.asarray(starts)[:size]
    members = np.clip(np.concatenate([given, drawn[len(given) :]]), lower, upper)
    members = members[: max(1, min(size, budget))]
    broken, values = _judged(members, objective, violation)
    spent = len(members)
    while True:
        best = int(np.lexsort((values, broken))[0])
        yield Progress(spent, members[best].copy(), float(values[best]), float(broken[best]))
        if spent >= budget or len(members) < _LEAST_SIZE:
            return
        tried = _crossed(members, best, lower, upper, rng=rng)[: budget - spent]
        new_broken, new_values = _judged(tried, objective, violation)
        spent += len(tried)
        for k in range(len(tried)):
            if (new_broken[k], new_values[k]) <= (broken[k], values[k]):
                members[k], broken[k], values[k] = tried[k], new_broken[k], new_values[k]


def _judged(
    places: FloatArray, objective: Objective, violation: Objective | None
) -> tuple[FloatArray, FloatArray]:
    """How far places (n, d) break the constraints (n,), and their values (n,); NaN is worst."""
    broken = np.zeros(len(places)) if violation is None else np.maximum(violation(places), 0.0)
    return np.nan_to_num(broken, nan=np.inf), np.nan_to_num(objective(places), nan=np.inf, posinf=np.inf)


def _crossed(
    members: FloatArray, best: int, lower: FloatArray, upper: FloatArray, *, rng: np.random.Generator
) -> FloatArray:
    """One trial (n, d) for each member: differences of others added, and crossed with it."""
    n, d = members.shape
    others = np.argsort(rng.random((n, n)), axis=1)[:, :3]
    weight = rng.uniform(*_WEIGHT)
    towards = rng.random((n, 1)) < _TOWARDS_BEST
    base = np.where(towards, members + weight * (members[best] - members), members[others[:, 0]])
    mutant = base + weight * (members[others[:, 1]] - members[others[:, 2]])
    forced = np.arange(d) == np.asarray(rng.integers(d, size=n))[:, None]
    crosses = forced | (rng.random((n, d)) < _CROSSING)
    tried = np.where(crosses, mutant, members)
    # what leaves the box comes back half way between its side and where it was
    tried = np.where(tried < lower, (lower + members) / 2, tried)
    return np.asarray(np.where(tried > upper, (upper + members) / 2, tried))
