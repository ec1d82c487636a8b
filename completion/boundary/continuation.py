# SPDX-License-Identifier: MIT
"""Continuation: the surface's own edges followed into what is hidden (Dell'Acqua & Fisher 2002)."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from completion.boundary.edges import BoundaryEdge, ChartLine, Circle
from completion.boundary.limits import CORNER_CELLS, LEAD_CELLS, SKIP_CELLS
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray, Value


class Cue(StrEnum):
    """Knowledge about surfaces that completion uses (Dell'Acqua & Fisher 2002)."""

    MERGING = "merging"  # parts that an occluder cut apart are one surface
    RELATIONS = "relations"  # walls are parallel, at right angles, in one plane
    INTERSECTION = "intersection"  # it ends where it was seen to meet another surface
    COLLINEAR = "collinear"  # an edge seen on both sides of an occluder goes on between
    CONVERGENT = "convergent"  # an edge that vanishes behind an occluder goes on
    CIRCULAR = "circular"  # so does an arc
    CLOSURE = "closure"  # at a seen corner an edge turns by a right angle
    ARCHITECTURAL = "architectural"  # walls and floors go on to where another one ends them
    FULL_TURN = "full-turn"  # a cylinder closes around its back


ALL_CUES = tuple(Cue)


@dataclass(frozen=True, slots=True, eq=False)
class ContinuedEdge(Value):
    """The hidden part of an edge, as far as it was followed."""

    curve: ChartLine | Circle  # which the edge follows
    start: float  # arc length of the seen end, metres
    end: float  # that of the other end, metres; may be the smaller one
    two_sided: bool  # whether the edge was seen again at `end`
    deviation: float  # standard deviation across the curve where it was seen, metres
    side: float  # sign of the distance across the curve on whose side the surface lies
    provenance: Cue  # INTERSECTION, COLLINEAR, CONVERGENT, CIRCULAR or CLOSURE

    def progress(self, uv: FloatArray) -> FloatArray:
        """How far points (..., 2) lie along the hidden part, metres (...,); negative before it."""
        sign = 1.0 if self.end >= self.start else -1.0
        way = sign * (self.curve.along(uv) - self.start)
        if np.isfinite(self.curve.length):
            way = np.mod(way + self.curve.length / 4, self.curve.length) - self.curve.length / 4
        return np.asarray(way, dtype=np.float64)


def continue_edges(
    edges: Sequence[BoundaryEdge], grid: ChartGrid, hidden: BoolArray, cues: Collection[Cue] = ALL_CUES
) -> list[ContinuedEdge]:
    """Follow every edge from the ends of its runs through the hidden cells (rows, columns) while they last.

    Edges are in the grid's chart; `cues` are the ways of going on that are followed.
    """
    continued = []
    for edge in edges:
        followed = []
        for run in range(len(edge.runs)):
            for sign in (-1.0, 1.0):
                continued_edge_none = _follow(
                    edge, run, sign=sign, grid=grid, hidden=hidden, lead=LEAD_CELLS * float(grid.cell.max())
                )
                followed += (
                    _turn(edge, run, sign, grid, hidden)
                    if continued_edge_none is None
                    else [continued_edge_none]
                )
        continued += _without_twins(followed, float(grid.cell.max()))
    return [edge for edge in continued if edge.provenance in cues]


def _turn(
    edge: BoundaryEdge, run: int, sign: float, grid: ChartGrid, hidden: BoolArray
) -> list[ContinuedEdge]:
    """From a seen corner, hidden edges at right angles of which too little was seen to fit a line."""
    if isinstance(edge.curve, Circle):
        return []
    corner = edge.curve.at(edge.runs[run][int(sign > 0)])
    lead = CORNER_CELLS * float(grid.cell.max())
    turned = []
    for turn in (-1.0, 1.0):
        line = ChartLine(corner, turn * edge.curve.normal)
        back = -float(line.normal @ (sign * edge.curve.direction))  # surface there, if it is turned to
        side = np.sign(back) * (1.0 if turn == edge.sides[run] else -1.0)
        short = BoundaryEdge(line, np.zeros((1, 2)), np.array([side]), edge.deviation)
        continued_edge_none = _follow(short, 0, sign=1.0, grid=grid, hidden=hidden, lead=lead)
        if continued_edge_none is not None:
            turned.append(replace(continued_edge_none, provenance=Cue.CLOSURE))
    return turned


def _follow(
    edge: BoundaryEdge, run: int, sign: float, grid: ChartGrid, hidden: BoolArray, lead: float
) -> ContinuedEdge | None:
    """The hidden part that begins no farther than `lead` beyond one end of a run; None without one."""
    low, high = edge.runs[run]
    start = float(high if sign > 0 else low)
    step = float(grid.cell.min()) / 2
    furthest = float(np.linalg.norm(grid.cell * np.array(grid.shape[::-1])))
    furthest = min(furthest, edge.curve.length - (high - low))
    ahead: FloatArray = step * np.arange(1.0, max(int(furthest / step), 1) + 1)
    index, cell = grid.cells_at(edge.curve.at(start + sign * ahead))
    open_ = np.zeros(len(ahead), dtype=np.bool_)
    open_[index] = hidden.ravel()[cell]
    first = int(np.argmax(open_))
    if not open_[first] or ahead[first] > lead:
        return None
    closed = np.convolve(~open_[first:], np.ones(int(2 * SKIP_CELLS) + 1), mode="full")[: len(open_) - first]
    stops = np.flatnonzero(closed > 2 * SKIP_CELLS)
    last = int(stops[0]) - int(2 * SKIP_CELLS) - 1 if len(stops) else len(open_) - first - 1
    length = float(ahead[first + max(last, 0)])
    if open_[first:].sum() < 2 or length < 1.5 * float(grid.cell.max()):
        return None
    end = start + sign * length
    met = _meets_run(edge, run, end, 2 * LEAD_CELLS * float(grid.cell.max()))
    begin = start + sign * float(ahead[first])
    side = float(edge.sides[run])
    return ContinuedEdge(
        curve=edge.curve,
        start=begin,
        end=end,
        two_sided=met is not None,
        deviation=edge.deviation,
        side=side,
        provenance=_cue(edge, met),
    )


def _cue(edge: BoundaryEdge, met: int | None) -> Cue:
    if edge.is_crease:
        return Cue.INTERSECTION
    if isinstance(edge.curve, Circle):
        return Cue.CIRCULAR
    return Cue.CONVERGENT if met is None else Cue.COLLINEAR


def _meets_run(edge: BoundaryEdge, run: int, end: float, slack: float) -> int | None:
    """Number of the other run, with the surface on the same side, that begins or ends near `end`."""
    for other in np.flatnonzero(edge.sides == edge.sides[run]):
        distance = np.abs(edge.runs[other] - end)
        if np.isfinite(edge.curve.length):
            distance = np.minimum(distance, np.abs(edge.curve.length - distance))
        alone = other == run and not np.isfinite(edge.curve.length)
        if not alone and distance.min() <= slack:
            return int(other)
    return None


def _without_twins(continued: list[ContinuedEdge], cell: float) -> list[ContinuedEdge]:
    """The continuations of one edge, those that were followed from both ends kept once."""
    kept: list[ContinuedEdge] = []
    for edge in continued:
        twin = any(
            (other.two_sided and edge.two_sided and other.side == edge.side)
            and abs(other.end - edge.start) <= 2 * LEAD_CELLS * 2 * cell
            for other in kept
        )
        if not twin:
            kept.append(edge)
    return kept
