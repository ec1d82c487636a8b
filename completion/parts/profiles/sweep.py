# SPDX-License-Identifier: MIT
"""Sweeps: directions and axes along which profiles are moved, and what a face is in a profile's plane.

In two dimensions a line is a plane along the third, and an arc a cylinder along it: charts and relations of
surfaces serve as they are. Across a sweep by turning, a plane is a line at right angles to the axis, a
cylinder one along it, a cone a slanted one; a torus is an arc, and a sphere one with its centre on the axis.
A face's parameters are taken where it is swept exactly, and its covariance given that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.division.divided_part import RelatedPart
from completion.parts.profiles import limits
from completion.relations.equations import Placement, move_surface, place
from completion.relations.estimate import JointEstimate, wald_test
from completion.relations.graph import is_settled
from completion.relations.relation import Relation, RelationKind
from scenes.checks import BoolArray, FloatArray, Value
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import perpendicular

SweepKind = Literal["extruded", "revolved"]
_ROUNDING = 1e-9  # metres
_Z = np.array([0.0, 0.0, 1.0])
_MOST_DIRECTIONS = 4
_LARGE = 0.2  # of the largest face, from which its direction goes before those of smaller ones


@dataclass(frozen=True, slots=True, eq=False)
class Sweep(Value):
    """How a profile is moved.

    Attributes
    ----------
    kind : "extruded" or "revolved"
        Along z of its frame, or about x.
    profile_from_world : Pose
        Into the profile's frame: of an extrusion x and y lie across it; of a revolution x is the axis.
    axis : SurfaceFit
        A cylinder of any radius along the direction, or about the axis, with the covariance of where that is.
    """

    kind: SweepKind
    profile_from_world: Pose
    axis: SurfaceFit

    @property
    def direction(self) -> FloatArray:
        """Along which, or about which: (3,) unit vector, world."""
        return np.asarray(self.profile_from_world.rotation[2 if self.kind == "extruded" else 0])

    def flatten(self, points: FloatArray) -> FloatArray:
        """Places (n, 3) in the profile: x and y, metres, and the height, metres, or the turn, radians."""
        local = self.profile_from_world.apply(points)
        if self.kind == "extruded":
            return np.asarray(local)
        return np.column_stack([local[:, 0], np.hypot(*local.T[1:]), np.arctan2(local[:, 2], local[:, 1])])

    def is_along(self, surface: Surface, points: FloatArray) -> BoolArray:
        """Whether a surface is along the motion of each of its points (n, 3), within `SWEPT`."""
        motion: FloatArray = self.direction
        if self.kind == "revolved":
            local = self.profile_from_world.apply(points) * [0.0, 1.0, 1.0]
            across = (
                np.cross([1.0, 0.0, 0.0], local) / np.maximum(np.linalg.norm(local, axis=1), 1e-12)[:, None]
            )
            motion = across @ self.profile_from_world.rotation
        return np.asarray(np.abs(np.sum(surface.normal(points) * motion, axis=1)) <= np.sin(limits.SWEPT))

    def wall(self, fit: SurfaceFit) -> SurfaceFit | None:
        """Return a face as a plane or cylinder along z through its profile; None where it is not swept."""
        kinds: dict[str, RelationKind] = {"plane": "perpendicular", "cylinder": "parallel"}
        if self.kind == "revolved":
            kinds = {"plane": "parallel", **dict.fromkeys(("cylinder", "cone", "torus", "sphere"), "coaxial")}
        kind = fit.surface.kind
        given = self._given(fit, kinds[kind]) if kind in kinds else None
        return None if given is None else self._embedded(given)

    def cap(self, fit: SurfaceFit) -> tuple[float, float] | None:
        """Height and its standard deviation, metres, of a plane across an extrusion; None of other faces."""
        given = self._given(fit, "parallel") if isinstance(fit.surface, Plane) else None
        if given is None:
            return None
        at = place(given.surface, np.zeros(3))
        along, height = (
            self.direction @ at.by_point,
            float(self.profile_from_world.apply(at.point[None])[0, 2]),
        )
        return height, float(np.sqrt(np.maximum(along @ given.covariance @ along, 0.0)))

    def _given(self, fit: SurfaceFit, kind: RelationKind) -> SurfaceFit | None:
        """The fit where it is so to the axis exactly, and its covariance given that; None where it is not."""
        if isinstance(fit.surface, Sphere):
            return self._centred(fit)
        relation = Relation(kind=kind, surfaces=(0, 1))
        test = wald_test(relation, JointEstimate([fit, self.axis], None, np.array(limits.BUILT_SD)))
        if not test.is_met or test.chi2 > limits.FAR_SD**2 * len(test.rows):
            return None
        exact = replace(self.axis, covariance=np.zeros_like(self.axis.covariance))
        joint = JointEstimate([fit, exact], None, np.zeros(3))
        joint.impose(relation, wald_test(relation, joint).rows)
        joint.solve()
        moved = move_surface(fit.surface, joint.change(0))
        return replace(fit, surface=moved, covariance=joint.covariance_of(0))

    def _centred(self, fit: SurfaceFit) -> SurfaceFit | None:
        """A sphere with its centre on the axis."""
        across = self.profile_from_world.rotation[1:] @ np.eye(4)[:3]
        off = self.profile_from_world.apply(place(fit.surface, np.zeros(4)).point[None])[0, 1:]
        gain = fit.covariance @ across.T
        by_axis = np.eye(2) * float(self.axis.covariance[:2, :2].max() + limits.BUILT_SD[1] ** 2)
        if off @ np.linalg.solve(across @ gain + by_axis, off) > 2 * limits.FAR_SD**2:
            return None
        shrunk = np.linalg.solve(across @ gain + _ROUNDING**2 * np.eye(2), gain.T)
        moved = move_surface(fit.surface, -off @ shrunk)
        return replace(fit, surface=moved, covariance=fit.covariance - gain @ shrunk)

    def _embedded(self, fit: SurfaceFit) -> SurfaceFit:
        """A face that is swept exactly, in the profile."""
        at = place(fit.surface, np.zeros(len(fit.covariance)))
        turned, point = self.profile_from_world.rotation, self.profile_from_world.apply(at.point[None])[0]
        if self.kind == "revolved":
            return _meridian(fit, at, float(point[0]), turned[0])
        if isinstance(fit.surface, Cylinder):
            by = np.vstack([turned[:2] @ at.by_point, at.by_radius])
            return _arc(fit, point[:2], at.radius, by)
        normal = turned @ at.direction
        tangent = turned.T @ np.array([-normal[1], normal[0], 0.0])
        by = np.vstack([-at.direction @ at.by_point, tangent @ at.by_direction])
        return _line(fit, point[:2], normal[:2], by)


def _meridian(fit: SurfaceFit, at: Placement, along: float, axis: FloatArray) -> SurfaceFit:
    """A surface of revolution as a line or an arc over its axis, (3,) in the world, from `along` it."""
    surface = fit.surface
    by_place, level = axis @ at.by_point, np.zeros((1, len(fit.covariance)))
    if isinstance(surface, Plane):
        sign = float(np.sign(at.direction @ axis))
        return _line(fit, np.array([along, 0.0]), np.array([sign, 0.0]), np.vstack([-sign * by_place, level]))
    if isinstance(surface, Sphere | Torus):
        by = np.vstack([by_place, at.by_ring_radius, at.by_radius])
        return _arc(fit, np.array([along, at.ring_radius]), at.radius, by)
    sign = float(np.sign(at.direction @ axis)) if isinstance(surface, Cone) else 1.0
    cosine, sine = np.cos(at.half_angle), np.sin(at.half_angle)
    # its distance is cos (r - r0) - sin (x - x0), so that a greater radius shifts the line by cos r0
    by = np.vstack([-cosine * at.by_radius, sign * at.by_half_angle])
    return _line(fit, np.array([along, at.radius]), np.array([-sign * sine, cosine]), by)


def _line(fit: SurfaceFit, point: FloatArray, normal: FloatArray, by: FloatArray) -> SurfaceFit:
    """A line through a point (2,) whose offset and slope have derivatives `by` (2, k)."""
    tangent = np.array([-normal[1], normal[0], 0.0])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = by @ fit.covariance @ by.T + np.diag([_ROUNDING**2, 0.0])
    if covariance[1, 1] <= 0:  # its slope is held: no rounding of it
        covariance[1] = covariance[:, 1] = 0.0
    surface = Plane(np.append(point, 0.0), np.append(normal, 0.0), tangent)
    return replace(fit, surface=surface, covariance=covariance, inliers=None)


def _arc(fit: SurfaceFit, centre: FloatArray, radius: float, by: FloatArray) -> SurfaceFit:
    """An arc whose centre and radius have derivatives `by` (3, k)."""
    covariance = np.zeros((5, 5))
    rows = np.ix_([0, 1, 4], [0, 1, 4])
    covariance[rows] = by @ fit.covariance @ by.T + np.diag([0.0, 0.0, _ROUNDING**2])
    concave = bool(getattr(fit.surface, "concave", False))
    surface = Cylinder(np.append(centre, 0.0), _Z, radius, np.array([1.0, 0.0, 0.0]), concave)
    return replace(fit, surface=surface, covariance=covariance, inliers=None)


def directions_of(part: RelatedPart, sample: Sequence[FloatArray]) -> list[tuple[Sweep, frozenset[int]]]:
    """Extrusions along the directions that most of a part may be swept along, and these faces (by place).

    `sample` holds points (n, 3) of each face. x of their frames lies along the largest flat wall, so that
    what they show is wider than high.
    """

    def is_swept(axis: _Axis, other: _Axis) -> bool:
        angle, allowed = axis.angle(other), axis.allowed(other)
        return (angle <= allowed and other.is_straight) or (
            other.at.is_plane and abs(angle - np.pi / 2) <= allowed
        )

    middle, axes = part.points.mean(axis=0), list(_axes(part, sample))
    found = []
    for axis in _classes(axes, lambda axis, other: axis.angle(other) <= axis.allowed(other)):
        sweep = Sweep("extruded", _upright(part, sample, axis.direction, middle), axis.fit(middle))
        found.append((sweep, frozenset(other.number for other in axes if is_swept(axis, other))))
    return sorted(found, key=lambda pair: -sum(len(sample[number]) for number in pair[1]))[:_MOST_DIRECTIONS]


def axes_of(part: RelatedPart, sample: Sequence[FloatArray]) -> list[tuple[Sweep, frozenset[int]]]:
    """Revolutions about the axes of curved faces, and the faces that are on each, by their places.

    `sample` holds points (n, 3) of each face.
    """

    def are_one(axis: _Axis, other: _Axis) -> bool:
        step = axis.at.point - other.at.point
        off = limits.FAR_SD * np.hypot(axis.place_sd, other.place_sd) + limits.BUILT_SD[1]
        off += axis.allowed(other) * float(np.linalg.norm(step))
        beside = float(np.linalg.norm(np.cross(other.direction, step)))
        return axis.angle(other) <= axis.allowed(other) and beside <= off

    middle, found = part.points.mean(axis=0), []
    axes = [axis for axis in _axes(part, sample) if not axis.at.is_plane]
    for axis in _classes(axes, are_one):
        along, first = axis.direction, perpendicular(axis.direction)
        point = axis.at.point + float((middle - axis.at.point) @ along) * along
        turn = np.stack([along, first, np.cross(along, first)])
        sweep = Sweep("revolved", Pose.from_parts(turn, -turn @ point), axis.fit(axis.at.point))
        found.append((sweep, frozenset(other.number for other in axes if are_one(other, axis))))
    return found


class _Axis(NamedTuple):
    """The direction (3,) of a face (by place) of n points, where it is, and how well both are known."""

    number: int
    n: int
    is_straight: bool
    at: Placement
    direction: FloatArray
    sd: float
    place_sd: float

    def angle(self, other: _Axis) -> float:
        """Radians between two directions, either way round."""
        return float(np.arcsin(np.minimum(1.0, np.linalg.norm(np.cross(self.direction, other.direction)))))

    def allowed(self, other: _Axis) -> float:
        """Radians within which two directions may be one."""
        return float(max(limits.SAME_DIRECTION, limits.FAR_SD * np.hypot(self.sd, other.sd)))

    def fit(self, point: FloatArray) -> SurfaceFit:
        """The axis as a cylinder through a point (3,)."""
        variance = np.repeat([self.place_sd**2 / 2, self.sd**2 / 2, 0.0], [2, 2, 1])
        return SurfaceFit(Cylinder(point, self.direction, 1.0), 0.0, np.diag(variance), 9)


def _axes(part: RelatedPart, sample: Sequence[FloatArray]) -> Iterator[_Axis]:
    for number, (fit, points) in enumerate(zip(part.fits, sample, strict=True)):
        at = place(fit.surface, np.zeros(len(fit.covariance)))
        if at.direction.any() and np.isfinite(fit.covariance).all() and is_settled(fit):
            largest = int(np.argmax(np.abs(np.round(at.direction, 9))))
            by = at.across @ at.by_direction, at.across @ at.by_point
            sd, place_sd = (float(np.sqrt(max(np.trace(each @ fit.covariance @ each.T), 0.0))) for each in by)
            direction = at.direction * np.sign(at.direction[largest])
            is_straight = isinstance(fit.surface, Plane | Cylinder)
            yield _Axis(number, len(points), is_straight, at, direction, sd=sd, place_sd=place_sd)


def _classes(axes: Sequence[_Axis], are_one: Callable[[_Axis, _Axis], bool]) -> list[_Axis]:
    """One axis of those that are one: the best known, of a large face if there is one."""
    most = max((axis.n for axis in axes), default=0)
    classes: list[_Axis] = []
    for axis in sorted(axes, key=lambda axis: (axis.n < _LARGE * most, axis.sd)):
        if not any(are_one(axis, other) for other in classes):
            classes.append(axis)
    return classes


def _upright(part: RelatedPart, sample: Sequence[FloatArray], along: FloatArray, middle: FloatArray) -> Pose:
    """The frame of an extrusion: x along the largest wall, or across it if that is wider."""
    walls = [
        (len(points), fit.surface.normal_direction)
        for fit, points in zip(part.fits, sample, strict=True)
        if isinstance(fit.surface, Plane)
        and abs(fit.surface.normal_direction @ along) < np.sin(limits.SAME_DIRECTION)
    ]
    first = perpendicular(along)
    if walls:
        first = np.cross(max(walls, key=lambda wall: wall[0])[1], along)
        first = first / np.linalg.norm(first)
    second = np.cross(along, first)
    if np.ptp((part.points - middle) @ second) > np.ptp((part.points - middle) @ first):
        first, second = second, -first
    turn = np.stack([first, second, along])
    return Pose.from_parts(turn, -turn @ middle)
