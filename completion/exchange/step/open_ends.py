# SPDX-License-Identifier: MIT
"""Open ends: where a region's measurement ends without a neighbour, its boundary goes on along that end.

The edge that is added there belongs to one face alone: the shell stays open, and the file says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from completion.exchange.step.curves.corners import Corner
from completion.exchange.step.curves.fold_curve import FoldCurve, tabled
from completion.exchange.step.curves.kernel import kernel, kernel_point, plain_zero
from completion.exchange.step.curves.splines import interpolated
from completion.exchange.step.curves.winding import axis_of, winding
from completion.exchange.step.loops import RegionLoops, Side, loop_points
from completion.exchange.step.pieces import Piece
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Surface
from scenes.surfaces.surface import cross

_N_POINTS = 25  # of an added edge
_NEAR = 4.0  # sampling distances of an added edge from points
_MEASURED = 0.5  # share of it that must be as near
_END = 0.005  # quantile of heights at which a region ends
_TIP = 4.0  # sampling distances from a cone's tip, within which it belongs to the region


class OpenEnds:
    """Adds the edges at open ends to the pieces and curves of a part (lists, changed in place)."""

    def __init__(
        self,
        pieces: list[Piece],
        curves: list[FoldCurve],
        corners: Sequence[Corner],
        surfaces: Sequence[Surface],
        spacing: float,
    ) -> None:
        self.pieces, self.curves, self.corners = pieces, curves, corners
        self.surfaces, self.spacing = surfaces, spacing

    def closed(self, place: int, loops: RegionLoops, points: FloatArray) -> tuple[RegionLoops, bool]:
        """The loops of a region of points (n, 3) with its open ends closed, and whether it had any."""
        if loops.rest:
            joined = self._joined(place, loops.rest, points)
            return (loops, False) if joined is None else (RegionLoops([*loops.closed, *joined], []), True)
        rims = self._rims(place, loops.closed, points)
        return RegionLoops([*loops.closed, *rims], []), bool(rims)

    def _ends(self, chain: Sequence[Side]) -> tuple[int, int]:
        first, last = chain[0], chain[-1]
        begin = self.pieces[first.piece].ends[0 if first.is_forward else 1]
        return begin, self.pieces[last.piece].ends[1 if last.is_forward else 0]

    def _joined(
        self, place: int, chains: Sequence[list[Side]], points: FloatArray
    ) -> list[list[Side]] | None:
        """Chains joined to loops by edges along the ends; None where an end was not measured."""
        ends = [self._ends(chain) for chain in chains]
        begins = np.array([self.corners[begin].point for begin, _ in ends])
        lasts = np.array([self.corners[end].point for _, end in ends])
        follows = linear_sum_assignment(np.linalg.norm(lasts[:, None] - begins[None], axis=2))[1]
        tree, links = cKDTree(points), dict[int, Side]()
        for n, to in enumerate(follows.tolist()):
            geometry = self._along(place, lasts[n], begins[to], tree)
            if geometry is None:
                return None
            links[n] = self._added(place, geometry, (ends[n][1], ends[to][0]))
        loops, unused = list[list[Side]](), set(range(len(chains)))
        while unused:
            n = min(unused)
            loop = list[Side]()
            while n in unused:
                unused.discard(n)
                loop += [*chains[n], links[n]]
                n = int(follows[n])
            loops.append(loop)
        return loops

    def _added(self, place: int, geometry: Any, ends: tuple[int, int]) -> Side:
        span = (float(geometry.FirstParameter()), float(geometry.LastParameter()))
        is_closed = ends == (-2, -2)
        self.curves.append(
            tabled((place, place), geometry, span, self.spacing, is_closed=is_closed, is_tangent=False)
        )
        length = float(np.linalg.norm(np.diff(self.curves[-1].points, axis=0), axis=1).sum())
        self.pieces.append(Piece(len(self.curves) - 1, *span, ends, 0.0, length))
        return Side(len(self.pieces) - 1, True)

    def _along(self, place: int, start: FloatArray, end: FloatArray, tree: cKDTree) -> Any | None:
        """The curve of a surface between two points (3,) along which its points end."""
        surface = self.surfaces[place]
        best, least = None, np.inf
        for path in _paths(surface, start, end):
            apart = tree.query(path)[0]
            if np.mean(apart <= _NEAR * self.spacing) >= _MEASURED and apart.mean() < least:
                best, least = path, float(apart.mean())
        if best is None or np.linalg.norm(best[-1] - best[0]) < 1e-6:
            return None
        return interpolated(best, is_closed=False)

    def _rims(self, place: int, loops: Sequence[Sequence[Side]], points: FloatArray) -> list[list[Side]]:
        """Circles at the ends of a tube or cone that goes all the way round and has no neighbour there."""
        surface = self.surfaces[place]
        if not isinstance(surface, Cylinder | Cone):
            return []
        middle, axis = axis_of(surface)
        turns = [winding(middle, axis, loop_points(loop, self.pieces, self.curves)) for loop in loops]
        if not loops and not _goes_round(surface, points):
            return []
        sense = 1 if surface.normal(points[:1])[0] @ _outward(surface, points[0]) > 0 else -1
        wanted = [level for level in (1, -1) if sense * sum(turns) != level * -1 or not loops]
        if sum(turns) == 0 and loops:
            return []
        height = (points - middle) @ axis
        rims = list[list[Side]]()
        for level in wanted if not loops else [1 if sense * sum(turns) > 0 else -1]:
            at = float(np.quantile(height, 1 - _END if level > 0 else _END))
            if isinstance(surface, Cone) and level < 0 and self._has_tip(surface, points):
                continue
            radius = surface.radius if isinstance(surface, Cylinder) else _radius(surface, at)
            if radius <= 0:
                continue
            side = self._added(place, _circle(middle + at * axis, axis, radius), (-2, -2))
            rims.append([Side(side.piece, sense * level < 0)])
        return rims

    def _has_tip(self, cone: Cone, points: FloatArray) -> bool:
        return bool(np.linalg.norm(points - cone.apex, axis=1).min() <= _TIP * self.spacing)


def _outward(surface: Cylinder | Cone, point: FloatArray) -> FloatArray:
    offset = point - surface.point
    return np.asarray(offset - (offset @ surface.direction) * surface.direction)


def _radius(cone: Cone, height: float) -> float:
    return float(cone.radius + height * np.tan(cone.half_angle))


def _goes_round(surface: Cylinder | Cone, points: FloatArray) -> bool:
    """Whether no sector of 20 degrees about the axis is without points."""
    zero = plain_zero(surface.direction)
    offset = points - surface.point
    angle = np.sort(np.arctan2(offset @ cross(surface.direction, zero), offset @ zero))
    return bool(np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.radians(20.0))


def _circle(centre: FloatArray, axis: FloatArray, radius: float) -> Any:
    gp, zero = kernel().gp, plain_zero(axis)
    up, side = (gp.gp_Dir(*(float(one) for one in row)) for row in (axis, zero))
    return kernel().Geom.Geom_Circle(gp.gp_Ax2(kernel_point(centre), up, side), radius)


def _paths(surface: Surface, start: FloatArray, end: FloatArray) -> list[FloatArray]:
    """Ways (n, 3) on a surface between two points: both ways round an axis."""
    share = np.linspace(0, 1, _N_POINTS)[:, None]
    if isinstance(surface, Plane):
        return [start + share * (end - start)]
    if isinstance(surface, Cylinder | Cone):
        axis, zero = surface.direction, plain_zero(surface.direction)
        across = cross(axis, zero)
        heights = [float((one - surface.point) @ axis) for one in (start, end)]
        angles = [
            float(np.arctan2((one - surface.point) @ across, (one - surface.point) @ zero))
            for one in (start, end)
        ]
        turn = (angles[1] - angles[0] + np.pi) % (2 * np.pi) - np.pi
        found = list[FloatArray]()
        for way in (turn, turn - np.copysign(2 * np.pi, turn)):
            height, angle = heights[0] + share * (heights[1] - heights[0]), angles[0] + share * way
            radius = surface.radius + (
                height * np.tan(surface.half_angle) if isinstance(surface, Cone) else 0
            )
            level = np.cos(angle) * zero + np.sin(angle) * across
            found.append(surface.point + height * axis + radius * level)
        return found
    path = start + share * (end - start)
    for _ in range(4):
        path = path - surface.distance(path)[:, None] * surface.normal(path)
    return [path]
