# SPDX-License-Identifier: MIT
"""IFC as scenes: elements, units, storeys, maps, what is left out, and files that are damaged."""

import json
import sys
from collections import Counter
from contextlib import suppress

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.checks.limits import limits
from scenes.io.describe import describe
from scenes.io.meshes import ifc
from scenes.io.scene_files import load_scene
from tests.helpers.data_paths import data_path
from tests.helpers.ifc_files import MAP, Box, ifc_text

pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")

STOREYS = (("Ground", 0.0), ("Upper", 3.0))
WALL = Box(at=(1, 2, 0), opening=(1, 0, 1, 2), type_name="W200", colour=(0.8, 0.1, 0.2))
SLAB = Box("IFCSLAB", (0, 0, -0.3), (5, 4, 0.3), "slab", storey=1, body="mapped")
DUPLEX = data_path("buildings/duplex.ifc")


def read(folder, boxes, **kwargs):
    path = folder / "a.ifc"
    path.write_text(ifc_text(boxes, **kwargs))
    return load_scene(path, mode="object")


def bounds(scene, number):
    return scene.mesh.some(scene.mesh.face_surface == number).bounds()


def volume(scene, number):
    corners = scene.mesh.corners[scene.mesh.face_surface == number]
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(
    ("unit", "schema", "told"),
    [
        ("m", "IFC4", None),
        ("mm", "IFC2X3", "millimetre"),
        ("ft", "IFC4X3_ADD2", "FOOT"),
        ("none", "IFC4", None),
    ],
)
def test_elements_have_their_places_and_sizes_in_metres(tmp_path, unit, schema, told):
    scene = read(tmp_path, [WALL, SLAB], unit=unit, schema=schema, storeys=STOREYS, site=(100, -200, 7))
    assert bounds(scene, 0) == pytest.approx(np.array([[101, -198, 7], [105, -197.8, 9.5]]), abs=1e-6)
    assert bounds(scene, 1) == pytest.approx(np.array([[100, -200, 9.7], [105, -196, 10]]), abs=1e-6)
    assert volume(scene, 0) == pytest.approx((4 * 2.5 - 1 * 2) * 0.2, rel=1e-6)
    assert any("states its unit" in one for one in scene.warnings) == (told is not None)
    wall, slab = scene.design.elements
    assert (wall.ifc_class, wall.name, wall.storey, wall.type_name) == ("IfcWall", "wall", "Ground", "W200")
    assert (slab.ifc_class, slab.storey, slab.type_name) == ("IfcSlab", "Upper", "")
    assert len(wall.global_id) == 22
    assert scene.surface_names == ("IfcWall wall", "IfcSlab slab")
    assert scene.design.unit == {"m": "metre", "none": ""}.get(unit, told)
    colour = scene.mesh.appearance.corner_colour[scene.mesh.face_surface == 0]
    assert colour == pytest.approx(np.broadcast_to((0.8, 0.1, 0.2), colour.shape), abs=1e-6)


def test_units_of_the_file_go_before_those_that_a_user_gives(tmp_path):
    for unit, sizes, told in (("none", 4e-3, "the diagonal"), ("ft", 4.0, "--units mm was not applied")):
        (tmp_path / "a.ifc").write_text(ifc_text([Box()], unit=unit))
        scene = load_scene(tmp_path / "a.ifc", units="mm", mode="object")
        assert np.ptp(scene.mesh.vertices, axis=0)[0] == pytest.approx(sizes)
        assert any(told in one for one in scene.warnings)


@pytest.mark.parametrize("unit", ["m", "mm", "ft"])
def test_coordinates_are_those_of_the_map(tmp_path, unit):
    scene = read(tmp_path, [WALL], unit=unit, conversion=MAP)
    half, root = 0.5, np.sqrt(0.75)
    own = np.array([[1, 2, 0], [5, 2, 2.5]])
    there = own @ np.array([[half, root, 0], [-root, half, 0], [0, 0, 1]]) + [500000.125, 5600000.25, 100.5]
    for place in there:
        assert np.linalg.norm(scene.mesh.vertices - place, axis=1).min() < 1e-6
    (sentence,) = [one for one in scene.warnings if "map" in one]
    assert "EPSG:25832" in sentence
    assert "(500000.125, 5600000.25, 100.5) m and turned by 60 deg" in sentence
    held = describe(tmp_path / "a.ifc")
    assert held["map_conversion"]["shift_m"] == pytest.approx([500000.125, 5600000.25, 100.5])
    assert held["classes"] == {"IfcWall": 1}


@pytest.mark.parametrize(
    ("metres", "values", "crs", "shift", "scale", "doubts"),
    [
        (0.001, {"Eastings": 5e5, "Scale": 0.001}, {"unit": {"metres": 1.0}}, 5e5, 1.0, 0),
        (0.001, {"Eastings": 5e8}, {"unit": None}, 5e5, 1.0, 0),  # without a unit of the map: the file's
        (0.001, {"Eastings": 5e5}, {"unit": {"metres": 1.0}}, 5e5, 1.0, 1),  # the scale was forgotten
        (1.0, {"Eastings": 5e5, "Scale": 0.9996}, {"unit": None}, 5e5, 0.9996, 0),
        (0.3048, {"FirstCoordinate": 100.0}, {"unit": {"metres": 0.3048}}, 30.48, 1.0, 0),
        (0.001, {"Eastings": 5e5, "Scale": 0.001}, {"unit": None, "unit_name": "METRE"}, 5e5, 1.0, 0),
    ],
)
def test_offsets_of_maps_are_in_the_unit_of_the_map(metres, values, crs, shift, scale, doubts):
    held = {"values": values, "crs": {"name": "x", **crs}}
    conversion, told = ifc._conversion(held, metres)
    assert conversion.shift_m == pytest.approx((shift, 0, 0))
    assert conversion.scale == pytest.approx((scale,) * 3)
    assert len(told) == doubts


def test_what_changes_nothing_is_no_map_conversion():
    held = {"values": {"Eastings": 0.0, "XAxisAbscissa": 1.0}, "crs": {"name": "x", "unit": None}}
    assert ifc._conversion(held, 1.0) == (None, ())
    with pytest.raises(InputError, match="cannot be used"):
        ifc._conversion({**held, "values": {"Eastings": float("inf")}}, 1.0)


def test_property_sets_of_old_files_are_a_map_conversion(tmp_path):
    numbers = {"Eastings": 1000.0, "Northings": 2000.0, "XAxisAbscissa": 0.0, "XAxisOrdinate": 1.0}
    lines = [
        f"#{41 + k}=IFCPROPERTYSINGLEVALUE('{name}',$,IFCREAL({value}),$)"
        for k, (name, value) in enumerate(numbers.items())
    ]
    held = "#40=IFCPROPERTYSET('0000000000000000000040',$,'ePset_MapConversion',$,(#41,#42,#43,#44))"
    scene = read(tmp_path, [Box()], schema="IFC2X3", conversion=[held, *lines])
    assert bounds(scene, 0) == pytest.approx(np.array([[999.8, 2000, 0], [1000, 2004, 2.5]]))


def test_spaces_and_openings_are_no_elements_and_what_has_no_geometry_is_counted(tmp_path):
    kinds = ("IFCSPACE", "IFCANNOTATION", "IFCVIRTUALELEMENT")
    boxes = [
        WALL,
        *(Box(kind) for kind in kinds),
        Box(name="bare", body="none"),
        Box(name="bad", body="broken"),
    ]
    scene = read(tmp_path, boxes)
    assert [element.ifc_class for element in scene.design.elements] == ["IfcWall"]
    text = " ".join(scene.warnings)
    assert "elements without a body that can be meshed, left out: 2 of 3 (IfcWall bare (#" in text
    assert "IfcWall bad (#" in text


@pytest.mark.parametrize(
    ("body", "turned", "is_open"), [("brep", 0, 0), ("inside out", 1, 0), ("open", 0, 1)]
)
def test_what_is_inside_out_is_turned(tmp_path, body, turned, is_open):
    scene = read(tmp_path, [Box(body=body), Box(at=(0, 3, 0))])
    text = " ".join(scene.warnings)
    assert ("in 1 closed components of 1 of 2 elements" in text) == turned
    assert ("not closed all round: 1 of 2 elements" in text) == is_open
    if not is_open:
        assert volume(scene, 0) == pytest.approx(4 * 0.2 * 2.5)


def test_what_is_there_twice_is_told(tmp_path):
    same = "'0123456789012345678901'"
    scene = read(tmp_path, [Box(global_id=same), Box(global_id=same)])
    text = " ".join(scene.warnings)
    assert "12 of 24 faces are there more than once" in text
    assert "GlobalId another has too: 2 of 2" in text
    assert scene.surface_names == ("IfcWall wall", "IfcWall wall 2")


@pytest.fixture(scope="module")
def duplex():
    if not DUPLEX.exists():
        pytest.skip(f"{DUPLEX} is not there")
    return load_scene(DUPLEX)


def test_the_duplex_is_as_its_truth(duplex):
    truth = np.load(DUPLEX.with_suffix(".npz"))
    elements = duplex.design.elements
    assert [[one.ifc_class, one.name] for one in elements] == json.loads(str(truth["elements"]))
    assert len(duplex.mesh.faces) == len(truth["faces"]) == 26348
    for k in range(len(elements)):
        corners = truth["vertices"][truth["faces"][truth["element"] == k]].reshape(-1, 3)
        assert bounds(duplex, k) == pytest.approx(np.array([corners.min(0), corners.max(0)]), abs=1e-3)
    assert Counter(one.storey for one in elements) == {"Level 1": 101, "Level 2": 93, "T/FDN": 14, "Roof": 7}
    assert all(len(one.global_id) == 22 for one in elements)


def test_of_the_duplex_eight_fixed_elements_are_inside_out_and_turned(duplex):
    truth = np.load(DUPLEX.with_suffix(".npz"))
    a, b, c = np.moveaxis(truth["vertices"][truth["faces"]].astype(float), 1, 0)
    before = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    fixed = [k for k, one in enumerate(duplex.design.elements) if one.ifc_class != "IfcFurnishingElement"]
    inward = [k for k in fixed if before[truth["element"] == k].sum() < -1e-3]
    assert len(inward) >= 6
    assert all(volume(duplex, k) > 0 for k in fixed if duplex.design.elements[k].ifc_class != "IfcRailing")


def test_a_mesh_as_a_design_has_named_elements(duplex):
    house = load_scene(DUPLEX.with_suffix(".glb"), up="y", design=True)
    assert [one.name for one in house.design.elements] == list(house.surface_names)
    assert not house.design.schema
    assert any("inside out" in one for one in house.warnings)


def endless(text):
    return text.replace("IFCLOCALPLACEMENT($", "IFCLOCALPLACEMENT(#102")  # below itself


HOSTILE = {
    "cut off": (lambda text: text[: len(text) // 2], "is cut off"),
    "binary": (lambda _: "\x7fELF\0\1" * 99, "is no IFC file"),
    "an archive": (lambda text: "PK\3\4" + text, "is an archive"),
    "placed below itself": (endless, r"engine crashed \(-11\) at IfcWall wall \(#"),
    "unknown schema": (lambda text: text.replace("'IFC4'", "'IFC9'"), "IFC"),
    "no elements": (lambda text: text.replace("IFCWALL(", "IFCSPACE("), "no element with geometry"),
    "not a number": (lambda text: text.replace("4.000000000", "1E400"), "a.ifc"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_in_one_line(tmp_path, name):
    change, words = HOSTILE[name]
    (tmp_path / "a.ifc").write_text(change(ifc_text([Box()])))
    with pytest.raises(InputError, match=words) as caught:
        load_scene(tmp_path / "a.ifc")
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_deep_brackets_are_read_or_refused(tmp_path):
    text = ifc_text([Box()])
    (tmp_path / "a.ifc").write_text(text.replace("((#9))", "(" * 200_000 + "#9" + ")" * 200_000))
    with suppress(InputError):
        assert load_scene(tmp_path / "a.ifc").design.schema == "IFC4"


def test_limits_of_time_and_triangles_hold(tmp_path, monkeypatch):
    with limits(faces=20), pytest.raises(InputError, match=r"faces=20; if you trust"):
        read(tmp_path, [Box(), Box(at=(0, 3, 0))])
    monkeypatch.setattr(ifc, "_SECONDS", 0)
    with pytest.raises(InputError, match="took more than 0 s before the first element"):
        read(tmp_path, [Box()])


def test_without_the_extra_the_cure_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ifcopenshell", None)
    with pytest.raises(InputError, match=r'not installed; the cure: pip install "unseen\[ifc\]"'):
        read(tmp_path, [Box()])
