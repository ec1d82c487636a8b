# SPDX-License-Identifier: MIT
"""Proxies: surfaces that are no part of the building and of no closed thing, in groups that touch."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.export.building import limits
from completion.export.building.model import BuildingModel
from scenes.checks import FloatArray

_MOST_SAMPLES = 200_000  # for the area of all facets


def find_proxies(model: BuildingModel, structure: Collection[int]) -> tuple[tuple[int, ...], ...]:
    """Return the surfaces outside `structure` in groups, each a thing, by their least number.

    Surfaces are of one thing where their facets come within `limits.NEAR_FACE_M` of each other, or are linked
    by others so. What stands on a floor or against a wall is linked by neither, since these are structure.
    What no surface explains (number 0) takes no part. Two things that touch are one.
    """
    is_loose = ~np.isin(model.surface, [0, *structure])
    numbers = np.unique(model.surface[is_loose])
    if not len(numbers):
        return ()
    places, facet = _samples(model.vertices[model.faces[is_loose]])
    owner = np.searchsorted(numbers, model.surface[is_loose])[facet]
    trees = [cKDTree(places[owner == k]) for k in range(len(numbers))]
    low, high = np.array([tree.mins for tree in trees]), np.array([tree.maxes for tree in trees])
    graph = np.triu((low[:, None] <= high + limits.NEAR_FACE_M).all(axis=2), 1)
    graph &= (low <= high[:, None] + limits.NEAR_FACE_M).all(axis=2)
    for one, other in np.argwhere(graph).tolist():  # boxes that meet
        graph[one, other] = trees[one].count_neighbors(trees[other], limits.NEAR_FACE_M) > 0
    n_things, thing = connected_components(graph, directed=False)
    groups = (tuple(numbers[thing == k].tolist()) for k in range(n_things))
    return tuple(sorted(groups))


def _samples(corners: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Places (k, 3) all over triangles (m, 3, 3), and the triangle (k,) of each.

    They are so near to each other that triangles which meet have samples within `limits.NEAR_FACE_M`, unless
    the area is so large that there would be too many.
    """
    sides = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(sides, axis=2)
    base = np.argmax(length, axis=1)
    rows = np.arange(len(corners))
    start, side, apex = corners[rows, base], sides[rows, base], corners[rows, base - 1]
    long = length[rows, base]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2
    step = max(limits.NEAR_FACE_M / 2, float(np.sqrt(area.sum() / _MOST_SAMPLES)))
    high = 2 * area / np.maximum(long, step)
    counts = np.ceil(np.column_stack([long, high]) / step).astype(np.int64) + 1
    places, facets = [], []
    for n, m in np.unique(counts, axis=0).tolist():  # places along the longest side, and towards the apex
        own = np.flatnonzero((counts == (n, m)).all(axis=1))
        along, up = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, m)))
        on_base = start[own, None] + along[:, None] * side[own, None]
        places.append((on_base + up[:, None] * (apex[own, None] - on_base)).reshape(-1, 3))
        facets.append(np.repeat(own, len(along)))
    return np.concatenate(places), np.concatenate(facets)
