# SPDX-License-Identifier: MIT
"""Things of a room closed by `complete`: what is inferred, what is written, what is told."""

from __future__ import annotations

import io
import json
import pickle
from dataclasses import replace

import ezdxf
import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from completion import BackOptions, CompletionOptions, complete
from completion.backs import closed_things
from completion.backs.closed_things import things_record
from completion.backs.closing import ClosedShape
from completion.export.building.things import STATES
from completion.export.dxf import dxf_of
from completion.export.svg import svg_of
from nbv.cli import app
from nbv.commands.info import describe_output
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.report.things_report import things_sections
from nbv.report.viewer.scan_views import completion_view
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.io.meshes.ply import read_mesh_ply
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.world.builtin import Finish, SceneBuilder

GREY = Finish((0.5, 0.5, 0.5))
OPTIONS = CompletionOptions(texture=False, backs=BackOptions())
LOW, HIGH = np.array([1.7, 2.2, 0.0]), np.array([2.3, 2.6, 0.5])


@pytest.fixture(scope="module")
def room():
    """A room with a box and a drum, seen by one camera; its completion."""
    build = SceneBuilder("room", "room")
    build.add_box("shell", (0, 0, 0), (4, 4, 2.5), GREY, inward=True)
    build.add_box("box", LOW, HIGH, GREY, yaw=0.5)
    build.add_cylinder("drum", (3.0, 2.4, 0.0), (0.0, 0.0, 0.6), 0.2, GREY)
    camera = PinholeSensor(fov_deg=65, width=240, height=180)
    noisy = Effects(noise=ConstantNoise(constant_m=0.001))
    pose = Pose.looking_at((2.0, 0.4, 1.5), (2.2, 2.6, 0.4))
    scan = scan_scene(build.finish(), pose, camera, effects=noisy, rng=0)
    return scan, complete(scan, OPTIONS, rng=0)


def test_both_things_stand_on_the_floor_and_are_closed(room):
    _, found = room
    assert len(found.things) == 2
    for one in found.things:
        assert one.why_open == ""
        assert one.thing.support_m == pytest.approx(0.0, abs=0.005)
        shape = one.back.shape
        assert trimesh.Trimesh(one.world_vertices(), shape.faces).is_watertight


def test_the_drum_is_full_and_its_far_side_is_inferred(room):
    _, found = room
    drum = min(found.things, key=lambda one: abs(one.thing.box.low @ one.thing.box.axes - [3, 2.4, 0]).sum())
    assert [symmetry.kind for symmetry in drum.back.sure] == ["axis"]
    assert drum.world_from_upright.apply(drum.back.sure[0].axis[None])[0, :2] == pytest.approx(
        [3.0, 2.4], abs=0.01
    )
    assert drum.back.volume.closed == pytest.approx(np.pi * 0.2**2 * 0.6, rel=0.1)
    inferred = drum.is_inferred
    assert inferred.any()
    centres = drum.world_vertices()[drum.back.shape.faces[inferred]].mean(axis=1)
    radius = np.linalg.norm(centres[:, :2] - [3.0, 2.4], axis=1)
    on_side, on_top = np.abs(radius - 0.2) < 0.02, np.abs(centres[:, 2] - 0.6) < 0.02
    assert (on_side | on_top).mean() > 0.95
    assert 0.2 < drum.inferred_m2 < 0.6  # half of the side is .38 m2


def test_what_closes_only_is_unknown(room):
    _, found = room
    for one in found.things:
        origin, state = one.back.shape.origin, one.face_states
        assert (state[origin >= 3] == 2).all()
        assert (state[origin == 0] == 0).all()


def test_files_hold_things_and_their_faces(room, tmp_path):
    _, found = room
    found.save(tmp_path)
    record = json.loads((tmp_path / "things.json").read_text())
    assert record["least"] == 0.8
    assert [entry["thing"] for entry in record["things"]] == [1, 2]
    for entry, one in zip(record["things"], found.things, strict=True):
        mesh = read_mesh_ply(tmp_path / entry["closed"])
        assert len(mesh.faces) == len(one.back.shape.faces)
        assert (mesh.face_properties["origin"] == one.back.shape.origin).all()
        assert mesh.face_properties["inferred"].sum() == one.is_inferred.sum()
        assert entry["volume_m3"]["least"] <= entry["volume_m3"]["closed"] * 2
        low, most = entry["depth_m"]["least"], entry["depth_m"]["most"]
        assert most is None or 0 < low <= most
    layer = next(layer for layer in completion_view(found, is_room=True).layers if layer.key == "things")
    assert len(layer.faces) == sum(int((one.back.shape.origin != 0).sum()) for one in found.things)
    assert (layer.channels[0].values == 1).sum() == sum(int(one.is_inferred.sum()) for one in found.things)
    (section,) = things_sections(found)
    assert "2 things stand" in section.blocks[0].text


def test_records_are_the_same_of_things_that_a_journal_kept(room):
    _, found = room
    kept = [pickle.loads(pickle.dumps(one)) for one in found.things]
    for one in kept:  # a journal may keep parts apart, so that equal hypotheses are two objects
        object.__setattr__(one.back, "sure", pickle.loads(pickle.dumps(one.back.sure)))
    record = things_record(kept, found.up, BackOptions())
    assert record == things_record(found.things, found.up, BackOptions())
    assert any(entry["sure"] for entry in record["things"])


def test_a_thing_of_which_no_room_is_left_stays_open(room, tmp_path, monkeypatch):
    scan, found = room
    none = ClosedShape(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.uint8), np.zeros(0))
    back = replace(found.things[0].back, shape=none)
    monkeypatch.setattr(closed_things, "find_back", lambda *_, **__: back)
    empty = complete(scan, OPTIONS, rng=0)
    assert [one.why_open for one in empty.things] == ["no room is left behind what was measured of it"] * 2
    empty.save(tmp_path)
    assert not (tmp_path / "things").exists()
    assert "2 left open" in things_sections(empty)[0].blocks[0].text


def test_nobody_asked_nothing_is_written(room, tmp_path):
    scan, _ = room
    plain = complete(scan, CompletionOptions(texture=False), rng=0)
    plain.save(tmp_path)
    assert plain.things == ()
    assert not (tmp_path / "things.json").exists()
    assert things_sections(plain) == ()


def test_the_same_on_any_number_of_threads(room):
    scan, found = room
    again = complete(scan, OPTIONS, rng=0, n_threads=2)
    for one, other in zip(found.things, again.things, strict=True):
        assert (one.world_vertices() == other.world_vertices()).all()
        assert (one.back.shape.origin == other.back.shape.origin).all()


def test_the_command_writes_and_describes_them(room, tmp_path):
    scan, found = room
    write_scan(scan, tmp_path / "scan.npz")
    out = tmp_path / "out"
    command = CliRunner().invoke(
        app, ["complete", str(tmp_path / "scan.npz"), "--backs", "--no-texture", "-o", str(out), "--json"]
    )
    assert command.exit_code == 0
    told = json.loads(command.stdout)
    assert (told["things"], told["closed"]) == (2, 2)
    assert told["backs_m2"] == pytest.approx(sum(one.inferred_m2 for one in found.things), rel=0.05)
    assert describe_output(out / "things.json")["closed"] == 2
    assert "Things and their back sides" in (out / "report.html").read_text()
    outputs = json.loads((out / "manifest.json").read_text())["outputs"]
    assert "things/01.ply" in [entry["name"] for entry in outputs]


def test_extents_hold_the_truth(room):
    _, found = room
    for one in found.things:
        corners = box_corners() if one is box_of(found) else drum_points()
        for name in ("width", "depth", "height"):
            extent = getattr(one.back.extents, name)
            true = np.ptp(corners @ np.array(extent.way))
            assert extent.least <= true <= (np.inf if extent.most is None else extent.most), name
            assert extent.least <= extent.estimate
        height = one.back.extents.height
        assert height.is_seen
        assert height.most - height.least < 0.05


def box_of(found):
    middle = (LOW + HIGH) / 2
    return min(found.things, key=lambda one: np.linalg.norm(one.world_vertices().mean(axis=0) - middle))


def box_corners():
    middle = (LOW + HIGH) / 2
    turn = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    return (np.array([*np.ndindex(2, 2, 2)]) - 0.5) * (HIGH - LOW) @ turn.T + middle


def drum_points():
    angle = np.linspace(0, 2 * np.pi, 200)
    ring = np.column_stack([3.0 + 0.2 * np.cos(angle), 2.4 + 0.2 * np.sin(angle)])
    return np.concatenate([np.column_stack([ring, np.full(200, z)]) for z in (0.0, 0.6)])


def test_a_decision_sheet_has_the_sizes_of_things(room):
    _, found = room
    sheet = found.decisions()
    mine = [one for one in sheet.dimensions if one.thing is not None]
    names = {one.name for one in mine}
    assert {"thing height, thing 1", "thing height, thing 2"} <= names
    assert all(one.low <= one.value <= one.high and one.surfaces == () for one in mine)
    assert "thing height, thing 1" in sheet.to_csv()


def test_a_thing_is_one_piece_of_furniture_in_ifc(room, tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    _, found = room
    found.export(tmp_path / "room.ifc")
    model = ifcopenshell.open(tmp_path / "room.ifc")
    furniture = model.by_type("IfcFurniture")
    assert [one.Name for one in furniture] == ["Thing 1", "Thing 2"]
    taken = {number + 1 for one in found.things for number in one.thing.surfaces}
    assert taken
    for proxy in model.by_type("IfcBuildingElementProxy"):  # none of their surfaces is there twice
        assert not taken & {int(number) for number in proxy.Tag.split("-")}
    for entity, one in zip(furniture, found.things, strict=True):
        (shape,) = entity.Representation.Representations
        assert sum(len(item.CoordIndex) for item in shape.Items) == len(one.back.shape.faces)
        styles = {style.Styles[0].Name for item in shape.Items for style in item.StyledByItem}
        assert styles == {("measured", "inferred", "unknown")[k] for k in np.unique(one.face_states)}


def test_drawings_have_outlines_of_things(room):
    _, found = room
    building = found.building()
    drum = max(building.model.things, key=lambda one: one.vertices[:, 0].mean())
    assert {state for state, _ in drum.outline} == {"measured"}  # its top was seen
    centres = drum.vertices[drum.faces].mean(axis=1)
    is_top = centres[:, 2] > 0.55
    state = np.where(is_top, 2, np.where(is_top | (centres[:, 0] > 3.15), 2, drum.state))
    bare = replace(drum, state=state)
    model = replace(building.model, things=(bare,))
    text = svg_of(replace(building, model=model))
    assert all(f'<path class="thing-{state}"' in text for state in ("measured", "inferred", "unknown"))
    drawing = ezdxf.read(io.StringIO(dxf_of(model).decode()))
    things = [one for one in drawing.modelspace() if one.dxf.layer.startswith("THING-")]
    assert {one.dxf.layer for one in things} == {"THING-MEASURED", "THING-INFERRED", "THING-UNKNOWN"}
    places = np.array([point[:2] for one in things for point in one.get_points()])
    assert np.linalg.norm(places - [3.0, 2.4], axis=1) == pytest.approx(0.2, abs=0.02)
    of = {state: np.concatenate([line for other, line in bare.outline if other == state]) for state in STATES}
    assert of["inferred"][:, 1].mean() > 2.4 + 0.05 > 2.4 - 0.05 > of["measured"][:, 1].mean()
    assert of["unknown"][:, 0].mean() > 3.1


def test_a_sure_back_side_stands_in_for_a_view(room):
    _, found = room
    known = KnownSurfaces(found, 0.01)
    back = np.array([[3.0, 2.6, 0.3], [3.0, 2.2, 0.3], [3.0, 2.6, 0.3], [3.0, 2.9, 0.3]])
    normals = np.array([[0, 1.0, 0], [0, -1, 0], [0, 0, 1], [0, 1, 0]])
    assert known.on_inferred(back, normals, 0.02).tolist() == [True, False, False, False]
    vertices, faces, confidence = known.inferred_mesh()
    assert len(faces) == len(confidence) > found.things[0].is_inferred.sum()
    assert np.isfinite(vertices).all()
    assert faces.max() < len(vertices)
