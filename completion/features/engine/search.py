# SPDX-License-Identifier: MIT
"""Search: where a template may lie, by differential evolution on truncated distances.

Evolution: an anytime search by differential evolution, for objectives that beams or votes make jump.
Where residuals are smooth, least squares is faster and better: evolve only to find where to begin, and
`polish` what was found. When it pays: docs/evolution.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from completion.features.engine.limits import LEAST_GAIN, REACH
from completion.features.engine.template import Measurements, Template
from scenes.checks import FloatArray, InputError


@dataclass(frozen=True, slots=True)
class Gate:
    """A constraint that holds within a tolerance: |value| <= tolerance.

    Attributes
    ----------
    value : callable
        From parameters (k,) to what ought to be 0.
    tolerance : float
        How far from 0 it may be, in its own unit.
    """

    value: Callable[[FloatArray], float]
    tolerance: float

    def breach(self, x: FloatArray) -> float:
        """Return by how many tolerances parameters (k,) are outside the gate, 0 within."""
        return max(abs(float(self.value(x))) / self.tolerance - 1.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SoughtParameters:
    """All k parameters from the m that are sought, each of these a number in 0..1 between its bounds.

    x = base + spread z, so that what is held, or equal, is so exactly.

    Attributes
    ----------
    base : (k,) float
        The parameters at z = 0.
    spread : (k, m) float
        What each of the sought adds to them.
    held : tuple of str
        Names of those that were given.
    """

    base: FloatArray
    spread: FloatArray
    held: tuple[str, ...]

    @property
    def n_sought(self) -> int:
        """How many are sought."""
        return int(self.spread.shape[1])

    def full(self, z: FloatArray) -> FloatArray:
        """Return the parameters (..., k) at z (..., m)."""
        return np.asarray(self.base + z @ self.spread.T)

    def sought(self, x: FloatArray) -> FloatArray:
        """Return z (..., m), within the bounds, nearest to parameters (..., k)."""
        return np.clip((x - self.base) @ np.linalg.pinv(self.spread).T, 0.0, 1.0)


def equations(
    names: Sequence[str],
    bounds: tuple[FloatArray, FloatArray],
    given: Mapping[str, float],
    equal: Sequence[tuple[str, ...]] = (),
) -> SoughtParameters:
    """Return what is left to be sought of parameters, of which some are given and some equal.

    Parameters
    ----------
    names : sequence of str
        Of the k parameters.
    bounds : pair of (k,) float
        Least and greatest values; those that are equal share what bounds they have in common.
    given : mapping
        Values held exactly, within the bounds or not.
    equal : sequence of tuple of str
        Names of parameters that are one; each stands in one tuple at most.

    Raises
    ------
    InputError
        A name that is none of the parameters, a value that is not finite, two values for one parameter,
        bounds that are not finite or leave nothing.
    """
    lower, upper = (np.asarray(side, dtype=np.float64) for side in bounds)
    _check_names(names, [*given, *(name for group in equal for name in group)])
    wrong = [name for name, value in given.items() if not np.isfinite(value)]
    if wrong:
        raise InputError(f"{wrong[0]} is given as {given[wrong[0]]}; give a finite number")
    shape = (len(names),)
    if lower.shape != shape or upper.shape != shape or not np.isfinite([lower, upper]).all():
        raise InputError(f"bounds must be finite, one pair for each of {len(names)} parameters")
    base, columns = np.zeros(len(names)), []
    grouped = {name for group in equal for name in group}
    for group in [*equal, *((name,) for name in names if name not in grouped)]:
        which = np.array([names.index(name) for name in group])
        values = {float(given[name]) for name in group if name in given}
        if len(values) > 1:
            raise InputError(f"{' and '.join(group)} are equal, but given as {sorted(values)}")
        least, greatest = float(lower[which].max()), float(upper[which].min())
        base[which] = next(iter(values), least)
        if values:
            continue
        if least > greatest:
            raise InputError(f"the bounds of {' and '.join(group)} leave no value: {least} to {greatest}")
        column = np.zeros(len(names))
        column[which] = greatest - least
        columns.append(column)
    spread = np.column_stack(columns) if columns else np.zeros((len(names), 0))
    return SoughtParameters(base, spread, tuple(name for name in names if name in given))


def _check_names(names: Sequence[str], asked: Sequence[str]) -> None:
    unknown = [name for name in asked if name not in names]
    if unknown:
        raise InputError(f"there is no parameter {unknown[0]}; there are {', '.join(names)}")


Objective = Callable[[FloatArray], FloatArray]
"""From several places (n, d) to their values (n,), less is better; each by itself."""

_LEAST_SIZE, _BY_DIMENSION, _LAST_SIZE = 24, 4, 12  # members of a population: at first, and at the end
_BEST, _MEMORY = 0.15, 5  # share of members that others step towards; lines of the memory
_LENIENT = 0.5  # share of the budget after which constraints are no longer loosened


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

    Differential evolution (Storn & Price 1997) in a box, with weights that are drawn about those that
    succeeded, and a population that shrinks (Tanabe & Fukunaga 2014, L-SHADE). What obeys the constraints
    beats what does not, and of two that do not the one that breaks them less (Deb 2000); among members they
    are loose at first (Takahama & Sakai 2006). The same generator gives the same places.

    Parameters
    ----------
    objective : callable
        From places (n, d) to values (n,); less is better.
    lower, upper : (d,) float
        The box.
    rng : Generator
        Where its draws come from.
    budget : int
        Evaluations at most; the population shrinks, and constraints tighten, as they are spent.
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
    broken, values = _evaluate(members, objective, violation)
    spent, memory, replaced = len(members), _Memory(), members[:0]
    looseness = float(np.nan_to_num(np.median(broken), posinf=0.0))
    best = _best_of(spent, members, broken, values)
    while True:
        yield best
        if spent >= budget or len(members) < _LAST_SIZE:
            return
        share = spent / budget
        loose = looseness * max(0.0, 1 - share / _LENIENT) ** 3
        order = np.lexsort((values, np.maximum(broken - loose, 0.0)))
        order = order[: max(_LAST_SIZE, round(size + (_LAST_SIZE - size) * share))]
        members, broken, values = members[order], broken[order], values[order]
        weights, crossing = memory.draw(len(members), rng)
        tried = _cross_over(members, replaced, weights, crossing, rng=rng)
        # what leaves the box comes back half way between its side and where it was
        tried = np.where(tried < lower, (lower + members) / 2, tried)
        tried = np.where(tried > upper, (upper + members) / 2, tried)[: budget - spent]
        new_broken, new_values = _evaluate(tried, objective, violation)
        spent += len(tried)
        gain = _gains(broken[: len(tried)], values[: len(tried)], new_broken, new_values, loose=loose)
        memory.learn(weights, crossing, gain)
        better = np.flatnonzero(gain >= 0)
        replaced = np.concatenate([members[np.flatnonzero(gain > 0)], replaced])
        replaced = replaced[rng.permutation(len(replaced))[: len(members)]]
        members[better], broken[better], values[better] = (
            tried[better],
            new_broken[better],
            new_values[better],
        )
        progress = _best_of(spent, tried, new_broken, new_values)
        is_better = (progress.violation, progress.value) <= (best.violation, best.value)
        best = progress if is_better else best._replace(evaluations=spent)


def polish(
    residuals: Callable[[FloatArray], FloatArray],
    progress: Progress,
    lower: FloatArray,
    upper: FloatArray,
    *,
    budget: int = 1000,
) -> Progress:
    """Return what least squares within the box makes of a place, where that is better; else what was found.

    Parameters
    ----------
    residuals : callable
        From a place (d,) to residuals (m,), gates among them weighed as they should count.
    progress : Progress
        Where to begin.
    lower, upper : (d,) float
        The box.
    budget : int
        Evaluations at most.

    Returns
    -------
    Progress
        Its value is the sum of squares; its violation is that of `progress`; the caller judges it anew.
    """
    spent = progress.evaluations

    def count_and_evaluate(x: FloatArray) -> FloatArray:
        nonlocal spent
        spent += 1
        return residuals(x)

    start = np.clip(progress.place, lower, upper)
    before = float(np.sum(count_and_evaluate(start) ** 2))
    rounds = max(1, (budget - 1) // (len(start) + 1))  # a round asks once, and for each derivative
    ended = least_squares(
        count_and_evaluate, start, bounds=(lower, upper), x_scale=upper - lower, max_nfev=rounds
    )
    value = float(2 * ended.cost)
    if value > before:
        return progress._replace(evaluations=spent, value=before)
    return Progress(spent, np.asarray(ended.x), value, progress.violation)


def _evaluate(
    places: FloatArray, objective: Objective, violation: Objective | None
) -> tuple[FloatArray, FloatArray]:
    """How far places (n, d) break the constraints (n,), and their values (n,); NaN is worst."""
    broken = np.zeros(len(places)) if violation is None else np.maximum(violation(places), 0.0)
    return np.nan_to_num(broken, nan=np.inf), np.nan_to_num(objective(places), nan=np.inf, posinf=np.inf)


def _best_of(spent: int, places: FloatArray, broken: FloatArray, values: FloatArray) -> Progress:
    best = int(np.lexsort((values, broken))[0])
    return Progress(spent, places[best].copy(), float(values[best]), float(broken[best]))


def _gains(
    broken: FloatArray, values: FloatArray, new_broken: FloatArray, new_values: FloatArray, *, loose: float
) -> FloatArray:
    """By how much trials (n,) are better than members (n,): in violation where it differs; -1 where worse."""
    old, new = np.maximum(broken - loose, 0.0), np.maximum(new_broken - loose, 0.0)
    with np.errstate(invalid="ignore"):
        by = np.where(new == old, values - new_values, old - new)
    worse = (new > old) | ((new == old) & (new_values > values))
    return np.where(worse, -1.0, np.nan_to_num(np.maximum(by, 0.0), posinf=1e300))


class _Memory:
    """Weights of differences and shares of crossing that succeeded, and draws about them."""

    def __init__(self) -> None:
        self.weights, self.crossing, self.line = np.full(_MEMORY, 0.5), np.full(_MEMORY, 0.8), 0

    def draw(self, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """A weight (n,) and a share (n,) for each member."""
        line = rng.integers(_MEMORY, size=n)
        weights = self.weights[line] + 0.1 * rng.standard_cauchy(n)
        while (weights <= 0).any():
            weights = np.where(weights > 0, weights, self.weights[line] + 0.1 * rng.standard_cauchy(n))
        return np.minimum(weights, 1.0), np.clip(rng.normal(self.crossing[line], 0.1), 0.0, 1.0)

    def learn(self, weights: FloatArray, crossing: FloatArray, gain: FloatArray) -> None:
        """Keep the Lehmer means of what brought a gain (n,), each weighed by it."""
        won = np.flatnonzero(gain > 0)
        if not len(won):
            return
        share = gain[won] / gain[won].max()
        for kept, chosen_weights in ((self.weights, weights[won]), (self.crossing, crossing[won])):
            kept[self.line] = (share @ chosen_weights**2) / max(share @ chosen_weights, 1e-12)
        self.line = (self.line + 1) % _MEMORY


def _cross_over(
    members: FloatArray,
    replaced: FloatArray,
    weights: FloatArray,
    crossing: FloatArray,
    *,
    rng: np.random.Generator,
) -> FloatArray:
    """One trial (n, d) for each member, the best first: steps to one of the best and along a difference."""
    n, d = members.shape
    best = rng.integers(max(2, round(_BEST * n)), size=n)
    pool = np.concatenate([members, replaced])
    first, second = rng.integers(n, size=n), rng.integers(len(pool), size=n)
    mutant = members + weights[:, None] * (members[best] - members + members[first] - pool[second])
    forced = np.arange(d) == np.asarray(rng.integers(d, size=n))[:, None]
    return np.asarray(np.where(forced | (rng.random((n, d)) < crossing[:, None]), mutant, members))


_N_POINTS = 400  # that the search looks at
_PATIENCE = 6  # generations a sought parameter in which the best gets hardly better


class SearchResult(NamedTuple):
    """Where the search ended."""

    place: FloatArray  # (m,) in the unit box
    violation: float
    evaluations: int
    is_settled: bool


def explore(
    template: Template,
    measured: Measurements,
    sought: SoughtParameters,
    *,
    rng: np.random.Generator,
    budget: int,
    begun: Sequence[FloatArray],
    gates: Sequence[Gate],
) -> SearchResult:
    """Return the best place of an evolution, until it stands still or the budget is spent.

    Deb's rule for gates: what obeys them beats what does not. It has settled when the best value has fallen
    by less than a thousandth in six generations for each parameter sought. An interrupt ends it, unsettled.
    It begins at the places (m,) that are given, among others.
    """
    n = sought.n_sought
    if n == 0:
        return SearchResult(np.zeros(0), breach(gates, sought.base), 0, True)
    chosen = rng.permutation(len(measured.points))[:_N_POINTS]
    subset, reach = measured.points[chosen], REACH * measured.diagonal
    scale = min(max(measured.noise, 0.25 * measured.spacing, 1e-3 * measured.diagonal), 0.5 * reach)
    most = float(np.log1p((reach / scale) ** 2))

    def value(places: FloatArray) -> FloatArray:
        each = [template.distance(subset, sought.full(z))[0] for z in places]
        return np.array([np.minimum(np.log1p((residuals / scale) ** 2), most).mean() for residuals in each])

    def violation(places: FloatArray) -> FloatArray:
        return np.array([breach(gates, sought.full(z)) for z in places])

    stages = search(
        value,
        np.zeros(n),
        np.ones(n),
        rng=rng,
        budget=max(1, budget),
        starts=np.array(begun) if len(begun) else None,
        violation=violation if gates else None,
    )
    best: list[tuple[float, float]] = []
    is_settled = False
    try:
        for stage in stages:
            find = SearchResult(stage.place, stage.violation, stage.evaluations, False)
            best.append((stage.violation, stage.value))
            before = best[max(0, len(best) - 1 - _PATIENCE * n)]
            still = before[0] == stage.violation and before[1] - stage.value < LEAST_GAIN * before[1]
            is_settled = len(best) > _PATIENCE * n and still
            if is_settled:
                break
    except KeyboardInterrupt:
        if not best:
            raise
    return find._replace(is_settled=is_settled)


def breach(gates: Sequence[Gate], x: FloatArray) -> float:
    """Return by how many tolerances parameters (k,) break all gates."""
    return sum(gate.breach(x) for gate in gates)
