# SPDX-License-Identifier: MIT
"""Healing: open edges are divided at the open vertices that lie within them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from scenes.checks import FloatArray

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
    found = []
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
            found.append((first, second, int(owner[is_open[k]]), candidates[on][order]))
    return found


def heal(
    vertices: FloatArray, faces: NDArray[np.int64], corner_uv: FloatArray, slack_m: float
) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Divide triangles (m, 3) at the vertices (n, 3) that lie within their open edges, to a slack in metres.

    `corner_uv` is (m, 3, 2). Returns the triangles (k, 3), the chart coordinates (k, 3, 2) of their corners,
    and which of those given each comes from (k,).
    """
    source = np.arange(len(faces))
    for _ in range(_ROUNDS):
        found: dict[int, tuple[int, int, int, NDArray[np.int64]]] = {}
        for one in vertices_within_edges(vertices, faces, slack_m):
            found.setdefault(one[2], one)  # one edge of a triangle at a time
        if not found:
            break
        new_faces, new_uv, new_source = [], [], []
        for first, second, face, between in found.values():
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
        kept[list(found)] = False
        faces = np.concatenate([faces[kept], np.array(new_faces, np.int64)])
        corner_uv = np.concatenate([corner_uv[kept], np.array(new_uv)])
        source = np.concatenate([source[kept], np.array(new_source, np.int64)])
    return faces, corner_uv, source
