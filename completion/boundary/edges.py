# SPDX-License-Identifier: MIT
"""Edges: lines and circles in a surface's chart, and the parts of its own boundary that follow them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.boundary.boundary_pixels import BoundaryPixels
from completion.boundary.limits import (
    GAP,
    LEAST_ARC,
    LEAST_SINE,
    LEAST_STEPS,
    MIN_POINTS,
    MOST_EDGES,
    MOST_VOTES,
    SLACK,
    SQUARE_COSINE,
)
from scenes.checks import BoolArray, FloatArray, Value
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import compiled, inlined, sort_order

_N_DIRECTIONS = 180
_REFITS = 2  # of a line, with the weights that it gives itself


def best_line(uv: FloatArray, step: FloatArray, left: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the line that most of the points `left` (n,) agree with, in runs, and those points (n,).

    Points and steps `uv` and `step` are (n, 2). A line is (4,): a place on it and its unit direction. Without
    one, no point is marked.
    """
    line, vote = np.zeros(4), left.copy()
    members = np.zeros(len(left), np.bool_)
    for _ in range(MOST_VOTES):
        if np.count_nonzero(vote) < MIN_POINTS:
            break
        line, width = _most_voted_line(uv, step, vote)
        for slack in (2.0 * width, width, 0.0, 0.0):
            chosen = near_line(line, uv, step, slack) & left
            if np.count_nonzero(chosen) < MIN_POINTS:
                break
            line = line_through(uv, step, chosen)
        members = in_runs(line, uv, step, near_line(line, uv, step, 0.0) & left)
        if members.any():
            break
        vote &= ~near_line(line, uv, step, width)
    return line, members


@compiled
def near_line(line: FloatArray, uv: FloatArray, step: FloatArray, least: float) -> BoolArray:
    """Which points (n, 2) lie on a line (4,) as far as their steps (n, 2) tell, or within `least` metres."""
    near = np.empty(len(uv), np.bool_)
    for i in range(len(uv)):
        across = abs(line[2] * (uv[i, 1] - line[1]) - line[3] * (uv[i, 0] - line[0]))
        near[i] = across <= max(_line_slack(line, step[i, 0], step[i, 1]), least)
    return near


@compiled
def line_through(uv: FloatArray, step: FloatArray, chosen: BoolArray) -> FloatArray:
    """The line (4,) by least squares through the chosen (n,) of points (n, 2).

    They are weighted by what a pixel's step (n, 2) says about them.
    """
    line = np.zeros(4)
    for refit in range(1 + _REFITS):
        total, u, v = 0.0, 0.0, 0.0
        for i in range(len(uv)):
            if chosen[i]:
                weight = 1 / _line_slack(line, step[i, 0], step[i, 1]) ** 2 if refit else 1.0
                total, u, v = total + weight, u + weight * uv[i, 0], v + weight * uv[i, 1]
        u, v = u / total, v / total
        moment = np.zeros((2, 2))
        for i in range(len(uv)):
            if chosen[i]:
                weight = 1 / _line_slack(line, step[i, 0], step[i, 1]) ** 2 if refit else 1.0
                right, up = uv[i, 0] - u, uv[i, 1] - v
                moment[0, 0] += weight * right * right
                moment[1, 0] += weight * right * up
                moment[1, 1] += weight * up * up
        moment[0, 1] = moment[1, 0]
        vectors = np.linalg.eigh(moment)[1]
        line[0], line[1], line[2], line[3] = u, v, vectors[0, 1], vectors[1, 1]
    return line


@compiled
def in_runs(line: FloatArray, uv: FloatArray, step: FloatArray, members: BoolArray) -> BoolArray:
    """Which members (n,) stand in a run along a line (4,) of enough points, over three steps long."""
    index = _indices_of(members)
    n, kept = len(index), np.zeros(len(members), np.bool_)
    along, size = np.empty(n), np.empty(n)
    for k in range(n):
        i = index[k]
        along[k] = (uv[i, 0] - line[0]) * line[2] + (uv[i, 1] - line[1]) * line[3]
        size[k] = np.sqrt(step[i, 0] ** 2 + step[i, 1] ** 2)
    order = np.empty(n, np.int64)
    sort_order(along, order, np.empty(n, np.int64))
    first = 0
    for k in range(1, n + 1):
        if k < n:
            gap = GAP * max(size[order[k]], size[order[k - 1]])
            if along[order[k]] - along[order[k - 1]] <= gap:
                continue
        if k - first >= MIN_POINTS:
            sizes = np.empty(k - first)
            for at in range(first, k):
                sizes[at - first] = size[order[at]]
            if along[order[k - 1]] - along[order[first]] > LEAST_STEPS * _median(sizes):
                for at in range(first, k):
                    kept[index[order[at]]] = True
        first = k
    return kept


@inlined
def _indices_of(members: BoolArray) -> NDArray[np.int64]:
    """The indices (k,) of those that are marked."""
    index, n = np.empty(len(members), np.int64), 0
    for i in range(len(members)):
        if members[i]:
            index[n] = i
            n += 1
    return index[:n]


@inlined
def _median(values: FloatArray) -> float:
    """The median of numbers (n,)."""
    n, order = len(values), np.empty(len(values), np.int64)
    sort_order(values, order, np.empty(n, np.int64))
    middle = values[order[n // 2]]
    return float(middle if n % 2 else (values[order[n // 2 - 1]] + middle) / 2)


@inlined
def _line_slack(line: FloatArray, right: float, up: float) -> float:
    """How far a point with this step may lie from a line (4,)."""
    across = abs(line[2] * up - line[3] * right)
    return float(SLACK[0] * across + SLACK[1] * np.sqrt(right * right + up * up))


@compiled
def _most_voted_line(uv: FloatArray, step: FloatArray, vote: BoolArray) -> tuple[FloatArray, float]:
    """The line with the most votes of the points that `vote` (n,) marks, and how wide its slot is.

    Every point (n, 2), with its step (n, 2), votes for an offset in each direction (Duda & Hart 1972).
    """
    index = _indices_of(vote)
    u, v, size = 0.0, 0.0, np.empty(len(index))
    for k in range(len(index)):
        u, v = u + uv[index[k], 0], v + uv[index[k], 1]
        size[k] = np.sqrt(step[index[k], 0] ** 2 + step[index[k], 1] ** 2)
    u, v, width = u / len(index), v / len(index), _median(size)
    right, up = np.empty(len(index)), np.empty(len(index))
    for k in range(len(index)):
        right[k], up[k] = uv[index[k], 0] - u, uv[index[k], 1] - v
    offset, low, high = np.empty((_N_DIRECTIONS, len(index))), np.inf, -np.inf
    for turn in range(_N_DIRECTIONS):
        angle = turn * np.pi / _N_DIRECTIONS
        sine, cosine = np.sin(angle), np.cos(angle)
        for k in range(len(index)):
            offset[turn, k] = cosine * up[k] - sine * right[k]
            low, high = min(low, offset[turn, k]), max(high, offset[turn, k])
    n_slots = int(np.rint((high - low) / width)) + 2
    most, best, place = -1, 0, 0
    count: NDArray[np.int64] = np.zeros(n_slots + 1, np.int64)
    for turn in range(_N_DIRECTIONS):
        count[:] = 0
        for k in range(len(index)):
            count[int(np.rint((offset[turn, k] - low) / width))] += 1
        for slot in range(n_slots):  # neighbouring slots together: a line may lie on their border
            if count[slot] + count[slot + 1] > most:
                most, best, place = count[slot] + count[slot + 1], turn, slot
    angle = best * np.pi / _N_DIRECTIONS
    sine, cosine, middle = np.sin(angle), np.cos(angle), low + (place + 0.5) * width
    line = np.empty(4)
    line[0], line[1], line[2], line[3] = u - middle * sine, v + middle * cosine, cosine, sine
    return line, width


@dataclass(frozen=True, slots=True, eq=False)
class ChartLine(Value):
    """The line through `point` along the unit vector `direction`, chart coordinates in metres."""

    point: FloatArray
    direction: FloatArray

    @property
    def normal(self) -> FloatArray:
        """Unit vector (2,) a quarter turn anticlockwise of the direction."""
        return np.array([-self.direction[1], self.direction[0]])

    @property
    def length(self) -> float:
        """A line never returns."""
        return float("inf")

    def across(self, uv: FloatArray) -> FloatArray:
        """Signed distance (...,)."""
        return np.asarray((uv - self.point) @ self.normal)

    def towards(self, uv: FloatArray) -> FloatArray:
        """Unit vector (..., 2) in which `across` grows."""
        return np.broadcast_to(self.normal, uv.shape)

    def along(self, uv: FloatArray) -> FloatArray:
        """Length (...,) from `point`."""
        return np.asarray((uv - self.point) @ self.direction)

    def at(self, along: FloatArray) -> FloatArray:
        """Chart coordinates (..., 2)."""
        return np.asarray(self.point + np.asarray(along)[..., None] * self.direction)


@dataclass(frozen=True, slots=True, eq=False)
class Circle(Value):
    """The circle around `centre` with `radius`, chart coordinates in metres."""

    centre: FloatArray
    radius: float

    @property
    def length(self) -> float:
        """Circumference."""
        return float(2 * np.pi * self.radius)

    def across(self, uv: FloatArray) -> FloatArray:
        """Signed distance (...,), positive inside."""
        return np.asarray(self.radius - np.linalg.norm(uv - self.centre, axis=-1), dtype=np.float64)

    def towards(self, uv: FloatArray) -> FloatArray:
        """Unit vector (..., 2) in which `across` grows."""
        offset = self.centre - uv
        size = np.linalg.norm(offset, axis=-1, keepdims=True)
        return np.asarray(offset / np.maximum(size, 1e-12), dtype=np.float64)

    def along(self, uv: FloatArray) -> FloatArray:
        """Arc length (...,) in -pi r .. pi r."""
        offset = uv - self.centre
        return np.asarray(self.radius * np.arctan2(offset[..., 1], offset[..., 0]), dtype=np.float64)

    def at(self, along: FloatArray) -> FloatArray:
        """Chart coordinates (..., 2)."""
        angle = np.asarray(along) / self.radius
        return np.asarray(self.centre + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def fit_circle(uv: FloatArray) -> Circle | None:
    """Fit a circle to points (n, 2) by Pratt's normalisation (Pratt 1987).

    None where the points lie on a line.
    """
    mean = uv.mean(axis=0)
    x, y = (uv - mean).T
    z = x * x + y * y
    moments = np.column_stack([z, x, y, np.ones(len(x))])
    constraint = np.array([[0, 0, 0, -2.0], [0, 1, 0, 0], [0, 0, 1, 0], [-2.0, 0, 0, 0]])
    values, vectors = np.linalg.eig(np.linalg.solve(constraint, moments.T @ moments))
    rounding = 1e-9 * float(np.abs(values).max())
    proper = (np.abs(values.imag) < rounding) & (values.real > -rounding)  # nothing where the fit is exact
    real = np.where(proper, values.real, np.inf)
    if not np.isfinite(real).any():
        return None
    a, b, c, d = vectors[:, int(np.argmin(real))].real
    if abs(a) < 1e-12:
        return None
    centre = np.array([-b, -c]) / (2 * a)
    square = float(centre @ centre - d / a)
    return Circle(mean + centre, float(np.sqrt(square))) if square > 0 else None


def meeting_line(chart: Surface, other: Surface) -> ChartLine | None:
    """Return the line in `chart` along which two surfaces of one frame meet, None where it is no line.

    Plane and plane meet in a line; so do a cylinder and a plane at right angles to its axis, or along it.
    """
    if isinstance(chart, Plane) and isinstance(other, Plane):
        return _of_planes(chart, other)
    if isinstance(chart, Cylinder) and isinstance(other, Plane):
        return _across_axis(chart, other)
    return None


def _of_planes(chart: Plane, other: Plane) -> ChartLine | None:
    """Where other.normal . (point + u a + v b - other.point) vanishes."""
    gradient = np.array([
        chart.u_direction @ other.normal_direction,
        chart.v_direction @ other.normal_direction,
    ])  # fmt: skip
    sine = float(np.linalg.norm(gradient))
    if sine < LEAST_SINE:
        return None
    height = float(other.distance(chart.point[None])[0])
    normal = gradient / sine
    return ChartLine(-height / sine * normal, np.array([normal[1], -normal[0]]))


def _across_axis(chart: Cylinder, other: Plane) -> ChartLine | None:
    """The height at which a plane at right angles to the axis cuts the cylinder."""
    cosine = float(chart.direction @ other.normal_direction)
    if abs(cosine) < SQUARE_COSINE:
        return None
    height = -float(other.distance(chart.point[None])[0]) / cosine
    return ChartLine(np.array([0.0, height]), np.array([1.0, 0.0]))


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryEdge(Value):
    """A curve with the runs of it that were seen."""

    curve: ChartLine | Circle  # where it is
    runs: FloatArray  # (k, 2) first and last arc length of each run, metres
    sides: FloatArray  # (k,) sign of the distance across on whose side the surface lies, for each run
    deviation: float  # standard deviation of a point of the curve across it where it was seen, metres
    is_crease: bool = False  # whether another surface meets it there
    common: float = 0.0  # deviation that all its pixels share, as those do that lie along a column; metres


def edge_along(line: ChartLine, boundary: BoundaryPixels) -> tuple[BoundaryEdge, BoolArray]:
    """Return the runs of a known line along which boundary pixels lie, and which pixels (n,) those are."""
    agrees = _agrees(line, boundary) & (np.linalg.norm(boundary.step, axis=1) > 0)
    members = in_runs(np.concatenate([line.point, line.direction]), boundary.uv, boundary.step, agrees)
    return replace(_edge(line, boundary.only(members)), is_crease=True), members


def find_edges(boundary: BoundaryPixels) -> list[BoundaryEdge]:
    """Fit lines and circles to points of one kind, in the chart of the surface, the best supported first.

    A point is known to half a pixel's step to either side; its tolerance across a curve therefore depends on
    the curve's direction. A connected chain is a circle where one circle explains it and no line does. Lines
    are found by voting (Hough) and refined by weighted least squares.
    """
    size = np.linalg.norm(boundary.step, axis=1)
    boundary, size = boundary.only(size > 0), size[size > 0]
    edges: list[BoundaryEdge] = []
    left = np.ones(len(size), dtype=np.bool_)
    for chain in _chains(boundary.uv, size):
        circle = _circle_of(boundary.only(chain))
        if circle is not None:
            agrees = _agrees(circle, boundary) & left
            edges.append(_edge(circle, boundary.only(agrees)))
            left &= ~agrees
    while left.sum() >= MIN_POINTS and len(edges) < MOST_EDGES:
        pair = _best_line(boundary, left)
        if pair is None:
            break
        line, members = pair
        edges.append(_edge(line, boundary.only(members)))
        left &= ~members
    return [edge for edge in edges if len(edge.runs)]


def _best_line(boundary: BoundaryPixels, left: BoolArray) -> tuple[ChartLine, BoolArray] | None:
    """The line that most of the points `left` agree with, in runs, and those points."""
    line, members = best_line(boundary.uv, boundary.step, left)
    return (ChartLine(line[:2], line[2:]), members) if members.any() else None


def _line_of(boundary: BoundaryPixels) -> ChartLine:
    """The line by least squares across it, points weighted by what a pixel's step says about them."""
    line = line_through(boundary.uv, boundary.step, np.ones(len(boundary.uv), dtype=np.bool_))
    return ChartLine(line[:2], line[2:])


def _slack(curve: ChartLine | Circle, boundary: BoundaryPixels) -> FloatArray:
    """How far (n,) points may lie from the curve: half their step across it, and a little for noise."""
    across = np.abs(np.einsum("ij,ij->i", boundary.step, curve.towards(boundary.uv)))
    size = np.linalg.norm(boundary.step, axis=1)
    return np.asarray(SLACK[0] * across + SLACK[1] * size, dtype=np.float64)


def _agrees(curve: ChartLine | Circle, boundary: BoundaryPixels) -> BoolArray:
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


def _edge(curve: ChartLine | Circle, boundary: BoundaryPixels) -> BoundaryEdge:
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
    return BoundaryEdge(curve, np.array(runs).reshape(-1, 2), np.array(sides), deviation, common=common)


def _spans(curve: ChartLine | Circle, boundary: BoundaryPixels) -> list[tuple[float, float]]:
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
    return circle if 2 * np.pi - gaps.max() >= LEAST_ARC else None
