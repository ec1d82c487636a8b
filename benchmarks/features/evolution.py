# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features evolution`: evolution, least squares from many starts, the exact solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Annotated

import numpy as np
import typer
from scipy.optimize import least_squares

from benchmarks.features.evolution_cases import CASES, SQUARE_DEG, Case, PartCase
from completion.templates.engine.evolution import Progress, polish, search
from scenes.checks import FloatArray

AT = (250, 500, 1000, 2000, 4000, 8000)
"""Evaluations after which the error is told."""

_ENOUGH = 0.01  # of the gates' tolerance, that least squares may break them by
_A_START = 400  # evaluations at most, of least squares from one start

Trace = list[tuple[int, FloatArray]]
"""The best place (d,), and after how many evaluations."""


class _SpentError(Exception):
    """The budget is spent."""


def evolve(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Evolution alone."""
    return [(one.evaluations, one.place) for one in _stages(case, seed, budget)]


def evolve_and_polish(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Evolution with half of each budget that is asked for, then least squares."""
    found = Trace()
    for total in (one for one in AT if one <= budget):
        *_, last = _stages(case, seed, total // 2)
        done = polish(case.residuals, last, case.lower, case.upper, budget=total // 2)
        places = np.array([last.place, done.place])
        broken = np.maximum(case.violation(places) - _ENOUGH * SQUARE_DEG, 0.0)
        best = np.lexsort((case.objective(places), broken))[0]
        found.append((total, places[best]))
    return found


def many_starts(case: Case, seed: int, budget: int = AT[-1]) -> Trace:
    """Levenberg-Marquardt from places drawn in the box, the best of all."""
    rng, spent, best, found = np.random.default_rng(seed), 0, np.inf, Trace()

    def counted(x: FloatArray) -> FloatArray:
        nonlocal spent, best
        if spent >= budget:
            raise _SpentError
        spent += 1
        off = case.residuals(x)
        own = float(off @ off)
        if own < best and ((x >= case.lower) & (x <= case.upper)).all():
            best = own
            found.append((spent, x.copy()))
        return off

    try:
        while True:
            start = rng.uniform(case.lower, case.upper)
            least_squares(counted, start, method="lm", x_scale=case.upper - case.lower, max_nfev=_A_START)
    except _SpentError:
        return found


ENGINES: dict[str, Callable[[Case, int, int], Trace]] = {
    "evolution": evolve,
    "evolution, then least squares": evolve_and_polish,
    "least squares from many starts": many_starts,
}
"""By name."""


def errors_at(case: Case, trace: Trace) -> FloatArray:
    """Errors (len(AT), 2) of the best place after so many evaluations; NaN before the first."""
    found = np.full((len(AT), 2), np.nan)
    for row, at in enumerate(AT):
        before = [place for spent, place in trace if spent <= at]
        if before:
            found[row] = case.errors(before[-1])
    return found


def measured(name: str, engine: str, seeds: range) -> tuple[FloatArray, float]:
    """Errors (seeds, len(AT), 2) of an engine on a case, and the processor's seconds a seed."""
    start, every = time.process_time(), []
    for seed in seeds:
        case = CASES[name](seed)
        every.append(errors_at(case, ENGINES[engine](case, seed, AT[-1])))
    return np.array(every), (time.process_time() - start) / len(seeds)


def evolution(
    first: Annotated[int, typer.Option("--first")] = 2000,
    seeds: Annotated[int, typer.Option("--seeds")] = 12,
) -> None:
    """Radius and angle of the part of figure 1, and sides of an opening, against evaluations."""
    for line in _lines(range(first, first + seeds)):
        print(line, flush=True)


def _lines(seeds: range) -> Iterator[str]:
    yield f"| case, engine | error | {' | '.join(map(str, AT))} | s |"
    yield f"|---|---|{'---|' * (len(AT) + 1)}"
    for name in CASES:
        for engine in ENGINES:
            every, seconds = measured(name, engine, seeds)
            is_part = isinstance(CASES[name](seeds[0]), PartCase)
            for column, what in enumerate(("R, mm", "angle, deg") if is_part else ("side, mm",)):
                low, middle, high = np.nanpercentile(every[:, :, column], [25, 50, 75], axis=0)
                cells = [f"{b:.3g} ({a:.2g}-{c:.2g})" for a, b, c in zip(low, middle, high, strict=True)]
                yield f"| {name}, {engine} | {what} | {' | '.join(cells)} | {seconds:.2f} |"
        exact = [case.exact() for case in (CASES[name](seed) for seed in seeds) if isinstance(case, PartCase)]
        if exact:
            radius, angle = np.nanmedian(exact, axis=0)
            failed = int(np.isnan(exact).any(axis=1).sum())
            yield f"| {name}, exact solver | R {radius:.3g} mm, angle {angle:.1g} deg | {failed} failed |"


def _stages(case: Case, seed: int, budget: int) -> Iterator[Progress]:
    rng = np.random.default_rng(seed)
    yield from search(
        case.objective, case.lower, case.upper, rng=rng, budget=budget, violation=case.violation
    )
