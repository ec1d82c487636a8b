# SPDX-License-Identifier: MIT
"""deviation.ply, design.glb and the IFC copy, read back by others."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from completion.asbuilt.findings import POINT_STATES
from nbv.inspection.models import write_design_glb, write_deviation_ply, write_ifc_copy
from nbv.inspection.verdict_colours import VERDICT_COLOURS, rgb_of
from scenes.io.meshes import ifc
from scenes.mesh.design import Element, ElementMesh
from tests.helpers.data_paths import data_path
from tests.helpers.ifc_files import Box, ifc_text
from tests.nbv.inspection.checks import BOXES, example_check

FAR = (500000.125, 5600000.25, 100.5)


def ply_vertices(path):
    held = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
    return {name: np.asarray(held[name]).reshape(-1) for name in held.dtype.names}


@pytest.mark.parametrize("origin", [(0, 0, 0), FAR])
def test_points_keep_their_places_elements_and_deviations(tmp_path, origin):
    check = example_check(origin)
    write_deviation_ply(tmp_path / "a.ply", check)
    held = ply_vertices(tmp_path / "a.ply")
    places = np.column_stack([held[axis] for axis in "xyz"])
    assert np.abs(places - check.cloud.points).max() < 1e-6
    assert np.array_equal(held["element"], check.cloud.element)
    assert held["deviation_m"] == pytest.approx(check.cloud.deviation_m, nan_ok=True)
    assert np.array_equal(held["state"], check.cloud.state)
    red, blue = held["red"].astype(int), held["blue"].astype(int)
    south, floor = held["element"] == 1, held["element"] == 0
    assert (blue[south] > red[south] + 50).all()  # behind the surface
    assert (red[floor] > blue[floor]).all()
    assert (np.abs(red - blue)[floor] < 30).all()
    other = held["state"] == POINT_STATES.index("on an element")
    assert (red[other] == blue[other]).all()
    text = (tmp_path / "a.ply").read_bytes().split(b"end_header")[0].decode()
    assert f"comment element 1 IfcWall wall south {1:022d}" in text
    assert "comment state 2 extra" in text


@pytest.mark.parametrize("origin", [(0, 0, 0), FAR])
def test_the_design_has_a_node_an_element_coloured_by_verdict(tmp_path, origin):
    check = example_check(origin)
    write_design_glb(tmp_path / "a.glb", check)
    scene = trimesh.load(tmp_path / "a.glb")
    named = [f"{one.element.ifc_class} {one.element.name}" for one in check.elements]
    assert set(scene.graph.nodes_geometry) == {*named, "extra-1", "extra-2"}
    for finding, name, (at, size) in zip(check.elements, named, BOXES.values(), strict=True):
        matrix, key = scene.graph[name]
        mesh = scene.geometry[key]
        rgb = np.rint(255 * np.array(rgb_of(VERDICT_COLOURS[finding.verdict])))
        assert (mesh.visual.vertex_colors[:, :3] == rgb).all()
        placed = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        low = np.array([at[0] + origin[0], at[2] + origin[2], -(at[1] + size[1] + origin[1])])  # y up
        assert placed.min(axis=0) == pytest.approx(low, abs=1e-5 if not origin[0] else 0.5)
        assert np.ptp(placed, axis=0) == pytest.approx([size[0], size[2], size[1]], abs=1e-4)
    box = scene.geometry[scene.graph["extra-1"][1]]
    assert box.is_watertight
    assert box.volume == pytest.approx(np.prod(np.ptp(check.extra[0].box_m, axis=0)), rel=1e-4)


def test_names_that_two_have_and_elements_that_were_not_asked_for_are_nodes_too(tmp_path):
    check = example_check()
    elements = tuple(Element("wall" if k else "") for k in range(6))
    design = ElementMesh(check.design.mesh, elements)
    write_design_glb(tmp_path / "a.glb", replace(check, design=design, elements=check.elements[:1], extra=()))
    scene = trimesh.load(tmp_path / "a.glb")
    assert set(scene.graph.nodes_geometry) == {"element 0", "wall", *(f"wall ({k})" for k in range(2, 6))}


@pytest.fixture
def properties(tmp_path):
    """What ifcopenshell reads of the property sets of a copy, by GlobalId; and how its messages changed."""
    ifcopenshell = pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")
    element = pytest.importorskip("ifcopenshell.util.element")
    validate = pytest.importorskip("ifcopenshell.validate")

    def read(source, check):
        target = tmp_path / "copy.ifc"
        n = write_ifc_copy(target, source, check)
        old, new = ifcopenshell.open(str(source)), ifcopenshell.open(str(target))
        assert all(str(one) == str(new.by_id(one.id())) for one in old)
        messages = []
        for model in (old, new):
            log = validate.json_logger()
            validate.validate(model, log)
            messages.append(sorted(str(one) for one in log.statements))
        assert messages[0] == messages[1]
        return n, {one.GlobalId: element.get_psets(one) for one in new.by_type("IfcElement")}

    return read


@pytest.mark.parametrize(
    ("unit", "schema"), [("m", "IFC4"), ("mm", "IFC2X3"), ("ft", "IFC4X3_ADD2"), ("none", "IFC4")]
)
def test_the_copy_says_what_was_found(tmp_path, properties, unit, schema):
    scale = {"mm": 1000.0, "ft": 1 / 0.3048}.get(unit, 1.0)
    named = [
        replace(one, element=replace(one.element, global_id=f"2{k:021d}"))
        for k, one in enumerate(example_check().elements)
    ]
    boxes = [Box(name=f"w{k}", at=(0, k, 0), global_id=f"'2{k:021d}'") for k in range(5)]
    text = ifc_text([*boxes, Box(name="other")], unit=unit, schema=schema)
    if schema == "IFC2X3":  # which asks for an owner
        owner = "#50=IFCOWNERHISTORY(#53,#54,$,.ADDED.,$,$,$,0);\n#51=IFCPERSON($,'x',$,$,$,$,$,$);\n"
        owner += "#52=IFCORGANIZATION($,'o',$,$,$);\n#53=IFCPERSONANDORGANIZATION(#51,#52,$);\n"
        owner += "#54=IFCAPPLICATION(#52,'1','a','a');\n"
        text = text.replace("DATA;\n", f"DATA;\n{owner}").replace("',$,'w", "',#50,'w")
    (tmp_path / "a.ifc").write_text(text)
    n, found = properties(tmp_path / "a.ifc", replace(example_check(), elements=tuple(named)))
    assert n == 5
    held = {gid: sets.get("Unseen_Check") for gid, sets in found.items()}
    wall = held[f"2{1:021d}"]
    assert wall["Verdict"] == "deviates"
    assert wall["Offset"] == pytest.approx(-0.0199 * scale)
    assert (wall["OffsetLow"], wall["OffsetHigh"]) == pytest.approx((-0.0212 * scale, -0.0186 * scale))
    assert wall["Tolerance"] == pytest.approx(0.01 * scale)
    assert (wall["MeasuredShare"], wall["LOA"], wall["Kind"]) == (0.61, "LOA20", "offset")
    assert wall["Sentence"] == named[1].sentence
    assert set(held[f"2{3:021d}"]) - {"id"} == {"Verdict", "Tolerance", "MeasuredShare", "Sentence"}
    assert [one is None for one in held.values()] == [False] * 5 + [True]


def test_copies_of_copies_hold_the_set_once_and_copies_are_the_same(tmp_path):
    pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")
    source, names = tmp_path / "a.ifc", [tmp_path / f"{k}.ifc" for k in "bcd"]
    source.write_text(ifc_text([Box(global_id=f"'{1:022d}'")], unit="mm"))
    check = example_check()
    for path in names[:2]:
        write_ifc_copy(path, source, check)
    assert names[0].read_bytes() == names[1].read_bytes()
    assert b"FILE_NAME('a.ifc','2026-01-01T00:00:00'" in names[0].read_bytes()
    write_ifc_copy(names[2], names[0], replace(check, elements=check.elements[1:]))
    assert names[2].read_bytes().count(b"'Unseen_Check'") == 1
    assert names[2].read_bytes().count(b"'Verdict'") == 1


def test_a_program_that_crashes_leaves_no_copy(tmp_path, monkeypatch):
    pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")
    (tmp_path / "a.ifc").write_text(ifc_text([Box()]))
    (tmp_path / "crash.py").write_text("import os; os._exit(11)")
    monkeypatch.setattr(ifc, "_PROGRAM", tmp_path / "crash.py")
    with pytest.raises(ifc.InputError, match=r"a.ifc: cannot be copied as IFC: ifcopenshell crashed \(11\)"):
        write_ifc_copy(tmp_path / "b.ifc", tmp_path / "a.ifc", example_check())
    with pytest.raises(ifc.InputError, match=r"none.ifc: "):
        write_ifc_copy(tmp_path / "b.ifc", tmp_path / "none.ifc", example_check())
    assert not (tmp_path / "b.ifc").exists()
    with pytest.raises(ifc.InputError, match=r"crashed \(11\) before the first element"):
        ifc.read_ifc(tmp_path / "a.ifc")


def test_elements_of_the_duplex_are_all_given_a_set(tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")
    source = data_path("buildings/duplex.ifc")
    if not source.is_file():
        pytest.skip("the handed data are not here")
    guids = [one.GlobalId for one in ifcopenshell.open(str(source)).by_type("IfcElement")]
    first = example_check().elements[1]
    elements = tuple(replace(first, element=Element("", "", guid)) for guid in guids)
    n = write_ifc_copy(tmp_path / "b.ifc", source, replace(example_check(), elements=elements))
    sets = ifcopenshell.open(str(tmp_path / "b.ifc")).by_type("IfcPropertySet")
    assert n == sum(one.Name == "Unseen_Check" for one in sets) > 200
