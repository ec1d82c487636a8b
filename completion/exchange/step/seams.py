# SPDX-License-Identifier: MIT
"""Seams: where a surface that returns to itself is cut open, so that the kernel can trim it.

Where a region leaves a sector free, the seam lies there. Where it goes all the way round, the seam passes
through a corner of its loops, and closed edges begin on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from completion.exchange.step.curves.fold_curve import FoldCurve
from completion.exchange.step.curves.kernel import kernel_surface, plain_zero
from completion.exchange.step.curves.winding import tube_angles, turns_of, winding
from completion.exchange.step.loops import Side, loop_points
from completion.exchange.step.pieces import Piece
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Sphere, Surface, Torus
from scenes.surfaces.surface import cross

_CLEAR = np.radians(8.0)  # between the points of a sphere and its seam
_SECTOR = np.radians(3.0)  # least free sector
_N_SAMPLES = 48


class Seams:
    """Chooses seams of all surfaces, and where closed edges begin (`pieces`, changed for that).

    Parameters
    ----------
    pieces, curves, surfaces : sequences
        The chosen pieces, the fold curves, the surfaces (millimetres).
    """

    def __init__(
        self, pieces: Sequence[Piece], curves: Sequence[FoldCurve], surfaces: Sequence[Surface]
    ) -> None:
        self.pieces, self.curves, self.surfaces = list(pieces), curves, surfaces
        self._begun = set[int]()

    def begin_on_tubes(self, surface: Surface, loops: Sequence[Sequence[Side]]) -> None:
        """Let closed edges round a torus's tube begin on its outer circle, where the kernel's seam is."""
        if isinstance(surface, Torus):
            for loop in loops:
                points = loop_points(loop, self.pieces, self.curves)
                level = tube_angles(surface, points)
                if turns_of(level) and not winding(surface.centre, surface.direction, points):
                    self._begin(
                        loop, lambda x: float((x - surface.centre) @ surface.direction), np.abs(level)
                    )

    def shape(self, surface: Surface, points: FloatArray, loops: Sequence[Sequence[Side]]) -> Any:
        """The kernel's surface of a region of points (n, 3) within loops, with a fitting seam."""
        if isinstance(surface, Sphere):
            shapes = [self.curves[self.pieces[loop[0].piece].curve].geometry for loop in loops]
            round_ = [one for one in shapes if type(one).__name__ == "Geom_Circle"]
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
        self, place: FloatArray, axis: FloatArray, zero: FloatArray, loops: Sequence[Sequence[Side]]
    ) -> None:
        """Let closed edges round an axis begin where it has its zero direction."""
        across = cross(axis, zero)
        for loop in loops:
            points = loop_points(loop, self.pieces, self.curves)
            if winding(place, axis, points):
                offset = points - place
                angle = np.abs(np.arctan2(offset @ across, offset @ zero))
                self._begin(loop, lambda x: float((x - place) @ across), angle)

    def _begin(self, loop: Sequence[Side], off: Callable[[FloatArray], float], level: FloatArray) -> None:
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
        start = curve.wrapped((low + high) / 2)
        self.pieces[number] = replace(piece, low=start, high=start + period)
        self._begun.add(number)

    def _parameters(self, side: Side) -> FloatArray:
        one = self.pieces[side.piece]
        t = np.linspace(one.low, one.high, _N_SAMPLES, endpoint=False)
        return t if side.is_forward else one.high + one.low - t

    def _corner_side(
        self, place: FloatArray, axis: FloatArray, loops: Sequence[Sequence[Side]]
    ) -> FloatArray:
        """The direction (3,) across the axis of where a loop that goes round it begins; else a plain one."""
        for loop in loops:
            first = self.pieces[loop[0].piece]
            if first.is_loop and loop[0].piece not in self._begun:
                continue
            if winding(place, axis, loop_points(loop, self.pieces, self.curves)):
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
    if gap[widest] < max(_SECTOR, 20 * usual):
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
    return (chosen, zero) if best > _CLEAR else (plain, plain_zero(plain))
