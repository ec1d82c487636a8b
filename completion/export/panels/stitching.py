# SPDX-License-Identifier: MIT
"""Stitching: the rim of the rest takes the nodes of the panels' borders, and gives them its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.export.panels.limits import SAME_PLACE
from completion.export.panels.model import PanelModel
from completion.export.panels.welding import edges_of
from scenes.checks import FloatArray

_TRIED = 6  # samples of the border around a point whose edges are tried


@dataclass(frozen=True, slots=True, eq=False)
class BorderPlaces:
    """The places on a border that are nearest to n points.

    Attributes
    ----------
    edge : (n,) int
        Which edge each is on; -1 where the border is out of reach.
    share : (n,) float
        How far along it, 0 at its first vertex and 1 at its second.
    """

    edge: NDArray[np.int64]
    share: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """The edges of measured facets beside which their surface was not measured: at holes, folds, shadows.

    Attributes
    ----------
    vertices : (n, 3) float
        Of the light model.
    edges : (m, 2) int
        Vertices of each edge, once for every surface whose border it is.
    surface : (m,) int
        Number of that surface.
    """

    vertices: FloatArray
    edges: NDArray[np.int64]
    surface: NDArray[np.int64]

    @classmethod
    def of(cls, panels: PanelModel) -> Border:
        """Return the border of all surfaces of a light model."""
        edges, surface = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
        measured = panels.is_measured
        for number in np.unique(panels.face_surface[measured]).tolist():
            border, count, _ = edges_of(panels.faces[measured & (panels.face_surface == number)])
            edges.append(border[count == 1])
            surface.append(np.full(np.count_nonzero(count == 1), number))
        return cls(panels.vertices, np.concatenate(edges), np.concatenate(surface))

    def nearest(self, points: FloatArray, owner: NDArray[np.int64], reach_m: FloatArray) -> BorderPlaces:
        """Return the places on the borders of the points' owners that are nearest to points (n, 3).

        `owner` (n,) are numbers of surfaces, 0 for none; `reach_m` (surfaces,) how far away it may be.
        """
        result = BorderPlaces(np.full(len(points), -1, np.int64), np.zeros(len(points)))
        for number in np.unique(owner[owner > 0]).tolist():
            asked, surface_faces = np.flatnonzero(owner == number), np.flatnonzero(self.surface == number)
            if not len(surface_faces):
                continue
            edge, share, off = self._nearest(points[asked], surface_faces, float(reach_m[number - 1]))
            near = off <= reach_m[number - 1]
            result.edge[asked[near]], result.share[asked[near]] = edge[near], share[near]
        return result

    def _nearest(
        self, points: FloatArray, members: NDArray[np.int64], spacing_m: float
    ) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """The nearest of some edges to points (n, 3), how far along it (n,), and how far off (n,), metres."""
        begin, way = (
            self.vertices[self.edges[members, 0]],
            np.diff(self.vertices[self.edges[members]], axis=1)[:, 0],
        )
        n_pieces = np.ceil(np.linalg.norm(way, axis=1) / spacing_m).astype(np.int64) + 1
        of = np.repeat(np.arange(len(members)), n_pieces)
        step = np.arange(len(of)) - np.repeat(np.cumsum(n_pieces) - n_pieces, n_pieces)
        samples = begin[of] + (step / np.maximum(n_pieces[of] - 1, 1))[:, None] * way[of]
        k = min(_TRIED, len(samples))
        tried = of[cKDTree(samples).query(points, k=k)[1].reshape(len(points), k)]
        length = np.maximum((way * way).sum(axis=1), 1e-18)
        share = ((points[:, None] - begin[tried]) * way[tried]).sum(axis=2) / length[tried]
        share = np.clip(share, 0.0, 1.0)
        off = np.linalg.norm(begin[tried] + share[..., None] * way[tried] - points[:, None], axis=2)
        row, best = np.arange(len(points)), off.argmin(axis=1)
        return members[tried[row, best]], share[row, best], off[row, best]

    def at(self, place: BorderPlaces) -> FloatArray:
        """Return the points (k, 3) of those places that are within reach."""
        on = place.edge >= 0
        begin, end = (self.vertices[self.edges[place.edge[on], k]] for k in (0, 1))
        return np.asarray(begin + place.share[on, None] * (end - begin), dtype=np.float64)


Chain = tuple[int, ...]
"""The vertices that replace an edge, its ends among them."""
_Corners = tuple[int, int, int]


def divide_triangles(
    faces: NDArray[np.int64], chains: Mapping[tuple[int, int], Chain]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide triangles (m, 3) whose edges are given with the chains that replace them, as fans.

    Edges are their two vertices in ascending order, chains lead from the first to the second. Returns the
    triangles (k, 3) and which of those given each comes from (k,).
    """
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
    n = int(faces.max(initial=0)) + 1
    known = np.array([a * n + b for a, b in chains if max(a, b) < n], np.int64)
    touched = np.isin(ends[..., 0] * n + ends[..., 1], known).any(axis=1)
    fans = [list(_fan(tuple(faces[k].tolist()), chains)) for k in np.flatnonzero(touched)]
    new = np.array([numbers for fan in fans for numbers in fan], np.int64).reshape(-1, 3)
    source = np.repeat(np.flatnonzero(touched), [len(fan) for fan in fans])
    return np.concatenate([faces[~touched], new]), np.concatenate([np.flatnonzero(~touched), source])


def _fan(corner: _Corners, chains: Mapping[tuple[int, int], Chain]) -> Iterator[_Corners]:
    """The triangles of one that is divided at all of its edges that have chains."""
    pending = [(corner, (True, True, True))]
    while pending:
        corner, is_own = pending.pop()
        at = next((k for k in range(3) if is_own[k] and edge_key(corner, k) in chains), -1)
        if at < 0:
            yield corner
            continue
        chain = chains[edge_key(corner, at)]
        links = chain if chain[0] == corner[at] else chain[::-1]
        apex, last = corner[(at + 2) % 3], len(links) - 2
        for k in range(last + 1):  # of the sides of the apex only the outer two were there before
            flags = (False, is_own[(at + 1) % 3] and k == last, is_own[(at + 2) % 3] and k == 0)
            pending.append(((links[k], links[k + 1], apex), flags))


def edge_key(corner: _Corners, k: int) -> tuple[int, int]:
    """Return the edge from the k-th corner of a triangle, its vertices in ascending order."""
    first, second = corner[k], corner[(k + 1) % 3]
    return (first, second) if first < second else (second, first)


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """The light model with further nodes on its borders.

    Attributes
    ----------
    panels : PanelModel
        With the nodes after its own vertices, and its facets divided at them.
    vertex : (n,) int
        For each point asked for, the vertex it became; -1 for none.
    """

    panels: PanelModel
    vertex: NDArray[np.int64]


def with_nodes(
    panels: PanelModel, points: FloatArray, owner: NDArray[np.int64], reach_m: FloatArray
) -> Nodes:
    """Put nodes on the panels' borders at the places nearest to points (n, 3) of their owners (n,), 0 none.

    `reach_m` (surfaces,) is how far away these may be. Places within a quarter of it are one node, and none
    is that near to a vertex. All facets that have a border's edge are divided at its nodes.
    """
    border = Border.of(panels)
    place = border.nearest(points, owner, reach_m)
    vertex = np.full(len(points), -1, np.int64)
    on = np.flatnonzero(place.edge >= 0)
    ends = border.edges[place.edge[on]]
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    begin, end = panels.vertices[ends[:, 0]], panels.vertices[ends[:, 1]]
    length = np.linalg.norm(end - begin, axis=1)
    along = place.share[on] * length
    apart = SAME_PLACE * reach_m[owner[on] - 1]
    first, second = along <= apart, along >= length - apart
    nearer = np.where(along < length / 2, ends[:, 0], ends[:, 1])
    vertex[on[first | second]] = nearer[first | second]
    chains: dict[tuple[int, int], Chain] = {}
    places: list[FloatArray] = []
    within = np.flatnonzero(~first & ~second)
    last, at = (-1, 0.0), -1
    for k in within[np.lexsort((along[within], edge.ravel()[within]))].tolist():
        key = (int(ends[k, 0]), int(ends[k, 1]))
        if edge.ravel()[k] != last[0] or along[k] - last[1] > apart[k]:
            last, at = (int(edge.ravel()[k]), float(along[k])), len(panels.vertices) + len(places)
            places.append(begin[k] + place.share[on[k]] * (end[k] - begin[k]))
            chains[key] = (*chains.get(key, (key[0],)), at)
        vertex[on[k]] = at
    closed = {key: (*chain, key[1]) for key, chain in chains.items()}
    return Nodes(_divided_panels(panels, np.array(places).reshape(-1, 3), closed), vertex)


def _divided_panels(
    panels: PanelModel, places: FloatArray, chains: Mapping[tuple[int, int], Chain]
) -> PanelModel:
    """Panels with places (k, 3) as further vertices, divided by chains of them."""
    vertices = np.concatenate([panels.vertices, places])
    faces, source = divide_triangles(panels.faces, chains)
    corners = panels.vertices[panels.faces[source]]
    sides = corners[:, 1:] - corners[:, :1]
    gram = np.einsum("nid,njd->nij", sides, sides)
    offset = np.einsum("nid,nkd->nik", sides, vertices[faces] - corners[:, :1])
    share = np.linalg.pinv(gram, hermitian=True) @ offset
    uv = panels.corner_uv[source]
    return replace(
        panels,
        vertices=vertices,
        faces=faces,
        face_surface=panels.face_surface[source],
        face_provenance=panels.face_provenance[source],
        corner_uv=uv[:, :1] + np.einsum("nik,nic->nkc", share, uv[:, 1:] - uv[:, :1]),
    )


def along_border(
    panels: PanelModel, faces: NDArray[np.int64], vertices: FloatArray, slack_m: float
) -> NDArray[np.int64]:
    """Let the triangles (m, 3) of the rest follow the panels' borders where two of their corners are on them.

    An open edge of the rest between two nodes becomes the way along the border between them, if that is
    longer by a slack at most and turns no triangle over. `vertices` (n, 3), metres, are those of both.
    """
    edges, count, owner = edges_of(faces)
    near = _neighbours(vertices, Border.of(panels).edges)
    chains: dict[tuple[int, int], Chain] = {}
    for (a, b), face in zip(edges[count == 1].tolist(), owner[count == 1].tolist(), strict=True):
        if a not in near or b not in near or any(b == other for other, _ in near[a]):
            continue
        chain = _way(near, a, b, float(np.linalg.norm(vertices[b] - vertices[a])) + slack_m)
        if len(chain) > 2 and not _turns_over(vertices, faces[face], chain):
            chains[a, b] = chain
    pieces_along, _ = divide_triangles(faces, chains)
    return pieces_along


def _neighbours(vertices: FloatArray, edges: NDArray[np.int64]) -> dict[int, list[tuple[int, float]]]:
    """The neighbours of each vertex along edges (n, 2), and how far away they are, metres."""
    near: dict[int, list[tuple[int, float]]] = {}
    edges = np.unique(edges, axis=0)
    length = np.linalg.norm(vertices[edges[:, 1]] - vertices[edges[:, 0]], axis=1)
    for (a, b), metres in zip(edges.tolist(), length.tolist(), strict=True):
        near.setdefault(a, []).append((b, metres))
        near.setdefault(b, []).append((a, metres))
    return near


def _way(near: Mapping[int, Sequence[tuple[int, float]]], begin: int, end: int, most_m: float) -> Chain:
    """The shortest way between two vertices (Dijkstra 1959), none if it is longer than asked for."""
    before: dict[int, int] = {}
    queue = [(0.0, begin, begin)]
    while queue:
        metres, vertex, came = heappop(queue)
        if vertex in before:
            continue
        before[vertex] = came
        if vertex == end:
            chain = [end]
            while chain[-1] != begin:
                chain.append(before[chain[-1]])
            return tuple(chain[::-1])
        for other, step in near[vertex]:
            if other not in before and metres + step <= most_m:
                heappush(queue, (metres + step, other, vertex))
    return ()


def _turns_over(vertices: FloatArray, face: NDArray[np.int64], chain: Chain) -> bool:
    """Whether a triangle that is divided along a chain would have parts that face the other way."""
    corner = face.tolist()
    at = next(k for k in range(3) if {corner[k], corner[(k + 1) % 3]} == {chain[0], chain[-1]})
    links = np.array(chain if corner[at] == chain[0] else chain[::-1])
    apex = vertices[corner[(at + 2) % 3]]
    first, second, third = vertices[face]
    whole = np.cross(second - first, third - first)
    parts = np.cross(vertices[links[1:]] - vertices[links[:-1]], apex - vertices[links[:-1]])
    return bool((parts @ whole < 0).any())
