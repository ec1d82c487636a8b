# SPDX-License-Identifier: MIT
"""DXF read back by its own library: clean, on its layers, as many facets and folds as the model has."""

import hashlib
import io
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from completion.export.building.model import OpeningOutline
from completion.export.dxf import dxf_of
from completion.options import CompletionOptions
from completion.pipeline import complete
from scenes.io.formats.format import METRES_PER_UNIT
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.data_paths import ROOT
from tests.helpers.exchange_examples import SIZE, UTM, box, drawn, panorama
from tests.helpers.long_cases import first_in_gate

ezdxf = pytest.importorskip("ezdxf")


def read(data):
    return ezdxf.read(io.StringIO(data.decode()))


@pytest.fixture(scope="module")
def room():
    return panorama()


@pytest.fixture(scope="module")
def document(room, tmp_path_factory):
    path = tmp_path_factory.mktemp("dxf") / "room.dxf"
    assert room.export(path) == [path]
    return ezdxf.readfile(path)


def on(document, kind, prefix):
    return [one for one in document.modelspace().query(kind) if one.dxf.layer.startswith(prefix)]


def test_the_drawing_is_clean_and_in_metres(document):
    audit = document.audit()
    assert (audit.errors, audit.fixes) == ([], [])
    assert document.header["$INSUNITS"] == 6
    assert {one.dxf.layer for one in document.modelspace()} <= {layer.dxf.name for layer in document.layers}


def test_it_has_the_facets_folds_and_corners_of_the_light_model(room, document):
    panels = room.panels()
    faces = document.modelspace().query("3DFACE")
    assert len(faces) == len(panels.faces) + len(panels.remainder.faces)
    assert len(on(document, "3DFACE", "INFERRED-")) == (~panels.is_measured).sum()
    assert len(on(document, "POLYLINE", "FOLD-")) == len(panels.folds)
    assert len(on(document, "POINT", "CORNER")) == len(panels.corners)
    assert {face.dxf.layer for face in faces} >= {"MEASURED-WALL", "INFERRED-WALL", "MEASURED-FLOOR"}
    first = room.world_from_reference.apply(panels.vertices[panels.faces[0]])
    np.testing.assert_allclose([list(corner) for corner in faces[0].wcs_vertices()][:3], first, rtol=1e-13)


def test_facets_folds_and_corners_carry_what_is_known_of_them(room, document):
    panels = room.panels()
    faces = document.modelspace().query("3DFACE")
    told = np.array([[tag.value for tag in face.get_xdata("UNSEEN")] for face in faces])
    n = len(panels.faces)
    np.testing.assert_array_equal(told[:n], np.column_stack([panels.face_surface, panels.face_provenance]))
    for line, fold in zip(on(document, "POLYLINE", "FOLD-"), panels.folds, strict=True):
        one, other, share, sd = (tag.value for tag in line.get_xdata("UNSEEN"))
        assert (one, other) == fold.surfaces
        assert (share, sd) == pytest.approx((fold.measured_share, fold.sd_m))
        assert line.dxf.layer == ("FOLD-MEASURED" if fold.measured_share >= 0.95 else "FOLD-INFERRED")
    assert all(point.get_xdata("UNSEEN")[0].value > 0 for point in on(document, "POINT", "CORNER"))


def test_edges_within_a_surface_are_invisible():
    faces = read(dxf_of(box())).modelspace().query("3DFACE")
    for face in faces:
        corners = [face.dxf.vtx0, face.dxf.vtx1, face.dxf.vtx2, face.dxf.vtx3]
        for k, is_visible in enumerate(face.get_edges_visibility()):
            step = corners[(k + 1) % 4] - corners[k]
            is_diagonal = step.z != 0 and np.hypot(step.x, step.y) > 0
            assert is_visible != is_diagonal


def test_the_plan_lies_on_the_walls_at_its_height(document):
    lines = on(document, "LWPOLYLINE", "PLAN-")
    assert {line.dxf.layer for line in lines} >= {"PLAN-MEASURED", "PLAN-INFERRED"}
    points = np.array([point for line in lines for point in line.get_points("xy")]) - UTM.translation[:2]
    assert np.ptp(points, axis=0) == pytest.approx(SIZE[:2], abs=0.005)
    assert {round(line.dxf.elevation, 2) for line in lines} == {101.1}


def test_sections_lie_flat_below_the_plan(document):
    lines = on(document, "LWPOLYLINE", "SECTION-")
    points = np.array([point for line in lines for point in line.get_points("xy")]) - UTM.translation[:2]
    assert points[:, 1].max() < 0
    assert np.ptp(points[:, 0]) == pytest.approx(SIZE[0], abs=0.05)
    assert {line.dxf.elevation for line in lines} == {0.0}
    words = {text.dxf.text for text in document.modelspace().query("TEXT")}
    assert {"Section A - A", "Section B - B", "A", "B"} <= words


@pytest.mark.long
def test_openings_are_closed_outlines():
    done = panorama("office", "none")
    lines = on(read(dxf_of(drawn(done))), "POLYLINE", "OPENING")
    assert all(line.is_closed for line in lines)
    kinds = {line.get_xdata("UNSEEN")[1].value for line in lines}
    assert kinds >= {"window"}


@pytest.mark.long
@pytest.mark.parametrize("seed", first_in_gate(1, ["1", "2", "3"]))
def test_every_process_writes_the_same_bytes(seed):
    program = (
        "import hashlib; from completion.export.dxf import dxf_of; "
        "from tests.helpers.exchange_examples import box; print(hashlib.sha256(dxf_of(box())).hexdigest())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    said = subprocess.run(
        [sys.executable, "-c", program], env=environment, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert said.stdout.strip() == hashlib.sha256(dxf_of(box())).hexdigest()


def test_the_same_model_gives_the_same_bytes_and_leaves_the_library_as_it_was(room):
    before = ezdxf.options.write_fixed_meta_data_for_testing
    assert dxf_of(drawn(room)) == dxf_of(drawn(room))
    assert ezdxf.options.write_fixed_meta_data_for_testing == before


def test_an_empty_completion_is_a_drawing_that_says_so(tmp_path):
    camera = PinholeProjection(30, 20, 50, 50, 0, 0)
    nothing = complete(
        RangeImage(np.full((20, 30), np.inf), camera, Pose.identity()), CompletionOptions(texture=False)
    )
    nothing.export(tmp_path / "a.dxf")
    document = ezdxf.readfile(tmp_path / "a.dxf")
    assert document.audit().errors == []
    assert [one.dxf.text for one in document.modelspace()] == ["Nothing was found that could be drawn."]
    nothing.export(tmp_path / "a.svg")
    assert "Nothing was found that could be drawn." in (tmp_path / "a.svg").read_text()


@pytest.mark.parametrize(
    ("units", "code", "metric"), [("m", 6, 1), ("mm", 4, 1), ("in", 1, 0), ("ft", 2, 0), ("us-ft", 21, 0)]
)
def test_a_drawing_is_in_the_unit_that_is_asked_for(units, code, metric):
    unit = METRES_PER_UNIT[units]
    opening = OpeningOutline(1, "door", np.array([[0, 0, 0], [1, 0, 0], [1, 0, 2.0]]), (), 1.0, 2.0, 1.0)
    plain, other = (read(dxf_of(replace(box(), openings=(opening,)), one)) for one in ("m", units))
    assert (other.header["$INSUNITS"], other.header["$MEASUREMENT"]) == (code, metric)
    assert np.array(other.header["$EXTMAX"]) * unit == pytest.approx(np.array(plain.header["$EXTMAX"]))
    assert other.header["$LTSCALE"] * unit == pytest.approx(plain.header["$LTSCALE"])
    faces, there = (one.modelspace().query("3DFACE") for one in (plain, other))
    for face, scaled in zip(faces, there, strict=True):
        assert np.array(scaled.dxf.vtx1) * unit == pytest.approx(np.array(face.dxf.vtx1), abs=1e-9)
        assert scaled.get_xdata("UNSEEN") == face.get_xdata("UNSEEN")
    (line,) = other.modelspace().query("POLYLINE[layer=='OPENING']")
    assert [tag.value * unit for tag in line.get_xdata("UNSEEN")[2:]] == pytest.approx([1.0, 2.0])
    assert other.audit().errors == []


@pytest.mark.parametrize("units", ["m", "mm", "us-ft"])
def test_widths_are_dimensions_and_rooms_have_stamps(units, tmp_path):
    done = panorama()
    done.export(tmp_path / "room.dxf", units=units)
    document = ezdxf.readfile(tmp_path / "room.dxf")
    unit = METRES_PER_UNIT[units]
    found = document.modelspace().query("DIMENSION")
    assert {one.dxf.layer for one in found} == {"DIMENSION-MEASURED"}
    spans = [unit * np.linalg.norm(np.subtract(one.dxf.defpoint3, one.dxf.defpoint2)) for one in found]
    assert sorted(spans) == pytest.approx(sorted(SIZE[:2]), abs=0.003)
    assert [one.get_measurement() * unit for one in found] == pytest.approx(spans)
    texts = {one.dxf.text for one in found}
    assert len(texts) == 2
    assert all("%%p" in text for text in texts)
    stamps = on(document, "TEXT", "ROOM")
    assert next(one.dxf.text for one in stamps) == "Room 0.1"
    middle = np.array(stamps[0].dxf.insert)[:2] * unit - UTM.translation[:2]
    assert (np.abs(middle - np.array(SIZE[:2]) / 2) < 1).all()
    assert document.audit().errors == []
