# SPDX-License-Identifier: MIT
"""Folds of two surfaces: the curves that their contacts lie on, exact conics where there are any."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from completion.exchange.step.curves.fold_curve import FoldCurve, curve_points, tabled
from completion.exchange.step.curves.kernel import kernel, kernel_errors, kernel_point
from completion.exchange.step.curves.splines import chord_lengths, circle_through, interpolated, line_through
from completion.exchange.step.curves.tracing import Traced, settled, traced
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Surface

_CONICS = ("Geom_Line", "Geom_Circle", "Geom_Ellipse", "Geom_Hyperbola", "Geom_Parabola")
_CLOSED = ("Geom_Circle", "Geom_Ellipse")
_NEAR = 1.6  # sampling distances between a contact and its curve
_FAR = 3.0  # the same where surfaces part so slowly that noise blurs the fold
_SAME = 0.5  # sampling distances between curves that are one
_MOST_CURVES = 12
_SMOOTH = np.radians(30.0)  # below which surfaces may be meant to touch
_EXACT = 2e-6  # mm that splines may be off
_MOST_KNOTS = 600


class FoldFinder:
    """Finds the curves of pairs of surfaces, millimetres."""

    def __init__(self, surfaces: list[Surface], shapes: list[Any], spacing: float, noise: float) -> None:
        self.surfaces, self.shapes = surfaces, shapes
        self.spacing, self.tolerance = spacing, max(4 * noise, 0.01 * spacing, 1e-4)

    def between(self, pair: tuple[int, int], contacts: FloatArray) -> list[FoldCurve]:
        """The curves of a pair that contacts (n, 3) are near."""
        found, left = list[FoldCurve](), contacts
        for geometry in self._conics(pair):
            if len(left) < 2:
                break
            curve = self._bounded(pair, geometry, left, is_tangent=False)
            if curve is None:
                continue
            near = curve.tree.query(left)[0] < _NEAR * self.spacing
            if near.sum() < 2:
                continue
            touching = self._instead(curve, left[near])
            left = self._add(found, touching or curve, left)
        for _ in range(_MOST_CURVES):
            if len(left) < 3:
                break
            curve = self._followed(pair, left)
            if curve is None:
                break
            left = self._add(found, curve, left)
        return found

    def _add(self, found: list[FoldCurve], curve: FoldCurve, left: FloatArray) -> FloatArray:
        """Add a curve, unless it is there already; return the contacts (n, 3) that are not near it."""
        same = [one for one in found if np.median(one.tree.query(curve.points)[0]) < _SAME * self.spacing]
        if not same:
            found.append(curve)
        reach = _FAR if same or curve.is_tangent else _NEAR
        return np.asarray(left[curve.tree.query(left)[0] >= reach * self.spacing])

    def _conics(self, pair: tuple[int, int]) -> Iterator[Any]:
        """Lines and conics in which the kernel says that two surfaces cross."""
        geom = kernel().Geom
        kinds = {self.surfaces[one].kind for one in pair}
        if "torus" in kinds and kinds != {"torus", "plane"} and not self._coaxial(pair):
            return
        try:
            crossing = kernel().GeomAPI.GeomAPI_IntSS(self.shapes[pair[0]], self.shapes[pair[1]], 1e-7)
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

    def _coaxial(self, pair: tuple[int, int]) -> bool:
        """Whether two surfaces turn about one axis, a sphere about any through its centre."""
        one, two = (self.surfaces[place] for place in pair)
        axes = [getattr(s, "direction", None) for s in (one, two)]
        places = [getattr(s, "point", getattr(s, "centre", None)) for s in (one, two)]
        axis = axes[0] if axes[0] is not None else axes[1]
        if axis is None or places[0] is None or places[1] is None:
            return False
        gap = places[1] - places[0]
        apart = float(np.linalg.norm(gap - (gap @ axis) * axis))
        turned = 0.0
        if axes[0] is not None and axes[1] is not None:
            turned = float(np.linalg.norm(np.cross(axes[0], axes[1])))
        return apart < 1e-7 and turned < 1e-10

    def _bounded(
        self, pair: tuple[int, int], geometry: Any, contacts: FloatArray, *, is_tangent: bool
    ) -> FoldCurve | None:
        """The part of a curve that contacts (n, 3) are near, and some way beyond; all of a closed one."""
        if type(geometry).__name__ in _CLOSED:
            span = (0.0, 2 * np.pi)
            return tabled(pair, geometry, span, self.spacing, is_closed=True, is_tangent=is_tangent)
        some = contacts[:: max(1, len(contacts) // 300)]
        project = kernel().GeomAPI.GeomAPI_ProjectPointOnCurve
        feet = list[float]()
        for point in some:
            foot = project(kernel_point(point), geometry)
            if foot.NbPoints() and foot.LowerDistance() < _NEAR * self.spacing:
                feet.append(float(foot.LowerDistanceParameter()))
        if len(feet) < 2:
            return None
        low, high = min(feet), max(feet)
        speed = np.linalg.norm(np.diff(curve_points(geometry, np.array([low, low + 1e-4])), axis=0)) / 1e-4
        margin = (6 * self.spacing) / max(float(speed), 1e-9) + 0.25 * (high - low)
        span = (low - margin, high + margin)
        return tabled(pair, geometry, span, self.spacing, is_closed=False, is_tangent=is_tangent)

    def _instead(self, curve: FoldCurve, contacts: FloatArray) -> FoldCurve | None:
        """The curve in which the surfaces touch, where they cross so flatly that they are meant to."""
        one, two = (self.surfaces[place] for place in curve.pair)
        near = curve.points[np.unique(curve.tree.query(contacts)[1])]
        turn = np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", one.normal(near), two.normal(near))), 0, 1))
        flat = float(np.median(turn))
        if flat > _SMOOTH:
            return None
        return self._touched(curve.pair, contacts, flat)

    def _touched(self, pair: tuple[int, int], contacts: FloatArray, flat: float) -> FoldCurve | None:
        one, two = (self.surfaces[place] for place in pair)
        path = traced(one, two, contacts, self.spacing, touching=True)
        most = self.tolerance if flat > np.radians(4.0) else max(self.tolerance, 0.2 * self.spacing)
        if path is None or path.gap > most or len(path.points) < 4:
            return None
        return self._curve(pair, path, contacts, touching=True)

    def _followed(self, pair: tuple[int, int], contacts: FloatArray) -> FoldCurve | None:
        """A curve that the kernel gave no conic for."""
        one, two = (self.surfaces[place] for place in pair)
        path = traced(one, two, contacts, self.spacing, touching=False)
        if path is None or len(path.points) < 4:
            return self._touched(pair, contacts, 0.0)
        curve = self._curve(pair, path, contacts, touching=False)
        if curve is None:
            return self._touched(pair, contacts, 0.0)
        return self._instead(curve, contacts) or curve

    def _curve(
        self, pair: tuple[int, int], path: Traced, contacts: FloatArray, *, touching: bool
    ) -> FoldCurve | None:
        """A path as a line, a circle or a spline."""
        exact = max(1e-6, 0.02 * self.spacing, path.gap) if touching else 1e-6
        plain = line_through(path.points, exact) or circle_through(path.points, exact)
        if plain is not None:
            return self._bounded(pair, plain, contacts, is_tangent=touching)
        geometry = self._spline(pair, path, touching=touching)
        if geometry is None:
            return None
        span = (geometry.FirstParameter(), geometry.LastParameter())
        return tabled(pair, geometry, span, self.spacing, is_closed=path.is_closed, is_tangent=touching)

    def _spline(self, pair: tuple[int, int], path: Traced, *, touching: bool) -> Any | None:
        """The spline through a path, made finer until it lies on both surfaces."""
        one, two = (self.surfaces[place] for place in pair)
        points = path.points
        geometry = interpolated(points, is_closed=path.is_closed)
        while geometry is not None and len(points) < _MOST_KNOTS:
            knots = chord_lengths(points, path.is_closed)
            between = curve_points(geometry, (knots[1:] + knots[:-1]) / 2)
            there = settled(one, two, between, touching=touching)
            off = np.linalg.norm(there.points - between, axis=1)
            if not there.holds.all() or off.max() <= (_EXACT if not touching else 1e-4):
                break
            n = len(points)
            finer = np.empty((n + len(between), 3))
            finer[0::2][:n] = points
            finer[1::2][: len(between)] = there.points
            points = finer
            geometry = interpolated(points, is_closed=path.is_closed)
        return geometry
