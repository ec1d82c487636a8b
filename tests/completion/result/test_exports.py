# SPDX-License-Identifier: MIT
"""Exports of completions: OBJ, GLB, E57 and polygons; what is inferred is never mixed up with the rest."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from shapely import Polygon

from completion.boundary.edges import ChartLine
from completion.export.panels.outline import GuideLine, straighten_polygon
from completion.export.panels.sheet import polygons_of_cells
from completion.extension.patch import Provenance
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.meshes import inferred_points, model_parts
from completion.result.record import polygons_record
from scenes.checks import InputError
from scenes.io.clouds.e57_writer import INFERRED
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scans
from scenes.io.scene_files import load_scene
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.completion_examples import example

UTM = Pose.from_parts(np.eye(3), np.array([5e5, 5e6, 100.0]))


def wall_with_openings():
    """A wall 3 m away, 4 m wide, from the floor up, with a window and a door; z is up."""
    camera = PinholeProjection.from_fov(161, 121, 60)
    pose = Pose.looking_at((0, 0, 1.0), (0, 1, 1.0))
    rays = pose.rotate(camera.directions())
    reach = 3.0 / rays[..., 1]
    x, z = reach * rays[..., 0], 1.0 + reach * rays[..., 2]
    through = ((np.abs(x + 0.8) < 0.3) & (np.abs(z - 1.3) < 0.4)) | ((np.abs(x - 0.6) < 0.4) & (z < 1.2))
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < 0, -1.0 / rays[..., 2], np.inf)
    reach = np.where(through, reach + 4.0, reach)
    colour = np.full((*camera.shape, 3), 0.5, np.float32)
    return RangeImage(np.minimum(reach, floor), camera, pose, colour=colour, sigma_m=0.0)


@pytest.fixture(scope="module")
def room():
    """A completed scan of the room with two occluders, without texture, at UTM coordinates."""
    scan = example("two_occluders", pixels=120).transform(UTM)
    return complete(replace(scan, name="west"), CompletionOptions(texture=False))


@pytest.fixture(scope="module")
def post():
    """A completed textured cylinder."""
    return complete(example("textured_cylinder", pixels=100), rng=0)


def test_obj_and_glb_hold_the_same_objects_textured(post, tmp_path):
    files = post.export(tmp_path / "a.obj")
    assert [file.name for file in files][:2] == ["a.obj", "a.mtl"]
    assert "map_Kd a_1.png" in (tmp_path / "a.mtl").read_text()
    assert "objects called hypothesised were inferred" in (tmp_path / "a.obj").read_text()[:200]
    assert post.export(tmp_path / "a.glb") == [tmp_path / "a.glb"]
    obj, glb = load_scene(tmp_path / "a.obj"), load_scene(tmp_path / "a.glb", up="y")
    for name in ("hypothesised 2 cylinder", "observed 2 cylinder"):
        areas = []
        for scene in (obj, glb):
            (number,) = (
                k
                for k, given in enumerate(scene.surface_names)
                if given.replace("_", " ").removesuffix(" texture 1") == name
            )
            chosen = np.flatnonzero(scene.mesh.face_surface == number).astype(np.int32)
            areas.append(scene.mesh.face_areas()[chosen].sum())
            colour = scene.mesh.appearance.colour(chosen, np.full((len(chosen), 3), 1 / 3))
            assert colour.std(axis=0).max() > 0.01
        assert areas[0] == pytest.approx(areas[1], rel=1e-5)
    inferred = sum(mesh_area(part) for part in model_parts(post) if part.name.startswith("hypothesised"))
    assert inferred == pytest.approx(post.hypothesised_m2, rel=0.01)


@pytest.mark.parametrize("seed", [228, 303, 352])
def test_an_outline_that_guides_fold_keeps_its_parts(seed):
    """Both sides of a narrow place follow one guide: what is left are several polygons and lines."""
    rng, n = np.random.default_rng(seed), 14
    top = np.column_stack([np.arange(n), rng.uniform(0.2, 1.2, n)])
    bottom = np.column_stack([np.arange(n)[::-1], -rng.uniform(0.2, 1.2, n)])
    area, guides = Polygon(np.concatenate([top, bottom])), []
    for run in ([2, 5], [8, 11]):
        height, slope = rng.uniform(-0.3, 0.3), rng.uniform(-0.1, 0.1)
        line = ChartLine(np.array([0, height]), np.array([1.0, slope]) / np.hypot(1, slope))
        guides.append(GuideLine(line, np.array([run], float), 1.0))
    assert straighten_polygon(area, guides, 0.1).area > 0.5 * area.area


def test_a_hole_that_is_laid_on_the_outline_stays_open():
    """A door whose sill is a row of cells: both edges of the row follow the floor."""
    wall = Polygon([(0, 0.02), (4, 0.02), (4, 3), (0, 3)], [[(1, 0.05), (2, 0.05), (2, 2), (1, 2)]])
    floor = GuideLine(ChartLine(np.zeros(2), np.array([1.0, 0.0])), np.array([[-np.inf, np.inf]]), 0.1)
    assert straighten_polygon(wall, [floor], 0.03).area == pytest.approx(12 - 2, rel=0.02)


def mesh_area(part):
    return trimesh.Trimesh(part.vertices, part.faces, process=False).area


@pytest.mark.long
def test_models_far_away_are_exact(room, tmp_path):
    room.save(tmp_path)
    room.export(tmp_path / "a.obj")
    ours = np.vstack([part.vertices for part in model_parts(room)])
    for name, up, tolerance in (("completed.glb", "y", 1e-6), ("a.obj", "z", 1e-8)):
        back = load_scene(tmp_path / name, up=up).mesh.vertices
        np.testing.assert_allclose(back.min(axis=0), ours.min(axis=0), atol=tolerance, rtol=0)
        np.testing.assert_allclose(back.max(axis=0), ours.max(axis=0), atol=tolerance, rtol=0)


def test_e57_keeps_scans_and_marks_what_is_inferred(room, tmp_path):
    pye57 = pytest.importorskip("pye57")
    room.export(tmp_path / "a.e57")
    with pye57.E57(str(tmp_path / "a.e57")) as file:
        names = [file.get_header(k)["name"].value() for k in range(file.scan_count)]
        told = json.loads(file.get_header(1)["description"].value())
        fields = file.get_header(1).point_fields
        others = file.read_scan_raw(1, ignore_unsupported_fields=True)
    assert names[0] == "west"
    assert all(name.startswith("inferred ") for name in names[1:])
    assert told["format"] == INFERRED
    assert set(told["provenance"]) == {str(why.value) for why in Provenance}
    assert {f"unseen:{name}" for name in ("surface", "provenance", "confidence", "sd")} <= set(fields)
    clouds = list(inferred_points(room))
    assert len(names) == 1 + len(clouds)
    assert sum(len(cloud.points) for cloud in clouds) == len(room.hypothesised.vertices)
    np.testing.assert_allclose(others["cartesianX"], clouds[0].points[:, 0])
    (scan,) = read_scans(tmp_path / "a.e57")  # nothing inferred comes back as measured
    original = example("two_occluders", pixels=120).transform(UTM)
    np.testing.assert_array_equal(scan.valid, original.valid)
    np.testing.assert_allclose(scan.points(), original.points(), atol=4e-9)
    np.testing.assert_allclose(scan.origin, original.origin, atol=4e-9)
    assert len(read_points(tmp_path / "a.e57").points) == original.valid.sum()


def test_the_extension_of_e57_is_read_by_its_library(room, tmp_path):
    lib = pytest.importorskip("pye57").libe57
    room.export(tmp_path / "a.e57")
    cloud = next(inferred_points(room))
    file = lib.ImageFile(str(tmp_path / "a.e57"), "r")
    points = file.root()["data3D"][1]["points"]
    n = len(cloud.points)
    number, sd = np.zeros(n, np.uint16), np.zeros(n, np.float32)
    buffers = lib.VectorSourceDestBuffer()
    buffers.append(lib.SourceDestBuffer(file, "unseen:provenance", number, n, True, True))
    buffers.append(lib.SourceDestBuffer(file, "unseen:sd", sd, n, True, True))
    reader = points.reader(buffers)
    assert reader.read() == n
    reader.close()
    file.close()
    np.testing.assert_array_equal(number, cloud.provenance)
    np.testing.assert_allclose(sd, cloud.sd, rtol=1e-6)
    assert (number > 0).all()


def test_unknown_suffixes_are_told_the_known_ones(room, tmp_path):
    with pytest.raises(InputError, match=r"a\.ply: cannot export a completion to \.ply; known: \.glb, \.obj"):
        room.export(tmp_path / "a.ply")


def test_the_same_completion_gives_the_same_bytes(room, tmp_path):
    for suffix in ("obj", "e57", "json"):
        for name in ("one", "two"):
            (tmp_path / name).mkdir(exist_ok=True)
            room.export(tmp_path / name / f"a.{suffix}")
        assert (tmp_path / "one" / f"a.{suffix}").read_bytes() == (
            tmp_path / "two" / f"a.{suffix}"
        ).read_bytes()


def test_an_empty_completion_exports_empty_files(tmp_path):
    camera = PinholeProjection(30, 20, 50, 50, 0, 0)
    nothing = complete(RangeImage(np.full((20, 30), np.inf), camera, Pose.identity()))
    nothing.export(tmp_path / "a.obj")
    assert polygons_record(nothing)["surfaces"] == []
    with pytest.raises(InputError, match="there is no scan to write"):
        nothing.export(tmp_path / "a.e57")


def test_polygons_of_a_room(room):
    record = polygons_record(room)
    assert (record["format"], record["unit"]) == ("unseen polygons 1", "m")
    assert {surface["role"] for surface in record["surfaces"]} >= {"floor", "wall", "ceiling"}
    for surface in record["surfaces"]:
        patch = room.patches[surface["id"] - 1]
        cells = patch.observed_m2 + patch.hypothesised_m2
        assert surface["area_m2"] == pytest.approx(cells, rel=0.06)
        point, normal = (np.array(surface["plane"][key]) for key in ("point", "normal"))
        for polygon in surface["polygons"]:
            for ring, sign in [(polygon["outer"], 1), *((hole, -1) for hole in polygon["holes"])]:
                points = np.array(ring["points"])
                assert len(points) == len(ring["edges"]) >= 3
                assert np.abs((points - point) @ normal).max() < 1e-8
                local = points - points[0]
                turn = np.cross(local[:-1], local[1:]).sum(axis=0) @ normal
                assert np.sign(turn) == sign
                for edge in ring["edges"]:
                    assert edge["state"] == ("measured" if edge["provenance"] == "measured" else "inferred")
                    assert 0 <= edge["confidence"] <= 1
                    assert 0 <= edge["sd_m"] < 0.02


def test_the_outline_of_a_floor_lies_on_the_walls(room):
    """A closed form: the room is 6 x 5 m, and its far sides are where the floor ends."""
    record = polygons_record(room)
    (floor,) = (surface for surface in record["surfaces"] if surface["role"] == "floor")
    points = np.array(floor["polygons"][0]["outer"]["points"]) - UTM.translation
    assert points[:, 0].max() == pytest.approx(6, abs=0.002)
    assert points[:, 1].max() == pytest.approx(5, abs=0.002)
    assert np.abs(points[:, 2]).max() < 0.001
    states = [edge["state"] for edge in floor["polygons"][0]["outer"]["edges"]]
    assert {"measured", "inferred"} <= set(states)


def test_openings_say_their_kind_and_size():
    found = complete(wall_with_openings(), CompletionOptions(texture=False))
    record = polygons_record(found)
    wall = next(surface for surface in record["surfaces"] if surface["role"] == "wall")
    assert [opening["kind"] for opening in wall["openings"]] == ["window", "door"]
    window, door = wall["openings"]
    pixel = 3.0 * found.observations[0].scan.projection.pixel_angle
    assert window["width_m"] == pytest.approx(0.6, abs=3 * pixel)
    assert window["height_m"] == pytest.approx(0.8, abs=3 * pixel)
    assert window["area_m2"] == pytest.approx(0.48, rel=0.15)
    assert door["width_m"] == pytest.approx(0.8, abs=3 * pixel)
    assert door["height_m"] == pytest.approx(1.2, abs=3 * pixel)
    assert np.array(window["points"])[:, 1] == pytest.approx(3.0, abs=1e-6)


def test_a_saw_along_a_guide_becomes_its_line():
    x = np.arange(0, 2, 0.02)
    saw = np.column_stack([x, 1 + 0.03 * (np.arange(len(x)) % 3 == 0)])
    polygon = Polygon([(0, 0), (2, 0), *saw[::-1]])
    everywhere = np.array([[-np.inf, np.inf]])
    top = GuideLine(ChartLine(np.array([0.0, 1.05]), np.array([1.0, 0.0])), everywhere, 0.1)
    side = GuideLine(ChartLine(np.array([2.05, 0.0]), np.array([0.0, 1.0])), everywhere, 0.1)
    found = straighten_polygon(polygon, [top, side], 0.02)
    assert shapely.get_coordinates(found).max(axis=0) == pytest.approx([2.05, 1.05])
    assert len(shapely.get_coordinates(found)) <= 8
    part = GuideLine(top.line, np.array([[0.0, 1.0]]), 0.1)  # beyond its run it says nothing
    assert straighten_polygon(polygon, [part], 0.02).area < found.area
    assert straighten_polygon(polygon, [], 0.02).area == pytest.approx(polygon.area, rel=0.02)
    parallel = GuideLine(ChartLine(np.array([0.0, 1.06]), np.array([1.0, 0.001])), everywhere, 0.1)
    assert straighten_polygon(polygon, [top, parallel], 0.02).is_valid


def test_a_side_that_folds_on_its_guide_leaves_no_slivers():
    """Cells with a ragged end beside a slanted line: moved onto it, their corners go back and forth."""
    rng = np.random.default_rng(0)
    rows, columns = 120, 90
    line = ChartLine(np.array([0.0, 1.6]), np.array([np.cos(0.3), np.sin(0.3)]))
    end = np.array([line.at(np.array(0.02 * k / np.cos(0.3)))[1] for k in range(columns)]) / 0.02
    cells = np.arange(rows)[:, None] < np.rint(end + rng.uniform(-2, 2, columns))
    polygon = shapely.transform(polygons_of_cells(cells, np.zeros((0, 3, 2))).geoms[0], lambda xy: 0.02 * xy)
    guide = GuideLine(line, np.array([[-np.inf, np.inf]]), 0.1)
    found = straighten_polygon(polygon, [guide], 0.02)
    assert found.is_valid
    assert found.area == pytest.approx(polygon.area, rel=0.01)
    assert len(shapely.get_coordinates(found)) <= 12


def test_an_outline_does_not_depend_on_where_its_ring_begins():
    rng = np.random.default_rng(1)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 60))
    places = np.column_stack([2.0 * np.cos(angle), np.sin(angle)]) * rng.uniform(0.97, 1.03, (60, 1))
    first, *others = (
        straighten_polygon(Polygon(np.roll(places, k, axis=0)), [], 0.05) for k in range(0, 60, 7)
    )
    assert len(first.geoms[0].exterior.coords if hasattr(first, "geoms") else first.exterior.coords) < 40
    for other in others:
        assert other.equals(first)
