# SPDX-License-Identifier: MIT
"""Healing: vertices within open edges divide the triangles there, and nothing else changes."""

import numpy as np

from completion.export.panels.welding import edges_of, heal, vertices_within_edges

VERTICES = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.3, 0, 0], [0.6, 0, 0], [0.5, -1, 0]], float
)
FACES = np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5]])  # the third touches the first in a part of its side


def uv_of(faces):
    return VERTICES[faces][..., :2].copy()


def test_edges_are_counted():
    edges, count, owner = edges_of(FACES)
    assert len(edges) == 8
    assert edges[count == 2].tolist() == [[0, 2]]
    assert set(owner[count == 1]) == {0, 1, 2}


def test_a_vertex_within_an_edge_is_found():
    (found,) = vertices_within_edges(VERTICES, FACES, 1e-4)
    assert found[:3] == (0, 1, 0)
    assert found[3].tolist() == [4, 5]


def test_triangles_are_divided_where_they_are_touched():
    faces, uv, source = heal(VERTICES, FACES, uv_of(FACES), 1e-4)
    assert vertices_within_edges(VERTICES, faces, 1e-4) == []
    assert np.bincount(source).tolist() == [3, 1, 1]
    assert np.allclose(uv, uv_of(faces))
    assert area(faces) == area(FACES)
    normals = np.cross(
        VERTICES[faces[:, 1]] - VERTICES[faces[:, 0]], VERTICES[faces[:, 2]] - VERTICES[faces[:, 0]]
    )
    assert (normals[:, 2] > 0).all()


def test_what_is_whole_stays_as_it_is():
    faces, _, source = heal(VERTICES, FACES[:2], uv_of(FACES[:2]), 1e-4)
    assert faces.tolist() == FACES[:2].tolist()
    assert source.tolist() == [0, 1]


def area(faces):
    sides = VERTICES[faces]
    return round(
        float(np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1).sum()), 9
    )
