# SPDX-License-Identifier: MIT
"""Network: the poses of a group of scans by all that they share, and the covariance of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from completion.observe.sensor_modes import N_MODES, displacements
from completion.registration.candidates.motions import STILL, composed, in_units, inverse, moved
from completion.registration.candidates.station_view import StationView
from completion.registration.grouping import Group
from completion.registration.refinement import Equations, Placed, equations_of
from scenes.checks import FloatArray, IntArray

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
        axes of the group; zeros for the first. It holds the noise, and what errors of the sensor do that
        all scans have in common.
    edges : tuple of Edge
        The pairs that share surface.
    """

    group: Group
    covariance: FloatArray
    edges: tuple[Edge, ...]

    def in_metres(self, unit_m: float) -> Network:
        """Return the same in metres whose lengths were in units of `unit_m`."""
        scale = np.tile([1.0] * 3 + [unit_m] * 3, len(self.group.poses))
        poses = {number: in_units(pose, 1.0 / unit_m) for number, pose in self.group.poses.items()}
        edges = tuple(replace(one, rms_m=unit_m * one.rms_m) for one in self.edges)
        return Network(Group(poses), self.covariance * np.outer(scale, scale), edges)


def settle_group(group: Group, views: Sequence[StationView]) -> Network:
    """Bring the scans of a group together by point-to-plane least squares over all pairs at once.

    The first scan stays. Offsets are weighted by their variance and robustly; facets of a pair tell as much
    as twenty independent ones at most. What bends a whole image, or scales it, is alike in all scans: its
    modes (`completion.observe.sensor_modes`) are followed through the least squares.
    """
    numbers = sorted(group.poses)
    back = inverse(group.poses[numbers[0]])
    poses = [composed(back, group.poses[number]) for number in numbers]
    n = len(numbers)
    matrix: FloatArray = np.zeros((6 * n, 6 * n))
    links: list[_Link] = []
    for number in range(_N_ROUNDS):
        gate = _GATES_M[min(number, len(_GATES_M) - 1)]
        links = _links(numbers, poses, views, gate)
        matrix, vector = _normal_equations(links, n)
        change = -_solved(matrix[6:, 6:], vector[6:]).reshape(-1, 6)
        for k, one in enumerate(change, start=1):
            poses[k] = moved(poses[k], one, poses[k][:, 3])
        if number >= len(_GATES_M) and np.abs(change).max(initial=0.0) < _STILL_M:
            break
    covariance = np.zeros((6 * n, 6 * n))
    if n > 1:
        known = np.linalg.pinv(matrix[6:, 6:], rcond=1e-12, hermitian=True)
        by_sensors = known @ _pull_of_sensors(links, n)[6:]
        covariance[6:, 6:] = known + by_sensors @ by_sensors.T
    edges = tuple(
        Edge((numbers[one.first], numbers[one.second]), len(one.equations.offset), _rms(one.equations))
        for one in links
    )
    return Network(Group(dict(zip(numbers, poses, strict=True))), covariance, edges)


class _Link(NamedTuple):
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


def _links(
    numbers: Sequence[int], poses: Sequence[FloatArray], views: Sequence[StationView], gate_m: float
) -> list[_Link]:
    """All pairs of scans that share surface."""
    found = []
    for i, j in combinations(range(len(numbers)), 2):
        a, b = Placed(views[numbers[i]], poses[i]), Placed(views[numbers[j]], poses[j])
        equations, middle = equations_of([a], [b], STILL, gate_m)
        if len(equations.offset) < _LEAST:
            continue
        own = equations.growth
        both = np.concatenate([-_about(own, poses[i][:, 3] - middle), own], axis=1)
        found.append(_Link(i, j, a=a, b=b, equations=equations, growth=both))
    return found


def _normal_equations(links: Sequence[_Link], n: int) -> tuple[FloatArray, FloatArray]:
    """Normal equations (6 n, 6 n), (6 n,) of turns and shifts of all scans about their places."""
    matrix, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for one in links:
        weight = one.equations.weight
        matrix[np.ix_(one.columns, one.columns)] += one.growth.T @ (weight[:, None] * one.growth)
        vector[one.columns] += one.growth.T @ (weight * one.equations.offset)
    return matrix, vector


def _pull_of_sensors(links: Sequence[_Link], n: int) -> FloatArray:
    """What each mode of the sensors' errors adds to the right side (6 n, k), the same mode in all scans."""
    pull = np.zeros((6 * n, N_MODES))
    for one in links:
        normals, places = one.equations.growth[:, 3:], one.equations.places
        apart = np.zeros((N_MODES, len(places)))
        for placed, sign in ((one.b, 1.0), (one.a, -1.0)):
            turn = placed.pose[:, :3]
            own = (places - placed.pose[:, 3]) @ turn
            moves = displacements(placed.view.seen, own) @ turn.T
            apart += sign * np.einsum("mij,ij->mi", moves, normals)
        pull[one.columns] += one.growth.T @ (one.equations.weight * apart).T
    return pull


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
