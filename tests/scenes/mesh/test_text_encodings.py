# SPDX-License-Identifier: MIT
"""Text formats with names that are no UTF-8: geometry and materials are read, whatever the encoding."""

from pathlib import Path

import numpy as np
import pytest

from scenes.io.scene_files import load_scene
from tests.helpers.data_paths import data_path, requires_data

CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
SIDES = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 3 0 0\nvertex 0 2 0\nendloop\nendfacet\n"
NAMES = [
    ("Größe", "latin-1"),
    ("Größe", "utf-8-sig"),
    ("Étage à façade", "cp1252"),
    ("ソ", "cp932"),  # ends in the byte of a backslash
    ("стена", "koi8-r"),
]


@requires_data
def test_a_reported_obj() -> None:
    mesh = load_scene(data_path("reported/latin1_obj_stl/o2_latin1.obj")).mesh
    assert len(mesh.faces) == 12
    assert mesh.face_areas().sum() == pytest.approx(28.0)


@pytest.mark.parametrize(("name", "encoding"), NAMES)
def test_obj_with_materials(tmp_path: Path, name: str, encoding: str) -> None:
    text = f"# {name}\nmtllib a.mtl\no {name}\n{CUBE}usemtl {name}\n{SIDES}"
    (tmp_path / "a.obj").write_bytes(text.encode(encoding))
    (tmp_path / "a.mtl").write_bytes(f"newmtl {name}\nKd 1 0 0\n".encode(encoding))
    scene = load_scene(tmp_path / "a.obj")
    assert len(scene.mesh.faces) == 12
    assert scene.mesh.face_areas().sum() == pytest.approx(6.0)
    assert not any("material" in text for text in scene.warnings)
    assert scene.mesh.appearance is not None
    seen = scene.mesh.appearance.colour(np.array([0], np.int32), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(seen[0], [1, 0, 0], atol=0.01)


def test_a_byte_order_mark_hides_no_vertex(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes((CUBE + SIDES).encode("utf-8-sig"))
    assert len(load_scene(tmp_path / "a.obj").mesh.faces) == 12


@pytest.mark.parametrize(("name", "encoding"), NAMES)
def test_stl_text(tmp_path: Path, name: str, encoding: str) -> None:
    text = f"solid {name}\n{FACET}endsolid {name}\n"
    (tmp_path / "a.stl").write_bytes(text.encode(encoding.removesuffix("-sig")))
    assert load_scene(tmp_path / "a.stl").mesh.face_areas().sum() == pytest.approx(3.0)


@pytest.mark.parametrize(("name", "encoding"), NAMES)
def test_ply_comments(tmp_path: Path, name: str, encoding: str) -> None:
    head = f"ply\nformat ascii 1.0\ncomment {name}\nelement vertex 3\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    rows = (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n3 0 0\n0 2 0\n3 0 1 2\n"
    )
    (tmp_path / "a.ply").write_bytes((head + rows).encode(encoding.removesuffix("-sig")))
    assert load_scene(tmp_path / "a.ply").mesh.face_areas().sum() == pytest.approx(3.0)
