# SPDX-License-Identifier: MIT
"""Segments: pieces of walls as lines and arcs in a profile, and the corners where two of them meet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from completion.parts.profiles import limits
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_PARALLEL = 0.02  # sine of an angle between lines, below which they have no corner
_LEAST_POINTS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A line or an arc of a profile.

    Attributes
    ----------
    wall : int
        Place of its line or circle among the profile's walls; -1 for the axis of a revolution.
    start, end : (2,) float
        In the profile, metres; equal where it is a whole circle.
    middle : (2,) float
        On it, halfway.
    centre : (2,) float, optional
        Of an arc.
    radius : float
        Metres; 0 of a line.
    """

    wall: int
    start: FloatArray
    end: FloatArray
    middle: FloatArray
    centre: FloatArray | None = None
    radius: float = 0.0

    @property
    def is_whole(self) -> bool:
        """Whether it is a circle."""
        return self.centre is not None and bool((self.start == self.end).all())

    @property
    def sweep_rad(self) -> float:
        """Angle from start to end about the centre, anticlockwise positive; of a line 0."""
        if self.centre is None:
            return 0.0
        if self.is_whole:
            return float(2 * np.pi)
        first, half, last = (np.arctan2(*(place - self.centre)[::-1])
                             for place in (self.start, self.middle, self.end))  # fmt: skip
        to_half, to_last = (half - first) % (2 * np.pi), (last - first) % (2 * np.pi)
        return float(to_last if to_half <= to_last else to_last - 2 * np.pi)

    @property
    def length(self) -> float:
        """Metres."""
        return abs(self.sweep_rad) * self.radius or float(np.linalg.norm(self.end - self.start))

    def places(self, n: int = 24) -> FloatArray:
        """Places (n, 2) from start to end, of a line both ends."""
        if self.centre is None:
            return np.stack([self.start, self.end])
        away = self.start - self.centre
        angle = np.arctan2(away[1], away[0]) + np.linspace(0, self.sweep_rad, n)
        return np.asarray(self.centre + self.radius * np.column_stack([np.cos(angle), np.sin(angle)]))

    def reverse(self) -> Segment:
        """The same, from end to start."""
        return Segment(self.wall, self.end, self.start, self.middle, self.centre, self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Part of a wall without a gap: from `low` to `high` along its chart, metres; a whole circle or not."""

    wall: int
    low: float
    high: float
    is_whole: bool = False

    def segment(
        self, surface: Surface, start: FloatArray | None = None, end: FloatArray | None = None
    ) -> Segment:
        """The piece from its own ends, or from corners (2,) of it."""
        middle = place_at(surface, (self.low + self.high) / 2)
        first = place_at(surface, self.low) if start is None else start
        last = place_at(surface, self.high) if end is None else end
        if not isinstance(surface, Cylinder):
            return Segment(self.wall, first, last, (first + last) / 2)
        last = first if self.is_whole else last
        return Segment(self.wall, first, last, middle, surface.point[:2].copy(), surface.radius)


def place_at(surface: Surface, along: float) -> FloatArray:
    """Place (2,) of a wall at a coordinate of its chart, metres."""
    return np.asarray(surface.from_uv(np.array([[along, 0.0]]))[0, :2])


def pieces_of(surface: Surface, wall: int, places: FloatArray, gap_m: float) -> Iterator[Piece]:
    """Pieces of a wall by its points (n, 2): where these are farther apart than a gap, it ends."""
    if len(places) < _LEAST_POINTS:
        return
    along = np.sort(surface.to_uv(np.column_stack([places, np.zeros(len(places))]))[:, 0])
    step = np.diff(along)
    cut = np.flatnonzero(step > gap_m) + 1
    if isinstance(surface, Cylinder):
        around = along[0] + surface.period - along[-1]
        if not len(cut) and around <= max(gap_m, float(np.max(step, initial=0.0))):
            yield Piece(wall, 0.0, surface.period, True)
            return
        if around <= gap_m:  # it goes on over the chart's seam
            along = np.concatenate([along[cut[0] :], along[: cut[0]] + surface.period])
            cut = np.flatnonzero(np.diff(along) > gap_m) + 1
    for part in np.split(along, cut):
        if len(part) >= _LEAST_POINTS:
            yield Piece(wall, float(part[0]), float(part[-1]))


def corner_of(
    first: Surface, second: Surface, near: FloatArray, *, touching: bool = False
) -> FloatArray | None:
    """Where two walls meet nearest to a place (2,); None where they do not.

    Those that touch, or miss one another, meet between where they are nearest.
    """
    if isinstance(first, Plane) and isinstance(second, Plane):
        normals = np.stack([first.normal_direction[:2], second.normal_direction[:2]])
        if abs(float(np.linalg.det(normals))) < _PARALLEL:
            return None
        return np.linalg.solve(normals, np.einsum("ij,ij->i", normals, [first.point[:2], second.point[:2]]))
    if isinstance(first, Cylinder) and isinstance(second, Cylinder):
        foot, way, half = _of_circles(first, second)
    else:
        line, circle = (first, second) if isinstance(first, Plane) else (second, first)
        foot, way, half = _of_line(line, circle)  # type: ignore[arg-type]
    if way is None:
        return None
    if touching or half <= 0:
        return foot
    both = [foot + sign * half * way for sign in (-1.0, 1.0)]
    return min(both, key=lambda place: float(np.linalg.norm(place - near)))


def _of_line(line: Plane, circle: Cylinder) -> tuple[FloatArray, FloatArray | None, float]:
    """Middle (2,) of a chord, its direction (2,) and half its length; 0 where there is none."""
    normal, centre = line.normal_direction[:2], circle.point[:2]
    above = float(normal @ (centre - line.point[:2]))
    foot = centre - above * normal
    return foot, np.array([-normal[1], normal[0]]), float(np.sqrt(max(circle.radius**2 - above**2, 0.0)))


def _of_circles(first: Cylinder, second: Cylinder) -> tuple[FloatArray, FloatArray | None, float]:
    """The same of the chord that two circles have in common."""
    step = second.point[:2] - first.point[:2]
    apart = float(np.linalg.norm(step))
    if apart <= 1e-3 * min(first.radius, second.radius):
        return first.point[:2], None, 0.0
    along = (apart**2 + first.radius**2 - second.radius**2) / (2 * apart)
    half = float(np.sqrt(max(first.radius**2 - along**2, 0.0)))
    along = float(np.clip(along, -first.radius, first.radius))
    way = step / apart
    return first.point[:2] + along * way, np.array([-way[1], way[0]]), half


def tangent_at(surface: Surface, place: FloatArray) -> FloatArray:
    """Unit vector (2,) along a wall at a place (2,) on it."""
    if isinstance(surface, Plane):
        return np.asarray(surface.u_direction[:2])
    away = place - surface.point[:2]  # type: ignore[attr-defined]
    return np.array([-away[1], away[0]]) / max(float(np.linalg.norm(away)), 1e-300)


def turn_between(first: Surface, second: Surface, place: FloatArray) -> float:
    """Angle between two walls at their corner (2,), radians, 0 where they touch."""
    (a, b), (c, d) = tangent_at(first, place), tangent_at(second, place)
    return float(np.arctan2(abs(a * d - b * c), abs(a * c + b * d)))


def fuzz_m(first: Surface, second: Surface, place: FloatArray, noise_m: float) -> float:
    """How far along them noise hides where two walls touch, metres; 0 where they cross."""
    if turn_between(first, second, place) > limits.SMOOTH:
        return 0.0
    radius = min(float(getattr(surface, "radius", np.inf)) for surface in (first, second))
    return limits.FUZZ * float(np.sqrt(noise_m * radius)) if np.isfinite(radius) else 0.0
