# SPDX-License-Identifier: MIT
"""Holes of meshes: closed on the plane or cylinder around them, and left with the reason elsewhere."""

import numpy as np
import pytest
import trimesh

from completion.parts.closing import close_holes
from completion.parts.pipeline import model_part
from scenes.mesh.labelled_mesh import LabelledMesh


def labelled(mesh):
    return LabelledMesh(mesh.vertices, mesh.faces, np.zeros(len(mesh.faces), np.int32))


def without(mesh, gone):
    mesh.update_faces(~gone)
    mesh.remove_unreferenced_vertices()
    return mesh


def as_trimesh(closed):
    return trimesh.Trimesh(closed.points, closed.faces, process=False)


@pytest.fixture(scope="module")
def box():
    """A box of 40 x 30 x 20 mm with a hole in its top, another across an edge."""
    mesh = trimesh.creation.box((0.04, 0.03, 0.02)).subdivide_to_size(0.002)
    middle = mesh.triangles_center
    top = (middle[:, 2] > 0.0099) & (np.hypot(*middle[:, :2].T) < 0.006)
    edge = np.linalg.norm(middle - [0.02, 0, -0.01], axis=1) < 0.005
    return close_holes(model_part(labelled(without(mesh, top | edge))))


def test_a_hole_in_a_plane_is_closed_and_marked(box):
    assert (box.n_holes, box.n_closed, box.left) == (2, 1, {"several": 1})
    added = box.faces[box.is_inferred]
    assert box.points[added][:, :, 2] == pytest.approx(0.01)
    assert len(set(box.surface[box.is_inferred].tolist())) == 1
    whole = as_trimesh(box)
    assert whole.is_winding_consistent
    assert whole.face_normals[box.is_inferred][:, 2] == pytest.approx(1.0)
    assert "1 of 2 borders of the mesh were closed" in box.told
    assert "nothing vetoes it" in box.told
    assert "1 border on several surfaces" in box.told


def soup(mesh):
    """The mesh as an STL has it: no triangle shares a corner with another."""
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    return LabelledMesh(points, np.arange(len(points)).reshape(-1, 3), np.zeros(len(mesh.faces), np.int32))


def test_triangles_that_share_no_corners_have_the_borders_of_their_mesh():
    mesh = trimesh.creation.box((0.04, 0.03, 0.02)).subdivide_to_size(0.004)
    assert close_holes(model_part(soup(mesh))) is None
    top = (mesh.triangles_center[:, 2] > 0.0099) & (np.hypot(*mesh.triangles_center[:, :2].T) < 0.006)
    closed = close_holes(model_part(soup(without(mesh, top))))
    assert (closed.n_holes, closed.n_closed, closed.left) == (1, 1, {})
    assert as_trimesh(closed).volume == pytest.approx(0.04 * 0.03 * 0.02)


def tube(radius, height, n):
    """A tube about z without ends, seen from outside."""
    angle, level = np.arange(n) * 2 * np.pi / n, np.linspace(0, height, n // 2)
    around, up = (one.ravel() for one in np.meshgrid(angle, level))
    points = np.column_stack([radius * np.cos(around), radius * np.sin(around), up])
    first = np.arange(n * (len(level) - 1))
    right = first // n * n + (first + 1) % n
    faces = np.concatenate(
        [np.stack([first, right, right + n], 1), np.stack([first, right + n, first + n], 1)]
    )
    return trimesh.Trimesh(points, faces, process=False)


@pytest.mark.parametrize("inside_out", [False, True])
def test_a_hole_in_a_cylinder_is_closed_round(inside_out):
    mesh = tube(0.01, 0.03, 64)
    gone = np.linalg.norm(mesh.triangles_center - [0.01, 0, 0.015], axis=1) < 0.006
    part = without(mesh, gone)
    if inside_out:
        part.invert()
    closed = close_holes(model_part(labelled(part)))
    assert (closed.n_holes, closed.n_closed, closed.left) == (3, 1, {"outside": 2})
    inner = closed.points[len(part.vertices) :]
    assert len(inner) > 20
    assert np.hypot(*inner[:, :2].T) == pytest.approx(0.01, rel=1e-3)
    assert closed.inferred_m2 == pytest.approx(float(tube(0.01, 0.03, 64).area - part.area), rel=0.02)
    assert as_trimesh(closed).is_winding_consistent


def test_the_end_of_a_sheet_is_no_hole():
    sheet = trimesh.creation.box((0.04, 0.03, 0.02)).subdivide_to_size(0.002)
    closed = close_holes(model_part(labelled(without(sheet, sheet.triangles_center[:, 2] < 0.0099))))
    assert (closed.n_closed, closed.left) == (0, {"outside": 1})
    assert not closed.is_inferred.any()
    assert closed.inferred_m2 == 0


@pytest.mark.long
def test_a_whole_mesh_and_points_have_nothing_to_close():
    mesh = trimesh.creation.box((0.04, 0.03, 0.02)).subdivide_to_size(0.002)
    assert close_holes(model_part(labelled(mesh))) is None
    points, _ = trimesh.sample.sample_surface(mesh, 4000, seed=0)
    assert close_holes(model_part(np.asarray(points))) is None
