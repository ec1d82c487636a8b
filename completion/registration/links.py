# SPDX-License-Identifier: MIT
"""Links: what two scans of a group share, as equations of the turns and shifts of both."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from completion.registration.candidates.motions import STILL
from completion.registration.candidates.station_view import StationView
from completion.registration.refinement import Equations, Placed, equations_of
from scenes.checks import FloatArray, IntArray

_LEAST = 20  # facets of two scans that meet before they tell anything
_RIDGE = 1e-6  # of the mean eigenvalue


class Link(NamedTuple):
    """Two scans of a group, by their place in it, that share surface."""

    first: int
    second: int
    a: Placed
    b: Placed
    equations: Equations
    growth: FloatArray  # (m, 12) of the offsets by turns and shifts of both, each about its own place

    @property
    def columns(self) -> IntArray:
        """The numbers (12,) of their turns and shifts among those of the group."""
        return np.asarray(np.r_[6 * self.first : 6 * self.first + 6, 6 * self.second : 6 * self.second + 6])


def links_of(
    numbers: Sequence[int], poses: Sequence[FloatArray], views: Sequence[StationView], gate_m: float
) -> list[Link]:
    """Return all pairs of scans that share surface, of those with these numbers at poses (3, 4)."""
    found = []
    for i, j in combinations(range(len(numbers)), 2):
        a, b = Placed(views[numbers[i]], poses[i]), Placed(views[numbers[j]], poses[j])
        equations, middle = equations_of([a], [b], STILL, gate_m)
        if len(equations.offset) < _LEAST:
            continue
        own = equations.growth
        both = np.concatenate([-_about(own, poses[i][:, 3] - middle), own], axis=1)
        found.append(Link(i, j, a=a, b=b, equations=equations, growth=both))
    return found


def normal_equations(links: Sequence[Link], n: int) -> tuple[FloatArray, FloatArray]:
    """Return normal equations (m, m) and (m,), m = 6 n, of turns and shifts of all scans about them."""
    matrix, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for one in links:
        if not len(one.growth):
            continue
        weight = one.equations.weight
        matrix[np.ix_(one.columns, one.columns)] += one.growth.T @ (weight[:, None] * one.growth)
        vector[one.columns] += one.growth.T @ (weight * one.equations.offset)
    return matrix, vector


def _about(growth: FloatArray, place: FloatArray) -> FloatArray:
    """Growth (n, 6) by a turn about another place, `place` (3,) from the one before."""
    turned = growth.copy()
    turned[:, :3] -= np.cross(place, growth[:, 3:])
    return turned


def solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solution (m,) of equations some of whose directions may be told by nothing; these stay."""
    if not len(vector):
        return np.zeros(0)
    ridge = _RIDGE * float(np.trace(matrix)) / len(vector)
    return np.asarray(np.linalg.solve(matrix + max(ridge, 1e-12) * np.eye(len(vector)), vector))
