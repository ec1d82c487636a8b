# SPDX-License-Identifier: MIT
"""Chains: edges of a model's triangles along which two regions meet, and the exact curves that they are of.

A tessellated model says which faces meet along which edges, where these end, and in which order they go
round a face. Corners and loops are read off; curves are where the two surfaces cross, or touch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from completion.export.step import limits
from completion.export.step.folds import ContactCurve, FoldFinder, tabulate
from completion.export.step.kernel import circle_through, interpolate, kernel, kernel_point, line_through
from completion.export.step.pieces import CurveCorner, CurvePiece, LoopSide, RegionLoops
from completion.export.step.regions import RegionMesh, place_text
from completion.export.step.tracing import CurvePath, project_on_curve
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Surface

_LEAST_POINTS = 9  # of a chain, those between its vertices included
_N_STEPS = 8
_OFF = 2.0  # times as far as vertices are off the surfaces, across these, that they may be off the curve
_ENDLESS = 1e50  # parameters of lines
_MOST_LOST = 0.25  # of the points of a chain that may lead to no curve: at its ends surfaces may be tangent


class RegionOutlines(NamedTuple):
    """Curves with their pieces and corners, the loops of each region, and why a region has none.

    `open_at` tells of each region where (3,) it ends without a neighbour; None of those that do not.
    """

    curves: list[ContactCurve]
    pieces: list[CurvePiece]
    corners: list[CurveCorner]
    loops: list[RegionLoops]
    open_at: list[FloatArray | None]
    reasons: dict[int, str]


class _Chain(NamedTuple):
    """Vertices (n,) from corner to corner between two regions, or of one that has no neighbour there."""

    pair: tuple[int, int]
    vertices: IntArray
    is_closed: bool


class DirectedEdges(NamedTuple):
    """Directed edges (n,) of triangles: where they start, the neighbour's edge, the regions beside them.

    Without a neighbour the one is -1 and the region `beside` as well.
    """

    start: IntArray
    twin: IntArray
    region: IntArray
    beside: IntArray

    @property
    def is_border(self) -> BoolArray:
        """Which edges (n,) part regions."""
        return np.asarray(self.region != self.beside)


def _next(edge: int) -> int:
    return edge - 2 if edge % 3 == 2 else edge + 1


def directed_edges(mesh: RegionMesh) -> DirectedEdges | None:
    """The edges of a mesh; None where triangles overlap, or turn both ways."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    n = len(mesh.vertices)
    key, other = start * n + end, end * n + start
    order = np.argsort(key, kind="stable")
    if (np.diff(key[order]) == 0).any():
        return None
    place = np.minimum(np.searchsorted(key[order], other), len(order) - 1)
    twin = np.where(key[order[place]] == other, order[place], -1)
    region = np.repeat(mesh.region, 3)
    return DirectedEdges(start, twin, region, beside=np.where(twin < 0, -1, region[twin]))


def outlines_of(
    edges: DirectedEdges, mesh: RegionMesh, finder: FoldFinder, names: Sequence[int]
) -> RegionOutlines:
    """Return the loops of the regions of a model's triangles, with the finder's surfaces; millimetres.

    `names` (k,) are what the surfaces are called.
    """
    chains, rounds = _chains(edges, len(finder.surfaces))
    corners, at = _corners(chains, edges, mesh, finder)
    curves, pieces, places, reasons = list[ContactCurve](), list[CurvePiece](), list[int](), dict[int, str]()
    is_along = list[bool]()
    for chain in chains:
        points = mesh.vertices[chain.vertices]
        ends = (-2, -2) if chain.is_closed else (at[int(chain.vertices[0])], at[int(chain.vertices[-1])])
        for point, corner in () if chain.is_closed else zip((0, -1), ends, strict=True):
            points[point] = corners[corner].point
        curve = _curve(chain, points, finder)
        places.append(-1 if curve is None else len(curves))
        if curve is None:
            one, two = (names[place] for place in chain.pair)
            from_, to = (place_text(points[k]) for k in (0, len(points) // 2 if chain.is_closed else -1))
            for place in set(chain.pair):
                reasons[place] = f"no curve was found where surfaces {one} and {two} meet, {from_} to {to}"
            is_along.append(True)
            continue
        piece, along = _piece(curve, points, ends, len(curves))
        curves.append(curve)
        pieces.append(piece)
        is_along.append(along)
    sides = _sides(mesh, finder.surfaces)
    loops = [
        RegionLoops([_loop(one, places, is_along, is_turned=sides[k] < 0) for one in own], [])
        if k not in reasons
        else RegionLoops([], [])
        for k, own in enumerate(rounds)
    ]
    free = {
        chain.pair[0]: mesh.vertices[chain.vertices[0]] for chain in chains if chain.pair[0] == chain.pair[1]
    }
    open_at = [free.get(k) for k in range(len(loops))]
    return RegionOutlines(curves, pieces, corners, loops, open_at=open_at, reasons=reasons)


def _loop(
    chains: Sequence[tuple[int, bool]], places: Sequence[int], is_along: Sequence[bool], *, is_turned: bool
) -> list[LoopSide]:
    """Chains in order round a region as pieces; the other way where the surface looks into the part."""
    sides = [LoopSide(places[k], forward == is_along[k]) for k, forward in chains]
    return [LoopSide(piece, not along) for piece, along in reversed(sides)] if is_turned else sides


def _sides(mesh: RegionMesh, surfaces: Sequence[Surface]) -> FloatArray:
    """Of each surface (k,), above 0 where its normals look as those of its triangles do."""
    corners = mesh.vertices[mesh.faces]
    across, middle = (
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
        corners.mean(axis=1),
    )
    own = [mesh.region == k for k in range(len(surfaces))]
    return np.array([
        np.einsum("ij,ij->", across[some], surface.normal(middle[some]))
        for some, surface in zip(own, surfaces, strict=True)
    ])  # fmt: skip


def _chains(edges: DirectedEdges, n: int) -> tuple[list[_Chain], list[list[list[tuple[int, bool]]]]]:
    """All chains, and the loops of each of n regions: chains in order, and whether each runs as given."""
    is_corner, is_border = _are_corners(edges), edges.is_border
    chains, known = list[_Chain](), dict[int, int]()
    rounds: list[list[list[tuple[int, bool]]]] = [[] for _ in range(n)]
    done = edges.region < 0
    for first in np.flatnonzero(is_border).tolist():
        if done[first]:
            continue
        ring = _ring(edges, is_border, first)
        done[ring] = True
        breaks = [k for k, one in enumerate(ring) if is_corner[edges.start[one]]]
        ring = ring[breaks[0] :] + ring[: breaks[0]] if breaks else ring
        starts = [k - breaks[0] for k in breaks] if breaks else [0]
        loop = list[tuple[int, bool]]()
        for a, b in zip(starts, [*starts[1:], len(ring)], strict=True):
            part = ring[a:b]
            name = min(min(one, int(edges.twin[one]) % len(done)) for one in part)
            is_new = name not in known
            if is_new:
                known[name] = len(chains)
                pair = int(edges.region[first]), int(edges.beside[part[0]])
                pair = (min(pair), max(pair)) if pair[1] >= 0 else (pair[0], pair[0])
                chains.append(_Chain(pair, edges.start[[*part, _next(part[-1])]], not breaks))
            loop.append((known[name], is_new))
        rounds[int(edges.region[first])].append(loop)
    return chains, rounds


def _ring(edges: DirectedEdges, is_border: BoolArray, first: int) -> list[int]:
    """Edges round a region, from one on."""
    ring, edge = [first], first
    while True:
        edge = _next(edge)
        while not is_border[edge]:
            edge = _next(int(edges.twin[edge]))
        if edge == first:
            return ring
        ring.append(edge)


def _are_corners(edges: DirectedEdges) -> BoolArray:
    """Which vertices (n,) end chains: where other regions meet than two along one line."""
    own = np.arange(len(edges.start))
    border = np.flatnonzero(edges.is_border & ((edges.twin < 0) | (own < edges.twin)))
    ends = edges.start[np.column_stack([border, np.where(border % 3 == 2, border - 2, border + 1)])].T.ravel()
    pair = np.sort(np.column_stack([edges.region[border], edges.beside[border]]), axis=1)
    n = int(edges.start.max()) + 1
    low, high = np.full((n, 2), len(own)), np.full((n, 2), -2)
    for k in range(2):
        np.minimum.at(low[:, k], ends, np.tile(pair[:, k], 2))
        np.maximum.at(high[:, k], ends, np.tile(pair[:, k], 2))
    return np.asarray((np.bincount(ends, minlength=n) != 2) | (low != high).any(axis=1))


def _corners(
    chains: Sequence[_Chain], edges: DirectedEdges, mesh: RegionMesh, finder: FoldFinder
) -> tuple[list[CurveCorner], dict[int, int]]:
    """Where chains end: the place nearest to the vertex that is on all surfaces there; places by vertex."""
    ends = [int(vertex) for chain in chains if not chain.is_closed for vertex in chain.vertices[[0, -1]]]
    at = {vertex: place for place, vertex in enumerate(dict.fromkeys(ends))}
    meeting: dict[int, set[int]] = {vertex: set() for vertex in at}
    for vertex, region in zip(edges.start.tolist(), edges.region.tolist(), strict=True):
        if vertex in meeting and region >= 0:
            meeting[vertex].add(region)
    return [
        CurveCorner(
            _on_all([finder.surfaces[k] for k in sorted(meeting[vertex])], mesh.vertices[vertex], finder)
        )
        for vertex in at
    ], at


def _on_all(surfaces: Sequence[Surface], vertex: FloatArray, finder: FoldFinder) -> FloatArray:
    """The place (3,) near a vertex that is on all surfaces, as far as these cross."""
    point = vertex.copy()
    for _ in range(_N_STEPS):
        normals = np.concatenate([surface.normal(point[None]) for surface in surfaces])
        off = np.concatenate([surface.distance(point[None]) for surface in surfaces])
        point = point - np.linalg.pinv(normals, rcond=limits.FLAT_SINE) @ off
    is_near = np.isfinite(point).all() and np.linalg.norm(point - vertex) < finder.reach
    return point if is_near else vertex


def _curve(chain: _Chain, points: FloatArray, finder: FoldFinder) -> ContactCurve | None:
    """The curve of which a chain's edges between points (n, 3) are chords; None where none was found."""
    surface, two = (finder.surfaces[place] for place in chain.pair)
    dense = points
    while len(dense) < max(_LEAST_POINTS, 2 * len(points) - 1):
        finer = np.empty((2 * len(dense) - 1, 3))
        finer[::2], finer[1::2] = dense, (dense[1:] + dense[:-1]) / 2
        dense = finer
    dense = dense[:-1] if chain.is_closed else dense
    within = finder.reach
    if chain.pair[0] == chain.pair[1]:
        on = dense - surface.distance(dense)[:, None] * surface.normal(dense)
        path, touching = CurvePath(on, chain.is_closed, 0.0), True
    else:
        sine = np.linalg.norm(np.cross(surface.normal(points), two.normal(points)), axis=1)
        touching = bool(np.median(sine) < limits.FLAT_SINE)
        off = float(np.abs([one.distance(points) for one in (surface, two)]).max())
        within += _OFF * off / max(float(np.median(sine)), limits.FLAT_SINE)
        moved = project_on_curve(surface, two, dense, touching=touching)
        near = moved.holds & (np.linalg.norm(moved.points - dense, axis=1) < finder.spacing)
        if not chain.is_closed:
            moved.points[[0, -1]] = points[[0, -1]]
            near[[0, -1]] = True
        if near.mean() < 1 - _MOST_LOST or near.sum() < 3:
            return None
        path = CurvePath(moved.points[near], chain.is_closed, float(np.median(moved.gap[near])))
    for geometry in _candidates(chain.pair, path, points, finder, touching=touching):
        curve = _tabulated(chain.pair, geometry, path, finder.spacing, is_tangent=touching)
        if curve.feet(points)[1].max() < within:
            return curve
    return None


def _candidates(
    pair: tuple[int, int], path: CurvePath, points: FloatArray, finder: FoldFinder, *, touching: bool
) -> Iterator[Any]:
    """Curves that a path may be of, the simplest first; those without a neighbour pass its points."""
    exact = 100 * limits.TOLERANCE + 4 * path.gap if touching else limits.TOLERANCE
    yield from filter(None, (line_through(path.points, exact), circle_through(path.points, exact)))
    if pair[0] == pair[1]:
        circle = circle_through(points, exact) if len(points) > _LEAST_POINTS else None
        yield from filter(None, (circle, interpolate(path.points, is_closed=path.is_closed)))
        return
    if not touching:
        yield from finder.conics(pair)
    if (spline := finder.spline(pair, path, touching=touching)) is not None:
        yield spline


def _tabulated(
    pair: tuple[int, int], geometry: Any, path: CurvePath, spacing: float, *, is_tangent: bool
) -> ContactCurve:
    """The curve with a table over the range that a path takes, or over all of one that returns."""
    span = (geometry.FirstParameter(), geometry.LastParameter())
    if not np.isfinite(span).all() or max(map(abs, span)) > _ENDLESS:
        feet = [_parameter(geometry, point) for point in path.points]
        span = (min(feet), max(feet))
    is_closed = bool(geometry.IsPeriodic())
    return tabulate(pair, geometry, span, spacing, is_closed=is_closed, is_tangent=is_tangent)


def _parameter(geometry: Any, point: FloatArray) -> float:
    """The parameter of the place on a curve that is nearest to a point (3,)."""
    foot = kernel().GeomAPI.GeomAPI_ProjectPointOnCurve(kernel_point(point), geometry)
    return float(foot.LowerDistanceParameter()) if foot.NbPoints() else float(geometry.FirstParameter())


def _piece(
    curve: ContactCurve, points: FloatArray, ends: tuple[int, int], place: int
) -> tuple[CurvePiece, bool]:
    """The piece of a curve from the first to the last of points (n, 3), and whether it runs their way."""
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    low, high, along = curve.low, curve.high, True
    if curve.is_closed:
        is_whole = ends[0] == ends[1]
        middle = points[len(points) // (4 if is_whole else 2)] if len(points) > 2 else points.mean(axis=0)
        first, last, between = (
            _parameter(curve.geometry, point) for point in (points[0], points[-1], middle)
        )
        period = curve.high - curve.low
        reach = period / 2 if is_whole else (last - first) % period
        along = (between - first) % period < reach
        low, turn = (first, reach) if along else (last, period - reach)
        high = low + (period if is_whole else turn)
    elif type(curve.geometry).__name__ != "Geom_BSplineCurve":  # which runs from end to end
        first, last = (_parameter(curve.geometry, points[k]) for k in (0, -1))
        along, low, high = first < last, min(first, last), max(first, last)
    return CurvePiece(place, low, high, ends if along else ends[::-1], support=1.0, length=length), along
