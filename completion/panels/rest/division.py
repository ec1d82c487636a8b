# SPDX-License-Identifier: MIT
"""Division: triangles are divided along their edges by chains of vertices that replace these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

Chain = tuple[int, ...]
"""The vertices that replace an edge, its ends among them."""
_Corners = tuple[int, int, int]


def divided(
    faces: NDArray[np.int64], chains: Mapping[tuple[int, int], Chain]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide triangles (m, 3) whose edges are given with the chains that replace them, as fans.

    Edges are their two vertices in ascending order, chains lead from the first to the second. Returns the
    triangles (k, 3) and which of those given each comes from (k,).
    """
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    n = int(faces.max(initial=0)) + 1
    known = np.array([a * n + b for a, b in chains if max(a, b) < n], np.int64)
    touched = np.isin(ends[..., 0] * n + ends[..., 1], known).any(axis=1)
    fans = [list(_fan(tuple(faces[k].tolist()), chains)) for k in np.flatnonzero(touched)]
    new = np.array([one for fan in fans for one in fan], np.int64).reshape(-1, 3)
    source = np.repeat(np.flatnonzero(touched), [len(fan) for fan in fans])
    return np.concatenate([faces[~touched], new]), np.concatenate([np.flatnonzero(~touched), source])


def _fan(corner: _Corners, chains: Mapping[tuple[int, int], Chain]) -> Iterator[_Corners]:
    """The triangles of one that is divided at all of its edges that have chains."""
    pending = [(corner, (True, True, True))]
    while pending:
        corner, is_own = pending.pop()
        at = next((k for k in range(3) if is_own[k] and edge_key(corner, k) in chains), -1)
        if at < 0:
            yield corner
            continue
        chain = chains[edge_key(corner, at)]
        links = chain if chain[0] == corner[at] else chain[::-1]
        apex, last = corner[(at + 2) % 3], len(links) - 2
        for k in range(last + 1):  # of the sides of the apex only the outer two were there before
            own = (False, is_own[(at + 1) % 3] and k == last, is_own[(at + 2) % 3] and k == 0)
            pending.append(((links[k], links[k + 1], apex), own))


def edge_key(corner: _Corners, k: int) -> tuple[int, int]:
    """Return the edge from the k-th corner of a triangle, its vertices in ascending order."""
    one, other = corner[k], corner[(k + 1) % 3]
    return (one, other) if one < other else (other, one)
