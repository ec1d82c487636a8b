# SPDX-License-Identifier: MIT
"""Wall lines: walls in the plan, and how probably they stand along their lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from completion.room import limits
from completion.room.walls import Wall
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class WallLine:
    """A line in the plan, and how probably a wall stands on it.

    Attributes
    ----------
    line : (3,) float
        a, b, c with a x + b y > c on its inner side.
    along : (2,) float
        Its unit direction.
    low : float
        Where its columns begin along it, metres.
    support : (n,) float
        Probability that a wall stands in each of them.
    ends : (2,) float
        From where to where it was measured, along it, metres.
    number : int
        Of the wall's surface, from 0; -1 of a line that is only supposed, which beams contradict.
    """

    line: FloatArray
    along: FloatArray
    low: float
    support: FloatArray
    ends: FloatArray
    number: int

    @property
    def is_measured(self) -> bool:
        """Whether it is that of a wall."""
        return self.number >= 0

    @classmethod
    def of(cls, wall: Wall, axes: FloatArray) -> WallLine:
        """Look at a wall's points and at beams that passed it; `axes` (2, 3) are the plan's."""
        points = wall.points
        normal = axes @ wall.plane.normal_direction
        normal = normal / np.linalg.norm(normal)
        middle = points.mean(axis=0)
        middle = middle - wall.plane.distance(middle[None]) * wall.plane.normal_direction
        line = np.append(normal, normal @ (axes @ middle))
        along = axes @ wall.along
        along = along / np.linalg.norm(along)
        where = (points @ axes.T) @ along
        shift = float(np.mean(where - points @ wall.along))
        ends = np.quantile(where, (limits.OUTLYING, 1 - limits.OUTLYING))
        low = float(where.min()) - 3 * limits.SUPPORT_M
        n = int((float(where.max()) + 3 * limits.SUPPORT_M - low) / limits.COLUMN_M) + 1
        column = ((where - low) / limits.COLUMN_M).astype(np.int64)
        apart = ndimage.distance_transform_edt(np.bincount(column, minlength=n) == 0) * limits.COLUMN_M
        support = np.exp(-np.maximum(apart - limits.COLUMN_M, 0) / limits.SUPPORT_M)
        tops = np.full(n, -np.inf)
        np.maximum.at(tops, column, points @ wall.up)
        passed = ((wall.crossed[:, 0] + shift - low) / limits.COLUMN_M).astype(np.int64)
        inside = (passed >= 0) & (passed < n)
        inside[inside] = wall.crossed[inside, 1] > tops[passed[inside]]
        reach = (wall.apart[inside] / (2 * limits.COLUMN_M)).astype(np.int64)
        begin, end = np.maximum(passed[inside] - reach, 0), np.minimum(passed[inside] + reach + 1, n)
        change = np.bincount(begin, minlength=n + 1) - np.bincount(end, minlength=n + 1)
        is_passed = np.cumsum(change)[:n] >= limits.CROSSINGS
        return cls(line, along, low, np.where(is_passed, 0.0, support), ends=ends, number=wall.number)

    def jambs(self) -> list[WallLine]:
        """Lines at right angles to it where it was seen to end: something goes on behind it from there."""
        lines = []
        for end, way in zip(self.ends, (-1.0, 1.0), strict=True):
            beside = end + way * limits.COLUMN_M * np.array([1.5, 2.5, 3.5])
            column = np.clip(
                ((beside - self.low) / limits.COLUMN_M).astype(np.int64), 0, len(self.support) - 1
            )
            is_seen = bool((self.support[column] == 0).any())
            normal = self.line[:2]
            behind = np.arange(0.0, 3 * limits.SUPPORT_M, limits.COLUMN_M)
            support = is_seen * limits.JAMB * np.exp(-behind / limits.SUPPORT_M)
            line = np.append(way * self.along, way * end)
            at = -float(self.line[2])
            lines.append(WallLine(line, -normal, at, support, ends=np.zeros(2), number=-1))
        return lines

    def is_along(self, other: WallLine) -> bool:
        """Whether it begins at another line and goes along it."""
        begin = self.line[2] * self.line[:2] + self.low * self.along
        is_near = abs(float(other.line[:2] @ begin - other.line[2])) < limits.COLUMN_M
        return is_near and abs(float(other.line[:2] @ self.line[:2])) > limits.ALONG

    def at(self, places: FloatArray) -> FloatArray:
        """Its support (n,) at places (n, 2) of the plan."""
        column = ((places @ self.along - self.low) / limits.COLUMN_M).astype(np.int64)
        inside = (column >= 0) & (column < len(self.support))
        return np.where(inside, self.support[np.clip(column, 0, len(self.support) - 1)], 0.0)
