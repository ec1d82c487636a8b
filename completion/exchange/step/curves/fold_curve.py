# SPDX-License-Identifier: MIT
"""Fold curves: where two surfaces meet, as curves of the kernel with a table of their points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from completion.exchange.step.curves.kernel import kernel
from scenes.checks import FloatArray

_LEAST_POINTS, _MOST_POINTS = 48, 3000  # of a table
_FINE = 4.0  # points of a table in a sampling distance
_N_STEPS = 4


@dataclass(frozen=True, slots=True, eq=False)
class FoldCurve:
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
    """

    pair: tuple[int, int]
    geometry: Any
    low: float
    high: float
    is_closed: bool
    is_tangent: bool
    t: FloatArray
    points: FloatArray

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
        found = self.t[first].copy()
        for place, (point, start) in enumerate(zip(points, found, strict=True)):
            t = float(start)
            for _ in range(_N_STEPS):
                foot, along = self.slope(t)
                t += float((point - foot) @ along) / max(float(along @ along), 1e-300)
                if not self.is_closed:
                    t = min(max(t, self.low), self.high)
            found[place] = self.wrapped(t)
        return found, np.linalg.norm(self.at(found) - points, axis=1)

    def wrapped(self, t: float) -> float:
        """The parameter within its period."""
        return self.low + (t - self.low) % (self.high - self.low) if self.is_closed else t


def curve_points(geometry: Any, t: FloatArray) -> FloatArray:
    """Points (n, 3) of a kernel's curve at parameters (n,)."""
    return np.array([geometry.Value(float(one)).Coord() for one in t]).reshape(-1, 3)


def tabled(
    pair: tuple[int, int], geometry: Any, span: tuple[float, float], step: float, *, is_closed: bool,
    is_tangent: bool,
) -> FoldCurve:  # fmt: skip
    """The curve with a table of points about a quarter of `step` apart."""
    low, high = span
    coarse = curve_points(geometry, np.linspace(low, high, _LEAST_POINTS))
    length = float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum())
    n = int(np.clip(_FINE * length / step, _LEAST_POINTS, _MOST_POINTS))
    t = np.linspace(low, high, n, endpoint=not is_closed)
    return FoldCurve(
        pair=pair, geometry=geometry, low=low, high=high, is_closed=is_closed, is_tangent=is_tangent,
        t=t, points=curve_points(geometry, t),
    )  # fmt: skip
