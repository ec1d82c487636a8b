# SPDX-License-Identifier: MIT
"""Bootstrap: 95 % intervals of figures of pooled cases, the cases drawn anew with replacement.

Percentile intervals (Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, section 13.3) of 1000
draws, always the same ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from benchmarks.metrics.inferred import Reliability, Tally
from scenes.checks import FloatArray, InputError

_N_RESAMPLES = 1000
Interval = list[float | None]
_Pool = TypeVar("_Pool", Tally, Reliability)


def interval(cases: Sequence[_Pool], figure: Callable[[_Pool], FloatArray]) -> Interval:
    """Return the 2.5 % and 97.5 % quantiles of a figure of pooled cases; None for both without a value.

    `cases`: areas of each case, to be added up. `figure`: what follows from areas; it is given all draws at
    once, along the first axis.
    """
    return quantiles(figure(pools(cases))) if cases else [None, None]


def difference_interval(
    ours: Sequence[_Pool], others: Sequence[_Pool], figure: Callable[[_Pool], FloatArray]
) -> Interval:
    """Return the same of the figure of `ours` less that of `others`, both of the same cases in each draw.

    Raises InputError: not as many of the one as of the other.
    """
    if len(ours) != len(others):
        raise InputError(f"differences are of the same cases: got {len(ours)} and {len(others)}")
    return quantiles(figure(pools(ours)) - figure(pools(others))) if ours else [None, None]


def pools(cases: Sequence[_Pool]) -> _Pool:
    """Return the sums of as many cases as there are, drawn with replacement, draws along the first axis."""
    picks = np.random.default_rng(0).integers(0, len(cases), (_N_RESAMPLES, len(cases)))
    times = np.zeros((_N_RESAMPLES, len(cases)))
    np.add.at(times, (np.arange(_N_RESAMPLES)[:, None], picks), 1.0)
    kind = type(cases[0])
    stacked = (np.stack([np.asarray(getattr(case, name)) for case in cases]) for name in kind.__slots__)
    return kind(*(np.einsum("rn,n...->r...", times, values) for values in stacked))


def quantiles(values: FloatArray) -> Interval:
    """Return the 2.5 % and 97.5 % quantiles of the values that are finite, None for both without any."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return [None, None]
    low, high = np.quantile(finite, [0.025, 0.975])
    return [number(low), number(high)]


def number(value: float) -> float | None:
    """Return a value for JSON: None where it is not finite."""
    return float(value) if math.isfinite(value) else None
