# SPDX-License-Identifier: MIT
"""Mirrors: planes, the images of points and directions in them, and those between two surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from completion.relations.engine.placement import Placement
from scenes.checks import FloatArray
from scenes.surfaces.surface import perpendicular

LEAST_APART = 0.2
"""Sine of half an angle between two directions, below which they do not tell the mirror between them."""


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """A plane: the points x with normal . (x - base) = level; `tilts` (2, 3) are unit vectors across it."""

    normal: FloatArray  # (3,) unit vector
    base: FloatArray  # (3,)
    level: float
    tilts: FloatArray

    @classmethod
    def of(cls, normal: FloatArray, point: FloatArray, base: FloatArray | None = None) -> Mirror:
        """The mirror through a point (3,) with a normal of any length, about a base (3,)."""
        unit = np.asarray(normal / np.linalg.norm(normal))
        first = perpendicular(unit)
        middle = point if base is None else base
        return cls(unit, middle, float(unit @ (point - middle)), np.stack([first, np.cross(unit, first)]))

    @property
    def point(self) -> FloatArray:
        """On it, (3,), as near to its base as can be."""
        return self.base + self.level * self.normal

    def moved(self, change: FloatArray) -> tuple[Mirror, FloatArray]:
        """The mirror after a change (3,), two tilts and an offset, and the normal's derivative (3, 3)."""
        vector = self.normal + change[:2] @ self.tilts
        length = float(np.linalg.norm(vector))
        unit = vector / length
        by = (self.tilts.T - np.outer(unit, unit @ self.tilts.T)) / length
        mirror = Mirror(unit, self.base, self.level + float(change[2]), self.tilts)
        return mirror, np.column_stack([by, np.zeros(3)])

    def turned(self, direction: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A direction (3,) in the mirror, and the derivative (3, 3) by `by`, the normal's."""
        along = float(self.normal @ direction)
        slope = -2 * (np.outer(self.normal, direction @ by) + along * by)
        return direction - 2 * along * self.normal, slope

    def image(self, point: FloatArray, by: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A point (3,) in the mirror, and the derivative (3, 3) by the mirror's tilts and offset."""
        step = point - self.base
        above = float(self.normal @ step) - self.level
        slope = -2 * (np.outer(self.normal, step @ by) + above * by)
        slope[:, 2] += 2 * self.normal
        return point - 2 * above * self.normal, slope


def mirrors_between(one: Placement, two: Placement) -> Iterator[Mirror]:
    """The planes in which one surface may be the other's image: bisectors, as far as the two tell them."""
    middle = (one.point + two.point) / 2
    if not one.direction.any():
        yield Mirror.of(two.point - one.point, middle)
        return
    for sign in (1.0, -1.0):
        between = one.direction - sign * two.direction
        apart = float(np.linalg.norm(between))
        if one.is_plane and apart > 2 * LEAST_APART:
            level = (
                one.direction @ (one.point - middle) - sign * two.direction @ (two.point - middle)
            ) / apart
            yield Mirror.of(between, middle + level * between / apart)
        elif not one.is_plane and apart > 2 * LEAST_APART and apart < 2 * np.sqrt(1 - LEAST_APART**2):
            yield Mirror.of(between, _nearest(one, two))
    if not one.is_plane:
        along = one.direction + np.copysign(1.0, one.direction @ two.direction) * two.direction
        step = two.point - one.point
        aside = step - float(step @ along) * along / float(along @ along)
        if np.linalg.norm(aside) > 1e-9 * max(1e-12, float(np.linalg.norm(step))):
            yield Mirror.of(aside, middle)


def _nearest(one: Placement, two: Placement) -> FloatArray:
    """The point (3,) midway between two axes where they are nearest."""
    step, cosine = two.point - one.point, float(one.direction @ two.direction)
    along = np.linalg.solve(
        np.array([[1.0, -cosine], [cosine, -1.0]]),
        np.array([one.direction @ step, two.direction @ step]),
    )
    nearest = one.point + along[0] * one.direction, two.point + along[1] * two.direction
    return np.asarray((nearest[0] + nearest[1]) / 2)
