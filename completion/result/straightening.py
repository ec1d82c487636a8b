# SPDX-License-Identifier: MIT
"""Straightening: outlines of cells laid on the edges that a surface is known to have, and their corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.boundary.curves import Line, meeting_line
from completion.extension.patch import Patch
from scenes.checks import FloatArray

_REACH = 3.0  # cells between an outline and the edge that it follows
_MEETING = 10.0  # the same where it meets another surface
_BEYOND = 2.0  # cells by which an outline may follow an edge past where it was seen
_ROUGH = 1.0  # cells that an outline may be off its polygon
_PARALLEL = float(np.sin(np.radians(10.0)))


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """A line of the chart that an outline is laid on.

    Attributes
    ----------
    line : Line
        Where it is.
    runs : (k, 2) float
        First and last arc length of the stretches along which it counts, metres.
    reach_m : float
        How far off it an outline may be.
    """

    line: Line
    runs: FloatArray
    reach_m: float


def guides_of(patch: Patch) -> list[Guide]:
    """Return a surface's own straight edges, and where it meets what encloses the room.

    Cells that are seen obliquely make a saw of an edge. An edge that was fitted to the pixels holds within
    three cells; where two surfaces meet is known better than where the pixels between them ended, so that
    it holds within ten.
    """
    cell = float(patch.grid.cell.max())
    always = np.array([[-np.inf, np.inf]])
    meetings = [meeting_line(patch.grid.surface, cut) for cut in patch.limits.cuts]
    guides = [Guide(line, always, _MEETING * cell) for line in meetings if line is not None]
    for edge in patch.edges:
        if isinstance(edge.curve, Line):
            slack = _BEYOND * cell * np.array([-1.0, 1.0])
            guides.append(Guide(edge.curve, edge.runs + slack, _REACH * cell))
    return guides


def straightened(polygon: Any, guides: Sequence[Guide], cell_m: float) -> Any:
    """Return a polygon of the chart whose sides lie on the guides where these run beside it.

    What follows none is straightened to within a cell.

    Parameters
    ----------
    polygon : shapely Polygon
        In the chart.
    guides : sequence of Guide
        Lines to follow.
    cell_m : float
        Size of a cell, metres.
    """
    dense = shapely.segmentize(polygon, cell_m)
    laid = shapely.transform(dense, lambda uv: _on_guides(uv, guides)) if guides else dense
    return shapely.make_valid(laid).simplify(_ROUGH * cell_m)


def _on_guides(uv: FloatArray, guides: Sequence[Guide]) -> FloatArray:
    """Places moved to the nearest guide that they follow, or to where the two nearest meet."""
    across = np.stack([np.where(_follows(uv, guide), guide.line.across(uv), np.inf) for guide in guides])
    order = np.argsort(np.abs(across), axis=0, kind="stable")[:2]
    moved = uv.copy()
    for k, guide in enumerate(guides):
        near = (order[0] == k) & np.isfinite(across[k])
        moved[near] -= across[k, near, None] * guide.line.normal
    if len(guides) > 1:
        for place in np.flatnonzero(np.isfinite(np.take_along_axis(across, order[1:2], axis=0)[0])):
            one, other = (guides[k] for k in order[:, place])
            corner = _meeting(one.line, other.line)
            if corner is not None and np.linalg.norm(corner - uv[place]) <= 1.5 * max(
                one.reach_m, other.reach_m
            ):
                moved[place] = corner
    return moved


def _follows(uv: FloatArray, guide: Guide) -> Any:
    """Which places lie beside a stretch of a guide."""
    along = guide.line.along(uv)[:, None]
    beside = ((along >= guide.runs[:, 0]) & (along <= guide.runs[:, 1])).any(axis=1)
    return beside & (np.abs(guide.line.across(uv)) <= guide.reach_m)


def _meeting(one: Line, other: Line) -> FloatArray | None:
    """Where two lines meet, None where they hardly do."""
    across = float(other.normal @ one.direction)
    if abs(across) < _PARALLEL:
        return None
    along = float(other.normal @ (other.point - one.point)) / across
    return np.asarray(one.at(np.array(along)), dtype=np.float64)
