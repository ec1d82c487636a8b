# SPDX-License-Identifier: MIT
"""Limits: how far a surface may be continued, from other surfaces and its own straight extent."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from completion.boundary.boundary_pixels import RimPoints
from completion.boundary.cues import ALL_CUES, Cue
from completion.boundary.sides import ended_sides
from completion.extension.adjacency import Surroundings, is_upright
from completion.extension.alignment import aligned_chart, facing_chart
from completion.merging.pipeline import MergedSurface
from completion.observe.observation import Observation
from completion.segmentation.regions import observed_arc
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

Mode = Literal["conservative", "standard", "bold"]

_FULL_TURN_ARC = np.radians(90.0)


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Where one surface may be continued.

    Attributes
    ----------
    chart : Surface
        The surface with its chart laid along the directions that bound it.
    enclosures : tuple of (int, Surface)
        Number, from 1, and shape of every other surface that encloses the room.
    cuts : tuple of Surface
        Enclosing surfaces that this one ends at; it stays on their normals' side.
    neighbours : tuple of Surface
        Other surfaces that it was seen to meet in a crease.
    own_low, own_high : (2,) float
        The rectangle of the measured part in the chart, metres.
    ends : (2, 2) float
        Chart coordinates at which enclosing planes close the low and the high sides, -inf and inf where none
        does, metres.
    reaches : (2, 2) float
        Probability that the surface goes on to each of them.
    ended : (2, 2) bool
        Sides of that rectangle at which the surface was seen to end.
    full_turn : bool
        Whether a cylinder may be closed around its back.
    encloses : bool
        Whether the surface is a plane that bounds all that was measured, as walls and floors do.
    said : (2, 2) bool
        Which of its ends a person set.
    """

    chart: Surface
    enclosures: tuple[tuple[int, Surface], ...]
    cuts: tuple[Surface, ...]
    neighbours: tuple[Surface, ...]
    own_low: FloatArray
    own_high: FloatArray
    ends: FloatArray
    reaches: FloatArray
    ended: BoolArray
    full_turn: bool
    encloses: bool
    said: BoolArray = field(default_factory=lambda: np.zeros((2, 2), dtype=np.bool_))

    def window(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corners (2,) of the rectangle of the chart in which a continuation is considered.

        On each side it reaches to where the surface may end; without such an end, and where it was not seen
        to end, walls and floors may go on as far again as they are long, cylinders as far again along their
        axis, other planes as far again as they are long in that direction.
        """
        size = self.own_high - self.own_low
        further = np.array([0.0, size[1]]) if isinstance(self.chart, Cylinder) else size
        if self.encloses:
            further = np.full(2, np.linalg.norm(size))
        low = np.where(self.reaches[0] > 0, self.ends[0], self.own_low - further * ~self.ended[0])
        high = np.where(self.reaches[1] > 0, self.ends[1], self.own_high + further * ~self.ended[1])
        return np.maximum(low, self.ends[0]), np.minimum(high, self.ends[1])

    def known_window(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corners (2,) of the measured rectangle, widened to where it is known to end."""
        low = np.where(self.reaches[0] > 0, self.ends[0], self.own_low)
        high = np.where(self.reaches[1] > 0, self.ends[1], self.own_high)
        return low, high


def limit(
    index: int,
    surfaces: Sequence[MergedSurface],
    rims: Sequence[RimPoints],
    surroundings: Surroundings,
    observations: Sequence[Observation],
    cues: Collection[Cue] = ALL_CUES,
) -> Limits:
    """Bound the continuation of surface `index`.

    It ends at surfaces that enclose the room. A cylinder may run around its back where at least 90 degrees of
    it were seen, and its radius is known.

    Parameters
    ----------
    index : int
        Which surface.
    surfaces, rims : sequences
        All surfaces and their rims.
    surroundings : Surroundings
        What they are to each other.
    observations : sequence of Observation
        The scans.
    cues : collection of Cue
        Whether creases, enclosing planes and full turns are made use of.
    """
    surface, enclosing = surfaces[index], surroundings.encloses
    points = surface.points(observations)
    thinned = points[:: max(1, len(points) // 50_000)]
    cuts = _cuts(index, surfaces, enclosing, thinned) if Cue.ARCHITECTURAL in cues else []
    neighbours = [
        surface.fit.surface
        for other, surface in enumerate(surfaces)
        if Cue.INTERSECTION in cues and surroundings.meets[index, other] and not enclosing[other]
    ]
    full_turn = False
    if isinstance(surface.fit.surface, Cylinder):
        chart: Surface = facing_chart(surface.fit.surface, thinned)
        arc = observed_arc(surface.fit.surface, thinned)
        known = surface.fit.parameter_deviations()["radius"] < 0.05 * surface.fit.surface.radius
        full_turn = (
            Cue.FULL_TURN in cues and not surface.fit.surface.concave and arc >= _FULL_TURN_ARC and known
        )
    elif isinstance(surface.fit.surface, Plane):
        plane = surface.fit.surface
        planes = [one for one in (*(cut for _, cut in cuts), *neighbours) if isinstance(one, Plane)]
        chart = aligned_chart(plane, planes, thinned, rims[index])
    else:
        raise TypeError(f"no limits are known for a {type(surface.fit.surface).__name__}")
    uv = chart.to_uv(thinned)
    own_low, own_high = np.quantile(uv, 0.002, axis=0), np.quantile(uv, 0.998, axis=0)
    sides = ended_sides(rims[index].recharted(surface.fit.surface, chart), own_low, own_high)
    ended = np.isfinite(sides)
    own_low = np.where(ended[0], np.minimum(own_low, sides[0]), own_low)
    own_high = np.where(ended[1], np.maximum(own_high, sides[1]), own_high)
    ending = [(number, cut) for number, cut in cuts if isinstance(cut, Plane)]
    ends, which = _ends(chart, [plane for _, plane in ending], own_low, own_high)
    stands = [
        surroundings.standing[number] * is_upright(surface.fit.surface, plane) for number, plane in ending
    ]
    runs_on = enclosing[index] or isinstance(chart, Cylinder)
    reaches = np.where(np.isfinite(ends), 1.0 if runs_on else np.array([*stands, 0.0])[which], 0.0)
    enclosures = tuple(
        (number, other.fit.surface)
        for number, other in enumerate(surfaces, start=1)
        if number != index + 1 and enclosing[number - 1]
    )
    return Limits(
        chart=chart,
        enclosures=enclosures,
        cuts=tuple(cut for _, cut in cuts),
        neighbours=tuple(neighbours),
        own_low=own_low,
        own_high=own_high,
        ends=ends,
        reaches=reaches,
        ended=ended,
        full_turn=full_turn,
        encloses=bool(enclosing[index]) and isinstance(chart, Plane),
    )


def with_ends(limits: Limits, planes: Sequence[Plane]) -> Limits:
    """Return the limits of a surface that goes on to `planes` and ends there, because a person says so.

    Where an enclosing plane is nearer, the surface ends at that.

    Parameters
    ----------
    limits : Limits
        As found.
    planes : sequence of Plane
        The surface lies on their normals' side.
    """
    ends, _ = _ends(limits.chart, planes, limits.own_low, limits.own_high)
    said = np.stack([ends[0] > limits.ends[0], ends[1] < limits.ends[1]])
    return replace(
        limits,
        cuts=(*limits.cuts, *planes),
        ends=np.where(said, ends, limits.ends),
        reaches=np.where(said, 1.0, limits.reaches),
        said=said,
    )


def _cuts(
    index: int, surfaces: Sequence[MergedSurface], enclosing: BoolArray, points: FloatArray
) -> list[tuple[int, Surface]]:
    """Enclosing surfaces, with their indices, that have the surface on their inner side."""
    cuts = []
    for other, candidate in enumerate(surfaces):
        if other == index or not enclosing[other]:
            continue
        distance = candidate.fit.surface.distance(points)
        slack = 3 * candidate.fit.rms + 0.02 * float(np.ptp(distance))
        if np.abs(distance).max() > 2 * slack and np.mean(distance > -slack) >= 0.98:
            cuts.append((other, candidate.fit.surface))
    return cuts


def _ends(
    chart: Surface, cuts: Sequence[Plane], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Where the nearest cuts close the low and high sides (rows) along u and v (columns), and which do."""
    ends = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    which = np.full((2, 2), -1)
    for axis in (0, 1) if isinstance(chart, Plane) else (1,):
        for row, (sign, side) in enumerate(((-1.0, low), (1.0, high))):
            for number, cut in enumerate(cuts):
                end = _reach_along(chart, cut, axis=axis, sign=sign, low=low, high=high)
                if end is not None and sign * (end - side[axis]) >= 0 > sign * (end - ends[row, axis]):
                    ends[row, axis], which[row, axis] = end, number
    return ends, which


def _reach_along(
    chart: Surface, cut: Plane, axis: int, sign: float, low: FloatArray, high: FloatArray
) -> float | None:
    """Chart coordinate where the cut meets the rectangle's continuation, None if it faces away."""
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    centre = (low + high) / 2
    step = np.zeros(2)
    step[axis] = max(float((high - low)[axis]), 1e-3) * 0.5
    here = centre if isinstance(chart, Plane) else np.array([0.0, centre[1]])
    pair = cut.distance(chart.from_uv(np.stack([here - step, here + step])))
    slope = float(pair[1] - pair[0]) / (2 * float(step[axis]))
    if sign * slope > -0.7:  # the cut must close this side, not run along it
        return None
    at_sides = corners[(corners[:, axis] == (high if sign > 0 else low)[axis])]
    height = cut.distance(chart.from_uv(at_sides))
    ends = at_sides[:, axis] - height / slope
    return float(ends.max() if sign > 0 else ends.min())
