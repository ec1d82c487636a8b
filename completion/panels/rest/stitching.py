# SPDX-License-Identifier: MIT
"""Stitching: the rim of the rest takes the nodes of the panels' borders, and gives them its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from completion.panels.healing import edges_of
from completion.panels.model import PanelModel
from completion.panels.rest.border import Border
from completion.panels.rest.division import Chain, divided
from scenes.checks import FloatArray

_SAME = 0.25  # of the reach, within which places on a border are one node


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
    apart = _SAME * reach_m[owner[on] - 1]
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
    faces, source = divided(panels.faces, chains)
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
    panels: PanelModel, rest: NDArray[np.int64], vertices: FloatArray, slack_m: float
) -> NDArray[np.int64]:
    """Let the triangles (m, 3) of the rest follow the panels' borders where two of their corners are on them.

    An open edge of the rest between two nodes becomes the way along the border between them, if that is
    longer by a slack at most and turns no triangle over. `vertices` (n, 3), metres, are those of both.
    """
    edges, count, owner = edges_of(rest)
    near = _neighbours(vertices, Border.of(panels).edges)
    chains: dict[tuple[int, int], Chain] = {}
    for (a, b), face in zip(edges[count == 1].tolist(), owner[count == 1].tolist(), strict=True):
        if a not in near or b not in near or any(b == other for other, _ in near[a]):
            continue
        chain = _way(near, a, b, float(np.linalg.norm(vertices[b] - vertices[a])) + slack_m)
        if len(chain) > 2 and not _turns_over(vertices, rest[face], chain):
            chains[a, b] = chain
    found, _ = divided(rest, chains)
    return found


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
