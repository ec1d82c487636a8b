# SPDX-License-Identifier: MIT
"""IFC4: what the text holds, and, where ifcopenshell is installed, what it reads back and reckons."""

import ast
import re
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from _pytest.assertion.rewrite import rewrite_asserts

from completion.export.ifc_entities import StepText
from completion.export.ifc_products import ProductEvidence, property_set, state_of
from completion.options import CompletionOptions
from completion.pipeline import complete
from scenes.checks import InputError
from scenes.io.scene_files import load_scene
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.exchange_examples import UTM, WRITTEN, ifc_text, panorama, parts_of
from tests.helpers.exchange_houses import (
    DOOR,
    HIGH_M,
    PARTITION_M,
    SLAB_M,
    completed_house,
    house_parts,
)
from tests.helpers.long_cases import first_in_gate


@pytest.fixture(scope="module")
def text():
    return ifc_text(house_parts())


@pytest.fixture(scope="module")
def entities(text):
    return Counter(re.findall(r"^#\d+=([A-Z0-9]+)\(", text, flags=re.MULTILINE))


def test_the_file_is_that_of_the_completion(text, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(int(WRITTEN.timestamp())))
    path = tmp_path / "completed.ifc"
    assert completed_house().export(path) == [path]
    assert path.read_text("utf-8") == text


def test_every_number_that_is_named_is_there_once(text):
    numbers = [int(one) for one in re.findall(r"^#(\d+)=", text, flags=re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert {int(one) for one in re.findall(r"#(\d+)", text)} <= set(numbers)
    identifiers = re.findall(r"=IFC[A-Z]+\('([0-3][\w$]{21})',\$", text)
    assert len(identifiers) == len(set(identifiers)) > 50


def test_it_has_the_parts_of_the_house(entities):
    parts = house_parts()
    kinds = Counter(body.kind for body in parts.bodies)
    assert entities["IFCBUILDINGSTOREY"] == len(parts.storeys) == 2
    assert entities["IFCSPACE"] == len(parts.rooms) == 3
    assert kinds == {"wall": 1, "slab": 1}
    assert entities["IFCPROJECT"] == entities["IFCSITE"] == entities["IFCBUILDING"] == 1
    assert (entities["IFCDOOR"], entities["IFCWINDOW"]) == (1, 0)
    assert entities["IFCOPENINGELEMENT"] == entities["IFCRELVOIDSELEMENT"]


def test_large_coordinates_are_in_the_map_conversion(text):
    (numbers,) = re.findall(r"IFCMAPCONVERSION\(#\d+,#\d+,([^)]*)\)", text)
    assert [float(one) for one in numbers.split(",")[:2]] == [499_999, 4_999_999]
    places = re.findall(r"IFCCARTESIANPOINT\(\(([^)]*)\)\)", text)
    assert max(abs(float(one)) for place in places for one in place.split(",")) < 20


def test_what_one_side_is_known_of_has_no_thickness(text):
    assert "'unknown: seen from one side'" in text
    one = ifc_text(house_parts(places=(0,)))
    lines = dict(re.findall(r"^#(\d+)=(.*);$", one, flags=re.MULTILINE))
    sets = [line for line in lines.values() if "'Qto_WallBaseQuantities'" in line]
    names = {lines[number] for line in sets for number in re.findall(r"#(\d+)", line)}
    assert any("'NetSideArea'" in name for name in names)
    assert not any("'Width'" in name or "Volume" in name for name in names)


def test_the_same_completion_gives_the_same_bytes_at_the_same_time(text):
    assert ifc_text(house_parts()) == text
    assert re.findall(r"\b20[0-9]{2}-", text) == ["2026-"]


def test_another_model_has_other_identifiers(text):
    parts = house_parts()
    moved = replace(parts, model=replace(parts.model, vertices=parts.model.vertices + 1e-3))
    first = re.search(r"IFCPROJECT\('([^']*)'", text).group(1)
    assert re.search(r"IFCPROJECT\('([^']*)'", ifc_text(moved)).group(1) != first


def test_an_empty_completion_is_a_building_with_nothing_in_it(tmp_path):
    camera = PinholeProjection(30, 20, 50, 50, 0, 0)
    nothing = complete(
        RangeImage(np.full((20, 30), np.inf), camera, Pose.identity()), CompletionOptions(texture=False)
    )
    nothing.export(tmp_path / "a.ifc")
    text = (tmp_path / "a.ifc").read_text()
    assert text.count("IFCBUILDINGSTOREY(") == 1
    assert "IFCWALL" not in text


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        panorama().export(tmp_path / "nowhere/a.ifc")
    with pytest.raises(InputError, match=r"cannot export a completion to .ifcxml; known: .*\.ifc"):
        panorama().export(tmp_path / "a.ifcxml")


def test_what_is_not_known_is_not_written():
    file = StepText(b"")
    property_set(file, "a", ProductEvidence((1, 2), None, np.nan, None))
    text = file.text("a", "IFC4", WRITTEN)
    assert "'Surfaces'" in text
    for name in ("State", "MeasuredShare", "Confidence", "StandardDeviation_mm"):
        assert name not in text
    assert [state_of(share) for share in (1.0, 0.5, 0.0)] == ["measured", "partly", "inferred"]


def test_scenes_read_it_back(tmp_path):
    """Walls within 1 mm of the bodies, in the scans' coordinates, from another unit too."""
    pytest.importorskip("ifcopenshell", reason="the extra ifc is not installed")
    (tmp_path / "a.ifc").write_text(ifc_text(house_parts(), "mm"))
    scene = load_scene(tmp_path / "a.ifc")
    assert scene.mode == "room"
    body = next(one for one in house_parts().bodies if one.kind == "wall")
    classes = [element.ifc_class for element in scene.design.elements]
    places = [scene.mesh.some(scene.mesh.face_surface == k).vertices for k in range(len(classes))]
    off = [body.frame.height(place) for place, kind in zip(places, classes, strict=True) if kind == "IfcWall"]
    thick = [one for one in off if np.abs(one).max() < 2 * PARTITION_M and np.ptp(one) > PARTITION_M / 2]
    assert len(thick) == 1  # the partition; the other walls are surfaces
    assert thick[0].max() == pytest.approx(0, abs=1e-3)
    assert thick[0].min() == pytest.approx(-body.thickness_m, abs=1e-3)
    assert np.linalg.norm(scene.mesh.vertices.mean(axis=0) - UTM.translation) < 10
    assert any("left out: 1 of" in one and "IfcDoor" in one for one in scene.warnings)  # drawn as a line


@pytest.fixture(scope="module")
def read(text):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    return ifcopenshell.file.from_string(text)


def quantities(element):
    from ifcopenshell.util.element import get_psets

    sets = get_psets(element, qtos_only=True)
    return {name: value for one in sets.values() for name, value in one.items() if name != "id"}


def evidence(element):
    from ifcopenshell.util.element import get_psets

    return get_psets(element, psets_only=True)["Unseen_Evidence"]


def reckoned(element):
    """Vertices (n, 3) and triangles (m, 3) of an element by the geometry engine, file coordinates."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    shape = ifcopenshell.geom.create_shape(settings, element).geometry
    return np.reshape(shape.verts, (-1, 3)), np.reshape(shape.faces, (-1, 3))


def area_of(vertices, faces):
    a, b, c = np.swapaxes(vertices[faces], 0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume_of(vertices, faces):
    a, b, c = np.swapaxes(vertices[faces] - vertices.mean(axis=0), 0, 1)
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6))


@pytest.fixture(scope="module")
def rules_compiled_once():
    """The library compiles the rules of the standard anew for each file, which takes longest."""
    rules = pytest.importorskip("ifcopenshell.express.rule_executor")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ast.parse", cache(ast.parse))
        patch.setattr("_pytest.assertion.rewrite.rewrite_asserts", cache(rewrite_asserts))
        patch.setattr(rules, "compile", cache(compile), raising=False)
        yield


@pytest.mark.usefixtures("rules_compiled_once")
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the library leaves its rules open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", first_in_gate(2, ["house", "office", "two_occluders"]))
def test_it_is_valid(name, text, tmp_path):
    pytest.importorskip("ifcopenshell")
    from ifcopenshell import validate

    path = tmp_path / "a.ifc"
    path.write_text(text if name == "house" else ifc_text(parts_of(panorama(name))))
    logger = validate.json_logger()
    validate.validate(str(path), logger, express_rules=True)
    assert logger.statements == []


def test_bodies_have_the_volume_that_is_told(read):
    bodies = [
        one for kind in ("IfcWall", "IfcSlab") for one in read.by_type(kind) if "Width" in quantities(one)
    ]
    assert len(bodies) == 2
    for one in bodies:
        told = quantities(one)
        assert volume_of(*reckoned(one)) == pytest.approx(told["NetVolume"], rel=1e-5)
        assert told["GrossVolume"] >= told["NetVolume"]
    wall = next(one for one in bodies if one.is_a("IfcWall"))
    told = quantities(wall)
    assert told["Width"] == pytest.approx(PARTITION_M, abs=1e-3)
    assert told["NetSideArea"] == pytest.approx(3 * HIGH_M - DOOR[0] * DOOR[1], rel=0.01)
    slab = next(one for one in bodies if one.is_a("IfcSlab"))
    assert quantities(slab)["Width"] == pytest.approx(SLAB_M, abs=1e-3)


def test_surfaces_have_the_area_that_is_told(read):
    count = 0
    for kind in ("IfcWall", "IfcSlab", "IfcCovering", "IfcBuildingElementProxy"):
        for one in read.by_type(kind):
            told = quantities(one)
            if "Width" in told or not told:
                continue
            area = told.get("NetSideArea") or told.get("NetArea") or told.get("NetSurfaceArea")
            assert area_of(*reckoned(one)) == pytest.approx(area, abs=1e-6 * max(area, 1))
            count += 1
    assert count >= 8


def test_spaces_have_the_volume_that_is_told(read):
    for one in read.by_type("IfcSpace"):
        told = quantities(one)
        assert volume_of(*reckoned(one)) == pytest.approx(told["NetVolume"], abs=1e-6)
        assert told["Height"] == pytest.approx(HIGH_M, abs=0.005)
        assert evidence(one)["Boundary"] == "closed"


def test_elements_lie_where_the_scans_say(read):
    conversion = read.by_type("IfcMapConversion")[0]
    origin = np.array([conversion.Eastings, conversion.Northings, conversion.OrthogonalHeight])
    everything = np.concatenate([reckoned(one)[0] for one in read.by_type("IfcSpace")]) + origin
    low, high = everything.min(axis=0) - UTM.translation, everything.max(axis=0) - UTM.translation
    assert low == pytest.approx([0, 0, 0], abs=0.005)
    assert high == pytest.approx([4 + PARTITION_M + 3, 3, 2 * HIGH_M + SLAB_M], abs=0.005)


def test_elements_are_in_their_storeys_and_say_what_is_known(read):
    from ifcopenshell.util.element import get_container

    for kind in ("IfcWall", "IfcSlab", "IfcCovering"):
        for one in read.by_type(kind):
            assert get_container(one).is_a("IfcBuildingStorey")
            known = evidence(one)
            assert known["State"] in ("measured", "inferred", "partly")
            assert 0 <= known["MeasuredShare"] <= 1
            assert 0 < known["Confidence"] <= 1
            assert 0 < known["StandardDeviation_mm"] < 5
            assert known["Surfaces"] == one.Tag.replace("-", ", ")


def test_measured_and_inferred_differ_in_colour(read):
    colours = {
        style.Name: tuple(style.Styles[0].SurfaceColour)[1:] for style in read.by_type("IfcSurfaceStyle")
    }
    assert {"measured", "inferred"} <= set(colours)
    assert colours["measured"] != colours["inferred"]
    for item in read.by_type("IfcStyledItem"):
        assert item.Item is not None


def test_columns_and_open_rooms_of_the_office():
    ifcopenshell = pytest.importorskip("ifcopenshell")
    read = ifcopenshell.file.from_string(ifc_text(parts_of(panorama("office"))))
    (column,) = read.by_type("IfcColumn")
    told = quantities(column)
    # The engine draws a circle as a polygon within it.
    assert volume_of(*reckoned(column)) == pytest.approx(told["NetVolume"], rel=0.1)
    (room,) = read.by_type("IfcSpace")
    assert "NetVolume" not in quantities(room)
    names = [one.RepresentationIdentifier for one in room.Representation.Representations]
    assert names == ["Body", "FootPrint"]
    floor = quantities(room)
    assert volume_of(*reckoned(room)) == pytest.approx(floor["NetFloorArea"] * floor["Height"], rel=1e-5)
    openings = read.by_type("IfcOpeningElement")
    assert {evidence(one)["Guess"] for one in openings} <= {"door", "window", "opening"}
    assert all(one.VoidsElements[0].RelatingBuildingElement.is_a("IfcWall") for one in openings)
