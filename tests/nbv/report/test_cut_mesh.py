# SPDX-License-Identifier: MIT
"""Cut mesh: areas and sides of what is left below a level plane, against closed forms."""

import numpy as np
import pytest

from nbv.report.figures.surface_values import below
from scenes.mesh.labelled_mesh import LabelledMesh
from tests.helpers.buildings import Building

BOX = Building()
BOX.box("box", (0, 0, 0), (2, 3, 4))
MESH = BOX.scene().mesh


@pytest.mark.parametrize("height", [0.5, 1.0, 3.999])
def test_a_box_keeps_its_bottom_and_the_lower_part_of_its_sides(height):
    cut, source = below(MESH, height)
    assert cut.face_areas().sum() == pytest.approx(2 * 3 + 2 * (2 + 3) * height)
    assert cut.vertices[:, 2].max() == pytest.approx(height)
    assert cut.face_normals() == pytest.approx(MESH.face_normals()[source])


def test_above_all_nothing_is_cut_and_below_all_nothing_is_left():
    cut, source = below(MESH, 5.0)
    assert source.tolist() == list(range(12))
    assert cut.face_areas() == pytest.approx(MESH.face_areas())
    assert len(below(MESH, -1.0)[1]) == 0


def test_random_triangles_part_into_what_lies_below_and_above():
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(90, 3))
    mesh = LabelledMesh(vertices, np.arange(90, dtype=np.int32).reshape(-1, 3))
    upside = LabelledMesh(vertices * [1, 1, -1], mesh.faces)
    for height in (-0.4, 0.0, 0.7):
        one, other = below(mesh, height), below(upside, -height)
        areas = np.bincount(one[1], one[0].face_areas(), 30) + np.bincount(
            other[1], other[0].face_areas(), 30
        )
        assert areas == pytest.approx(mesh.face_areas())
