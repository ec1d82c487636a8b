# SPDX-License-Identifier: MIT
"""Folds: the stretches of curves along which surfaces that meet share an edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.export.panels import limits
from completion.export.panels.sheet import Sheet
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from scenes.surfaces.surface import cross


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
    sagitta = min(limits.CHORD_M, radius_m / 10)
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
    if sine < limits.LEAST_SINE:
        return []
    direction, middle = across / sine, (first.point + second.point) / 2
    normals = np.stack([first.normal_direction, second.normal_direction, direction])
    offsets = [plane.normal_direction @ plane.point for plane in (first, second)]
    return [StraightFold(np.linalg.solve(normals, [*offsets, direction @ middle]), direction)]


def _of_plane_and_cylinder(plane: Plane, cylinder: Cylinder) -> list[FoldCurve]:
    rise = float(plane.normal_direction @ cylinder.direction)
    if abs(rise) > limits.STEEP_COSINE:
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


_ACROSS = (
    0.5,
    1.0,
    1.5,
    limits.FOLD_REACH_CELLS,
)  # cells beside a fold at which a surface that reaches it is looked for
_FARTHER = (3.0, 4.0)  # the same, where nothing was seen to be free between
_SMOOTH = 15  # samples over which a side is decided


@dataclass(frozen=True, slots=True, eq=False)
class Fold:
    """An edge that two surfaces share.

    Attributes
    ----------
    first, second : int
        Numbers of the surfaces, from 1.
    curve : FoldCurve
        Where they meet, working frame.
    number : int
        Of the curve: all folds along one curve have the same.
    start, end : float
        Parameters of the curve, metres.
    sides : (2, 2) bool
        Whether the first and the second surface go on to the left and the right of it, in their own charts
        seen along the curve.
    cell_m : float
        Side of the larger cell of the two, metres.
    """

    first: int
    second: int
    curve: FoldCurve
    number: int
    start: float
    end: float
    sides: BoolArray
    cell_m: float

    @property
    def goes_on(self) -> tuple[int, ...]:
        """Numbers of those of its surfaces that go on beyond it, as a floor does under a partition."""
        both = zip((self.first, self.second), self.sides, strict=True)
        return tuple(number for number, sides in both if sides.all())

    def stations(self) -> FloatArray:
        """Parameters (n,) from start to end between which it is straight enough."""
        return self.curve.stations(self.start, self.end)


def find_folds(sheets: Sequence[Sheet]) -> list[Fold]:
    """Return the folds of all pairs of surfaces that both reach the curve in which they meet.

    A surface reaches a place of the curve where its outline is within two cells of it, or four where nothing
    is known to be free between. Gaps of four cells are
    bridged; a fold is three cells long at least. It is divided where a surface that ended there goes on. A
    fold that is known to no better than a cell is none.
    """
    boxes = [_box(sheet) for sheet in sheets]
    folds: list[Fold] = []
    n_curves = 0
    for i, first_sheet in enumerate(sheets):
        for j in range(i + 1, len(sheets)):
            slack = limits.FOLD_REACH_CELLS * max(first_sheet.cell_m, sheets[j].cell_m)
            low = np.maximum(boxes[i][0], boxes[j][0]) - slack
            high = np.minimum(boxes[i][1], boxes[j][1]) + slack
            if (low > high).any():
                continue
            box = np.stack([low, high])
            for curve in fold_curves(first_sheet.surface, sheets[j].surface):
                folds += _of_curve(first_sheet, sheets[j], curve, n_curves, box)
                n_curves += 1
    return folds


def _box(sheet: Sheet) -> tuple[FloatArray, FloatArray]:
    """Low and high corner (3,) of the box around a sheet."""
    row, column = np.argwhere(sheet.patch.provenance >= 0).T.astype(np.float64) + 0.5
    points = sheet.surface.from_uv(sheet.patch.grid.uv_of(row, column))
    return points.min(axis=0) - sheet.cell_m, points.max(axis=0) + sheet.cell_m


def _of_curve(first_sheet: Sheet, other: Sheet, curve: FoldCurve, number: int, box: FloatArray) -> list[Fold]:
    """The folds along one curve, in the box (2, 3) that both surfaces reach."""
    cell, step = max(first_sheet.cell_m, other.cell_m), min(first_sheet.cell_m, other.cell_m) / 2
    low, high = curve.span(box)
    if not low < high:
        return []
    t = np.linspace(low, high, max(2, int(np.ceil((high - low) / step)) + 1))
    step = float(t[1] - t[0])
    near = np.ones(len(t), np.bool_)
    for sheet in (first_sheet, other):
        held = np.flatnonzero(near)
        uv, left = sheet.along(curve.at(t))
        near[held] = _reaches(sheet, uv[held], left[held])
    if not near.any():
        return []
    bridged = 2 * int(limits.BRIDGED_CELLS * cell / step / 2) + 1
    padded = np.pad(near, bridged)
    near = ndimage.binary_closing(padded, np.ones(bridged))[bridged:-bridged]
    run, n_runs = ndimage.label(near)
    folds = []
    for first, last in (np.flatnonzero(run == k)[[0, -1]] for k in range(1, n_runs + 1)):
        if t[last] - t[first] < limits.FOLD_CELLS * cell:
            continue
        stretch = t[first : last + 1]
        sides = np.stack([sides_along(sheet, curve, stretch) for sheet in (first_sheet, other)], axis=1)
        for begin, stop in _pieces(sides, int(np.ceil(limits.CHANGE_CELLS * cell / step))):
            start, end = float(stretch[begin]), float(stretch[min(stop, len(stretch) - 1)])
            on = sides[begin:stop].mean(axis=0) > 0.5
            if not on.any(axis=1).all() or _sd_across(first_sheet, other, curve, (start + end) / 2) > cell:
                continue
            folds.append(
                Fold(
                    first=first_sheet.number,
                    second=other.number,
                    curve=curve,
                    number=number,
                    start=start,
                    end=end,
                    sides=on,
                    cell_m=cell,
                )
            )
    return folds


def _sd_across(first_sheet: Sheet, other: Sheet, curve: FoldCurve, t: float) -> float:
    """Standard deviation across a fold at a parameter, metres, but for what moves both surfaces together.

    sqrt(s1^2 + s2^2 + 2 s1 s2 |cos D|) / sin D, with D the angle between the surfaces.
    """
    place = curve.at(np.array([t]))
    first, second = (
        float(sheet.patch.source.fit.standard_deviation(place)[0]) for sheet in (first_sheet, other)
    )
    cosine = abs(float(first_sheet.surface.normal(place)[0] @ other.surface.normal(place)[0]))
    sine = float(np.sqrt(max(1 - cosine**2, 1e-12)))
    return float(np.sqrt(first**2 + second**2 + 2 * first * second * cosine)) / sine


def _reaches(sheet: Sheet, uv: FloatArray, left: FloatArray) -> BoolArray:
    """Whether a surface is within two cells (n,) of places (n, 2) of a curve, straight across it.

    Within four where no beam went through between: a surface that is seen obliquely has few pixels there.
    """
    reaches = sheet.is_within(uv, 0.0)
    for beside in (*_ACROSS, *_FARTHER):
        for sign in (1.0, -1.0):
            held = np.flatnonzero(~reaches)
            step = sign * sheet.cell_m * left[held]
            there = sheet.is_within(uv[held] + beside * step, 0.0)
            if beside in _FARTHER:
                between = (uv[held] + k * step for k in np.arange(beside))
                there &= ~np.logical_or.reduce([sheet.is_free(place) for place in between])
            reaches[held] = there
    return reaches


def sides_along(sheet: Sheet, curve: FoldCurve, t: FloatArray) -> BoolArray:
    """Whether a surface is to the left and the right (n, 2) of a curve at parameters (n,), in its chart.

    It is looked for three cells beside it, nearer where it is on neither side; what a few samples say against
    their neighbours does not count.
    """
    uv, left = sheet.along(curve.at(t))
    result = np.zeros((len(t), 2), np.bool_)
    for beside in (limits.FOLD_CELLS, _FARTHER[-1] + 0.5, *_ACROSS[::-1]):
        open_ = np.flatnonzero(~result.any(axis=1))
        for column, sign in enumerate((1.0, -1.0)):
            place = uv[open_] + sign * beside * sheet.cell_m * left[open_]
            result[open_, column] = sheet.is_within(place, 0.0)
    width = min(_SMOOTH, len(t))
    share = ndimage.uniform_filter1d(result.astype(np.float64), width, axis=0, mode="nearest")
    return np.asarray(share > 0.5, dtype=np.bool_)


def _pieces(sides: BoolArray, least: int) -> list[tuple[int, int]]:
    """First sample of each piece in which the sides (n, 2, 2) are the same, and that of the next one.

    Pieces of fewer than `least` samples join what comes before.
    """
    code: NDArray[np.int64] = sides.reshape(len(sides), -1) @ (1 << np.arange(sides[0].size))
    starts = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
    kept = [0]
    for begin, stop in pairwise(starts[1:]):
        if stop - begin >= least and code[begin] != code[kept[-1]]:
            if begin - kept[-1] < least and len(kept) == 1:
                kept = [begin]  # a short first piece joins what follows
            else:
                kept.append(begin)
    stops = [*kept[1:], len(code)]
    return [(0 if k == 0 else begin, stop) for k, (begin, stop) in enumerate(zip(kept, stops, strict=True))]
