# SPDX-License-Identifier: MIT
"""Matching: how far inferred area lies from the true surfaces, and hidden true area from inferred area."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.samples import Samples
from benchmarks.completion.truth.truth import FARTHEST_M, SAME_WAY, TrueChart
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster

_LIFT_M = 1e-4  # rays start this far off, so that area in place is met


@dataclass(frozen=True, slots=True, eq=False)
class NearestTruth:
    """What true surface each sample is nearest to.

    Attributes
    ----------
    distance : (n,) float
        Distance to the bounded true surfaces of the same direction, metres; inf beyond 5 cm.
    chart : (n,) int32
        Index of the chart, -1 where there is none.
    """

    distance: FloatArray
    chart: NDArray[np.int32]


def nearest_truth(samples: Samples, charts: Sequence[TrueChart]) -> NearestTruth:
    """Find the nearest true surface, of the same direction within 10 degrees, to each sample."""
    distance = np.full(len(samples.points), np.inf)
    nearest = np.full(len(samples.points), -1, np.int32)
    for index, chart in enumerate(charts):
        apart = chart.distances(samples.points, samples.normals)
        closer = apart < distance
        distance[closer], nearest[closer] = apart[closer], index
    return NearestTruth(distance, nearest)


def inferred_distances(cells: TrueCells, hypothesis: Hypothesis, caster: RayCaster) -> FloatArray:
    """Distance (rows, columns) across the surface from cells that are not seen to inferred area there.

    By rays along the normals into the inferred mesh, both ways. inf where there is no inferred area of the
    same direction within 5 cm, and for cells that are visible or out of view.
    """
    grid = cells.chart.grid
    result = np.full(cells.sight.size, np.inf)
    asked = np.flatnonzero((cells.hidden | (~cells.chart.present & cells.in_view)).ravel())
    if not len(asked) or not len(hypothesis.faces):
        return result.reshape(grid.shape)
    points = grid.centres()[asked]
    normals = grid.surface.normal(points)
    for way in (normals, -normals):
        hits = caster.first_hit(points - _LIFT_M * way, way)
        parallel = hits.hit & (hits.incidence_cosine >= SAME_WAY) & (hits.ranges <= FARTHEST_M + _LIFT_M)
        met = asked[parallel]
        result[met] = np.minimum(result[met], np.abs(hits.ranges[parallel] - _LIFT_M))
    return result.reshape(grid.shape)


def hidden_distances(cells: TrueCells, across: FloatArray, samples: Samples) -> FloatArray:
    """Distance (n,) from each reachable hidden cell, in order, to inferred area of the same direction.

    Where inferred area lies before or behind the cell it is the distance `across`, beside its edges the
    distance to `samples` of it. inf beyond 5 cm.
    """
    result = across[cells.reachable]
    missed = ~np.isfinite(result)
    points = cells.chart.grid.centres()[cells.reachable.ravel()][missed]
    result[missed] = _to_samples(points, samples, _parallel(samples, cells.chart))
    return result


def _parallel(samples: Samples, chart: TrueChart) -> BoolArray:
    """Samples near the unbounded surface and of its direction."""
    surface = chart.grid.surface
    near = np.abs(surface.distance(samples.points)) <= FARTHEST_M
    near[near] = (
        np.abs(np.einsum("ij,ij->i", surface.normal(samples.points[near]), samples.normals[near])) >= SAME_WAY
    )
    return np.asarray(near, dtype=np.bool_)


def _to_samples(points: FloatArray, samples: Samples, chosen: BoolArray) -> FloatArray:
    if not chosen.any() or not len(points):
        return np.full(len(points), np.inf)
    distance, _ = cKDTree(samples.points[chosen]).query(points, distance_upper_bound=FARTHEST_M)
    return np.asarray(distance, dtype=np.float64)
