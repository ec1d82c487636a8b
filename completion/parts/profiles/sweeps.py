# SPDX-License-Identifier: MIT
"""Sweeps of a part: the directions that planes and cylinders share, and the axes of what is turned."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.parts.profiles.sample import SweptPart
from completion.parts.profiles.sweep import Sweep
from completion.relations.equations import Placement, place
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cylinder, Plane
from scenes.surfaces.surface import perpendicular

_MOST_DIRECTIONS = 4
_LARGE = 0.2  # of the largest face, from which its direction goes before those of smaller ones


def directions_of(part: SweptPart, sample: Sequence[FloatArray]) -> list[tuple[Sweep, float]]:
    """Extrusions along the directions that most of a part may be swept along, and the share of it that is.

    `sample` holds points (n, 3) of each face. x of their frames lies along the largest flat wall, so that
    what they show is wider than high.
    """
    axes = list(_axes(part, sample))
    classes = _classes(axes, lambda axis, other: _angle(axis, other) <= _allowed(axis, other))
    total, middle = sum(len(points) for points in sample), part.points.mean(axis=0)
    found = []
    for axis in classes:
        swept = sum(other.n for other in axes if _is_swept(axis, other)) / max(total, 1)
        found.append(
            (Sweep("extruded", _upright(part, sample, axis.direction, middle), axis.fit(middle)), swept)
        )
    return sorted(found, key=lambda pair: -pair[1])[:_MOST_DIRECTIONS]


def axes_of(part: SweptPart, sample: Sequence[FloatArray]) -> list[tuple[Sweep, float]]:
    """Revolutions about the axes that curved faces have, and the share of the part on each."""

    def are_one(axis: _Axis, other: _Axis) -> bool:
        allowed, apart = _allowed(axis, other), float(np.linalg.norm(axis.at.point - other.at.point))
        off = limits.FAR_SD * np.hypot(axis.place_sd, other.place_sd) + limits.BUILT_SD[1] + allowed * apart
        return _angle(axis, other) <= allowed and other.offset(axis.at.point) <= off

    axes = list(_axes(part, sample, curved=True))
    total, middle = sum(len(points) for points in sample), part.points.mean(axis=0)
    found = []
    for axis in _classes(axes, are_one):
        along, first = axis.direction, perpendicular(axis.direction)
        point = axis.at.point + float((middle - axis.at.point) @ along) * along
        turn = np.stack([along, first, np.cross(along, first)])
        share = sum(other.n for other in axes if are_one(other, axis)) / max(total, 1)
        found.append(
            (Sweep("revolved", Pose.from_parts(turn, -turn @ point), axis.fit(axis.at.point)), share)
        )
    return sorted(found, key=lambda pair: -pair[1])


def _classes(axes: Sequence[_Axis], are_one: Callable[[_Axis, _Axis], bool]) -> list[_Axis]:
    """One axis of those that are one: the best known, of a large face if there is one."""
    most = max((axis.n for axis in axes), default=0)
    classes: list[_Axis] = []
    for axis in sorted(axes, key=lambda axis: (axis.n < _LARGE * most, axis.sd)):
        if not any(are_one(axis, other) for other in classes):
            classes.append(axis)
    return classes


def _is_swept(axis: _Axis, other: _Axis) -> bool:
    """Whether a face lies along a direction, or is a plane across it."""
    angle = _angle(axis, other)
    if other.is_plane and abs(angle - np.pi / 2) <= _allowed(axis, other):
        return True
    return angle <= _allowed(axis, other) and other.is_straight


class _Axis:
    """The direction of a face where relations hold, where it is, and how well both are known."""

    def __init__(self, fit: SurfaceFit, n: int) -> None:
        self.n = n
        self.is_straight = isinstance(fit.surface, Plane | Cylinder)
        self.at: Placement = place(fit.surface, np.zeros(len(fit.covariance)))
        self.is_plane = isinstance(fit.surface, Plane)
        direction = self.at.direction
        largest = int(np.argmax(np.abs(np.round(direction, 9))))
        self.direction = np.asarray(direction * np.sign(direction[largest]))
        by = self.at.across @ self.at.by_direction
        self.tilts = by @ fit.covariance @ by.T
        by = self.at.across @ self.at.by_point
        self.shifts = by @ fit.covariance @ by.T
        self.sd, self.place_sd = (
            float(np.sqrt(max(np.trace(each), 0.0))) for each in (self.tilts, self.shifts)
        )

    def offset(self, point: FloatArray) -> float:
        """How far a point (3,) is from the axis, metres."""
        return float(np.linalg.norm(np.cross(self.direction, point - self.at.point)))

    def fit(self, point: FloatArray) -> SurfaceFit:
        """The axis as a cylinder through a point (3,)."""
        covariance = np.zeros((5, 5))
        covariance[[0, 1], [0, 1]] = self.place_sd**2 / 2
        covariance[[2, 3], [2, 3]] = self.sd**2 / 2
        return SurfaceFit(Cylinder(point, self.direction, 1.0), 0.0, covariance, 9)


def _axes(part: SweptPart, sample: Sequence[FloatArray], *, curved: bool = False) -> Iterator[_Axis]:
    for fit, points in zip(part.fits, sample, strict=True):
        axis = _Axis(fit, len(points)) if np.isfinite(fit.covariance).all() and is_settled(fit) else None
        if axis is not None and axis.at.direction.any() and not (curved and axis.is_plane):
            yield axis


def _angle(axis: _Axis, other: _Axis) -> float:
    return float(np.arcsin(min(1.0, np.linalg.norm(np.cross(axis.direction, other.direction)))))


def _allowed(axis: _Axis, other: _Axis) -> float:
    """Radians within which two directions may be one."""
    return float(max(limits.SAME_DIRECTION, limits.FAR_SD * np.hypot(axis.sd, other.sd)))


def _upright(part: SweptPart, sample: Sequence[FloatArray], along: FloatArray, middle: FloatArray) -> Pose:
    """The frame of an extrusion: x along the largest wall, or across it if that is wider."""
    flat, most = {k: fit.surface for k, fit in enumerate(part.fits)}, np.sin(limits.SAME_DIRECTION)
    walls = [
        k for k, one in flat.items() if isinstance(one, Plane) and abs(one.normal_direction @ along) < most
    ]
    first = perpendicular(along)
    if walls:
        largest = max(walls, key=lambda number: len(sample[number]))
        normal = part.fits[largest].surface.normal_direction  # type: ignore[attr-defined]
        first = np.cross(normal, along) / np.linalg.norm(np.cross(normal, along))
    second = np.cross(along, first)
    spread = [float(np.ptp((part.points - middle) @ way)) for way in (first, second)]
    if spread[1] > spread[0]:
        first, second = second, -first
    turn = np.stack([first, second, along])
    return Pose.from_parts(turn, -turn @ middle)
