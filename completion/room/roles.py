# SPDX-License-Identifier: MIT
"""Roles: which planes are floors, ceilings and walls of the room, and what stands behind its walls.

A level plane is a floor or ceiling where hardly anything was measured beyond it. An upright one is a wall
where few beams passed it above what was measured of it: a beam over the top of a cupboard passes, one through
a doorway has wall above it. From the floor to its measured top, and from corner to corner, a wall is a
rectangle; what beams would have to cross it for, elsewhere than through its openings, is another room's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.room import limits
from completion.room.planes import Beams, Role, RoomPlane, level_role
from scenes.checks import BoolArray, FloatArray, freeze_arrays
from scenes.inclination import Up
from scenes.surfaces.catalogue import Plane


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A wall as a rectangle, working frame.

    Attributes
    ----------
    number : int
        Of its surface, from 0.
    plane : Plane
        Its plane; the normal points into the room.
    along, up : (3,) float
        Unit directions, level and upwards.
    low, high : (2,) float
        Its corners along these, metres.
    crossed : (n, 2) float
        Where beams passed it, as coordinates along these.
    """

    number: int
    plane: Plane
    along: FloatArray
    up: FloatArray
    low: FloatArray
    high: FloatArray
    crossed: FloatArray

    def __post_init__(self) -> None:
        freeze_arrays(self)

    def places(self, points: FloatArray) -> FloatArray:
        """Coordinates (n, 2) of points (n, 3) along it and upwards."""
        return np.column_stack([points @ self.along, points @ self.up])

    def hides(self, points: FloatArray, origin: FloatArray) -> BoolArray:
        """Tell which points (n, 3) stand behind it as seen from a scanner, (3,), and not in its openings."""
        before = float(self.plane.distance(origin[None])[0])
        depth = self.plane.distance(points)
        hidden: BoolArray = np.asarray((depth < -limits.BEHIND_M) & (before > 0), dtype=np.bool_)
        at = np.flatnonzero(hidden)
        if not len(at):
            return hidden
        part = before / (before - depth[at])
        place = self.places(origin + part[:, None] * (points[at] - origin))
        inside = ((place > self.low) & (place < self.high)).all(axis=1)
        if len(self.crossed) and inside.any():
            apart = cKDTree(self.crossed).query(place[inside], distance_upper_bound=limits.OPENING_M)[0]
            inside[inside] = ~np.isfinite(apart)
        hidden[at] = inside
        return hidden


def behind_walls(
    points: FloatArray, walls: Sequence[Wall], origins: Sequence[FloatArray], number: int
) -> BoolArray:
    """Tell which points (n, 3) of surface `number` some other wall hides from each of the scanners (3,)."""
    behind = np.ones(len(points), dtype=np.bool_)
    for origin in origins:
        left = np.flatnonzero(behind)
        hidden = np.zeros(len(left), dtype=np.bool_)
        for wall in walls:
            if wall.number != number:
                hidden |= wall.hides(points[left], origin)
        behind[left] = hidden
    return behind


@dataclass(frozen=True, slots=True, eq=False)
class RoomRoles:
    """What each surface is to the room.

    Attributes
    ----------
    roles : tuple of str
        "floor", "ceiling", "wall" or "" for each surface.
    walls : tuple of Wall
        The walls.
    """

    roles: tuple[Role, ...]
    walls: tuple[Wall, ...]


def find_roles(
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    flatness_m: float,
    up: Up,
    encloses: BoolArray,
) -> RoomRoles:
    """Find the floors, ceilings and walls among surfaces.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        Working frame.
    observations : sequence of Observation
        The scans.
    flatness_m : float
        By how much real surfaces stray from planes, metres.
    up : Up
        Which way is up in the working frame.
    encloses : (n,) bool
        Which surfaces have nearly all measured points on their inner side: those that stand upright are walls
        whatever passes beside them.
    """
    beams = Beams.of(observations, limits.N_ROLE_BEAMS)
    eye = float(np.mean([seen.scan.origin for seen in observations], axis=0) @ up.direction)
    whole = sum(surface.n_pixels for surface in surfaces)
    roles: list[Role] = [""] * len(surfaces)
    upright: dict[int, _UprightPlane] = {}
    for number, surface in enumerate(surfaces):
        plane = RoomPlane.of(surface, observations, flatness_m) if surface.n_pixels else None
        if plane is None:
            continue
        inclination = surface.fit.inclination(up.direction, up.sd_deg)
        if inclination.is_level and surface.n_pixels >= limits.FLOOR_SHARE * whole:
            roles[number] = level_role(plane, beams, up.direction, eye)
        elif inclination.is_upright and surface.n_pixels >= limits.WALL_SHARE * whole:
            known = _UprightPlane.of(plane, beams, up.direction)
            if known.is_large:
                upright[number] = known
                roles[number] = "wall" if known.is_passed_by_few or encloses[number] else ""
    levels = [
        surfaces[k].points(observations, limits.N_BEAMS) for k, role in enumerate(roles) if role == "floor"
    ]
    floor = min((float((points @ up.direction).mean()) for points in levels), default=None)
    walls = {number: known for number, known in upright.items() if roles[number] == "wall"}
    rectangles = [known.as_wall(number, list(walls.values()), floor) for number, known in walls.items()]
    return RoomRoles(tuple(roles), tuple(rectangles))


@dataclass(frozen=True, slots=True, eq=False)
class _UprightPlane:
    """An upright plane, and what beams passed of it; (n, 2) and (2,) are places along it and upwards."""

    plane: RoomPlane
    along: FloatArray
    up: FloatArray
    low: FloatArray
    high: FloatArray
    crossed: FloatArray
    passed_columns: float
    beside: float
    over: float

    @classmethod
    def of(cls, plane: RoomPlane, beams: Beams, up: FloatArray) -> _UprightPlane:
        """Look at the beams that end behind it."""
        along = np.cross(up, plane.normal)
        along = along / np.linalg.norm(along)
        frame = np.stack([along, up], axis=1)
        own = plane.points @ frame
        low, high = np.quantile(own, (limits.OUTLYING, 1 - limits.OUTLYING), axis=0)
        before, after = plane.plane.distance(beams.origin), plane.plane.distance(beams.point)
        passes = (before > 0) & (after < -(limits.PASSED_M + 3 * np.hypot(beams.sigma, plane.bias_m)))
        part = before[passes] / (before[passes] - after[passes])
        at = (beams.origin[passes] + part[:, None] * (beams.point[passes] - beams.origin[passes])) @ frame
        is_across = (at[:, 0] > low[0]) & (at[:, 0] < high[0])
        n_beams = max(len(beams.point), 1)
        near = (at[:, 0] > low[0] - limits.BESIDE_M) & (at[:, 0] < high[0] + limits.BESIDE_M)
        return cls(
            plane=plane,
            along=along,
            up=up,
            low=low,
            high=high,
            crossed=at[near],
            passed_columns=_passed_columns(own, at[is_across], low, high),
            beside=float(np.count_nonzero(~is_across)) / n_beams,
            over=float(np.count_nonzero(is_across & (at[:, 1] > high[1]))) / n_beams,
        )

    @property
    def is_large(self) -> bool:
        """Whether it is as large as the least piece of a wall that counts."""
        is_wide = bool((self.high - self.low >= limits.LEAST_WALL_M).all())
        return is_wide and self.plane.area_m2 >= limits.LEAST_WALL_M2

    @property
    def is_passed_by_few(self) -> bool:
        """Whether few beams passed above what was measured of it, beside it and over it."""
        few = self.passed_columns < limits.PASSED_COLUMNS
        return few and self.beside < limits.PASSED_BESIDE and self.over < limits.PASSED_OVER

    def as_wall(self, number: int, walls: Sequence[_UprightPlane], floor: float | None) -> Wall:
        """As a rectangle from the floor to its measured top, and to the corners with other walls near."""
        low, high = self.low.copy(), self.high.copy()
        low[0], high[0] = low[0] - limits.PAST_END_M, high[0] + limits.PAST_END_M
        for other in walls:
            slope = float(other.plane.normal @ self.along)
            if other is self or abs(slope) < limits.CORNER_SINE:
                continue
            middle = self.plane.middle
            at = float(middle @ self.along) - float(other.plane.plane.distance(middle[None])[0]) / slope
            corner = middle + (at - float(middle @ self.along)) * self.along
            reach = float(corner @ other.along)
            if not other.low[0] - limits.CORNER_M < reach < other.high[0] + limits.CORNER_M:
                continue
            if self.low[0] - limits.TO_CORNER_M < at < self.low[0]:
                low[0] = min(low[0], at)
            if self.high[0] < at < self.high[0] + limits.TO_CORNER_M:
                high[0] = max(high[0], at)
        is_on_floor = floor is not None and self.low[1] - floor < limits.ABOVE_FLOOR_M
        low[1] = (
            floor if is_on_floor and floor is not None else self.low[1] - limits.BELOW_M
        ) - limits.SLACK_M
        high[1] = self.high[1] + limits.SLACK_M
        return Wall(number, self.plane.plane, self.along, self.up, low, high, self.crossed)


def _passed_columns(own: FloatArray, crossed: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Share of the columns of a plane in which a beam passed above the highest place (n, 2) measured."""
    n = max(int((high[0] - low[0]) / limits.COLUMN_M), 4)
    tops = []
    for places in (own, crossed):
        column = np.floor((places[:, 0] - low[0]) / (high[0] - low[0]) * n).astype(np.int64)
        inside = (column >= 0) & (column < n)
        top = np.full(n, -np.inf)
        np.maximum.at(top, column[inside], places[inside, 1])
        tops.append(top)
    return float(np.mean(tops[1] > tops[0] + limits.SLACK_M))
