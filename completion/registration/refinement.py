# SPDX-License-Identifier: MIT
"""Refinement: a motion of some scans to others by point-to-plane least squares, and how stiff it is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from completion.registration import limits
from completion.registration.facets import Meetings, meet
from completion.registration.motions import STILL, compose, inverse, perturb
from completion.registration.station_view import StationView
from scenes.card import shown
from scenes.checks import BoolArray, FloatArray, IntArray


@shown
class PlacedScan(NamedTuple):
    """A scan and its pose (3, 4) in the frame of its group."""

    view: StationView
    pose: FloatArray


class MotionEquations(NamedTuple):
    """Point-to-plane equations of scans that move together against others that stay.

    `growth` (n, 6) of the offsets by a turn about a place and a shift, `offset`, `deviation`, metres,
    `share` (n,): how much of an independent measurement each is, and the `places` (n, 3) of the facets.
    """

    growth: FloatArray
    offset: FloatArray
    deviation: FloatArray
    share: FloatArray
    places: FloatArray

    @property
    def weight(self) -> FloatArray:
        """Inverse variances (n,), robust (Geman & McClure 1987)."""
        ratio = self.offset / self.deviation
        spread = max(1.0, limits.MAD_TO_SD * float(np.median(np.abs(ratio))))
        robust = np.square(1.0 / (1.0 + np.square(ratio / (limits.SURE * spread))))
        return np.asarray(self.share * robust / np.square(spread * self.deviation))


def refine(
    stay: Sequence[PlacedScan], move: Sequence[PlacedScan], motion: FloatArray, n_rounds: int, step: int = 1
) -> FloatArray:
    """Return the motion (3, 4) of a group of scans into the frame of another that brings facets together.

    Every step-th facet takes part. Rounds end early where a step is small beside the pose's own standard
    deviation: going on would settle what facets do not know.
    """
    reach = max(placement.view.radius_m for placement in move)
    scale = np.array([reach] * 3 + [1.0] * 3)
    for number in range(n_rounds):
        gate = limits.GATES_M[min(number, len(limits.GATES_M) - 1)]
        equations, middle = equations_of(stay, move, motion, gate, step)
        if len(equations.offset) < limits.LEAST_FOR_MOTION:
            return motion
        weight = equations.weight
        matrix = equations.growth.T @ (weight[:, None] * equations.growth)
        ridge = limits.RIDGE * np.trace(matrix / np.outer(scale, scale)) / 6 * np.square(scale)
        gradient = equations.growth.T @ (weight * equations.offset)
        change: FloatArray = -np.linalg.solve(matrix + np.diag(ridge), gradient).astype(np.float64)
        motion = perturb(motion, change, middle)
        if number >= len(limits.GATES_M) and _is_settled(change, matrix, scale, reach):
            break
    return motion


def _is_settled(change: FloatArray, matrix: FloatArray, scale: FloatArray, reach: float) -> bool:
    """Tell whether a step (6,) is small beside what `matrix` (6, 6), the inverse covariance, leaves open."""
    is_small = float(change @ matrix @ change) < limits.OF_SD**2
    return is_small or bool(np.abs(change * scale).max() < limits.SMALL_STEP * reach)


def equations_of(
    stay: Sequence[PlacedScan], move: Sequence[PlacedScan], motion: FloatArray, gate_m: float, step: int = 1
) -> tuple[MotionEquations, FloatArray]:
    """Return the equations of all facets that meet across, and the place (3,) that turns are about."""
    middle = np.mean([compose(motion, placement.pose)[:, 3] for placement in move], axis=0)
    parts = [
        part
        for a in stay
        for b in move
        for part in _link_equations(a, PlacedScan(b.view, compose(motion, b.pose)), middle, gate_m, step)
    ]
    return MotionEquations(*(np.concatenate(several) for several in zip(*parts, strict=True))), middle


def _link_equations(
    a: PlacedScan, b: PlacedScan, middle: FloatArray, gate_m: float, step: int
) -> tuple[MotionEquations, MotionEquations]:
    """The equations of facets of b that meet a, and of those of a that b meets, by a motion of b."""
    relative = compose(inverse(a.pose), b.pose)
    there = meet(b.view.facets, relative, a.view.sight, a.view.facets, step)
    here = meet(a.view.facets, inverse(relative), b.view.sight, b.view.facets, step)
    chosen = there.met & (np.abs(there.offset) <= gate_m)
    places = _move_places(b.view.facets.centre[::step][chosen], b.pose)
    equations = _equations(places, middle, there.normal[chosen] @ a.pose[:, :3].T, there, chosen)
    chosen = here.met & (np.abs(here.offset) <= gate_m)
    places = _move_places(a.view.facets.centre[::step][chosen], a.pose)
    other = _equations(places, middle, -here.normal[chosen] @ b.pose[:, :3].T, here, chosen)
    return equations, other


def _equations(
    places: FloatArray, middle: FloatArray, normals: FloatArray, met: Meetings, chosen: BoolArray
) -> MotionEquations:
    growth = np.concatenate([np.cross(places - middle, normals), normals], axis=1)
    share = np.full(len(places), min(1.0, limits.INDEPENDENT / max(len(chosen), 1)))
    return MotionEquations(growth, met.offset[chosen], met.deviation[chosen], share, places)


def _move_places(places: FloatArray, motion: FloatArray) -> FloatArray:
    return np.asarray(places @ motion[:, :3].T + motion[:, 3])


class Stiffness(NamedTuple):
    """What facets that met tell least of a motion."""

    least: float  # eigenvalue, 0 to 1 / 6
    free: FloatArray  # (6,) its direction: a turn about the middle times the reach, and a shift
    middle: FloatArray  # (3,) of the facets
    reach_m: float  # root mean square of their distances to it

    @property
    def change(self) -> FloatArray:
        """The motion (6,) that they tell least: a turn about the middle, radians, and a shift, metres."""
        return np.asarray(self.free / np.array([max(self.reach_m, limits.SMALL_STEP)] * 3 + [1.0] * 3))


def stiffness(equations: MotionEquations) -> Stiffness:
    """Return what n facets tell least of a motion; turns count by what they shift at the facets' reach."""
    if not len(equations.offset):
        return Stiffness(0.0, np.zeros(6), np.zeros(3), 0.0)
    middle = equations.places.mean(axis=0)
    arms, normals = equations.places - middle, equations.growth[:, 3:]
    reach = float(np.sqrt(np.square(arms).sum(axis=1).mean()))
    members = np.concatenate([np.cross(arms, normals) / max(reach, limits.SMALL_STEP), normals], axis=1)
    values, vectors = np.linalg.eigh(members.T @ members / len(members))
    return Stiffness(max(float(values[0]), 0.0), np.asarray(vectors[:, 0]), middle, reach)


class Link(NamedTuple):
    """Two scans of a group, by their place in it, that share surface."""

    first: int
    second: int
    a: PlacedScan
    b: PlacedScan
    equations: MotionEquations
    growth: FloatArray  # (m, 12) of the offsets by turns and shifts of both, each about its own place

    @property
    def columns(self) -> IntArray:
        """The numbers (12,) of their turns and shifts among those of the group."""
        return np.asarray(np.r_[6 * self.first : 6 * self.first + 6, 6 * self.second : 6 * self.second + 6])


def links_of(
    numbers: Sequence[int], poses: Sequence[FloatArray], views: Sequence[StationView], gate_m: float
) -> list[Link]:
    """Return all pairs of scans that share surface, of those with these numbers at poses (3, 4)."""
    links = []
    for i, j in combinations(range(len(numbers)), 2):
        a, b = PlacedScan(views[numbers[i]], poses[i]), PlacedScan(views[numbers[j]], poses[j])
        equations, middle = equations_of([a], [b], STILL, gate_m)
        if len(equations.offset) < limits.LEAST_MEETINGS:
            continue
        growth = equations.growth
        both = np.concatenate([-_about(growth, poses[i][:, 3] - middle), growth], axis=1)
        links.append(Link(i, j, a=a, b=b, equations=equations, growth=both))
    return links


def normal_equations(links: Sequence[Link], n: int) -> tuple[FloatArray, FloatArray]:
    """Return normal equations (m, m) and (m,), m = 6 n, of turns and shifts of all scans about them."""
    matrix, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for link in links:
        if not len(link.growth):
            continue
        weight = link.equations.weight
        matrix[np.ix_(link.columns, link.columns)] += link.growth.T @ (weight[:, None] * link.growth)
        vector[link.columns] += link.growth.T @ (weight * link.equations.offset)
    return matrix, vector


def _about(growth: FloatArray, place: FloatArray) -> FloatArray:
    """Growth (n, 6) by a turn about another place, `place` (3,) from the one before."""
    turned = growth.copy()
    turned[:, :3] -= np.cross(place, growth[:, 3:])
    return turned


def solve_ridge(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Return the solution (m,) of equations some of whose directions may be told by nothing; these stay."""
    if not len(vector):
        return np.zeros(0)
    ridge = limits.RIDGE_OF_GROUP * float(np.trace(matrix)) / len(vector)
    return np.asarray(np.linalg.solve(matrix + max(ridge, 1e-12) * np.eye(len(vector)), vector))
