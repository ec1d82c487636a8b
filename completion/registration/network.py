# SPDX-License-Identifier: MIT
"""Network: the poses of a group of scans by all that they share, and the covariance of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.registration.grouping import Group
from completion.registration.motions import STILL, composed, inverse, moved
from completion.registration.refinement import Equations, Placed, equations_of
from completion.registration.station_view import StationView
from scenes.checks import FloatArray

_GATES_M = (0.15, 0.1, 0.05)
_N_ROUNDS = 15
_STILL_M = 1e-5
_LEAST = 20  # facets of two scans that meet before they tell anything
_RIDGE = 1e-6  # of the mean eigenvalue


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Two scans of a group that share surface.

    Attributes
    ----------
    scans : (int, int)
        Their numbers.
    n_met : int
        Facets that met.
    rms_m : float
        Root mean square by which these lie apart, robust, metres.
    """

    scans: tuple[int, int]
    n_met: int
    rms_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A group as all that its scans share settles it.

    Attributes
    ----------
    group : Group
        The poses, relative to the first scan.
    covariance : (6 n, 6 n) float
        Of turns (radians) and shifts (metres) of the scans in their order, each about the scan's own place,
        axes of the group; zeros for the first.
    edges : tuple of Edge
        The pairs that share surface.
    """

    group: Group
    covariance: FloatArray
    edges: tuple[Edge, ...]


def settle_group(group: Group, views: Sequence[StationView]) -> Network:
    """Bring the scans of a group together by point-to-plane least squares over all pairs at once.

    The first scan stays. Offsets are weighted by their variance and robustly; facets of a pair tell as much
    as twenty independent ones at most.
    """
    numbers = sorted(group.poses)
    back = inverse(group.poses[numbers[0]])
    poses = [composed(back, group.poses[number]) for number in numbers]
    n = len(numbers)
    matrix: FloatArray = np.zeros((6 * n, 6 * n))
    edges: list[Edge] = []
    for number in range(_N_ROUNDS):
        gate = _GATES_M[min(number, len(_GATES_M) - 1)]
        matrix, vector, edges = _normal_equations(numbers, poses, views, gate)
        change = -_solved(matrix[6:, 6:], vector[6:]).reshape(-1, 6)
        for k, one in enumerate(change, start=1):
            poses[k] = moved(poses[k], one, poses[k][:, 3])
        if number >= len(_GATES_M) and np.abs(change).max(initial=0.0) < _STILL_M:
            break
    covariance = np.zeros((6 * n, 6 * n))
    if n > 1:
        covariance[6:, 6:] = np.linalg.pinv(matrix[6:, 6:], rcond=1e-12, hermitian=True)
    return Network(Group(dict(zip(numbers, poses, strict=True))), covariance, tuple(edges))


def _normal_equations(
    numbers: Sequence[int], poses: Sequence[FloatArray], views: Sequence[StationView], gate_m: float
) -> tuple[FloatArray, FloatArray, list[Edge]]:
    """Normal equations (6 n, 6 n), (6 n,) of turns and shifts of all scans about their places."""
    n, edges = len(numbers), list[Edge]()
    matrix, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for i in range(n):
        for j in range(i + 1, n):
            a, b = Placed(views[numbers[i]], poses[i]), Placed(views[numbers[j]], poses[j])
            equations, middle = equations_of([a], [b], STILL, gate_m)
            if len(equations.offset) < _LEAST:
                continue
            edges.append(Edge((numbers[i], numbers[j]), len(equations.offset), _rms(equations)))
            own = equations.growth
            other = -_about(own, poses[i][:, 3] - middle)
            weight = equations.weight
            both = np.concatenate([other, own], axis=1)
            chosen = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
            matrix[np.ix_(chosen, chosen)] += both.T @ (weight[:, None] * both)
            vector[chosen] += both.T @ (weight * equations.offset)
    return matrix, vector, edges


def _about(growth: FloatArray, place: FloatArray) -> FloatArray:
    """Growth (n, 6) by a turn about another place, `place` (3,) from the one before."""
    turned = growth.copy()
    turned[:, :3] -= np.cross(place, growth[:, 3:])
    return turned


def _solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """The solution (m,) of equations some of whose directions may be told by nothing; these stay."""
    if not len(vector):
        return np.zeros(0)
    ridge = _RIDGE * float(np.trace(matrix)) / len(vector)
    return np.asarray(np.linalg.solve(matrix + max(ridge, 1e-12) * np.eye(len(vector)), vector))


def _rms(equations: Equations) -> float:
    return 1.4826 * float(np.median(np.abs(equations.offset)))
