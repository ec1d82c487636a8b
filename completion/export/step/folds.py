# SPDX-License-Identifier: MIT
"""Folds of two surfaces: the curves that their contacts lie on, exact conics where there are any."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from completion.export.step import limits
from completion.export.step.kernel import (
    chord_lengths,
    circle_through,
    interpolate,
    kernel,
    kernel_errors,
    kernel_point,
    kernel_surface,
    line_through,
)
from completion.export.step.tracing import CurvePath, project_on_curve, trace_curve
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_LEAST_POINTS, _MOST_POINTS = 48, 3000  # of a table
_FINE = 4.0  # points of a table in a sampling distance
_N_STEPS = 4


@dataclass(frozen=True, slots=True, eq=False)
class ContactCurve:
    """A curve on which two surfaces meet, millimetres.

    Attributes
    ----------
    pair : (int, int)
        Places of the surfaces.
    geometry : kernel curve
        Line, circle, ellipse, another conic or B-spline.
    low, high : float
        The range of its parameter that is looked at; of a closed one its period.
    is_closed : bool
        Whether the curve returns.
    is_tangent : bool
        Whether the surfaces touch there, instead of crossing.
    t, points : (n,) float, (n, 3) float
        A table of the curve.
    reach : float
        Sampling distances to its contacts.
    """

    pair: tuple[int, int]
    geometry: Any
    low: float
    high: float
    is_closed: bool
    is_tangent: bool
    t: FloatArray
    points: FloatArray
    reach: float = limits.TOUCH_REACH

    @property
    def tree(self) -> cKDTree:
        """Of the table's points."""
        return cKDTree(self.points)

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) of parameters (n,)."""
        return curve_points(self.geometry, t)

    def slope(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Point (3,) and derivative (3,) at a parameter."""
        gp = kernel().gp
        place, along = gp.gp_Pnt(), gp.gp_Vec()
        self.geometry.D1(float(t), place, along)
        return np.array(place.Coord()), np.array(along.Coord())

    def feet(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters (n,) of the nearest points of the curve within its range, and the distances (n,)."""
        if not len(points):
            return np.zeros(0), np.zeros(0)
        first = self.tree.query(points)[1]
        feet_t = self.t[first].copy()
        for place, (point, start) in enumerate(zip(points, feet_t, strict=True)):
            t = float(start)
            for _ in range(_N_STEPS):
                foot, along = self.slope(t)
                t += float((point - foot) @ along) / max(float(along @ along), 1e-300)
                if not self.is_closed:
                    t = min(max(t, self.low), self.high)
            feet_t[place] = self.wrap(t)
        return feet_t, np.linalg.norm(self.at(feet_t) - points, axis=1)

    def wrap(self, t: float) -> float:
        """The parameter within its period."""
        return self.low + (t - self.low) % (self.high - self.low) if self.is_closed else t


def curve_points(geometry: Any, t: FloatArray) -> FloatArray:
    """Points (n, 3) of a kernel's curve at parameters (n,)."""
    return np.array([geometry.Value(float(parameter)).Coord() for parameter in t]).reshape(-1, 3)


def tabulate(
    pair: tuple[int, int], geometry: Any, span: tuple[float, float], step: float, *, is_closed: bool,
    is_tangent: bool,
) -> ContactCurve:  # fmt: skip
    """The curve with a table of points about a quarter of `step` apart."""
    low, high = span
    coarse = curve_points(geometry, np.linspace(low, high, _LEAST_POINTS))
    length = float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum())
    n = int(np.clip(_FINE * length / step, _LEAST_POINTS, _MOST_POINTS))
    t = np.linspace(low, high, n, endpoint=not is_closed)
    return ContactCurve(
        pair=pair, geometry=geometry, low=low, high=high, is_closed=is_closed, is_tangent=is_tangent,
        t=t, points=curve_points(geometry, t),
    )  # fmt: skip


_CONICS = ("Geom_Line", "Geom_Circle", "Geom_Ellipse", "Geom_Hyperbola", "Geom_Parabola")
_CLOSED = ("Geom_Circle", "Geom_Ellipse")
_MOST_CURVES = 12
_MOST_KNOTS = 600
_ARC_GAP = np.pi / 4  # radians between arcs of an endless conic


def _span(feet: Sequence[float], period: float) -> tuple[float, float]:
    """The range of parameters; of a curve with a period the arc that holds most of them."""
    t = np.sort(feet)
    if not period:
        return float(t[0]), float(t[-1])
    gap = np.diff(t, append=t[0] + period)
    cut = np.flatnonzero(gap > _ARC_GAP)
    if not len(cut):
        return 0.0, period
    first = np.append(cut[-1:] + 1 - len(t), cut[:-1] + 1)  # of each arc, whose last foot is at its cut
    best = int((cut - first).argmax())
    low = t[first[best]] - (period if first[best] < 0 else 0.0)
    return float(low), float(t[cut[best]])


class FoldFinder:
    """Finds the curves along which pairs of surfaces meet; lengths in millimetres."""

    def __init__(self, surfaces: list[Surface], shapes: list[Any], spacing: float, noise: float) -> None:
        self.surfaces, self.shapes = surfaces, shapes
        self.noise = noise
        self.spacing, self.tolerance = spacing, max(4 * noise, 0.01 * spacing, 1e-4)
        self.reach = max(8 * noise, limits.COINCIDENT_REACH * spacing)

    def curves_between(self, pair: tuple[int, int], contacts: FloatArray) -> list[ContactCurve]:
        """The curves along which a pair of surfaces meets, near their contact points (n, 3)."""
        folds, left = list[ContactCurve](), contacts
        for geometry in self.conics(pair):
            if len(left) < 2:
                break
            curve = self._trim_curve(pair, geometry, left, is_tangent=False)
            if curve is None:
                continue
            near = curve.tree.query(left)[0] < limits.TOUCH_REACH * self.spacing
            if near.sum() < 2:
                continue
            left = self._add(folds, self._instead(curve, left[near]) or curve, left)
        for _ in range(_MOST_CURVES):
            if len(left) < 3:
                break
            curve, before = self._follow_curve(pair, left), len(left)
            if curve is None:
                break
            left = self._add(folds, curve, left)
            if len(left) == before:
                break
        return folds

    def _add(self, folds: list[ContactCurve], curve: ContactCurve, left: FloatArray) -> FloatArray:
        """Add a curve, unless it is there already; return the contacts (n, 3) that are not near it."""
        curve = self._with_reach(curve, left)
        apart, nearest = curve.tree.query(left)
        near = apart < curve.reach * self.spacing
        there = curve.points[nearest[near]] if near.any() else curve.points
        same = any(np.median(fold.tree.query(there)[0]) < limits.SAME_REACH * self.spacing for fold in folds)
        if not same:
            folds.append(curve)
        reach = limits.CONTACT_REACH if same else curve.reach
        return np.asarray(left[apart >= reach * self.spacing])

    def _turn(self, curve: ContactCurve, contacts: FloatArray) -> float:
        """Radians between the surfaces along a curve near contacts (n, 3)."""
        near = curve.points[np.unique(curve.tree.query(contacts)[1])]
        surface, two = (self.surfaces[place] for place in curve.pair)
        cosine = np.abs(np.einsum("ij,ij->i", surface.normal(near), two.normal(near)))
        return float(np.median(np.arccos(np.clip(cosine, 0, 1))))

    def _with_reach(self, curve: ContactCurve, contacts: FloatArray) -> ContactCurve:
        """The curve with its reach: flat surfaces are taken for each other, by noise, far from it."""
        turn = 0.0 if curve.is_tangent else np.sin(self._turn(curve, contacts))
        wide = limits.TOUCH_REACH + 2 * self.noise / max(turn, 1e-9) / self.spacing
        return replace(curve, reach=float(min(wide, limits.CONTACT_REACH)))

    def conics(self, pair: tuple[int, int]) -> Iterator[Any]:
        """Lines and conics in which the kernel says that two surfaces cross."""
        geom = kernel().Geom
        kinds = {self.surfaces[number].kind for number in pair}
        if "torus" in kinds and kinds != {"torus", "plane"} and not self._coaxial(pair):
            return
        try:
            crossing = kernel().GeomAPI.GeomAPI_IntSS(*self._parallel(pair), 1e-7)
        except kernel_errors():
            return
        if not crossing.IsDone():
            return
        for number in range(1, crossing.NbLines() + 1):
            line = crossing.Line(number)
            while isinstance(line, geom.Geom_TrimmedCurve):
                line = line.BasisCurve()
            if type(line).__name__ in _CONICS:
                yield line

    def _parallel(self, pair: tuple[int, int]) -> list[Any]:
        """The kernel's surfaces of a pair; a cylinder along a plane is exactly so, not an endless ellipse."""
        shapes = [self.shapes[place] for place in pair]
        surface, two = (self.surfaces[place] for place in pair)
        for place, one, other in ((0, surface, two), (1, two, surface)):
            if isinstance(one, Cylinder) and isinstance(other, Plane):
                normal = other.normal_direction
                along = one.direction - one.direction @ normal * normal
                if np.linalg.norm(along - one.direction) < limits.PARALLEL:
                    shapes[place] = kernel_surface(Cylinder(one.point, along, one.radius))
        return shapes

    def _coaxial(self, pair: tuple[int, int]) -> bool:
        """Whether two surfaces turn about one axis, a sphere about any through its centre."""
        surface, two = (self.surfaces[place] for place in pair)
        axes = [getattr(s, "direction", None) for s in (surface, two)]
        places = [getattr(s, "point", getattr(s, "centre", None)) for s in (surface, two)]
        axis = axes[0] if axes[0] is not None else axes[1]
        if axis is None or places[0] is None or places[1] is None:
            return False
        gap = places[1] - places[0]
        apart = float(np.linalg.norm(gap - (gap @ axis) * axis))
        turned = 0.0
        if axes[0] is not None and axes[1] is not None:
            turned = float(np.linalg.norm(np.cross(axes[0], axes[1])))
        return apart < 1e-7 and turned < 1e-10

    def _trim_curve(
        self, pair: tuple[int, int], geometry: Any, contacts: FloatArray, *, is_tangent: bool
    ) -> ContactCurve | None:
        """The part of a curve that contacts (n, 3) are near, and some way beyond; all of a closed one.

        Of one too large for its table, as of cylinders along each other, only the arc.
        """
        period = 0.0
        if type(geometry).__name__ in _CLOSED:
            size = geometry.MajorRadius() if hasattr(geometry, "MajorRadius") else geometry.Radius()
            period = 2 * np.pi
            if _FINE * period * size / self.spacing <= _MOST_POINTS:
                return tabulate(
                    pair, geometry, (0.0, period), self.spacing, is_closed=True, is_tangent=is_tangent
                )
        sample = contacts[:: max(1, len(contacts) // 300)]
        project = kernel().GeomAPI.GeomAPI_ProjectPointOnCurve
        feet = list[float]()
        for point in sample:
            foot = project(kernel_point(point), geometry)
            if foot.NbPoints() and foot.LowerDistance() < limits.TOUCH_REACH * self.spacing:
                feet.append(float(foot.LowerDistanceParameter()))
        if len(feet) < 2:
            return None
        low, high = _span(feet, period)
        speed = np.linalg.norm(np.diff(curve_points(geometry, np.array([low, low + 1e-4])), axis=0)) / 1e-4
        is_closed = high - low == period > 0
        margin = 0.0 if is_closed else (6 * self.spacing) / max(float(speed), 1e-9) + 0.25 * (high - low)
        span = (low - margin, high + margin)
        return tabulate(pair, geometry, span, self.spacing, is_closed=is_closed, is_tangent=is_tangent)

    def _instead(self, curve: ContactCurve, contacts: FloatArray) -> ContactCurve | None:
        """The curve in which the surfaces touch, where they cross so flatly that they are meant to.

        Near it lie no fewer of the contacts (n, 3) than near the crossing.
        """
        flat = self._turn(curve, contacts)
        if flat > limits.SMOOTH_ANGLE:
            return None
        touching = self._tangent_curve(curve.pair, contacts, flat)
        if touching is None:
            return None
        n, m = (
            np.count_nonzero(one.tree.query(contacts)[0] < limits.CONTACT_REACH * self.spacing)
            for one in (touching, curve)
        )
        return touching if n >= m else None

    def _tangent_curve(self, pair: tuple[int, int], contacts: FloatArray, flat: float) -> ContactCurve | None:
        surface, two = (self.surfaces[place] for place in pair)
        path = trace_curve(surface, two, contacts, self.spacing, touching=True)
        most = self.tolerance if flat > np.radians(4.0) else max(self.tolerance, 0.2 * self.spacing)
        if path is None or path.gap > most or len(path.points) < 4:
            return None
        return self._curve(pair, path, contacts, touching=True)

    def _follow_curve(self, pair: tuple[int, int], contacts: FloatArray) -> ContactCurve | None:
        """A curve that the kernel gave no conic for."""
        surface, two = (self.surfaces[place] for place in pair)
        path = trace_curve(surface, two, contacts, self.spacing, touching=False)
        if path is None or len(path.points) < 4:
            return self._tangent_curve(pair, contacts, 0.0)
        curve = self._curve(pair, path, contacts, touching=False)
        if curve is None:
            return self._tangent_curve(pair, contacts, 0.0)
        return self._instead(curve, contacts) or curve

    def _curve(
        self, pair: tuple[int, int], path: CurvePath, contacts: FloatArray, *, touching: bool
    ) -> ContactCurve | None:
        """A path as a line, a circle or a spline."""
        exact = max(1e-6, 0.02 * self.spacing, path.gap) if touching else 1e-6
        plain = line_through(path.points, exact) or circle_through(path.points, exact)
        if plain is not None:
            return self._trim_curve(pair, plain, contacts, is_tangent=touching)
        geometry = self.spline(pair, path, touching=touching)
        if geometry is None:
            return None
        span = (geometry.FirstParameter(), geometry.LastParameter())
        return tabulate(pair, geometry, span, self.spacing, is_closed=path.is_closed, is_tangent=touching)

    def spline(self, pair: tuple[int, int], path: CurvePath, *, touching: bool) -> Any | None:
        """The spline through a path, made finer until it lies on both surfaces."""
        surface, two = (self.surfaces[place] for place in pair)
        points = path.points
        geometry = interpolate(points, is_closed=path.is_closed)
        while geometry is not None and len(points) < _MOST_KNOTS:
            knots = chord_lengths(points, path.is_closed)
            between = curve_points(geometry, (knots[1:] + knots[:-1]) / 2)
            there = project_on_curve(surface, two, between, touching=touching)
            off = np.linalg.norm(there.points - between, axis=1)
            if not there.holds.all() or off.max() <= (limits.SPLINE_EXACT if not touching else 1e-4):
                break
            n = len(points)
            finer = np.empty((n + len(between), 3))
            finer[0::2][:n] = points
            finer[1::2][: len(between)] = there.points
            points = finer
            geometry = interpolate(points, is_closed=path.is_closed)
        return geometry
