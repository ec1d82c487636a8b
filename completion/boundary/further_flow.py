# SPDX-License-Identifier: MIT
"""Further flow: what it costs to force each node of a minimum cut to its other side, found near that node."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from scenes.checks import BoolArray
from texture.engine.compiled import compiled


def further_flow(rest: Any, is_source: BoolArray) -> NDArray[np.int64]:
    """Return how much more (n,) could flow between each node and the terminal on its side of the cut.

    By that much the cut costs more where the node is forced to the other side. A solver that begins again for
    each node takes time with the square of their number; here the shortest paths that are left are followed
    from the node until they reach the terminal (Edmonds & Karp 1972), and what flowed is put back.

    Parameters
    ----------
    rest : sparse array, (n + 2, n + 2)
        What the largest flow left of the capacities, whole numbers; the source is node n, the sink n + 1.
    is_source : (n + 2,) bool
        Nodes on the source's side: no capacity is left from these to the others.
    """
    some = coo_array(rest)
    rows, columns = np.append(some.row, some.col), np.append(some.col, some.row)
    key, index = np.unique(rows.astype(np.int64) * len(is_source) + columns, return_inverse=True)
    capacity = np.bincount(index[: some.nnz], some.data, minlength=len(key)).astype(np.int64)
    row, column = np.divmod(key, len(is_source))
    start, back = np.searchsorted(row, np.arange(len(is_source) + 1)), np.lexsort((row, column))
    more = np.zeros(len(is_source) - 2, np.int64)
    for terminal, side, left in ((-2, is_source, capacity), (-1, ~is_source, capacity[back])):
        _add_flows(start, column, back, left, len(is_source) + terminal, side, more)
    return more


@compiled
def _add_flows(
    start: NDArray[np.int64],
    other: NDArray[np.int64],
    back: NDArray[np.int64],
    left: NDArray[np.int64],
    source: int,
    side: BoolArray,
    more: NDArray[np.int64],
) -> None:
    """Add to each node of a `side` what may flow there from the source through nodes of that side.

    Edges of node i, to the `other` ends, are numbered from `start[i]` on; `back` is the number of the edge
    the other way. What is `left` of the capacities is changed and put back.
    """
    seen, onward, queue = (
        np.zeros(side.size, np.int64),
        np.zeros(side.size, np.int64),
        np.zeros(side.size, np.int64),
    )
    touched, is_touched, search = np.zeros(left.size, np.int64), np.zeros(left.size, np.bool_), 0
    before = left.copy()
    for node in range(more.size):
        if not side[node]:
            continue
        n_touched = 0
        while True:
            search += 1
            queue[0], seen[node], head, tail = node, search, 0, 1
            while head < tail and seen[source] != search:
                here = queue[head]
                head += 1
                for edge in range(start[here], start[here + 1]):
                    there = other[edge]
                    if side[there] and seen[there] != search and left[back[edge]] > 0:
                        seen[there], onward[there], queue[tail] = search, back[edge], there
                        tail += 1
            if seen[source] != search:
                break
            least, here = left[onward[source]], source
            while here != node:
                least, here = min(least, left[onward[here]]), other[onward[here]]
            here = source
            while here != node:
                edge = onward[here]
                left[edge] -= least
                left[back[edge]] += least
                for changed in (edge, back[edge]):
                    if not is_touched[changed]:
                        is_touched[changed], touched[n_touched] = True, changed
                        n_touched += 1
                here = other[edge]
            more[node] += least
        for edge in touched[:n_touched]:
            left[edge], is_touched[edge] = before[edge], False
