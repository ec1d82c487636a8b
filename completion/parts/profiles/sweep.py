# SPDX-License-Identifier: MIT
"""Sweep: a direction or an axis along which a profile is moved, and what a face is in the profile's plane.

In two dimensions a line is a plane along the third, and an arc a cylinder along it: charts and relations of
surfaces serve as they are. Across a sweep by turning, a plane is a line at right angles to the axis, a
cylinder one along it, a cone a slanted one; a torus is an arc, and a sphere one with its centre on the axis.
A face's parameters are taken where it is swept exactly, and its covariance given that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.profiles import limits
from completion.relations.equations import Placement, move_surface, place
from completion.relations.estimate import JointEstimate, wald_test
from completion.relations.relation import Relation, RelationKind
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

SweepKind = Literal["extruded", "revolved"]
_ROUNDING = 1e-9  # metres
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
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
        along = self.direction @ place(given.surface, np.zeros(3)).by_point
        height = float(self.profile_from_world.apply(given.surface.point[None])[0, 2])
        return height, float(np.sqrt(max(along @ given.covariance @ along, 0.0)))

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
        off = self.profile_from_world.apply(fit.surface.centre[None])[0, 1:]
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
