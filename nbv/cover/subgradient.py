# SPDX-License-Identifier: MIT
"""Subgradient ascent: multipliers of instances that are too large for a linear programme.

Polyak's step along a heavy-ball direction. What rises is the value that `nbv.cover.cover` proves, so
that the multipliers of every step would do; the best are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from nbv.cover.instance import CoverInstance
from scenes.checks import FloatArray

_PATIENCE = 30  # steps without gain after which the step is halved
_GAIN = 1e-4  # share of the value that counts as gain
_MEMORY = 0.7  # of the direction before
_SMALLEST = 1e-4  # share of Polyak's step at which it is over


@dataclass(frozen=True, slots=True, eq=False)
class Multipliers:
    """Multipliers (n,) of the samples, the price of a unit of weight, and about what they prove."""

    samples: FloatArray
    price: float
    value: float


def ascend(instance: CoverInstance, n_chosen: int, n_steps: int) -> Multipliers:
    """Return multipliers that prove a bound near the best.

    Parameters
    ----------
    instance : CoverInstance
        Reduced: all of its samples coverable.
    n_chosen : int
        Size of a choice that is known; the steps aim at it.
    n_steps : int
        Steps at the most: two products of the matrix with a vector each.
    """
    sees = instance.matrix.astype(np.float64)
    seen_by = csr_array(sees.T)
    sizes = np.maximum(np.diff(instance.matrix.indptr), 1)
    multipliers = 1.0 / (seen_by * sizes[None, :]).max(axis=1).toarray().ravel()
    best = _valued(instance, sees, multipliers)
    share, waited, direction = 1.0, 0, np.zeros(instance.n_samples)
    for _ in range(n_steps):
        now = _valued(instance, sees, multipliers)
        waited = 0 if now.value > best.value + _GAIN * abs(best.value) else waited + 1
        best = max(best, now, key=lambda some: some.value)
        if waited > _PATIENCE:
            share, waited = share / 2, 0
            multipliers, direction = best.samples, np.zeros(instance.n_samples)
            continue
        direction = _slope(instance, sees, seen_by, now) + _MEMORY * direction
        length = float(direction @ direction)
        if share < _SMALLEST or length == 0:
            break
        step = share * (n_chosen - now.value) / length
        multipliers = np.clip(multipliers + step * direction, 0.0, 1.0)
    return best


def _valued(instance: CoverInstance, sees: csr_array, multipliers: FloatArray) -> Multipliers:
    """Return the multipliers with their best price, and about what they prove."""
    excess = float(np.maximum(sees @ multipliers - 1.0, 0.0).sum())
    if instance.is_full:
        return Multipliers(multipliers, 0.0, instance.fold * float(multipliers.sum()) - excess)
    price = _best_price(instance, multipliers)
    lost = np.maximum(price * instance.weights - instance.fold * multipliers, 0.0)
    return Multipliers(multipliers, price, price * instance.wanted - float(lost.sum()) - excess)


def _best_price(instance: CoverInstance, multipliers: FloatArray) -> float:
    """Return the price that fits multipliers best: the samples that are cheaper hold the wanted weight."""
    prices = instance.fold * multipliers / instance.weights
    order = np.argsort(prices, kind="stable")
    reached = np.cumsum(instance.weights[order])
    last = min(int(np.searchsorted(reached, instance.wanted)), len(order) - 1)
    return float(prices[order[last]])


def _slope(instance: CoverInstance, sees: csr_array, seen_by: csr_array, at: Multipliers) -> FloatArray:
    """Return how the value changes with each multiplier, 0 where one is to fall below 0."""
    chosen = (sees @ at.samples > 1.0).astype(np.float64)
    wanted = at.price * instance.weights > instance.fold * at.samples
    slope: FloatArray = instance.fold * (wanted | instance.is_full) - seen_by @ chosen
    slope[(at.samples <= 0) & (slope < 0)] = 0.0
    return slope
