# SPDX-License-Identifier: MIT
"""Visiting order: a short order in which to visit places, by 2-opt and the moving of short stretches."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray

_MOST_STARTS = 8


def short_order(lengths: FloatArray, first: int | None = None) -> list[int]:
    """Return a short order in which to visit all of n places, from `first` on where one is given.

    `lengths` (n, n) may hold inf.

    Examples
    --------
    >>> places = np.array([0.0, 5.0, 1.0, 4.0])
    >>> short_order(np.abs(places[:, None] - places))
    [0, 2, 3, 1]
    >>> short_order(np.abs(places[:, None] - places), first=3)
    [3, 1, 2, 0]
    """
    finite = lengths[np.isfinite(lengths)]
    no_way = (1 + float(finite.max(initial=0.0))) * len(lengths)  # dearer than any tour without such a leg
    cost = np.where(np.isfinite(lengths), lengths, no_way)
    if first is not None:
        return _order_from(cost, first)
    few = np.unique(np.linspace(0, len(cost) - 1, _MOST_STARTS).astype(int))
    starts = [_nearest_first(cost, int(start)) for start in few]
    return min((_improved(cost, order) for order in starts), key=lambda order: _total(cost, order))


def _order_from(cost: FloatArray, first: int) -> list[int]:
    """Return a short order from a place: one more place, near it alone, is an end of any short tour."""
    n = len(cost)
    far = (1 + float(cost.max(initial=0.0))) * (n + 1)  # dearer than any tour
    with_end = np.full((n + 1, n + 1), far)
    with_end[:n, :n] = cost
    with_end[n, first] = with_end[first, n] = with_end[n, n] = 0.0
    order = _improved(with_end, _nearest_first(with_end, n))
    return order[1:] if order[0] == n else order[-2::-1]


def _nearest_first(cost: FloatArray, start: int) -> list[int]:
    order, left = [start], set(range(len(cost))) - {start}
    while left:
        order.append(min(left, key=lambda place: (cost[order[-1], place], place)))
        left.remove(order[-1])
    return order


def _improved(cost: FloatArray, order: list[int]) -> list[int]:
    """Turn and move stretches as long as that makes an open tour shorter."""
    while True:
        shorter = _turned(cost, order) or _moved(cost, order)
        if shorter is None:
            return order
        order = shorter


def _turned(cost: FloatArray, order: list[int]) -> list[int] | None:
    """Return the order with the one stretch turned round that gains most, None where none does."""
    n = len(order)
    route = np.array(order)
    first, last = np.triu_indices(n, 1)
    before, after = np.maximum(first - 1, 0), np.minimum(last + 1, n - 1)
    change = np.zeros(len(first))
    inner, outer = first > 0, last < n - 1
    change += inner * (cost[route[before], route[last]] - cost[route[before], route[first]])
    change += outer * (cost[route[first], route[after]] - cost[route[last], route[after]])
    best = int(np.argmin(change))
    if change[best] >= -_gain(cost):
        return None
    a, b = int(first[best]), int(last[best]) + 1
    return order[:a] + order[a:b][::-1] + order[b:]


def _moved(cost: FloatArray, order: list[int]) -> list[int] | None:
    """Return the order with a stretch of up to three places moved elsewhere, None where none gains."""
    now = _total(cost, order)
    for size in range(1, min(4, len(order))):
        for start in range(len(order) - size + 1):
            stretch, rest = order[start : start + size], order[:start] + order[start + size :]
            inside = _total(cost, stretch)
            route = np.array(rest)
            joined = cost[route, stretch[0]], cost[stretch[-1], route]
            between = joined[0][:-1] + joined[1][1:] - cost[route[:-1], route[1:]]
            added = np.concatenate([joined[1][:1], between, joined[0][-1:]])
            at = int(np.argmin(added))
            if _total(cost, rest) + inside + added[at] < now - _gain(cost):
                return rest[:at] + stretch + rest[at:]
    return None


def _gain(cost: FloatArray) -> float:
    """Least gain that counts, metres: well above rounding, so that the search ends."""
    return 1e-12 * float(cost.max(initial=0.0)) * len(cost) + 1e-9


def _total(cost: FloatArray, order: list[int]) -> float:
    route = np.array(order)
    return float(cost[route[:-1], route[1:]].sum())
