# SPDX-License-Identifier: MIT
"""Odds: weights of what is known of places, most likely by which of them are right."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from scenes.checks import BoolArray, FloatArray

_LEAST = 0.003  # probability that is told of anything
_EVEN = 1e-6  # standard deviation of what is the same everywhere


def probability(known: FloatArray, weights: FloatArray) -> FloatArray:
    """Return how probable places are by what is `known` (n, k), by weights (1 + k,) of the log odds."""
    return np.asarray(1 / (1 + np.exp(-(weights[0] + known @ weights[1:]))), dtype=np.float64)


def log_likelihood(stated: FloatArray, right: BoolArray, weight: FloatArray) -> float:
    """Return the mean over places of what was stated (n,), weighted (n,)."""
    stated = np.clip(stated, _LEAST, 1 - _LEAST)
    return float(np.average(np.log(np.where(right, stated, 1 - stated)), weights=weight))


def most_likely_odds(
    known: FloatArray, right: BoolArray, weight: FloatArray, *, ridge: float, base: FloatArray | None = None
) -> FloatArray:
    """Return constant and weights (1 + k,) by ridge regression of the log odds (Hoerl & Kennard 1970).

    A place is right with the probability that follows from what is `known` (n, k), times `base` (n,).
    `ridge`: what a weight whose part of the log odds strays by one has to be worth, of all places.
    """
    base = np.ones(len(known)) if base is None else base
    weight = weight / weight.sum()
    mean = weight @ known
    spread = np.sqrt(weight @ np.square(known - mean))
    scale = np.where(spread > _EVEN, spread, 1.0)  # what is even tells nothing
    columns = np.column_stack([np.ones(len(known)), (known - mean) / scale])

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        goes_on = 1 / (1 + np.exp(-columns @ x))
        stated = np.clip(base * goes_on, 1e-6, 1 - 1e-6)
        likelihood = weight @ np.log(np.where(right, stated, 1 - stated))
        slope = np.where(right, 1 / stated, -1 / (1 - stated)) * base * goes_on * (1 - goes_on)
        slope = -columns.T @ (weight * slope)
        slope[1:] += ridge * x[1:]
        return ridge / 2 * float(x[1:] @ x[1:]) - float(likelihood), slope

    x = minimize(cost, np.zeros(columns.shape[1]), jac=True, method="L-BFGS-B").x
    return np.append(x[0] - (x[1:] / scale) @ mean, x[1:] / scale)
