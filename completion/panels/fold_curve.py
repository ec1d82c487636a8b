# SPDX-License-Identifier: MIT
"""Fold curve: where two surfaces meet, exactly on both, by one parameter in metres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from scenes.surfaces.surface import cross

CHORD_M = 0.002  # that a facet of a cylinder is off it, at most
_LEAST_SINE = float(np.sin(np.radians(12.0)))  # of the angle between two planes that meet
_STEEP = 0.15  # cosine between a plane's normal and an axis, below which the section runs along the axis


class FoldCurve(Protocol):
    """A curve along which two surfaces meet, by a parameter `t` in metres."""

    def span(self, box: FloatArray) -> tuple[float, float]:
        """Least and greatest parameter of what may lie between two corners (2, 3) of a box."""

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) at parameters (n,), on both surfaces."""

    def stations(self, low: float, high: float) -> FloatArray:
        """Parameters (n,) from `low` to `high` between which it is straight to within `CHORD_M`."""


@dataclass(frozen=True, slots=True, eq=False)
class StraightFold:
    """The line in which two planes meet: `t` is the distance from `point` along the unit `direction`."""

    point: FloatArray  # (3,)
    direction: FloatArray  # (3,)

    def span(self, box: FloatArray) -> tuple[float, float]:
        """Least and greatest parameter in a box (2, 3)."""
        return _along(self.point, self.direction, box)

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) at parameters (n,)."""
        return np.asarray(self.point + np.asarray(t)[..., None] * self.direction)

    def stations(self, low: float, high: float) -> FloatArray:
        """The two ends (2,)."""
        return np.array([low, high])


@dataclass(frozen=True, slots=True, eq=False)
class RoundFold:
    """The section of a cylinder by a plane that crosses it; `t` is the arc length s of the cylinder's chart.

    With the plane n x = d and the cylinder's points p + r e(s) + h w: h(s) = (d - n (p + r e(s))) / (n w).
    """

    cylinder: Cylinder
    plane: Plane

    def span(self, box: FloatArray) -> tuple[float, float]:  # noqa: ARG002 -- that of its protocol
        """All of the way round, whatever the box (2, 3)."""
        return -self.cylinder.period / 2, self.cylinder.period / 2

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) at parameters (n,)."""
        foot = self.cylinder.from_uv(np.stack([t, np.zeros_like(t)], axis=-1))
        steep = float(self.plane.normal_direction @ self.cylinder.direction)
        return foot - (self.plane.distance(foot) / steep)[..., None] * self.cylinder.direction

    def stations(self, low: float, high: float) -> FloatArray:
        """The ends, and the facet lines of the cylinder between them, (n,)."""
        return np.concatenate([[low], facet_lines(self.cylinder, low, high), [high]])


@dataclass(frozen=True, slots=True, eq=False)
class SideFold:
    """One of the two lines, about along the axis, in which a plane cuts a cylinder lengthwise.

    `t` is the height h; s(h) = s0 + side r arccos((d - n (p + h w)) / (r |n across w|)).
    """

    cylinder: Cylinder
    plane: Plane
    side: float  # 1 or -1
    heights: tuple[float, float]  # between which the plane reaches the cylinder

    def span(self, box: FloatArray) -> tuple[float, float]:
        """Least and greatest height in a box (2, 3)."""
        low, high = _along(self.cylinder.point, self.cylinder.direction, box)
        return max(low, self.heights[0]), min(high, self.heights[1])

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) at parameters (n,)."""
        cylinder = self.cylinder
        away, across, middle = _lengthwise(cylinder, self.plane)
        rise = float(self.plane.normal_direction @ cylinder.direction)
        share = np.clip((away - np.asarray(t) * rise) / (cylinder.radius * across), -1.0, 1.0)
        s = middle + self.side * cylinder.radius * np.arccos(share)
        s = (s + cylinder.period / 2) % cylinder.period - cylinder.period / 2
        return cylinder.from_uv(np.stack([s, np.asarray(t)], axis=-1))

    def stations(self, low: float, high: float) -> FloatArray:
        """The ends, and more where it turns around the axis, (n,)."""
        ends = self.at(np.array([low, high]))
        turned = np.ptp(np.unwrap(self.cylinder.to_uv(ends)[:, 0], period=self.cylinder.period))
        return np.linspace(low, high, 2 + 2 * int(turned / facet_width(self.cylinder.radius)))


def fold_curves(first: Surface, second: Surface) -> list[FoldCurve]:
    """Return the curves in which two surfaces of one frame meet, as far as they have a closed form.

    Planes meet in a line: u = n1 x n2, at the point that solves [n1; n2; u] x = [d1; d2; u c], c between the
    surfaces' own points. A plane crosses a cylinder in an ellipse, or lengthwise in two lines. Empty for
    planes less than 12 degrees apart and for other pairs.
    """
    if isinstance(first, Plane) and isinstance(second, Plane):
        return _of_planes(first, second)
    if isinstance(first, Cylinder) and isinstance(second, Plane):
        first, second = second, first
    if isinstance(first, Plane) and isinstance(second, Cylinder):
        return _of_plane_and_cylinder(first, second)
    return []


def facet_width(radius_m: float) -> float:
    """Arc length of a facet of a cylinder whose chord is off it by `CHORD_M`, or by a tenth of the radius."""
    sagitta = min(CHORD_M, radius_m / 10)
    return float(2 * radius_m * np.arccos(1 - sagitta / radius_m))


def facet_lines(cylinder: Cylinder, low: float, high: float) -> FloatArray:
    """Return arc lengths (n,) strictly between two at which the facets of a cylinder meet.

    A whole number of facets goes round.
    """
    width = cylinder.period / np.ceil(cylinder.period / facet_width(cylinder.radius))
    inset = 1e-3 * width
    first, last = np.ceil((low + inset) / width), np.floor((high - inset) / width)
    return np.asarray(width * np.arange(first, last + 1))


def _of_planes(first: Plane, second: Plane) -> list[FoldCurve]:
    across = cross(first.normal_direction, second.normal_direction)
    sine = float(np.linalg.norm(across))
    if sine < _LEAST_SINE:
        return []
    direction, middle = across / sine, (first.point + second.point) / 2
    normals = np.stack([first.normal_direction, second.normal_direction, direction])
    offsets = [plane.normal_direction @ plane.point for plane in (first, second)]
    return [StraightFold(np.linalg.solve(normals, [*offsets, direction @ middle]), direction)]


def _of_plane_and_cylinder(plane: Plane, cylinder: Cylinder) -> list[FoldCurve]:
    rise = float(plane.normal_direction @ cylinder.direction)
    if abs(rise) > _STEEP:
        return [RoundFold(cylinder, plane)]
    away, across, _ = _lengthwise(cylinder, plane)
    reach = cylinder.radius * across
    if abs(rise) * max(cylinder.radius, 1.0) < 1e-9:
        if abs(away) >= reach:
            return []
        heights = (-np.inf, np.inf)
    else:
        low, high = sorted((away + sign * reach) / rise for sign in (-1.0, 1.0))
        heights = (low, high)
    return [SideFold(cylinder, plane, side, heights) for side in (-1.0, 1.0)]


def _along(point: FloatArray, direction: FloatArray, box: FloatArray) -> tuple[float, float]:
    """Least and greatest distance along a direction from a point of the corners of a box (2, 3)."""
    middle = float((box.mean(axis=0) - point) @ direction)
    half = float(np.abs(direction) @ (box[1] - box[0]) / 2)
    return middle - half, middle + half


def _lengthwise(cylinder: Cylinder, plane: Plane) -> tuple[float, float, float]:
    """D - n p, the length of n across the axis, and the arc length at which e(s) is along n."""
    normal = plane.normal_direction
    across = normal - (normal @ cylinder.direction) * cylinder.direction
    middle = cylinder.to_uv((cylinder.point + across)[None])[0, 0]
    return -float(plane.distance(cylinder.point[None])[0]), float(np.linalg.norm(across)), float(middle)
