# SPDX-License-Identifier: MIT
"""Boundaries: where a region ends without a neighbour, and where a closed surface is cut open.

Open ends: where a region's measurement ends without a neighbour, its boundary goes on along that end.
The edge that is added there belongs to one face alone: the shell stays open, and the file says so.

Seams: where a surface that returns to itself is cut open, so that the kernel can trim it.
Where a region leaves a sector free, the seam lies there. Where it goes all the way round, the seam passes
through a corner of its loops, and closed edges begin on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from completion.export.step.folds import ContactCurve, curve_points, tabulate
from completion.export.step.kernel import (
    axis_of,
    interpolate,
    kernel,
    kernel_point,
    kernel_surface,
    plain_zero,
    tube_angles,
    turns_of,
    winding_number,
)
from completion.export.step.limits import (
    END_QUANTILE,
    FAR_REACH,
    MAJORITY,
    SAME_REACH,
    SEAM_ANGLE,
    SECTOR_ANGLE,
)
from completion.export.step.pieces import CurveCorner, CurvePiece, LoopSide, RegionLoops, loop_points
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Surface, Torus
from scenes.surfaces.surface import cross

_N_POINTS = 25  # of an added edge
_MOST_ALONG = 1000  # places along one


class OpenEnds:
    """Adds the edges at open ends to the pieces and curves of a part (lists, changed in place)."""

    def __init__(
        self,
        pieces: list[CurvePiece],
        curves: list[ContactCurve],
        corners: Sequence[CurveCorner],
        surfaces: Sequence[Surface],
        spacing: float,
    ) -> None:
        self.pieces, self.curves, self.corners = pieces, curves, corners
        self.surfaces, self.spacing = surfaces, spacing

    def close_loops(
        self, place: int, loops: RegionLoops, points: FloatArray
    ) -> tuple[RegionLoops, FloatArray | None]:
        """The loops of a region of points (n, 3) with its open ends closed, and where (3,) there was one."""
        chains = [chain for chain in loops.open_chains if not self._is_sliver(place, chain, points)]
        if chains:
            joined = self._join_chains(place, chains, points)
            if joined is None:
                return loops, None
            end = self._ends(chains[0])[1]
            return RegionLoops([*loops.closed, *joined], []), self.corners[end].point
        rims = self._rims(place, loops.closed, points)
        at = self.curves[self.pieces[rims[0][0].piece].curve].points[0] if rims else None
        return RegionLoops([*loops.closed, *rims], []), at

    def _ends(self, chain: Sequence[LoopSide]) -> tuple[int, int]:
        first, last = chain[0], chain[-1]
        begin = self.pieces[first.piece].ends[0 if first.is_forward else 1]
        return begin, self.pieces[last.piece].ends[1 if last.is_forward else 0]

    def _is_sliver(self, place: int, chain: Sequence[LoopSide], points: FloatArray) -> bool:
        """Whether a chain closes along itself, without width: no region lies in it."""
        begin, end = (self.corners[corner].point for corner in self._ends(chain))
        back = self._along(place, end, begin, cKDTree(points))
        if back is None:
            return False
        way = curve_points(back, np.linspace(back.FirstParameter(), back.LastParameter(), _MOST_ALONG))
        apart = cKDTree(way).query(loop_points(chain, self.pieces, self.curves))[0]
        return bool(apart.max() < SAME_REACH * self.spacing)

    def _join_chains(
        self, place: int, chains: Sequence[list[LoopSide]], points: FloatArray
    ) -> list[list[LoopSide]] | None:
        """Chains joined to loops by edges along the ends; None where an end was not measured."""
        ends = [self._ends(chain) for chain in chains]
        begins = np.array([self.corners[begin].point for begin, _ in ends])
        lasts = np.array([self.corners[end].point for _, end in ends])
        follows = linear_sum_assignment(np.linalg.norm(lasts[:, None] - begins[None], axis=2))[1]
        tree, links = cKDTree(points), dict[int, LoopSide]()
        for n, to in enumerate(follows.tolist()):
            geometry = self._along(place, lasts[n], begins[to], tree)
            if geometry is None:
                return None
            links[n] = self._add_edge(place, geometry, (ends[n][1], ends[to][0]))
        loops, unused = list[list[LoopSide]](), set(range(len(chains)))
        while unused:
            n = min(unused)
            loop = list[LoopSide]()
            while n in unused:
                unused.discard(n)
                loop += [*chains[n], links[n]]
                n = int(follows[n])
            loops.append(loop)
        return loops

    def _add_edge(self, place: int, geometry: Any, ends: tuple[int, int]) -> LoopSide:
        span = (float(geometry.FirstParameter()), float(geometry.LastParameter()))
        is_closed = ends == (-2, -2)
        self.curves.append(
            tabulate((place, place), geometry, span, self.spacing, is_closed=is_closed, is_tangent=False)
        )
        length = float(np.linalg.norm(np.diff(self.curves[-1].points, axis=0), axis=1).sum())
        self.pieces.append(CurvePiece(len(self.curves) - 1, *span, ends, 0.0, length))
        return LoopSide(len(self.pieces) - 1, True)

    def _along(self, place: int, start: FloatArray, end: FloatArray, tree: cKDTree) -> Any | None:
        """The curve of a surface between two points (3,) along which its points end."""
        surface = self.surfaces[place]
        best, least = None, np.inf
        for path in _paths(surface, start, end):
            apart = tree.query(path)[0]
            if np.mean(apart <= FAR_REACH * self.spacing) >= MAJORITY and apart.mean() < least:
                best, least = path, float(apart.mean())
        if best is None or np.linalg.norm(best[-1] - best[0]) < 1e-6:
            return None
        return interpolate(best, is_closed=False)

    def _rims(
        self, place: int, loops: Sequence[Sequence[LoopSide]], points: FloatArray
    ) -> list[list[LoopSide]]:
        """Circles at the ends of a tube or cone that goes all the way round and has no neighbour there."""
        surface = self.surfaces[place]
        if not isinstance(surface, Cylinder | Cone):
            return []
        middle, axis = axis_of(surface)
        turns = [winding_number(middle, axis, loop_points(loop, self.pieces, self.curves)) for loop in loops]
        if not loops and not _goes_round(surface, points):
            return []
        sense = 1 if surface.normal(points[:1])[0] @ _outward(surface, points[0]) > 0 else -1
        wanted = [level for level in (1, -1) if sense * sum(turns) != level * -1 or not loops]
        if sum(turns) == 0 and loops:
            return []
        height = (points - middle) @ axis
        rims = list[list[LoopSide]]()
        for level in wanted if not loops else [1 if sense * sum(turns) > 0 else -1]:
            at = float(np.quantile(height, 1 - END_QUANTILE if level > 0 else END_QUANTILE))
            if isinstance(surface, Cone) and level < 0 and self._has_tip(surface, points):
                continue
            radius = surface.radius if isinstance(surface, Cylinder) else _radius(surface, at)
            if radius <= 0:
                continue
            side = self._add_edge(place, _circle(middle + at * axis, axis, radius), (-2, -2))
            rims.append([LoopSide(side.piece, sense * level < 0)])
        return rims

    def _has_tip(self, cone: Cone, points: FloatArray) -> bool:
        return bool(np.linalg.norm(points - cone.apex, axis=1).min() <= FAR_REACH * self.spacing)


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
    up, side = (gp.gp_Dir(*(float(value) for value in row)) for row in (axis, zero))
    return kernel().Geom.Geom_Circle(gp.gp_Ax2(kernel_point(centre), up, side), radius)


def _paths(surface: Surface, start: FloatArray, end: FloatArray) -> list[FloatArray]:
    """Ways (n, 3) on a surface between two points: both ways round an axis."""
    share = np.linspace(0, 1, _N_POINTS)[:, None]
    if isinstance(surface, Plane):
        return [start + share * (end - start)]
    if isinstance(surface, Cylinder | Cone):
        axis, zero = surface.direction, plain_zero(surface.direction)
        across = cross(axis, zero)
        heights = [float((end_point - surface.point) @ axis) for end_point in (start, end)]
        angles = [
            float(np.arctan2((end_point - surface.point) @ across, (end_point - surface.point) @ zero))
            for end_point in (start, end)
        ]
        turn = (angles[1] - angles[0] + np.pi) % (2 * np.pi) - np.pi
        paths = list[FloatArray]()
        for way in (turn, turn - np.copysign(2 * np.pi, turn)):
            height, angle = heights[0] + share * (heights[1] - heights[0]), angles[0] + share * way
            radius = surface.radius + (
                height * np.tan(surface.half_angle) if isinstance(surface, Cone) else 0
            )
            level = np.cos(angle) * zero + np.sin(angle) * across
            paths.append(surface.point + height * axis + radius * level)
        return paths
    path = start + share * (end - start)
    for _ in range(4):
        path = path - surface.distance(path)[:, None] * surface.normal(path)
    return [path]


_N_SAMPLES = 48


class Seams:
    """Chooses the seams of all surfaces and the start of closed edges; `pieces` is a copy that is edited.

    Parameters
    ----------
    pieces, curves, surfaces : sequences
        The chosen pieces, the fold curves, the surfaces (millimetres).
    """

    def __init__(
        self, pieces: Sequence[CurvePiece], curves: Sequence[ContactCurve], surfaces: Sequence[Surface]
    ) -> None:
        self.pieces, self.curves, self.surfaces = list(pieces), curves, surfaces
        self._begun = set[int]()

    def begin_on_tubes(self, surface: Surface, loops: Sequence[Sequence[LoopSide]]) -> None:
        """Let closed edges round a torus's tube begin on its outer circle, where the kernel's seam is."""
        if isinstance(surface, Torus):
            for loop in loops:
                points = loop_points(loop, self.pieces, self.curves)
                level = tube_angles(surface, points)
                if turns_of(level) and not winding_number(surface.centre, surface.direction, points):
                    self._begin(
                        loop, lambda x: float((x - surface.centre) @ surface.direction), np.abs(level)
                    )

    def shape(self, surface: Surface, points: FloatArray, loops: Sequence[Sequence[LoopSide]]) -> Any:
        """The kernel's surface of a region of points (n, 3) within loops, with a fitting seam."""
        if isinstance(surface, Sphere):
            shapes = [self.curves[self.pieces[loop[0].piece].curve].geometry for loop in loops]
            round_ = [shape for shape in shapes if type(shape).__name__ == "Geom_Circle"]
            axis = np.array(round_[0].Axis().Direction().Coord()) if round_ else None
            up, zero = _meridian(surface.centre, points, axis)
            if axis is not None and abs(float(up @ axis)) > 1 - 1e-12:
                zero = self._corner_side(surface.centre, up, loops)
                self._begin_on(surface.centre, up, zero, loops)
            return kernel_surface(surface, zero, up)
        if not isinstance(surface, Cylinder | Cone | Torus):
            return kernel_surface(surface)
        place = surface.centre if isinstance(surface, Torus) else surface.point
        free = _free_side(place, surface.direction, points)
        if free is not None:
            return kernel_surface(surface, free)
        zero = self._corner_side(place, surface.direction, loops)
        self._begin_on(place, surface.direction, zero, loops)
        return kernel_surface(surface, zero)

    def _begin_on(
        self, place: FloatArray, axis: FloatArray, zero: FloatArray, loops: Sequence[Sequence[LoopSide]]
    ) -> None:
        """Let closed edges round an axis begin where it has its zero direction."""
        across = cross(axis, zero)
        for loop in loops:
            points = loop_points(loop, self.pieces, self.curves)
            if winding_number(place, axis, points):
                offset = points - place
                angle = np.abs(np.arctan2(offset @ across, offset @ zero))
                self._begin(loop, lambda x: float((x - place) @ across), angle)

    def _begin(self, loop: Sequence[LoopSide], off: Callable[[FloatArray], float], level: FloatArray) -> None:
        number = loop[0].piece
        piece = self.pieces[number]
        if not piece.is_loop or number in self._begun:
            return
        curve, period = self.curves[piece.curve], piece.high - piece.low
        step = period / _N_SAMPLES
        middle = float(self._parameters(loop[0])[int(level.argmin())])
        low, high = middle - step, middle + step
        if off(curve.at(np.array([low]))[0]) * off(curve.at(np.array([high]))[0]) > 0:
            return
        for _ in range(80):
            half = (low + high) / 2
            same = off(curve.at(np.array([low]))[0]) * off(curve.at(np.array([half]))[0]) > 0
            low, high = (half, high) if same else (low, half)
        start = curve.wrap((low + high) / 2)
        self.pieces[number] = replace(piece, low=start, high=start + period)
        self._begun.add(number)

    def _parameters(self, side: LoopSide) -> FloatArray:
        piece = self.pieces[side.piece]
        t = np.linspace(piece.low, piece.high, _N_SAMPLES, endpoint=False)
        return t if side.is_forward else piece.high + piece.low - t

    def _corner_side(
        self, place: FloatArray, axis: FloatArray, loops: Sequence[Sequence[LoopSide]]
    ) -> FloatArray:
        """The direction (3,) across the axis of where a loop that goes round it begins; else a plain one."""
        for loop in loops:
            first = self.pieces[loop[0].piece]
            if first.is_loop and loop[0].piece not in self._begun:
                continue
            if winding_number(place, axis, loop_points(loop, self.pieces, self.curves)):
                t = first.low if loop[0].is_forward else first.high
                corner = self.curves[first.curve].at(np.array([t]))[0] - place
                radial = corner - (corner @ axis) * axis
                return np.asarray(radial / np.linalg.norm(radial))
        return plain_zero(axis)


def _free_side(place: FloatArray, axis: FloatArray, points: FloatArray) -> FloatArray | None:
    """The direction (3,) across the axis amid the widest sector without points; None if narrow."""
    first = plain_zero(axis)
    second = cross(axis, first)
    offset = points - place
    angle = np.sort(np.arctan2(offset @ second, offset @ first))
    if not len(angle):
        return first
    gap = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(gap.argmax())
    usual = float(np.median(gap))
    if gap[widest] < max(SECTOR_ANGLE, 20 * usual):
        return None
    middle = angle[widest] + gap[widest] / 2
    return np.asarray(np.cos(middle) * first + np.sin(middle) * second)


def _meridian(
    centre: FloatArray, points: FloatArray, axis: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Axis (3,) and zero direction (3,) of a sphere whose seam, half a great circle, is far from the points.

    Where the points leave no room for one, it turns about `axis`.
    """
    plain = np.array([0.0, 0.0, 1.0]) if axis is None else axis
    unit = (points - centre) / np.maximum(np.linalg.norm(points - centre, axis=1, keepdims=True), 1e-12)
    mean = unit.mean(axis=0) if len(unit) else np.zeros(3)
    size = float(np.linalg.norm(mean))
    if size < 1e-3:
        return plain, plain_zero(plain)
    zero = -mean / size
    first = plain_zero(zero)
    second = cross(zero, first)
    best, chosen = -1.0, first
    for angle in np.arange(12) * np.pi / 12:
        turned = np.cos(angle) * first + np.sin(angle) * second
        ahead, along = unit @ zero, unit @ turned
        near = np.where(ahead > 0, np.hypot(ahead, along), np.abs(along))
        clear = float(np.arccos(np.clip(near, -1, 1)).min())
        if clear > best + 1e-9:
            best, chosen = clear, turned
    return (chosen, zero) if best > SEAM_ANGLE else (plain, plain_zero(plain))
