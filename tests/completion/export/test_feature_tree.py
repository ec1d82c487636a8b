# SPDX-License-Identifier: MIT
"""Features in STEP: a tree of named products beside one body, read back; gaps in a mesh, closed and told."""

import re

import numpy as np
import pytest
import trimesh

from tests.helpers.step_examples import needs_kernel, read_back

needs_kernel()

from OCP.collections import Sequence_TDF_Label  # noqa: E402
from OCP.Interface import Interface_Static  # noqa: E402
from OCP.STEPCAFControl import STEPCAFControl_Reader  # noqa: E402
from OCP.TCollection import TCollection_ExtendedString  # noqa: E402
from OCP.TDataStd import TDataStd_Name  # noqa: E402
from OCP.TDF import TDF_Label  # noqa: E402
from OCP.TDocStd import TDocStd_Document  # noqa: E402
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool  # noqa: E402

from benchmarks.cases.dimensioned_parts import dimensioned_part  # noqa: E402
from benchmarks.cases.models import model_mesh  # noqa: E402
from completion.export.step.faces import volume_of  # noqa: E402
from completion.export.step.sewing import sub_shapes  # noqa: E402
from completion.parts.pipeline import model_part  # noqa: E402
from completion.parts.step_export import named_model, outcome_lines, step_model  # noqa: E402
from scenes.io.point_files import read_part_file  # noqa: E402
from scenes.mesh.labelled_mesh import LabelledMesh  # noqa: E402


def part_of_model(name, folder):
    held = read_part_file(model_mesh(name, "coarse", 0).write(folder, "part", "stl"), "mm")
    return model_part(held.mesh)


@pytest.fixture(scope="module")
def lug(tmp_path_factory):
    return part_of_model("lug", tmp_path_factory.mktemp("lug"))


@pytest.fixture(scope="module")
def model(lug):
    return named_model(lug, "lug")


def name_of(label):
    name = TDataStd_Name()
    assert label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return name.Get().ToExtString()


def listed(find, *given):
    found = Sequence_TDF_Label()
    find(*given[:1], found, *given[1:])
    return [found.Value(k) for k in range(1, found.Length() + 1)]


def tree_of(label):
    """Name, kind of shape, names of faces, and the products below."""
    product = TDF_Label()
    if not XCAFDoc_ShapeTool.GetReferredShape_s(label, product):
        product = label
    return (
        name_of(product),
        XCAFDoc_ShapeTool.GetShape_s(label).ShapeType().name,
        [name_of(face) for face in listed(XCAFDoc_ShapeTool.GetSubShapes_s, product)],
        [tree_of(part) for part in listed(XCAFDoc_ShapeTool.GetComponents_s, product, False)],
    )


def read_tree(data, folder):
    """The one product that is free in a STEP file, with those below."""
    (folder / "tree.step").write_bytes(data)
    document, reader = TDocStd_Document(TCollection_ExtendedString("XmlOcaf")), STEPCAFControl_Reader()
    reader.SetNameMode(True)
    before = Interface_Static.IVal_s("read.stepcaf.subshapes.name")
    Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", 1)
    reader.ReadFile(str(folder / "tree.step"))
    reader.Transfer(document)
    Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", before)
    (root,) = listed(XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes)
    return tree_of(root)


def test_the_tree_has_the_body_and_each_feature_by_name(model, tmp_path):
    title, _, _, (body, features) = read_tree(model.feature_data, tmp_path)
    assert (title, body[0], body[1], features[0]) == ("lug", "body", "TopAbs_SOLID", "features")
    names = [product[0] for product in features[3]]
    assert names[:3] == [
        "hole 1: diameter 18.00 mm, through, counterbore diameter 26.00 mm, depth 3.00 mm",
        "hole 2: diameter 7.00 mm, through",
        "hole 3: diameter 7.00 mm, through",
    ]
    assert {product[1] for product in features[3]} <= {"TopAbs_SHELL", "TopAbs_COMPOUND"}
    bore = features[3][0][2]
    assert len(bore) == 3
    assert all(re.match(r"surface \d+ (cylinder|plane), hole 1, 100 % measured", face) for face in bore)
    assert sum(", hole 1, " in face for face in body[2]) == 3


def test_readers_count_one_solid_of_the_same_volume_in_either_file(model, tmp_path):
    for data in (model.data, model.feature_data):
        (solid,) = sub_shapes(read_back(data, tmp_path), "TopAbs_SOLID")
        assert 1e-9 * volume_of(solid) == pytest.approx(model.volume_m3, rel=1e-9)
    assert read_back(model.data, tmp_path).ShapeType().name == "TopAbs_SOLID"


def test_patterns_hold_their_holes(tmp_path):
    part = part_of_model("bracket", tmp_path)
    *_, (_, features) = read_tree(named_model(part, "bracket").feature_data, tmp_path)
    pattern = features[3][0]
    assert pattern[0] == "pattern 1: 4 x hole diameter 6.60 mm, through, pitch 26.00 mm x 35.00 mm"
    assert [hole[0].partition(":")[0] for hole in pattern[3]] == ["hole 2", "hole 3", "hole 4", "hole 5"]


def test_a_recess_in_a_thin_wall_does_not_go_through(tmp_path):
    *_, (_, features) = read_tree(named_model(part_of_model("housing", tmp_path), "h").feature_data, tmp_path)
    pockets = [product[0] for product in features[3] if product[0].startswith("pocket")]
    assert pockets == [
        "pocket 1: 88.00 mm x 58.00 mm, depth 35.00 mm",
        "pocket 2: 20.00 mm x 15.00 mm, depth 5.00 mm",
    ]


def test_the_same_features_give_the_same_bytes(lug, model):
    again = named_model(lug, "lug")
    assert again.feature_data == model.feature_data
    assert again.data == model.data


def test_without_features_there_is_one_file(tmp_path):
    block = trimesh.creation.box((0.03, 0.02, 0.01))
    part = model_part(LabelledMesh(block.vertices, block.faces))
    assert part.export(tmp_path / "block.step") == [tmp_path / "block.step"]


def test_an_export_with_features_tells_both_files(lug, tmp_path):
    written = lug.export(tmp_path / "lug.stp")
    assert written == [tmp_path / "lug.stp", tmp_path / "lug.features.stp"]
    assert all(file.is_file() for file in written)


def block_without(where):
    """A box of many triangles, 40 x 30 x 20 mm about the origin, without some, as STEP."""
    box = trimesh.creation.box((0.04, 0.03, 0.02)).subdivide().subdivide().subdivide()
    middle = box.triangles_center
    mesh = LabelledMesh(np.asarray(box.vertices), np.asarray(box.faces[~where(1e3 * middle)], dtype=np.int32))
    return step_model(model_part(mesh))


def names_in(model):
    return re.findall(r"ADVANCED_FACE\('([^']*)'", re.sub(r"\n\s*", "", model.data.decode()))


@pytest.mark.parametrize(
    ("where", "n_filled"),
    [
        (lambda at: (at[:, 2] > 9.9) & (np.abs(at[:, :2]) < 4).all(axis=1), 1),
        (lambda at: (at[:, 2] > 4) & (at[:, 0] > 12) & (np.abs(at[:, 1]) < 4), 2),
    ],
)
def test_a_gap_that_surfaces_determine_is_closed_and_is_in_the_name(where, n_filled):
    model = block_without(where)
    assert model.is_solid
    assert model.volume_m3 == pytest.approx(2.4e-5, rel=1e-9)
    record = model.record()
    assert len(record["inferred_faces"]) == n_filled
    assert record["open_edges"] == []
    filled = [name for name in names_in(model) if "gap in the mesh inferred" in name]
    assert [int(name.split()[1]) for name in filled] == record["inferred_faces"]
    text = model.data.decode().replace("\n", "")
    assert "PRESENTATION_LAYER_ASSIGNMENT('PARTLY-INFERRED'" in text
    assert text.count("COLOUR_RGB(") == 2
    assert outcome_lines(model)[1].strip().startswith("inferred: gaps in the mesh were closed on surface")


def test_open_edges_are_told_with_their_surface_place_and_length():
    model = block_without(lambda at: at[:, 2] > 9.9)
    assert not model.is_solid
    edges = model.record()["open_edges"]
    assert sorted(edge["length_m"] for edge in edges) == pytest.approx([0.03, 0.03, 0.04, 0.04])
    assert all(edge["at_m"][2] == pytest.approx(0.01) for edge in edges)
    assert sorted(edge["surface"] for edge in edges) == model.record()["open_faces"]
    assert not any("inferred" in name for name in names_in(model))


def test_ends_that_two_faces_share_are_not_open():
    """A plate with a raised block: its sides are found in two pieces each, without a fold between them."""
    made = dimensioned_part(8, 0.02, 2.0)
    model = step_model(model_part(made.points))
    assert model.is_solid, model.reason
    assert model.record()["open_faces"] == model.record()["open_edges"] == []
    length, width, high, thick = (value for _, value in made.meant[:4])
    step, end = made.surfaces[15:17]  # after six holes with their floors, two faces and the block's top
    block = 1e3 * abs(float(end.distance(step.point[None])[0]))
    true = width * (length * thick + block * (high - thick)) - 6 * np.pi * 4.0**2 * 6.0
    assert 1e9 * model.volume_m3 == pytest.approx(true, rel=1e-3)
    assert not any("open end" in name for name in names_in(model))


def test_faces_without_a_neighbour_that_failed_tell_their_open_edge(lug, monkeypatch):
    from completion.export.step import faces

    made, calls = faces.trimmed_face, []

    def fails_once(*given):
        calls.append(given)
        return faces.TrimmedFace(None, "the kernel could not trim it") if len(calls) == 1 else made(*given)

    monkeypatch.setattr(faces, "trimmed_face", fails_once)
    model = step_model(lug)
    assert not model.is_solid
    reason = (
        r"1 of 24 surfaces could not be trimmed.*; faces have open edges: of surface \d+ near \(.*\) mm \("
    )
    assert re.match(reason, model.reason)
    assert model.record()["open_edges"]
