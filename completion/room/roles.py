# SPDX-License-Identifier: MIT
"""Roles: which planes are floors, ceilings and walls of the room.

A level plane is a floor or ceiling where hardly anything was measured beyond it. An upright one is a wall
where, along most of what was measured of it, it bounds a room of the layout.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from completion.merging.merged_surface import MergedSurface, largest_shares
from completion.observe.observation import Observation
from completion.room import limits
from completion.room.layout import Layout, find_layout
from completion.room.planes import Beams, Role, RoomPlane, level_roles
from completion.room.walls import Wall
from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray
from scenes.inclination import Up


@dataclass(frozen=True, slots=True, eq=False)
class Room(ArrayValue):
    """What scans show of the rooms, working frame.

    Attributes
    ----------
    roles : tuple of str
        "floor", "ceiling", "wall" or "" for each surface.
    walls : tuple of Wall
        The walls, from corner to corner.
    layouts : tuple of Layout
        The plan of each storey in which scanners stood, from the lowest up; rooms are numbered on.
    origins : tuple of (3,) float
        Where the scanners stood.
    up : (3,) float
        Which way is up.
    bases : frozenset of int
        Level surfaces below which nothing was measured, that may be floors or tables, by number.
    places : tuple of (n, 3) float
        Some points of each surface that has a role, a little before it.
    """

    roles: tuple[Role, ...] = ()
    walls: tuple[Wall, ...] = ()
    layouts: tuple[Layout, ...] = ()
    origins: tuple[FloatArray, ...] = ()
    up: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    bases: frozenset[int] = frozenset()
    places: tuple[FloatArray, ...] = ()

    def role(self, number: int) -> Role:
        """What a surface is to the room; "" of what is no surface of its own."""
        return self.roles[number] if 0 <= number < len(self.roles) else ""

    def wall(self, number: int) -> Wall:
        """The wall that a surface is, by its number."""
        return next(wall for wall in self.walls if wall.number == number)

    def only(self, kept: BoolArray) -> Room:
        """Return the room without the roles and walls of surfaces that are not `kept` (n,)."""
        roles = tuple(role if is_so else "" for role, is_so in zip(self.roles, kept, strict=True))
        walls = tuple(wall for wall in self.walls if kept[wall.number])
        return replace(self, roles=roles, walls=walls, bases=frozenset(k for k in self.bases if kept[k]))

    def may_end(self, other: int, number: int) -> bool:
        """Tell whether surface `number` may end at surface `other`, by the rooms that both bound.

        What a wall ends is for the most part of rooms that the wall bounds. What lies above the floor of a
        storey, or below its ceiling, as landings do, ends walls that stand near it for the most part.
        """
        if not self.role(other) or not self.role(number):
            return True
        places, other_places = self.places[number], self.places[other]
        if self.role(other) == "wall":
            bounded, within = self.rooms_at(other_places), self.rooms_at(places)
            n_each = np.bincount(bounded, minlength=within.max(initial=0) + 1)
            is_common = (n_each >= limits.BOUNDING_SHARE * len(other_places))[within[within > 0]]
            return not n_each[1:].any() or not len(is_common) or bool(is_common.mean() >= limits.BOUNDING)
        if self.role(number) != "wall" or self._is_outermost(other_places):
            return True
        away, _ = cKDTree(other_places @ self.axes.T).query(places @ self.axes.T)
        return bool((away < limits.SUPPORT_M).mean() >= limits.BOUNDING)

    def _is_outermost(self, points: FloatArray) -> bool:
        """Whether a floor or ceiling, with points (n, 3), is the lowest or highest one of a storey."""
        height = float((points @ self.up).mean())
        levels = [level for layout in self.layouts for level in (layout.floor_m, layout.ceiling_m)]
        return any(abs(height - level) <= limits.SLAB_M for level in levels)

    @property
    def axes(self) -> FloatArray:
        """Level directions (2, 3) along which most walls stand."""
        return self.layouts[0].axes if self.layouts else np.eye(3)[:2]

    @property
    def scanner_rooms(self) -> tuple[int, ...]:
        """The rooms in which scanners stand."""
        return tuple(room for layout in self.layouts for room in layout.scanner_rooms)

    def rooms_at(self, points: FloatArray) -> IntArray:
        """Which room (n,) points (n, 3) are in; 0 for none."""
        rooms = np.zeros(len(points), dtype=np.int64)
        for layout, at in self._by_storey(points):
            rooms[at] = layout.rooms_at(points[at])
        return rooms

    def closed_at(self, points: FloatArray) -> FloatArray:
        """Of four ways along the axes, the share (n,) in which a wall ends the room of points (n, 3)."""
        closed = np.zeros(len(points))
        for layout, at in self._by_storey(points):
            closed[at] = layout.closed_at(points[at])
        return closed

    def _by_storey(self, points: FloatArray) -> Iterator[tuple[Layout, IntArray]]:
        """Yield the plans, and which of points (n, 3) are in their storeys, by number."""
        floors, height = np.array([layout.floor_m for layout in self.layouts]), points @ self.up
        storey = np.searchsorted(floors, height + limits.SLAB_M, side="right") - 1
        for k, layout in enumerate(self.layouts):
            is_in = (np.maximum(storey, 0) == k) & (height < layout.ceiling_m + limits.SLAB_M)
            yield layout, np.flatnonzero(is_in)

    def rooms_beside(self, wall: Wall, points: FloatArray) -> tuple[IntArray, IntArray]:
        """Which rooms (n,) are before and behind a wall at points (n, 3) of it; 0 for none."""
        aside = limits.ASIDE_M * wall.plane.normal_direction
        return self.rooms_at(points + aside), self.rooms_at(points - aside)

    def bounds(self, wall: Wall, points: FloatArray) -> BoolArray:
        """Tell at which points (n, 3) of it a wall parts a room, on its inner side, from another or none."""
        front, back = self.rooms_beside(wall, points)
        return np.asarray((front > 0) & (back != front), dtype=np.bool_)

    def holds(self, points: FloatArray) -> BoolArray:
        """Tell which points (n, 3) are in rooms in which scanners stand, above their floors."""
        low = min((layout.floor_m for layout in self.layouts), default=-np.inf)
        is_above = points @ self.up > low - limits.SLAB_M
        return np.asarray(is_above & np.isin(self.rooms_at(points), self.scanner_rooms), dtype=np.bool_)

    def hides(self, points: FloatArray, number: int) -> BoolArray:
        """Tell which points (n, 3) of surface `number` the rest of the room hides from all scanners."""
        behind = np.ones(len(points), dtype=np.bool_)
        for origin in self.origins:
            seen = np.flatnonzero(behind)
            seen = seen[~self._past_levels(points[seen], origin)]
            for wall in self.walls:
                if wall.number != number:
                    seen = seen[~wall.hides(points[seen], origin)]
            behind[seen] = False
        return behind

    def _past_levels(self, points: FloatArray, origin: FloatArray) -> BoolArray:
        """Which points (n, 3) are below the floor or above the ceiling of a room seen from `origin`."""
        past = np.zeros(len(points), dtype=np.bool_)
        eye, height = float(origin @ self.up), points @ self.up
        for layout in self.layouts:
            for level, side in ((layout.floor_m, -1.0), (layout.ceiling_m, 1.0)):
                is_past = (side * (height - level) > limits.BEHIND_M) & (side * (eye - level) < 0)
                at = np.flatnonzero(is_past & np.isfinite(level))
                part = (level - eye) / (height[at] - eye)
                past[at] |= np.isin(
                    self.rooms_at(origin + part[:, None] * (points[at] - origin)), self.scanner_rooms
                )
        return past


NO_ROOM = Room()


def assign_roles(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float, up: Up
) -> Room:
    """Find the floors, ceilings and walls among surfaces; none where up is undecided.

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
    """
    if not up.is_decided:
        return Room(tuple("" for _ in surfaces))
    # 1. Candidates: planes that are large enough, and beams that tell what they bound.
    beams = Beams.of(observations, int(np.clip(limits.SCAN_BEAMS * len(observations), *limits.N_ROLE_BEAMS)))
    levels, upright = _look(surfaces, observations, flatness_m, up)
    points = {number: surfaces[number].points(observations, limits.N_WALL_POINTS) for number, _ in upright}
    walls = [
        Wall.measured(number, plane, points[number], beams, up=up.direction) for number, plane in upright
    ]
    walls = [wall for wall in walls if (wall.high - wall.low >= limits.LEAST_WALL_M).all()]

    # 2. Storeys: the floors and ceilings of each, and the plan of what stands between them.
    roles: list[Role] = [""] * len(surfaces)
    bases = set[int]()
    layouts: list[Layout] = []
    storeys = beams.by_height(up.direction, limits.STOREY_M)
    eyes = [-np.inf, *(float((there.origin @ up.direction).mean()) for there in storeys), np.inf]
    for there, below, eye, above in zip(storeys, eyes, eyes[1:], eyes[2:], strict=False):
        floors, ceilings = list[float](), list[float]()
        level = level_roles([plane for _, plane in levels], there, up.direction, eye)
        for (number, plane), role in zip(levels, level, strict=True):
            height = float(plane.middle @ up.direction)
            if role == "base":
                bases.add(number)
            elif role:
                roles[number] = role
            if role == "floor" and height > below:
                floors.append(height)
            if role == "ceiling" and height < above:
                ceilings.append(height)
        bottom, top = np.quantile(there.point @ up.direction, (limits.OUTLYING, 1 - limits.OUTLYING))
        floor = min(floors, default=float(bottom) if layouts else -np.inf)
        ceiling = max(ceilings, default=np.inf)
        between = floor - limits.SLAB_M, min(ceiling + limits.SLAB_M, above)
        band = (max([bottom, *floors]) + limits.BAND_M, min([top, *ceilings]) - limits.BAND_M)
        here = [part for wall in walls if (part := wall.between(*between)) is not None]
        layout = find_layout(here, there, up.direction, band)
        n_before = sum(len(lower.enclosed) for lower in layouts)
        layouts.append(replace(layout.numbered_from(n_before), floor_m=floor, ceiling_m=ceiling))

    # 3. Walls: those that bound a room, as far as its corners.
    room = Room(
        layouts=tuple(layouts), origins=tuple(seen.scan.origin for seen in observations), up=up.direction
    )
    bounding = [wall for wall in walls if room.bounds(wall, wall.points).mean() >= limits.BOUNDING]
    for wall in bounding:
        roles[wall.number] = "wall"
    places = [np.zeros((0, 3)) for _ in surfaces]
    for number, plane in (*levels, *upright):
        places[number] = plane.points + limits.ASIDE_M * plane.normal
    return replace(
        room,
        roles=tuple(roles),
        walls=tuple(to_corners(wall, room) for wall in bounding),
        bases=frozenset(number for number in bases if not roles[number]),
        places=tuple(places),
    )


def _look(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float, up: Up
) -> tuple[list[tuple[int, RoomPlane]], list[tuple[int, RoomPlane]]]:
    """Level planes and upright ones, by number, that are large enough to bound a room."""
    share, level, upright = largest_shares(surfaces), [], []
    for number, surface in enumerate(surfaces):
        plane = RoomPlane.of(surface, observations, flatness_m) if surface.n_pixels else None
        if plane is None:
            continue
        inclination = surface.fit.inclination(up.direction, up.sd_deg)
        if inclination.is_level and share[number] >= limits.FLOOR_SHARE:
            level.append((number, plane))
        is_large = share[number] >= limits.WALL_SHARE and plane.area_m2 >= limits.LEAST_WALL_M2
        if inclination.is_upright and is_large:
            upright.append((number, plane))
    return level, upright


def to_corners(wall: Wall, room: Room) -> Wall:
    """Return a wall that goes on along its line as far as it bounds a room, and down to a near floor.

    Its points are not kept.
    """
    middle = (wall.low[1] + wall.high[1]) / 2
    step = np.arange(limits.PLAN_M / 2, limits.FARTHEST_M, limits.PLAN_M)
    reach = []
    for end, way in ((wall.low[0], -1.0), (wall.high[0], 1.0)):
        along = np.column_stack([end + way * step, np.full(len(step), middle)])
        reach.append(limits.PLAN_M * int(np.argmin(np.append(room.bounds(wall, wall.place(along)), False))))
    floors = [layout.floor_m for layout in room.layouts if layout.floor_m < middle]
    floor = max(floors, default=-np.inf)
    bottom = floor if wall.low[1] - floor < limits.ABOVE_FLOOR_M else wall.low[1] - limits.BELOW_M
    aside, slack = limits.PAST_END_M, limits.SLACK_M
    return replace(
        wall,
        points=np.zeros((0, 3)),
        low=np.array([wall.low[0] - reach[0] - aside, bottom - slack]),
        high=np.array([wall.high[0] + reach[1] + aside, wall.high[1] + slack]),
    )
