# SPDX-License-Identifier: MIT
"""Rules of buildingSMART's validation service (buildingSMART/ifc-gherkin-rules), and units of files."""

import re
from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely

from completion.export.ifc_elements import elements_of
from completion.export.ifc_entities import Shapes, StepText
from scenes.io.formats.format import METRES_PER_UNIT
from tests.helpers.exchange_examples import ifc_text, panorama, parts_of
from tests.helpers.exchange_houses import house_parts

UNITS = ("m", "mm", "in", "ft", "us-ft")
BUILDINGS = {
    "house of two storeys": house_parts,
    "one storey": lambda: house_parts(places=(0, 1)),
    "open room": lambda: parts_of(panorama("office")),
    "furniture": lambda: parts_of(panorama("two_occluders")),
}


NAMES = [pytest.param(name, marks=pytest.mark.long if name == "one storey" else ()) for name in BUILDINGS]


@cache
def text_of(name, units="m"):
    return ifc_text(BUILDINGS[name](), units)


@cache
def read(name, units="m"):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    return ifcopenshell.file.from_string(text_of(name, units))


@pytest.mark.parametrize("name", NAMES)
def test_the_header_is_that_of_the_policy(name):
    head = text_of(name).split("ENDSEC;")[0]
    assert "FILE_DESCRIPTION(('ViewDefinition [ReferenceView_V1.2]'),'2;1');" in head
    (words,) = re.findall(r"FILE_NAME\((.*)\);", head)
    _, stamp, author, organisation, writer, system, _ = re.findall(r"'([^']*)'", words)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT[0-2]\d:[0-5]\d:[0-5]\d(\.\d+)?(Z|[+-]\d\d:\d\d)?", stamp)
    assert re.fullmatch(r"[^-]+?\s-\s[^-]+?\s-\s\d+([.,;|]\d+)*", system)
    assert re.fullmatch(r".*[a-zA-Z].*\d.*", writer)
    assert not re.fullmatch("[a-zA-Z]*", organisation)  # a single word is taken for no organisation
    assert author


@pytest.mark.parametrize("name", NAMES)
def test_there_is_one_tree_from_the_project_to_the_spaces(name):
    """PJS101, PJS003, SPS002, SPS007, OJP001."""
    file = read(name)
    for kind in ("IfcProject", "IfcSite", "IfcBuilding"):
        assert len(file.by_type(kind)) == 1
    for kind, above in (
        ("IfcSite", "IfcProject"), ("IfcBuilding", "IfcSite"), ("IfcBuildingStorey", "IfcBuilding"),
        ("IfcSpace", "IfcBuildingStorey"),
    ):  # fmt: skip
        for one in file.by_type(kind):
            assert [link.RelatingObject.is_a() for link in one.Decomposes] == [above]
    for one in file.by_type("IfcElement"):
        if not one.is_a("IfcFeatureElement"):
            (link,) = one.ContainedInStructure
            assert link.RelatingStructure.is_a("IfcBuildingStorey")
    identifiers = [one.GlobalId for one in file.by_type("IfcRoot")]
    assert len(set(identifiers)) == len(identifiers)


@pytest.mark.parametrize("name", NAMES)
def test_shapes_are_such_as_the_rules_allow(name):
    """GEM002, GEM003, GEM004, GEM052, IFC102, and the shapes of the reference view."""
    file = read(name)
    for one in file.by_type("IfcSpace"):
        kinds = {r.RepresentationIdentifier: r.RepresentationType for r in one.Representation.Representations}
        assert kinds["Body"] in ("SweptSolid", "Tessellation")
    for one in file.by_type("IfcProduct"):
        shapes = one.Representation.Representations if one.Representation else ()
        names = [shape.RepresentationIdentifier for shape in shapes]
        assert set(names) <= {"Body", "FootPrint", "Reference", "Profile"}
        assert len(set(names)) == len(names)
        assert {shape.RepresentationType for shape in shapes} <= {"SweptSolid", "Tessellation", "Curve3D"}
    for kind in ("IfcFaceBasedSurfaceModel", "IfcFacetedBrep"):
        assert not file.by_type(kind)
    (whole,) = file.by_type("IfcGeometricRepresentationContext", include_subtypes=False)
    assert whole.HasSubContexts


@pytest.mark.parametrize(
    ("name", "units"), [*((name, "m") for name in BUILDINGS if name != "one storey"), ("open room", "mm")]
)
def test_no_points_repeat_and_nothing_is_left_over(name, units):
    """GEM111; IFC105: a traversal from all IfcRoot reaches all but styles and coordinate operations."""
    file = read(name, units)
    for one in file.by_type("IfcPolyline"):
        places = np.array([point.Coordinates for point in one.Points])
        assert min(np.linalg.norm(b - a) for a, b in pairwise(places)) > 1e-6
    reached = {part.id() for root in file.by_type("IfcRoot") for part in file.traverse(root)}
    for inverse in ("IfcStyledItem", "IfcMapConversion", "IfcGeometricRepresentationSubContext"):
        reached |= {part.id() for one in file.by_type(inverse) for part in file.traverse(one)}
    assert [one for one in file if one.id() not in reached] == []


@pytest.mark.parametrize("name", NAMES)
def test_quantities_are_named_as_the_standard_has_them(name):
    """QTY001, PSE002."""
    pytest.importorskip("ifcopenshell")
    from ifcopenshell.util.pset import get_template

    template = get_template("IFC4")
    for one in read(name).by_type("IfcElementQuantity"):
        assert one.MethodOfMeasurement == "BaseQuantities"
        known = {entry.Name for entry in template.get_by_name(one.Name).HasPropertyTemplates}
        assert {entry.Name for entry in one.Quantities} <= known
    assert {one.Name for one in read(name).by_type("IfcPropertySet")} == {"Unseen_Evidence"}


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the library leaves its rules open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("units", UNITS[1:])
def test_other_units_are_valid_and_give_the_same_lengths(units, tmp_path):
    """PJS001, GRF005: names of units, and a map conversion in the unit of the file."""
    pytest.importorskip("ifcopenshell")
    from ifcopenshell import validate
    from ifcopenshell.util.unit import calculate_unit_scale

    name, metres = "house of two storeys", METRES_PER_UNIT[units]
    file, plain = read(name, units), read(name)
    (tmp_path / "a.ifc").write_text(text_of(name, units))
    logger = validate.json_logger()
    validate.validate(str(tmp_path / "a.ifc"), logger)
    assert logger.statements == []
    for power, kind in enumerate(("LENGTHUNIT", "AREAUNIT", "VOLUMEUNIT"), start=1):
        assert calculate_unit_scale(file, unit_type=kind) == pytest.approx(metres**power, rel=1e-12)
    for kind, value, power in (
        ("IfcQuantityLength", "LengthValue", 1), ("IfcQuantityArea", "AreaValue", 2),
        ("IfcQuantityVolume", "VolumeValue", 3), ("IfcExtrudedAreaSolid", "Depth", 1),
        ("IfcDoor", "OverallHeight", 1), ("IfcBuildingStorey", "Elevation", 1),
    ):  # fmt: skip
        there = [getattr(one, value) * metres**power for one in file.by_type(kind)]
        there_plain = [getattr(one, value) for one in plain.by_type(kind)]
        if kind != "IfcBuildingStorey":
            assert there == pytest.approx(there_plain, abs=1e-6)
        else:  # above an origin of whole units
            assert np.ptp(there) == pytest.approx(np.ptp(there_plain), abs=1e-6)
    (conversion,) = file.by_type("IfcMapConversion")
    place = [conversion.Eastings, conversion.Northings, conversion.OrthogonalHeight]
    assert place == np.rint(place).tolist()
    assert conversion.Scale == 1.0
    assert conversion.TargetCRS.MapUnit == conversion.SourceCRS.file.by_type("IfcUnitAssignment")[0].Units[0]


@pytest.mark.parametrize(
    ("far", "units"),
    [
        ((0.0, 0.0, 0.0), "us-ft"),
        ((3e5, 0.0, 0.0), "m"),
        ((-4e5, 6.5e6, -30.0), "us-ft"),
        ((2.7e6, 1.2e6, 400.0), "m"),
    ],
)
def test_places_and_their_map_conversion_give_the_coordinates_of_the_scans(far, units):
    model = house_parts().model
    moved = replace(model, vertices=model.vertices - model.drawn.min(axis=0) + np.array(far))
    parts = replace(
        house_parts(), model=moved, faces=(), bodies=(), storeys=(), rooms=(), columns=(), pipes=()
    )
    text = ifc_text(parts, units)
    found = re.findall(r"IFCMAPCONVERSION\(#\d+,#\d+,([^)]*)\)", text)
    assert bool(found) == (np.abs(moved.drawn).max() >= 1000)
    origin = np.array([float(one) for one in found[0].split(",")[:3]]) if found else np.zeros(3)
    lists = re.findall(r"IFCCARTESIANPOINTLIST3D\(\((.*)\)\)", text)
    places = np.concatenate([np.array(re.findall(r"[-\d.E]+", one), float).reshape(-1, 3) for one in lists])
    unit = METRES_PER_UNIT[units]
    assert np.abs(places).max() * unit < 1000 if found else True
    world = (places + origin) * unit
    assert world.min(axis=0) == pytest.approx(moved.drawn.min(axis=0), abs=2e-4)
    assert world.max(axis=0) == pytest.approx(moved.drawn.max(axis=0), abs=2e-4)


def doorway(kind, width, height, points=None, *, sill=0.0):
    """The house's parts, whose partition has one opening of a kind."""
    parts = house_parts()
    number = next(body for body in parts.bodies if body.kind == "wall").surfaces[0]
    faces = []
    for face in parts.faces:
        openings = ()
        if face.number == number:
            known = next(one for one in face.openings if one.kind == "door")
            corners = shapely.box(0, 0, width, height) if points is None else shapely.Polygon(points)
            uv = shapely.get_coordinates(corners.exterior)[:-1]
            corner = face.frame.flat(known.points).min(axis=0)
            outline = face.frame.place(uv + corner + (0.0, sill))
            openings = (replace(known, kind=kind, points=outline, width_m=width, height_m=height),)
        faces.append(replace(face, openings=openings))
    return replace(parts, faces=tuple(faces))


@pytest.mark.parametrize(
    ("kind", "width", "height", "sill", "points", "filled"),
    [
        ("door", 0.9, 2.0, 0.0, None, "IfcDoor"),
        ("door", 1.6, 2.2, 0.05, None, "IfcDoor"),
        ("window", 0.8, 2.0, 0.0, None, "IfcDoor"),  # its wall goes on below the floor of the storey
        ("window", 0.8, 1.1, 0.9, None, "IfcWindow"),
        ("window", 0.5, 0.5, 1.5, None, "IfcWindow"),
        ("window", 1.9, 2.0, 0.2, None, "IfcWindow"),
        ("opening", 0.9, 1.2, 0.9, None, None),
        ("window", 1.0, 1.0, 0.9, [(0, 0), (1, 0), (0, 1)], None),  # no rectangle
        ("door", 2.7, 2.2, 0.0, None, None),  # a passage
        ("door", 0.8, 0.7, 0.0, None, None),  # a hatch at the floor
    ],
)
def test_doors_and_windows_are_where_their_kind_is_known(kind, width, height, sill, points, filled):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    from ifcopenshell.util.element import get_psets

    file = ifcopenshell.file.from_string(ifc_text(doorway(kind, width, height, points, sill=sill)))
    openings = file.by_type("IfcOpeningElement")
    assert openings
    fillings = [*file.by_type("IfcDoor"), *file.by_type("IfcWindow")]
    assert [one.is_a() for one in fillings] == ([filled] if filled else [])
    for one in fillings:
        assert (one.OverallWidth, one.OverallHeight) == pytest.approx((width, height))
        (link,) = one.FillsVoids
        assert link.RelatingOpeningElement.VoidsElements[0].RelatingBuildingElement.is_a("IfcWall")
        assert one.ObjectPlacement.PlacementRelTo == link.RelatingOpeningElement.ObjectPlacement
        assert get_psets(one)["Unseen_Evidence"]["State"] == "inferred"


def test_things_are_one_proxy_each():
    parts = parts_of(panorama("two_occluders"))
    products = Counter(
        product.entity for _, product in elements_of(parts, [Shapes(StepText(b""), np.zeros(3))])
    )
    loose = [kind for kind in parts.model.kinds[1:] if kind not in ("wall", "floor", "ceiling")]
    assert 0 < products["IfcBuildingElementProxy"] < len(loose)
