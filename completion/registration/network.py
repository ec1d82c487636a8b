# SPDX-License-Identifier: MIT
"""Network: the poses of a group of scans by all that they share, and the covariance of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from completion.observe.sensor_modes import N_MODES, displacements
from completion.registration.adjustment import adjusted
from completion.registration.candidates.motions import composed, in_units, inverse, moved
from completion.registration.candidates.station_view import StationView
from completion.registration.grouping import Group
from completion.registration.links import Link, links_of, normal_equations, solved
from completion.registration.refinement import Equations
from scenes.checks import FloatArray

_GATES_M = (0.15, 0.1, 0.05)
_N_ROUNDS = 15
_STILL_M = 1e-5


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


def settle_group(group: Group, views: Sequence[StationView], *, by_planes: bool = False) -> Network:
    """Bring the scans of a group together by point-to-plane least squares over all pairs at once.

    The first scan stays. Offsets are weighted by their variance and robustly; facets of a pair tell as much
    as twenty independent ones at most. What bends a whole image, or scales it, is alike in all scans: its
    modes (`completion.observe.sensor_modes`) are followed through the least squares. With `by_planes`, planes
    that scans share are estimated together with the poses, which halves the errors of scans of flat walls;
    that is kept where both answers agree within what facets leave open.
    """
    numbers = sorted(group.poses)
    back = inverse(group.poses[numbers[0]])
    poses = [composed(back, group.poses[number]) for number in numbers]
    n = len(numbers)
    matrix: FloatArray = np.zeros((6 * n, 6 * n))
    links: list[Link] = []
    for number in range(_N_ROUNDS):
        gate = _GATES_M[min(number, len(_GATES_M) - 1)]
        links = links_of(numbers, poses, views, gate)
        matrix, vector = normal_equations(links, n)
        change = -solved(matrix[6:, 6:], vector[6:]).reshape(-1, 6)
        for k, one in enumerate(change, start=1):
            poses[k] = moved(poses[k], one, poses[k][:, 3])
        if number >= len(_GATES_M) and np.abs(change).max(initial=0.0) < _STILL_M:
            break
    if by_planes and n > 1:
        poses = _if_alike(adjusted(poses, [views[k] for k in numbers], links), poses, matrix)
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


def _if_alike(
    efficient: Sequence[FloatArray], safe: Sequence[FloatArray], matrix: FloatArray
) -> list[FloatArray]:
    """Poses that suppose more than others, where both differ by no more than chance makes them.

    `matrix` (6 n, 6 n) is the inverse covariance of the safe ones. Where what the others suppose holds, that
    planes are flat and one surface, their difference has less variance than the safe ones themselves: J. A.
    Hausman, "Specification tests in econometrics", Econometrica 1978.
    """
    change = np.concatenate(
        [
            [*Rotation.from_matrix(one[:, :3] @ two[:, :3].T).as_rotvec(), *(one[:, 3] - two[:, 3])]
            for one, two in zip(efficient, safe, strict=True)
        ]
    )
    return list(efficient if change @ matrix @ change <= len(change) - 6 else safe)


def _pull_of_sensors(links: Sequence[Link], n: int) -> FloatArray:
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


def _rms(equations: Equations) -> float:
    return 1.4826 * float(np.median(np.abs(equations.offset)))
