# SPDX-License-Identifier: MIT
"""Meshes made from models and meshes of scans are divided into faces."""

import numpy as np
import pytest
import trimesh

from completion.parts.division.meshes import segment_mesh
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh


def labelled(mesh) -> LabelledMesh:
    return LabelledMesh(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int32))


def test_a_box_of_twelve_triangles_has_six_faces():
    found = segment_mesh(labelled(trimesh.creation.box((0.1, 0.06, 0.03))))
    assert [fit.surface.kind for fit in found.fits] == ["plane"] * 6
    assert found.triangle_labels is not None
    assert np.bincount(found.triangle_labels).tolist() == [0] + [2] * 6
    assert len(found.labels) == 8
    assert (found.labels > 0).all()


@pytest.mark.long
def test_a_cylinder_of_flat_triangles_is_a_cylinder():
    found = segment_mesh(labelled(trimesh.creation.cylinder(0.02, 0.08, sections=64)))
    assert sorted(fit.surface.kind for fit in found.fits) == ["cylinder", "plane", "plane"]
    (round_one,) = (fit for fit in found.fits if fit.surface.kind == "cylinder")
    assert round_one.surface.radius == pytest.approx(0.02, rel=1e-9)  # by its vertices
    assert found.triangle_labels is not None
    assert (found.triangle_labels > 0).all()


def test_a_scanned_mesh_is_its_vertices():
    grid = np.stack(np.meshgrid(np.arange(40), np.arange(30), indexing="ij"), -1).reshape(-1, 2) * 2e-3
    height = 1e-4 * np.random.default_rng(0).normal(size=len(grid))
    bend = np.maximum(grid[:, 0] - 0.04, 0.0)
    vertices = np.column_stack([grid[:, 0], grid[:, 1], bend + height])
    corner = (np.arange(39)[:, None] * 30 + np.arange(29)).ravel()
    faces = np.vstack([np.column_stack([corner, corner + 30, corner + 1]),
                       np.column_stack([corner + 1, corner + 30, corner + 31])])  # fmt: skip
    found = segment_mesh(LabelledMesh(vertices, faces.astype(np.int32)))
    assert [fit.surface.kind for fit in found.fits] == ["plane", "plane"]
    truth = np.where(grid[:, 0] < 0.04, 1, 2)
    alike = [np.mean((found.labels == one) == (truth == 1)) for one in (1, 2)]
    assert max(alike) > 0.95


def test_meshes_without_area_are_refused():
    flat = LabelledMesh(np.zeros((3, 3)), np.array([[0, 1, 2]], dtype=np.int32))
    with pytest.raises(InputError, match="none of the 1 triangles has an area"):
        segment_mesh(flat)
