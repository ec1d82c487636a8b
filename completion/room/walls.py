# SPDX-License-Identifier: MIT
"""Walls: upright planes as rectangles, which beams passed where, and what they hide."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from completion.room import limits
from completion.room.planes import Beams, RoomPlane
from scenes.checks import ArrayValue, BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane


@dataclass(frozen=True, eq=False)
class Wall(ArrayValue):
    """A wall as a rectangle, working frame.

    Attributes
    ----------
    number : int
        Of its surface, from 0.
    plane : Plane
        Its plane; the normal points into the room.
    points : (n, 3) float
        Some of what was measured of it.
    along, up : (3,) float
        Unit directions, level and upwards.
    low, high : (2,) float
        Its corners along these, metres.
    crossed : (n, 2) float
        Where beams passed it, as coordinates along these.
    apart : (n,) float
        How far the next beam of those that are looked at is from each, metres.
    """

    number: int
    plane: Plane
    points: FloatArray
    along: FloatArray
    up: FloatArray
    low: FloatArray
    high: FloatArray
    crossed: FloatArray
    apart: FloatArray

    @classmethod
    def measured(
        cls, number: int, plane: RoomPlane, points: FloatArray, beams: Beams, *, up: FloatArray
    ) -> Wall:
        """As much of an upright plane as was measured, `points` (n, 3), and where beams passed it and beside.

        `up` (3,) is the direction that is up.
        """
        along = np.cross(up, plane.normal)
        along = along / np.linalg.norm(along)
        frame = np.stack([along, up], axis=1)
        low, high = np.quantile(plane.points @ frame, (limits.OUTLYING, 1 - limits.OUTLYING), axis=0)
        before, after = plane.plane.distance(beams.origin), plane.plane.distance(beams.point)
        passes = (before > 0) & (after < -(limits.PASSED_M + 3 * np.hypot(beams.sigma, plane.bias_m)))
        part = before[passes] / (before[passes] - after[passes])
        way = part[:, None] * (beams.point[passes] - beams.origin[passes])
        at, apart = (beams.origin[passes] + way) @ frame, beams.apart[passes] * np.linalg.norm(way, axis=1)
        near = (at[:, 0] > low[0] - limits.BESIDE_M) & (at[:, 0] < high[0] + limits.BESIDE_M)
        return cls(
            number=number,
            plane=plane.plane,
            points=points,
            along=along,
            up=up,
            low=low,
            high=high,
            crossed=at[near],
            apart=apart[near],
        )

    def between(self, bottom_m: float, top_m: float) -> Wall | None:
        """Return what of it is between two heights; None where nothing of a wall is."""
        points = self.points[(self.points @ self.up > bottom_m) & (self.points @ self.up < top_m)]
        if len(points) < 2 or np.ptp(points @ self.up) < limits.COLUMN_M:
            return None
        passed = (self.crossed[:, 1] > bottom_m) & (self.crossed[:, 1] < top_m)
        low, high = (np.array([end[0], np.clip(end[1], bottom_m, top_m)]) for end in (self.low, self.high))
        return replace(
            self, points=points, low=low, high=high, crossed=self.crossed[passed], apart=self.apart[passed]
        )

    def places(self, points: FloatArray) -> FloatArray:
        """Coordinates (n, 2) of points (n, 3) along it and upwards."""
        return np.column_stack([points @ self.along, points @ self.up])

    def place(self, places: FloatArray) -> FloatArray:
        """Points (n, 3) of the plane at coordinates (n, 2) along it and upwards."""
        frame = np.stack([self.along, self.up, self.plane.normal_direction])
        off = np.full(len(places), float(self.plane.normal_direction @ self.plane.point))
        return np.asarray(np.linalg.solve(frame, np.column_stack([places, off]).T).T)

    @cached_property
    def _crossings(self) -> cKDTree:
        return cKDTree(self.crossed)

    def hides(self, points: FloatArray, origin: FloatArray) -> BoolArray:
        """Tell which points (n, 3) stand behind it as seen from a scanner, (3,), and not in its openings."""
        before = float(self.plane.distance(origin[None])[0])
        depth = self.plane.distance(points)
        hidden: BoolArray = (depth < -limits.BEHIND_M) & (before > 0)
        at = np.flatnonzero(hidden)
        if not len(at):
            return hidden
        part = before / (before - depth[at])
        place = self.places(origin + part[:, None] * (points[at] - origin))
        inside = np.asarray(((place > self.low) & (place < self.high)).all(axis=1), dtype=np.bool_)
        if len(self.crossed) and inside.any():
            away, beam = self._crossings.query(place[inside])
            inside[np.flatnonzero(inside)] = away > limits.OPENING_M + self.apart[beam] / 2
        hidden[at] = inside
        return hidden
