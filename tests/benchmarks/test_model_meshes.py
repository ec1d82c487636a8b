# SPDX-License-Identifier: MIT
"""Meshes of CAD models: the truth that they come with, and what counts as found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.cases.models import FORMATS, ModelMesh, model_mesh
from benchmarks.suites.model_meshes import faces_found
from completion.parts.division.meshes import segment_mesh
from completion.parts.division.result import PartSegmentation
from scenes.io.point_files import read_part_file
from scenes.mesh.labelled_mesh import LabelledMesh


@pytest.fixture
def box() -> ModelMesh:
    """A box of 12 triangles: its sides are faces 0 to 5."""
    corners = np.array(np.meshgrid([0, 40], [0, 30], [0, 20], indexing="ij")).reshape(3, -1).T
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([[a, b, c] for side in sides for a, b, c in (side[:3], (side[0], *side[2:]))])
    return ModelMesh(corners[triangles].astype(np.float64), np.repeat(np.arange(6), 2), ("plane",) * 6, 24e3)


def _divided(model: ModelMesh) -> PartSegmentation:
    points = model.corners.reshape(-1, 3) * 1e-3
    faces = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
    return segment_mesh(LabelledMesh(points, faces, np.zeros(len(faces), np.int32)))


def test_a_face_counts_once_and_by_its_kind(box: ModelMesh) -> None:
    part = _divided(box)
    assert faces_found(box, part) == (6, 6, [])
    swapped = replace(box, kinds=("cylinder", *box.kinds[1:]))
    found, right, faults = faces_found(swapped, part)
    assert (found, right) == (6, 5)
    assert faults == ["face 0 (cylinder, 2 triangles, 600 mm2) is a plane"]
    halved = replace(part, triangle_labels=np.where(np.arange(12) == 0, 0, part.triangle_labels))
    assert faces_found(box, halved)[:2] == (5, 5)  # half of a side is not the side


@pytest.mark.parametrize("format_", FORMATS)
def test_all_formats_keep_the_triangles(box: ModelMesh, tmp_path: Path, format_: str) -> None:
    read = read_part_file(box.write(tmp_path, "box", format_), "mm").mesh
    assert read is not None
    assert np.allclose(read.vertices[read.faces] * 1e3, box.corners, atol=1e-4)


def test_the_kernel_knows_faces_and_volume() -> None:
    pytest.importorskip("OCP", reason="the geometry kernel is not installed")
    model = model_mesh("bent sheet", "middle", 1)
    assert sorted(model.kinds) == 7 * ["cylinder"] + 10 * ["plane"]
    a, b, c = model.corners.transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(model.volume_mm3, rel=5e-3)
    assert model_mesh("bent sheet", "middle", 1).corners.tobytes() == model.corners.tobytes()
