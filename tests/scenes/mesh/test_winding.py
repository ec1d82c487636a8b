# SPDX-License-Identifier: MIT
"""Winding: what is inside out is turned, cavities and open components stay."""

import numpy as np
import pytest

from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.mesh.winding import turn_outside_out

CORNERS = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 1.0) for z in (0, 1.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
FAR = np.array([5e5, 5.6e6, 100.0])


def joined(*cubes, labels=None):
    """Cubes (shift, size, faces) as one mesh, each with corners of its own, and their labels."""
    vertices = np.vstack([shift + size * CORNERS for shift, size, _ in cubes])
    faces = np.vstack([faces + 8 * k for k, (_, _, faces) in enumerate(cubes)])
    numbers = range(len(cubes)) if labels is None else labels
    label = np.repeat(numbers, [len(faces) for _, _, faces in cubes])
    return LabelledMesh(vertices, faces, label), label


def volume(mesh):
    a, b, c = np.moveaxis(mesh.corners - mesh.vertices[0], 1, 0)
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def one_turned(k):
    faces = CUBE.copy()
    faces[k] = faces[k, ::-1]
    return faces


@pytest.mark.parametrize("faces", [CUBE, CUBE[:, ::-1], one_turned([3]), one_turned([0, 2, 5, 7, 8, 11])])
@pytest.mark.parametrize("at", [0.0, FAR])
def test_a_closed_component_has_its_outside_outside(faces, at):
    mesh, body = joined((at, 1.0, faces))
    turned = turn_outside_out(mesh, body)
    assert volume(turned.mesh) == pytest.approx(1.0)
    assert (turned.n_components, turned.n_open) == (int(not np.array_equal(faces, CUBE)), 0)
    assert turn_outside_out(turned.mesh, body).n_components == 0


def test_corners_that_are_no_shared_vertices_are_joined_by_their_places():
    soup = LabelledMesh(CORNERS[CUBE[:, ::-1].ravel()], np.arange(36).reshape(-1, 3))
    assert volume(turn_outside_out(soup, soup.face_surface).mesh) == pytest.approx(1.0)


def test_a_cavity_stays_a_cavity_and_one_beside_is_turned():
    inward = CUBE[:, ::-1]
    mesh, body = joined((0.0, 1.0, CUBE), (0.25, 0.5, inward), (3.0, 1.0, inward), labels=[0, 0, 0])
    turned = turn_outside_out(mesh, body)
    assert turned.n_components == 1
    assert volume(turned.mesh) == pytest.approx(1 - 0.125 + 1)
    apart, body = joined((0.0, 1.0, CUBE), (0.25, 0.5, inward))
    assert volume(turn_outside_out(apart, body).mesh) == pytest.approx(1.125)  # bodies of their own


def test_bodies_that_touch_are_turned_each():
    mesh, body = joined((0.0, 1.0, CUBE[:, ::-1]), (np.array([1.0, 0, 0]), 1.0, CUBE))
    turned = turn_outside_out(mesh, body)
    assert (turned.n_components, turned.n_surfaces, turned.n_open) == (1, 1, 0)
    assert volume(turned.mesh) == pytest.approx(2.0)


def test_what_is_open_stays_and_is_counted():
    mesh, body = joined((0.0, 1.0, CUBE[1:, ::-1]), (2.0, 1.0, CUBE))
    turned = turn_outside_out(mesh, body)
    assert (turned.n_components, turned.n_open) == (0, 1)
    assert np.array_equal(turned.mesh.faces, mesh.faces)


def test_colours_and_texture_coordinates_go_with_their_corners():
    shades = np.broadcast_to(np.linspace(0, 1, 8)[:, None], (8, 3)).astype(np.float32)
    faces = CUBE[:, ::-1]
    image = np.zeros((2, 2, 3), np.uint8)
    uv = np.stack([shades[faces][..., 0]] * 2, axis=-1)
    look = Appearance(shades[faces], (image,), np.zeros(12, np.int32), uv)
    mesh = turn_outside_out(LabelledMesh(CORNERS, faces, appearance=look), np.zeros(12, int)).mesh
    assert np.array_equal(mesh.appearance.corner_colour, shades[mesh.faces])
    assert np.array_equal(mesh.appearance.corner_uv[..., 0], shades[mesh.faces][..., 0])
