# SPDX-License-Identifier: MIT
"""Adjustment: poses of a group and the planes that its scans share, estimated together.

A plane is one surface of all scans that saw it, so that what two rooms say of the wall between them does not
go through a chain of poses. Of its pixels only sums count: their misfit under any small motion is quadratic.
After G. Ferrer, "Eigen-Factors: plane estimation for multi-frame and time-continuous point cloud alignment",
IROS 2019: planes are put where they fit best, and what that leaves settles the poses.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.registration.candidates.motions import moved
from completion.registration.candidates.station_view import StationView
from completion.registration.links import Link, normal_equations, solved
from completion.registration.refinement import INDEPENDENT
from scenes.checks import BoolArray, FloatArray, IntArray

_ALIKE, _SAME_M = np.cos(np.radians(5.0)), 0.03  # of a facet and the plane that it lies in
_LEAST = 12  # facets of two planes that meet, of one surface
_N_ROUNDS, _STILL = 8, 1e-7

Surface = list[tuple[int, int]]
"""By the places of scans in their group, and the numbers of their planes: the planes that are one surface."""


def adjusted(
    poses: Sequence[FloatArray], views: Sequence[StationView], links: Sequence[Link]
) -> list[FloatArray]:
    """Return poses (3, 4) of n scans that their planes and themselves make most probable; the first stays.

    Facets that met and lie in no plane that both scans share count by pairs, as they do without planes.
    """
    labels = [_labels(one, poses, views) for one in links]
    surfaces = _surfaces(links, labels)
    surface_of = {member: number for number, several in enumerate(surfaces) for member in several}
    besides = [
        _without(one, ~_are_one(one, told, surface_of)) for one, told in zip(links, labels, strict=True)
    ]
    fixed, pull = normal_equations(besides, len(poses))
    now, change = list(poses), np.zeros(6 * len(poses))
    for _ in range(_N_ROUNDS):
        matrix, vector = fixed.copy(), pull + fixed @ change
        for several in surfaces:
            _add(matrix, vector, several, now, views)
        step = -solved(matrix[6:, 6:], vector[6:])
        change[6:] += step
        for k, one in enumerate(step.reshape(-1, 6), start=1):
            now[k] = moved(now[k], one, now[k][:, 3])
        if np.abs(step).max(initial=0.0) < _STILL:
            break
    return now


def _labels(link: Link, poses: Sequence[FloatArray], views: Sequence[StationView]) -> IntArray:
    """The plane of either scan (2, m) that each place where they met lies in; -1 for none."""
    found = []
    for k in (link.first, link.second):
        planes, pose = views[k].planes, poses[k]
        places = (link.equations.places - pose[:, 3]) @ pose[:, :3]
        normals = link.equations.growth[:, 3:] @ pose[:, :3]
        off = np.abs(places @ planes.normals.T - planes.heights)
        off[np.abs(normals @ planes.normals.T) < _ALIKE] = np.inf
        if not off.shape[1]:
            found.append(np.full(len(places), -1))
            continue
        best = off.argmin(axis=1)
        found.append(np.where(off[np.arange(len(off)), best] < _SAME_M, best, -1))
    return np.array(found)


def _surfaces(links: Sequence[Link], labels: Sequence[IntArray]) -> list[Surface]:
    """The planes that are one surface, since facets of them met, of two scans at least each."""
    met: dict[tuple[tuple[int, int], tuple[int, int]], int] = defaultdict(int)
    for link, (one, two) in zip(links, labels, strict=True):
        pairs, counts = np.unique(
            np.stack([one, two])[:, (one >= 0) & (two >= 0)], axis=1, return_counts=True
        )
        for (p, q), count in zip(pairs.T.tolist(), counts.tolist(), strict=True):
            if count >= _LEAST:
                met[(link.first, p), (link.second, q)] += count
    nodes = sorted({node for pair in met for node in pair})
    number = {node: k for k, node in enumerate(nodes)}
    ends = np.array([[number[one], number[two]] for one, two in met]).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(nodes), len(nodes)))
    count, component = connected_components(graph, directed=False) if nodes else (0, np.zeros(0))
    return [[node for node, own in zip(nodes, component, strict=True) if own == k] for k in range(count)]


def _are_one(link: Link, told: IntArray, surface_of: dict[tuple[int, int], int]) -> BoolArray:
    """Whether each place (m,) where two scans met lies in planes that are one surface."""
    one, two = (
        np.array([surface_of.get((k, p), -1) for p in own.tolist()], dtype=np.int64)
        for k, own in zip((link.first, link.second), told, strict=True)
    )
    return np.asarray((one >= 0) & (one == two))


def _without(link: Link, kept: BoolArray) -> Link:
    """A link with some of its equations alone."""
    equations = type(link.equations)(*(values[kept] for values in link.equations))
    return link._replace(equations=equations, growth=link.growth[kept])


def _add(
    matrix: FloatArray,
    vector: FloatArray,
    several: Surface,
    poses: Sequence[FloatArray],
    views: Sequence[StationView],
) -> None:
    """Add what planes that are one surface tell of turns and shifts, the surface being where it fits best.

    A pixel x of a scan at pose (R, t) is off by n . (R x + t) + d. A turn w about the scan's place and
    a shift s change that by w . (R x x n) + s . n, another surface by its own (n, d) . (R x + t, 1).
    """
    scatters = {}
    for k, plane in several:
        lift = np.eye(4)
        lift[:3] = poses[k]
        share = min(1.0, INDEPENDENT / max(views[k].planes.n_pixels, 1))
        scatters[k, plane] = share * lift @ views[k].planes.scatter[plane] @ lift.T
    total = np.sum(list(scatters.values()), axis=0)
    middle = total[:3, 3] / total[3, 3]
    axes = np.linalg.eigh(total[:3, :3] - total[3, 3] * np.outer(middle, middle))[1]
    normal = axes[:, 0]
    surface = np.append(normal, -normal @ middle)
    free = np.eye(4)[:, 1:]  # what another surface adds to (n, d)
    free[:3, :2] = axes[:, 1:]
    sides = np.zeros((len(matrix), 3))
    for (k, _), scatter in scatters.items():
        growth = np.zeros((4, 6))
        growth[:3, :3] = np.cross(np.eye(3), normal)
        growth[3, :3] = np.cross(normal, poses[k][:, 3])
        growth[3, 3:] = normal
        columns = slice(6 * k, 6 * k + 6)
        matrix[columns, columns] += growth.T @ scatter @ growth
        vector[columns] += growth.T @ scatter @ surface
        sides[columns] += growth.T @ scatter @ free
    matrix -= sides @ np.linalg.solve(free.T @ total @ free, sides.T)
