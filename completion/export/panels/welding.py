# SPDX-License-Identifier: MIT
"""Welding: the faces of all charts as one mesh whose surfaces share the vertices of their folds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.export.panels.arrangement import Arrangement, Trace
from completion.export.panels.limits import PRECISION_M, SAME_NODE_M, SAME_VERTEX_M
from completion.export.panels.model import PanelModel
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder

_ROUNDS = 4  # an edge that was divided may run through further vertices


def edges_of(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the edges (k, 2) of triangles (m, 3), how many of them each has (k,), and one of these (k,)."""
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, first, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return edges, count, first % max(len(faces), 1)


def vertices_within_edges(
    vertices: FloatArray, faces: NDArray[np.int64], slack_m: float
) -> list[tuple[int, int, int, NDArray[np.int64]]]:
    """Return the open edges that other open vertices lie within, to a slack in metres.

    For each its two vertices, its triangle, and the vertices (k,) on it in their order from the first.
    """
    edges, count, owner = edges_of(faces)
    is_open = np.flatnonzero(count == 1)
    rim = np.unique(edges[is_open])
    if not len(rim):
        return []
    tree = cKDTree(vertices[rim])
    begin, end = vertices[edges[is_open, 0]], vertices[edges[is_open, 1]]
    length = np.linalg.norm(end - begin, axis=1)
    near = tree.query_ball_point((begin + end) / 2, length / 2, return_sorted=True)
    pairs = []
    for k, held in enumerate(near):
        if len(held) < 1:
            continue
        along = (end[k] - begin[k]) / max(length[k], 1e-12)
        candidates = rim[held]
        offset = vertices[candidates] - begin[k]
        t = offset @ along
        across = np.linalg.norm(offset - t[:, None] * along, axis=1)
        on = (across < slack_m) & (t > slack_m) & (t < length[k] - slack_m)
        if on.any():
            order = np.argsort(t[on], kind="stable")
            first, second = edges[is_open[k]].tolist()
            pairs.append((first, second, int(owner[is_open[k]]), candidates[on][order]))
    return pairs


def heal(
    vertices: FloatArray, faces: NDArray[np.int64], corner_uv: FloatArray, slack_m: float
) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Divide triangles (m, 3) at the vertices (n, 3) that lie within their open edges, to a slack in metres.

    `corner_uv` is (m, 3, 2). Returns the triangles (k, 3), the chart coordinates (k, 3, 2) of their corners,
    and which of those given each comes from (k,).
    """
    source = np.arange(len(faces))
    for _ in range(_ROUNDS):
        entries: dict[int, tuple[int, int, int, NDArray[np.int64]]] = {}
        for edge in vertices_within_edges(vertices, faces, slack_m):
            entries.setdefault(edge[2], edge)  # one edge of a triangle at a time
        if not entries:
            break
        new_faces, new_uv, new_source = [], [], []
        for first, second, face, between in entries.values():
            corner = faces[face].tolist()
            at = next(k for k in range(3) if {corner[k], corner[(k + 1) % 3]} == {first, second})
            chain = [first, *between.tolist(), second]
            ends = corner_uv[face, [at, (at + 1) % 3]]
            if corner[at] != first:
                chain = chain[::-1]
            start, stop = vertices[chain[0]], vertices[chain[-1]]
            share = ((vertices[chain] - start) @ (stop - start)) / float((stop - start) @ (stop - start))
            uv, apex = ends[0] + share[:, None] * (ends[1] - ends[0]), (at + 2) % 3
            for k in range(len(chain) - 1):
                new_faces.append([chain[k], chain[k + 1], corner[apex]])
                new_uv.append([uv[k], uv[k + 1], corner_uv[face, apex]])
                new_source.append(int(source[face]))
        kept = np.ones(len(faces), np.bool_)
        kept[list(entries)] = False
        faces = np.concatenate([faces[kept], np.array(new_faces, np.int64)])
        corner_uv = np.concatenate([corner_uv[kept], np.array(new_uv)])
        source = np.concatenate([source[kept], np.array(new_source, np.int64)])
    return faces, corner_uv, source


_ON_M = 1.5 * PRECISION_M  # between a place and the fold that it is on


def weld(charts: Sequence[Arrangement]) -> PanelModel:
    """Triangulate the faces of all charts without further points, with the nodes of folds in common.

    A node that one surface has on a fold goes into the rings of the other too (nodes within .4 mm are one),
    so that no vertex lies within another's edge; nodes of folds within .6 mm of one another are one vertex.
    """
    rings = [_Rings.of(chart) for chart in charts if len(chart.faces)]
    shared: dict[int, list[FloatArray]] = {}
    for ring in rings:
        for line, on in zip(ring.chart.tracks, ring.on, strict=True):
            shared.setdefault(line.key, []).append(on[np.isfinite(on)])
    nodes = {key: _merge_parameters(np.concatenate(nodes_met)) for key, nodes_met in shared.items()}
    placed = [_triangulate(ring, nodes) for ring in rings]
    starts = np.cumsum([0, *(len(ring.vertices) for ring in placed)])
    if not len(starts) > 1:
        return PanelModel()
    vertices = np.concatenate([ring.vertices for ring in placed])
    on_fold = np.concatenate([ring.on_fold for ring in placed])
    faces = np.concatenate([ring.faces + start for ring, start in zip(placed, starts, strict=False)])
    vertices, index = _weld_vertices(vertices, on_fold)
    faces = index[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    uv = np.concatenate([ring.uv[ring.faces] for ring in placed])[proper]
    faces, uv, source = heal(vertices, faces[proper], uv, PRECISION_M)
    number = np.repeat([ring.number for ring in placed], [len(ring.faces) for ring in placed]).astype(
        np.int32
    )
    provenance = np.concatenate([ring.provenance for ring in placed])
    return PanelModel(vertices, faces, number[proper][source], provenance[proper][source], uv)


@dataclass(frozen=True, slots=True, eq=False)
class _Rings:
    """The rings of a chart's faces, and where their corners lie on its traces."""

    chart: Arrangement
    uv: FloatArray  # (n, 2) corners of all rings, closed
    ring: NDArray[np.int64]  # (n,) of which ring
    face: NDArray[np.int64]  # (rings,) of which face, outer rings first in each
    on: tuple[FloatArray, ...]  # for each trace the parameter (n,) of each corner, nan off it

    @classmethod
    def of(cls, chart: Arrangement) -> _Rings:
        rings, face = shapely.get_rings(chart.faces, return_index=True)
        uv, ring = shapely.get_coordinates(rings, return_index=True)
        return cls(chart, uv, ring, face, tuple(_parameters(line, uv) for line in chart.tracks))


def _parameters(trace: Trace, uv: FloatArray) -> FloatArray:
    """The parameter of a trace (n,) at places (n, 2) of the chart; nan for those off it."""
    result = np.full(len(uv), np.nan)
    low, high = trace.uv.min(axis=0) - _ON_M, trace.uv.max(axis=0) + _ON_M
    near = np.flatnonzero(((uv >= low) & (uv <= high)).all(axis=1))
    line, points = trace.line, shapely.points(uv[near])
    on = shapely.dwithin(line, points, _ON_M)
    reached = shapely.line_locate_point(line, points[on])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(trace.uv, axis=0), axis=1))])
    result[near[on]] = np.interp(reached, lengths, trace.t)
    return result


def _merge_parameters(t: FloatArray) -> FloatArray:
    """Parameters in ascending order, those within .4 mm of one another as their first."""
    ordered = np.unique(t)
    kept: list[float] = []
    for value in ordered.tolist():
        if not kept or value - kept[-1] > SAME_NODE_M:
            kept.append(value)
    return np.array(kept)


@dataclass(frozen=True, slots=True, eq=False)
class _SurfaceTriangles:
    """The triangles of one surface."""

    number: int
    vertices: FloatArray  # (n, 3)
    uv: FloatArray  # (n, 2)
    on_fold: NDArray[np.bool_]  # (n,)
    faces: NDArray[np.int64]  # (m, 3)
    provenance: NDArray[np.int8]  # (m,)


def _triangulate(rings: _Rings, nodes: dict[int, FloatArray]) -> _SurfaceTriangles:
    """The faces of a chart as triangles, with all nodes of its folds."""
    chart, surface = rings.chart, rings.chart.sheet.surface
    uv, ring, where, t = _with_nodes(rings, nodes)
    polygons = _polygons(uv, ring, rings.face, len(chart.faces))
    triangles, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    known, first = np.unique(_keys(uv), axis=0, return_index=True)
    index = _find(known, _keys(corners.reshape(-1, 2))).reshape(-1, 3)
    (a, b), (c, d) = ((corners[:, k] - corners[:, 0]).T for k in (1, 2))
    turn = a * d - b * c
    inward = isinstance(surface, Cylinder) and surface.concave
    index[(turn < 0) != inward] = index[(turn < 0) != inward][:, ::-1]
    places = uv[first]
    vertices = surface.from_uv(places)
    for number, line in enumerate(chart.tracks):
        on = np.flatnonzero(where[first] == number)
        vertices[on] = line.curve.at(t[first][on])
    return _SurfaceTriangles(
        number=chart.sheet.number,
        vertices=vertices,
        uv=places,
        on_fold=where[first] >= 0,
        faces=index,
        provenance=chart.provenance[owner],
    )


def _with_nodes(
    rings: _Rings, nodes: dict[int, FloatArray]
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """The rings with the nodes of all folds that they run along.

    Corners (n, 2), their ring (n,), the trace (n,) that each is on, -1 for none, and its parameter (n,).
    """
    traces, uv, ring = rings.chart.tracks, rings.uv, rings.ring
    where, t = np.full(len(uv), -1), np.zeros(len(uv))
    added: list[tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray, int]] = []
    for number, (trace, on) in enumerate(zip(traces, rings.on, strict=True)):
        known = nodes[trace.key]
        here = np.flatnonzero(np.isfinite(on))
        nearest = _nearest(known, on[here])
        where[here], t[here] = number, known[nearest]
        edge = here[np.isin(here + 1, here)]
        edge = edge[ring[edge] == ring[np.minimum(edge + 1, len(ring) - 1)]]
        begin, end = _nearest(known, on[edge]), _nearest(known, on[edge + 1])
        middle = shapely.points((uv[edge] + uv[edge + 1]) / 2)
        direct = np.abs(on[edge + 1] - on[edge]) < 2 * np.linalg.norm(uv[edge + 1] - uv[edge], axis=1)
        along = direct & (np.abs(end - begin) > 1) & shapely.dwithin(trace.line, middle, 2 * _ON_M)
        for k, first, last in zip(edge[along], begin[along], end[along], strict=True):
            between = np.arange(first + 1, last) if first < last else np.arange(first - 1, last, -1)
            share = (known[between] - on[k]) / (on[k + 1] - on[k])
            place = uv[k] + share[:, None] * (uv[k + 1] - uv[k])
            added.append((np.full(len(between), k), share, place, known[between], number))
    if added:
        after, share = (np.concatenate([row[k] for row in added]) for k in (0, 1))
        order = np.lexsort((share, after))
        where = np.insert(
            where,
            after[order] + 1,
            np.repeat([row[4] for row in added], [len(row[0]) for row in added])[order],
        )
        t = np.insert(t, after[order] + 1, np.concatenate([row[3] for row in added])[order])
        uv = np.insert(uv, after[order] + 1, np.concatenate([row[2] for row in added])[order], axis=0)
        ring = np.insert(ring, after[order] + 1, ring[after[order]])
    return uv, ring, where, t


def _nearest(known: FloatArray, t: FloatArray) -> NDArray[np.int64]:
    """Which of ascending parameters is nearest to each."""
    if len(known) < 2:
        return np.zeros(len(t), np.int64)
    middle = (known[1:] + known[:-1]) / 2
    return np.asarray(np.searchsorted(middle, t), dtype=np.int64)


def _polygons(uv: FloatArray, ring: NDArray[np.int64], face: NDArray[np.int64], n_faces: int) -> NDArray[Any]:
    """The polygons (n,) of rings."""
    rings = shapely.linearrings(uv, indices=ring)
    first = np.searchsorted(face, np.arange(n_faces))
    holes = np.ones(len(rings), np.bool_)
    holes[first] = False
    if not holes.any():
        return np.asarray(shapely.polygons(rings[first]))
    ends = np.append(first[1:], len(rings))
    return np.array(
        [
            shapely.polygons(rings[a], holes=rings[a + 1 : b] if b > a + 1 else None)
            for a, b in zip(first, ends, strict=True)
        ],
        dtype=object,
    )


def _keys(uv: FloatArray) -> NDArray[np.int64]:
    """Whole numbers (n, 2) that tell the places (n, 2) of a chart apart."""
    return np.rint(uv * (1e3 / PRECISION_M)).astype(np.int64)


def _find(known: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """The row of sorted `known` (n, 2) that is equal to each `wanted` (m, 2)."""
    first, second = np.unique(known[:, 0]), np.unique(known[:, 1])  # ranks: whole numbers may be too large
    flat, asked = (
        np.searchsorted(first, rows[:, 0]) * len(second) + np.searchsorted(second, rows[:, 1])
        for rows in (known, wanted)
    )
    return np.asarray(np.searchsorted(flat, asked), dtype=np.int64)


def _weld_vertices(vertices: FloatArray, on_fold: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Vertices with those on folds that are within .6 mm of one another as one, and which each became."""
    fold = np.flatnonzero(on_fold)
    pairs = (
        cKDTree(vertices[fold]).query_pairs(SAME_VERTEX_M, output_type="ndarray")
        if len(fold)
        else np.zeros((0, 2), int)
    )
    n = len(vertices)
    graph = coo_array((np.ones(len(pairs)), (fold[pairs[:, 0]], fold[pairs[:, 1]])), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    _, first, index = np.unique(label, return_index=True, return_inverse=True)
    return vertices[first], index
