# SPDX-License-Identifier: MIT
"""Edges: straight and circular parts of a surface's own boundary, and on which side of them it lies."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.boundary.boundary_pixels import BoundaryPixels
from completion.boundary.curves import Circle, Line, fit_circle
from completion.boundary.lines import GAP, MIN_POINTS, SLACK, best_line, in_runs, line_through
from scenes.checks import BoolArray, FloatArray

_MAX_EDGES = 40
_MIN_ARC = np.radians(30.0)


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A curve with the runs of it that were seen."""

    curve: Line | Circle  # where it is
    runs: FloatArray  # (k, 2) first and last arc length of each run, metres
    sides: FloatArray  # (k,) sign of the distance across on whose side the surface lies, for each run
    deviation: float  # standard deviation of a point of the curve across it where it was seen, metres
    is_crease: bool = False  # whether another surface meets it there
    common: float = 0.0  # deviation that all its pixels share, as those do that lie along a column; metres


def edge_along(line: Line, boundary: BoundaryPixels) -> tuple[Edge, BoolArray]:
    """Return the runs of a known line along which boundary pixels lie, and which pixels (n,) those are."""
    agrees = _agrees(line, boundary) & (np.linalg.norm(boundary.step, axis=1) > 0)
    members = in_runs(np.concatenate([line.point, line.direction]), boundary.uv, boundary.step, agrees)
    return replace(_edge(line, boundary.only(members)), is_crease=True), members


def find_edges(boundary: BoundaryPixels) -> list[Edge]:
    """Fit lines and circles to points of one kind, in the chart of the surface, the best supported first.

    A point is known to half a pixel's step to either side; its tolerance across a curve therefore depends on
    the curve's direction. A connected chain is a circle where one circle explains it and no line does. Lines
    are found by voting (Hough) and refined by weighted least squares.
    """
    size = np.linalg.norm(boundary.step, axis=1)
    boundary, size = boundary.only(size > 0), size[size > 0]
    edges: list[Edge] = []
    left = np.ones(len(size), dtype=np.bool_)
    for chain in _chains(boundary.uv, size):
        circle = _circle_of(boundary.only(chain))
        if circle is not None:
            agrees = _agrees(circle, boundary) & left
            edges.append(_edge(circle, boundary.only(agrees)))
            left &= ~agrees
    while left.sum() >= MIN_POINTS and len(edges) < _MAX_EDGES:
        found = _best_line(boundary, left)
        if found is None:
            break
        line, members = found
        edges.append(_edge(line, boundary.only(members)))
        left &= ~members
    return [edge for edge in edges if len(edge.runs)]


def _best_line(boundary: BoundaryPixels, left: BoolArray) -> tuple[Line, BoolArray] | None:
    """The line that most of the points `left` agree with, in runs, and those points."""
    line, members = best_line(boundary.uv, boundary.step, left)
    return (Line(line[:2], line[2:]), members) if members.any() else None


def _line_of(boundary: BoundaryPixels) -> Line:
    """The line by least squares across it, points weighted by what a pixel's step says about them."""
    line = line_through(boundary.uv, boundary.step, np.ones(len(boundary.uv), dtype=np.bool_))
    return Line(line[:2], line[2:])


def _slack(curve: Line | Circle, boundary: BoundaryPixels) -> FloatArray:
    """How far (n,) points may lie from the curve: half their step across it, and a little for noise."""
    across = np.abs(np.einsum("ij,ij->i", boundary.step, curve.towards(boundary.uv)))
    size = np.linalg.norm(boundary.step, axis=1)
    return np.asarray(SLACK[0] * across + SLACK[1] * size, dtype=np.float64)


def _agrees(curve: Line | Circle, boundary: BoundaryPixels) -> BoolArray:
    return np.asarray(np.abs(curve.across(boundary.uv)) <= _slack(curve, boundary), dtype=np.bool_)


def _gaps(boundary: BoundaryPixels) -> FloatArray:
    return np.asarray(GAP * np.linalg.norm(boundary.step, axis=1), dtype=np.float64)


def _runs(along: FloatArray, gap: FloatArray) -> list[NDArray[np.int64]]:
    """Indices of points in runs without a gap wider than either end's."""
    order = np.argsort(along, kind="stable")
    if not len(order):
        return []
    wide = np.diff(along[order]) > np.maximum(gap[order][1:], gap[order][:-1])
    return np.split(order, np.flatnonzero(wide) + 1)


def _edge(curve: Line | Circle, boundary: BoundaryPixels) -> Edge:
    """The edge through these pixels; the surface lies where their steps come from."""
    side = -np.sign(np.einsum("ij,ij->i", boundary.step, curve.towards(boundary.uv)))
    runs, sides = [], []
    for sign in (-1.0, 1.0):
        spans = _spans(curve, boundary.only(side == sign))
        runs += spans
        sides += [sign] * len(spans)
    rms = float(np.sqrt(np.mean(np.square(curve.across(boundary.uv))))) if len(boundary.uv) else 0.0
    deviation = rms * float(np.sqrt(2 / max(len(boundary.uv), 2)))
    step = np.abs(np.einsum("ij,ij->i", boundary.step, curve.towards(boundary.uv)))
    quantum = float(np.median(step)) if len(step) else 0.0
    common = float(np.sqrt(max(quantum**2 / 12 - rms**2, 0.0)))  # what the residuals do not show of it
    return Edge(curve, np.array(runs).reshape(-1, 2), np.array(sides), deviation, common=common)


def _spans(curve: Line | Circle, boundary: BoundaryPixels) -> list[tuple[float, float]]:
    """First and last arc length of each run of points."""
    along = curve.along(boundary.uv)
    spans = [
        (float(along[run].min()), float(along[run].max()))
        for run in _runs(along, _gaps(boundary))
        if len(run) >= MIN_POINTS
    ]
    if isinstance(curve, Circle) and len(spans) > 1:
        return _across_seam(spans, curve.length, float(_gaps(boundary).max()))
    return spans


def _across_seam(spans: list[tuple[float, float]], length: float, gap: float) -> list[tuple[float, float]]:
    """Join the last and the first run of a circle where they touch across the seam."""
    first, last = spans[0], spans[-1]
    if first[0] + length - last[1] > gap:
        return spans
    return [(last[0] - length, first[1]), *spans[1:-1]]


def _chains(uv: FloatArray, size: FloatArray) -> list[BoolArray]:
    """Points that hang together: no farther apart than a few steps."""
    if len(uv) < 2 * MIN_POINTS:
        return []
    pairs = cKDTree(uv).query_pairs(GAP * float(np.median(size)), output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(uv), len(uv)))
    part = connected_components(graph, directed=False)[1]
    counts = np.bincount(part)
    return [part == number for number in np.flatnonzero(counts >= 2 * MIN_POINTS)]


def _circle_of(boundary: BoundaryPixels) -> Circle | None:
    """The circle through a chain, if nearly all its points agree with it and it is plainly no line."""
    line = _line_of(boundary)
    if np.mean(_agrees(line, boundary)) > 0.6:
        return None
    circle = fit_circle(boundary.uv)
    if circle is None or np.mean(_agrees(circle, boundary)) < 0.9:
        return None
    angle = np.sort(circle.along(boundary.uv)) / circle.radius
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    return circle if 2 * np.pi - gaps.max() >= _MIN_ARC else None
