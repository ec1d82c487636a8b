# SPDX-License-Identifier: MIT
"""Overlap: which views share enough surface, well enough conditioned, for their scans to be registered.

Two views are linked when they share a fraction of what the smaller one measures, and when the normals of the
shared surface hold all six degrees of freedom: the Hessian of point-to-plane registration (Chen and Medioni
1992; Gelfand et al. 2003), turned about the centroid and with lengths in units of the shared surface's
radius, must have no small eigenvalue. Parallel walls of a corridor fail: along them nothing holds. A view of
one wall alone can be registered with nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import connected_components

from nbv.cover.instance import CoverInstance
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray, FloatArray, Value, check_options


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlapOptions(Value):
    """When two views are linked.

    Parameters
    ----------
    min_overlap : float
        Least share of the smaller view's surface that both measure, 0..1.
    min_stiffness : float
        Least eigenvalue of the normalised Hessian, 0..1/3; three orthogonal planes that meet have about 0.1.

    Raises
    ------
    InputError
        A number out of bounds.
    """

    min_overlap: float = 0.2
    min_stiffness: float = 0.02

    def __post_init__(self) -> None:
        check_options(self, min_overlap=(0.0, 1.0), min_stiffness=(0.0, 1 / 3))


@dataclass(frozen=True, slots=True, eq=False)
class ViewLinks:
    """Overlap of one view with each of m others, (m,): shared fraction, stiffness, whether linked."""

    overlap: FloatArray
    stiffness: FloatArray
    linked: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class OverlapGraph:
    """Overlaps of the scans of m candidates, computed on demand.

    Attributes
    ----------
    seen, by_sample : (m, n) csr, (m, n) csc
        Which candidate measures which sample.
    terms : (n, 41) float
        Of each sample, times its area: 1, its point, its point squared, and the Hessian's entries.
    areas : (m,) float
        Square metres that each candidate measures.
    """

    seen: csr_array
    by_sample: csc_array
    terms: FloatArray
    areas: FloatArray
    options: OverlapOptions

    @classmethod
    def of(cls, matrix: csr_array, samples: SurfaceSamples, options: OverlapOptions) -> OverlapGraph:
        """Return the graph of the candidates of `matrix` (m, n)."""
        seen = csr_array((np.ones(len(matrix.indices)), matrix.indices, matrix.indptr), matrix.shape)
        points, normals = samples.points, samples.normals
        rows = np.concatenate([np.cross(points, normals), normals], axis=1)
        hessian = np.einsum("ni,nj->nij", rows, rows).reshape(-1, 36)
        square = np.square(points).sum(axis=1)
        terms = np.column_stack([np.ones(len(points)), points, square, hessian]) * samples.areas[:, None]
        return cls(seen, csc_array(seen), terms, seen @ samples.areas, options)

    @property
    def registrable(self) -> BoolArray:
        """Whether what a candidate sees (m,) is stiff enough for its scan to be registered with any other."""
        sums = self.seen @ self.terms
        stiff = np.zeros(len(sums))
        stiff[sums[:, 0] > 0] = stiffness(sums[sums[:, 0] > 0])
        return np.asarray(stiff >= self.options.min_stiffness)

    def links(self, candidate: int) -> ViewLinks:
        """Return the overlap (m,) of a candidate with every candidate; it is not linked to itself."""
        members = self.seen.indices[self.seen.indptr[candidate] : self.seen.indptr[candidate + 1]]
        sums = self.by_sample[:, members] @ self.terms[members]
        least = np.minimum(self.areas, self.areas[candidate])
        overlap = np.divide(sums[:, 0], least, out=np.zeros_like(least), where=least > 0)
        stiff = np.zeros_like(least)
        enough = np.flatnonzero((overlap >= self.options.min_overlap - 1e-12) & (sums[:, 0] > 0))
        stiff[enough] = stiffness(sums[enough])
        linked = np.zeros(len(least), dtype=np.bool_)
        linked[enough] = stiff[enough] >= self.options.min_stiffness
        linked[candidate] = False
        return ViewLinks(overlap, stiff, linked)

    def linked_to_any(self, views: Sequence[int]) -> NDArray[np.bool_]:
        """Tell for each of the `views` (v) which candidates are linked to it, (v, m)."""
        return np.array([self.links(view).linked for view in views]).reshape(-1, len(self.areas))


def stiffness(sums: FloatArray) -> FloatArray:
    """Return the smallest eigenvalues of normalised point-to-plane Hessians.

    Parameters
    ----------
    sums : (k, 41) float
        Sums of `OverlapGraph.terms` over shared samples, of positive area.
    """
    weight = sums[:, 0]
    centroid = sums[:, 1:4] / weight[:, None]
    square = sums[:, 4] / weight - np.square(centroid).sum(axis=1)
    radius = np.sqrt(np.maximum(square, 1e-12))
    x, y, z = centroid.T
    move = np.tile(np.eye(6), (len(sums), 1, 1))  # (p - c) x n = p x n - c x n
    nought = np.zeros_like(x)
    cross = np.stack([nought, -z, y, z, nought, -x, -y, x, nought], axis=-1).reshape(-1, 3, 3)
    move[:, :3, 3:] = -cross
    move[:, :3] /= radius[:, None, None]
    hessian = move @ (sums[:, 5:].reshape(-1, 6, 6) / weight[:, None, None]) @ move.transpose(0, 2, 1)
    least: FloatArray = np.linalg.eigvalsh(np.asarray(hessian, dtype=np.float64))[:, 0]
    return np.maximum(least, 0.0)


def components(linked: NDArray[np.bool_], views: Sequence[int]) -> NDArray[np.int64]:
    """Return the number of the connected group of each of the `views`; `linked` (v, m) as above."""
    if not len(views):
        return np.zeros(0, np.int64)
    among = linked[:, np.asarray(views)]
    group: NDArray[np.int64] = connected_components(csr_array(among | among.T), directed=False)[1]
    return group


_MOST_LOOKS = 2000  # candidates looked at in search of a way from one group of views to another


@dataclass(frozen=True, slots=True)
class Connected:
    """Views with overlapping scans: those given, less those that became superfluous, then those added.

    `apart` are those of them that no way joins to the largest group; none when all scans can be registered.
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
    for number in sorted(kept, key=lambda k: len(instance.seen_by(views[k]))):
        others = [k for k in kept if k != number]
        fewer = times.copy()
        fewer[instance.seen_by(views[number])] -= 1
        if was_met and not instance.is_met_by(fewer):
            continue
        if not was_met or len(set(components(linked[others], [views[k] for k in others]))) > n_groups:
            continue
        kept, times = others, fewer
    return kept
