# SPDX-License-Identifier: MIT
"""Connection: views added to a cover until all scans can be registered with one another."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.cover.instance import CoverInstance
from nbv.cover.overlap import OverlapGraph, components

_MOST_LOOKS = 2000  # candidates looked at in search of a way from one group of views to another


@dataclass(frozen=True, slots=True)
class Connected:
    """Views with overlapping scans, and those that no candidate links to them.

    Attributes
    ----------
    chosen : tuple of int
        Candidates: those given, less those that became superfluous, then those added.
    n_added : int
        How many were added.
    apart : tuple of int
        Those of them that no way joins to the largest group; none when all scans can be registered.
    """

    chosen: tuple[int, ...]
    n_added: int
    apart: tuple[int, ...]


def connect(instance: CoverInstance, graph: OverlapGraph, chosen: tuple[int, ...]) -> Connected:
    """Add few candidates, by greedy choice, so that links join all views.

    A candidate that joins the most groups is added first; where none joins two, the candidates along a
    shortest way from the smallest group to another one. Then views are dropped whose surface the others
    measure and whose links the others do without.
    """
    views = list(chosen)
    linked = graph.linked_to_any(views)
    while len(set(groups := components(linked, views))) > 1:
        bridge = _best_bridge(linked, groups)
        new = [bridge] if bridge is not None else _way_out(graph, linked, views, groups)
        if not new:
            break
        views += new
        linked = np.vstack([linked, graph.linked_to_any(new)])
    kept = _without_superfluous(instance, linked, views)
    still = [views[k] for k in kept]
    groups = components(linked[kept], still)
    largest = int(np.argmax(np.bincount(groups))) if len(groups) else 0
    apart = tuple(view for view, group in zip(still, groups, strict=True) if group != largest)
    return Connected(tuple(still), len(set(still) - set(chosen)), apart)


def _best_bridge(linked: NDArray[np.bool_], groups: NDArray[np.int64]) -> int | None:
    """Return the candidate that is linked to the most groups of views, None where that is fewer than two."""
    touched = np.array([linked[groups == group].any(axis=0) for group in np.unique(groups)])
    joined = touched.sum(axis=0)
    best = int(np.argmax(joined))
    return best if joined[best] > 1 else None


def _way_out(
    graph: OverlapGraph, linked: NDArray[np.bool_], views: list[int], groups: NDArray[np.int64]
) -> list[int]:
    """Return the candidates along a shortest way from the smallest group of views to another one."""
    smallest = int(np.argmin(np.bincount(groups)))
    goal = linked[groups != smallest].any(axis=0)
    came_from = {int(c): -1 for c in np.flatnonzero(linked[groups == smallest].any(axis=0))}
    waiting = deque(came_from)
    for _ in range(_MOST_LOOKS):
        if not waiting:
            break
        here = waiting.popleft()
        if goal[here]:
            way = [here]
            while came_from[way[-1]] >= 0:
                way.append(came_from[way[-1]])
            return [c for c in way if c not in views]
        for neighbour in np.flatnonzero(graph.links(here).linked):
            if int(neighbour) not in came_from:
                came_from[int(neighbour)] = here
                waiting.append(int(neighbour))
    return []


def _without_superfluous(instance: CoverInstance, linked: NDArray[np.bool_], views: list[int]) -> list[int]:
    """Return the positions in `views` that are kept: no coverage is lost, and no group falls apart."""
    kept = list(range(len(views)))
    times = instance.times_seen(views)
    was_met = instance.is_met_by(times)
    n_groups = len(set(components(linked, views)))
    for one in sorted(kept, key=lambda k: len(instance.seen_by(views[k]))):
        rest = [k for k in kept if k != one]
        fewer = times.copy()
        fewer[instance.seen_by(views[one])] -= 1
        if was_met and not instance.is_met_by(fewer):
            continue
        if not was_met or len(set(components(linked[rest], [views[k] for k in rest]))) > n_groups:
            continue
        kept, times = rest, fewer
    return kept
