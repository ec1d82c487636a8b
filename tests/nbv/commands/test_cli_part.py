# SPDX-License-Identifier: MIT
"""`unseen part`: its files, labels, stated relations, meshes, and failures in one line."""

import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from nbv.cli import app
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.io.meshes.ply import read_mesh_ply
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.point_files import read_points
from scenes.io.scan_files import write_scan
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene
from tests.helpers.long_cases import first_in_gate
from tests.helpers.wall_examples import corner_mesh, panelled, wall_mesh

N = 900


def run(*arguments):
    return CliRunner().invoke(app, ["part", *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A corner of three planes with labels, one point missing, and a mesh of a box."""
    here = tmp_path_factory.mktemp("part")
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, 0.1, (3, N, 2))
    points = np.vstack([np.insert(flat[axis], axis, 0.0, axis=1) for axis in range(3)])
    points += rng.normal(0, 1e-4, points.shape)
    label = np.repeat([7, 3, 0], N)
    points[5] = np.nan
    np.savez(here / "corner.npz", points=points)
    np.savez(here / "labelled.npz", points=points, label=label)
    rows = "\n".join(f"{x},{y},{z},{k}" for (x, y, z), k in zip(points, label, strict=True))
    (here / "labelled.csv").write_text("x,y,z,label\n" + rows.replace("nan", "") + "\n")
    trimesh.creation.box((0.1, 0.06, 0.03)).export(here / "box.stl")
    return here


@pytest.fixture(scope="module")
def corner(folder):
    result = run(folder / "corner.npz", "-o", folder / "out", "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), folder / "out"


def test_it_prints_one_object_and_writes_all_files(corner):
    summary, out = corner
    assert summary["surfaces"] == {"plane": 3}
    assert summary["relations"]["accepted"] == 3
    assert summary["free"] == 6
    names = {file.name for file in out.iterdir()}
    assert names == {
        "part.json", "dimensions.csv", "relations.json", "part.ply", "report.html", "manifest.json",
    }  # fmt: skip
    assert "The relations drawn" in (out / "report.html").read_text("utf-8")
    (frame,) = json.loads((out / "relations.json").read_text("utf-8"))["direction_frames"]
    assert (frame["type"], [one["surfaces"] for one in frame["directions"]]) == ("manhattan", [[1], [2], [3]])


@pytest.mark.long
def test_rows_and_mirrors_may_be_stated(folder, corner):
    said = folder / "rows.json"
    said.write_text(json.dumps([{"type": "regular", "surfaces": [1, 2, 3]}]))
    result = run(folder / "corner.npz", "-o", folder / "rows", "--relations", said)
    assert result.exit_code == 0, result.output
    held = json.loads((folder / "rows" / "relations.json").read_text("utf-8"))["relations"]
    (stated,) = (one for one in held if one["given"])
    assert (stated["type"], stated["status"]) == ("regular", "rejected")
    said.write_text(json.dumps([{"type": "symmetric", "surfaces": [1, 2, 3]}]))
    result = run(folder / "corner.npz", "-o", folder / "rows", "--relations", said)
    assert result.exit_code == 1
    assert "symmetric is a relation of pairs of surfaces, two or more, got 3" in result.output


def test_part_ply_holds_every_point_in_order(corner, folder):
    held = read_mesh_ply(corner[1] / "part.ply")
    points = np.load(folder / "corner.npz")["points"]
    np.testing.assert_array_equal(held.vertices, points)
    surface = held.vertex_properties["surface"]
    assert surface[5] == 0
    assert [len(np.unique(surface[k * N + 10 : (k + 1) * N])) for k in range(3)] <= [3, 3, 3]
    assert set(np.unique(surface)) <= {0, 1, 2, 3}


def test_part_json_has_a_surface_a_label_and_relations_json_its_relations(corner):
    part = json.loads((corner[1] / "part.json").read_text())
    assert [one["label"] for one in part["surfaces"]] == [1, 2, 3]
    assert part["noise_m"] == pytest.approx(1e-4, rel=0.3)
    relations = json.loads((corner[1] / "relations.json").read_text())
    assert relations["format"] == "unseen-relations/1"
    assert {one["type"] for one in relations["relations"]} == {"perpendicular"}
    normals = [one["normal"] for one in relations["surfaces"]]
    assert abs(np.dot(normals[0], normals[1])) < 1e-9
    assert relations["degrees_of_freedom"] == {"unknowns": 9, "rank": 3, "free": 6}


@pytest.mark.long
def test_relations_off_leaves_surfaces_as_measured(folder):
    out = folder / "off"
    result = run(folder / "corner.npz", "-o", out, "--json", "--relations", "off")
    assert json.loads(result.stdout)["relations"] is None
    assert not (out / "relations.json").exists()


@pytest.mark.parametrize("file", first_in_gate(1, ["labelled.npz", "labelled.csv"]))
def test_labels_of_the_file_are_kept(folder, file):
    out = folder / f"kept-{file}"
    result = run(folder / file, "-o", out, "--json")
    assert json.loads(result.stdout)["surfaces"] == {"plane": 2}
    part = json.loads((out / "part.json").read_text())
    assert [one["label"] for one in part["surfaces"]] == [3, 7]
    assert part["without_surface"] == N


@pytest.mark.long
def test_labels_can_be_ignored(folder):
    result = run(folder / "labelled.npz", "-o", folder / "anew", "--json", "--ignore-labels")
    assert json.loads(result.stdout)["surfaces"] == {"plane": 3}


def test_a_forbidden_relation_is_not_imposed(folder):
    said = folder / "said.json"
    said.write_text(json.dumps([{"type": "perpendicular", "surfaces": [3, 7], "forbidden": True}]))
    result = run(folder / "labelled.npz", "-o", folder / "said", "--json", "--relations", said)
    assert json.loads(result.stdout)["relations"]["accepted"] == 0


def test_a_mesh_keeps_its_vertices_and_triangles(folder):
    out = folder / "box"
    result = run(folder / "box.stl", "-o", out, "--json")
    assert json.loads(result.stdout)["surfaces"] == {"plane": 6}
    assert len(read_mesh_ply(out / "part.ply").faces) == 12


@pytest.mark.long
def test_the_same_input_gives_the_same_bytes(corner, folder):
    run(folder / "corner.npz", "-o", folder / "again", "--quiet", "--threads", "1")
    for name in ("part.json", "relations.json", "part.ply", "report.html"):
        assert (folder / "again" / name).read_bytes() == (corner[1] / name).read_bytes()


def test_what_is_no_part_is_told_in_one_line(folder):
    np.savez(folder / "nan.npz", points=np.full((9, 3), np.nan))
    (folder / "wrong.json").write_text('[{"type": "parallel", "surfaces": [3, 9]}]')
    for arguments, message in (
        ([folder / "absent.ply"], "no such file"),
        ([folder / "nan.npz"], "holds no finite point"),
        ([folder / "wrong.json"], "cannot read points from .json"),
        ([folder / "labelled.npz", "--relations", folder / "wrong.json"], "there is no surface 9"),
    ):
        result = run(*arguments, "-o", folder / "failed")
        assert result.exit_code == 1
        (line,) = [line for line in result.stderr.splitlines() if ": warning: " not in line]
        assert message in line


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (np.eye(3), "the points lie in 3 places; a surface needs 8"),
        (np.ones((500, 3)), "the points lie in 1 places; a surface needs 8"),
        (np.outer(np.arange(500), [1e-3, 2e-3, 3e-3]), "line"),
    ],
    ids=["few", "one place", "a line"],
)
def test_what_holds_no_surface_says_why(folder, points, reason):
    np.savez(folder / "few.npz", points=points)
    result = run(folder / "few.npz", "-o", folder / "few", "--json")
    found = json.loads(result.stdout)
    assert found["surfaces"] == {}
    assert reason in found["warnings"][0]
    assert reason in result.stderr
    assert "No surface was found" in (folder / "few" / "report.html").read_text()


def test_labels_that_are_none_are_refused_with_their_file(folder):
    (folder / "halves.csv").write_text("x,y,z,label\n" + "0,0,0,0.5\n" * 20)
    result = run(folder / "halves.csv", "-o", folder / "failed")
    assert result.exit_code == 1
    assert "halves.csv: 20 of 20 labels are no whole numbers" in result.stderr


@pytest.fixture(scope="module")
def flat(folder):
    """A wall with ripple, a panel and a switch, its vertices labelled."""
    vertices, faces, labels, _ = wall_mesh(panelled(0))
    write_mesh_ply(folder / "wall.ply", vertices, faces, {"label": labels.astype(np.int32)}, [])
    result = run(folder / "wall.ply", "--flatten", "-o", folder / "flat", "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), folder / "flat"


@pytest.mark.long
def test_flattening_takes_ripple_from_planes_and_leaves_their_relief(flat):
    summary, out = flat
    vertices, faces, _, _ = wall_mesh(panelled(0))
    held = read_mesh_ply(out / "flat.ply")
    np.testing.assert_array_equal(held.faces, faces)
    relief = held.vertex_properties["relief"] == 1
    assert relief.mean() == pytest.approx((28 * 28 + 12 * 8) / len(vertices), abs=0.005)
    plane = held.vertices[~relief]
    assert np.linalg.svd(plane - plane.mean(axis=0), compute_uv=False)[-1] < 1e-9
    moved = np.linalg.norm(held.vertices - vertices, axis=1)
    np.testing.assert_allclose(held.vertex_properties["moved"], moved, atol=1e-6)
    assert summary["flattening"]["turned_over"] == 0
    assert summary["flattening"]["crossing_anew"] == 0


def test_part_json_and_report_tell_what_was_flattened(flat):
    _, out = flat
    part = json.loads((out / "part.json").read_text())
    told = part["surfaces"][0]["flattening"]
    assert told["is_flattened"]
    assert told["ripple_after_m"] < 1e-9 < 1e-3 < told["ripple_before_m"]
    large = [one for one in told["relief"] if one["area_m2"] > 0.005]
    assert len(large) == 2
    assert all(one["p"] < 1e-6 for one in large)
    assert part["flattening"]["relief_points"] > 0
    assert "Flattened" in (out / "report.html").read_text()


def test_without_flattening_nothing_of_it_is_written(corner):
    summary, out = corner
    assert "flattening" not in summary
    assert "flattening" not in (out / "part.json").read_text()
    assert not (out / "flat.ply").exists()


@pytest.mark.long
def test_walls_meet_in_their_crease_when_flattened(folder):
    vertices, faces, labels, _ = corner_mesh(5)
    write_mesh_ply(folder / "walls.ply", vertices, faces, {"label": labels.astype(np.int32)}, [])
    result = run(folder / "walls.ply", "--flatten", "-o", folder / "walls", "--quiet")
    assert result.exit_code == 0, result.output
    held = read_mesh_ply(folder / "walls" / "flat.ply").vertices
    crease = held[np.arange(64) * 80]
    line = crease - crease.mean(axis=0)
    assert np.linalg.svd(line, compute_uv=False)[1] < 1e-9


@pytest.mark.long
def test_points_that_were_left_out_keep_their_places_when_flattened(folder):
    vertices, _, _, _ = wall_mesh(panelled(0))
    order = np.random.default_rng(0).permutation(len(vertices))
    points = vertices[order]
    points[7] = np.nan
    np.savez(folder / "cloud.npz", points=points, label=np.ones(len(points), np.int32))
    result = run(folder / "cloud.npz", "--flatten", "-o", folder / "cloud", "--json")
    assert result.exit_code == 0, result.output
    held = read_mesh_ply(folder / "cloud" / "flat.ply")
    assert np.isnan(held.vertices[7]).all()
    assert len(held.vertices) == len(points)
    known = np.arange(len(points)) != 7
    away = np.linalg.norm(held.vertices - points, axis=1)[known]
    assert 0.001 < np.median(away) < 0.004
    assert 0.1 < held.vertex_properties["relief"].mean() < 0.25


@pytest.mark.parametrize(
    ("file", "reason"),
    [("box.stl", "are too few to tell ripple from relief"), ("ball.stl", "no plane to flatten")],
)
def test_what_cannot_be_flattened_is_told_in_one_line(folder, file, reason):
    trimesh.creation.icosphere(subdivisions=2, radius=0.05).export(folder / "ball.stl")
    result = run(folder / file, "--flatten", "-o", folder / "failed", "--quiet")
    assert result.exit_code == 1
    assert reason in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (folder / "failed" / "flat.ply").exists()


@pytest.fixture(scope="module")
def one_side(tmp_path_factory):
    """A scan of a box of 6 x 4 x 3 cm from above one corner, and what `--backs` makes of it."""
    here = tmp_path_factory.mktemp("one_side")
    mesh = trimesh.creation.box((0.06, 0.04, 0.03))
    labelled = LabelledMesh(mesh.vertices, mesh.faces.astype(np.int32), np.zeros(len(mesh.faces), np.int32))
    scene = Scene(labelled, (None,), ("box",), "box", "object")
    sensor = PinholeSensor(fov_deg=25, width=130, height=130, min_range_m=0.01, max_range_m=1.0)
    view = View(Pose.looking_at([0.14, 0.16, 0.15], [0, 0, 0]), sensor)
    write_scan(scan_scene(scene, view), here / "scan.pcd")
    result = run(here / "scan.pcd", "--noise", "2e-5", "--backs", "-o", here / "out", "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), here / "out"


def test_backs_keeps_measured_and_inferred_apart(one_side):
    summary, out = one_side
    told = json.loads((out / "part.json").read_text("utf-8"))
    backs = told["backs"]
    assert summary["backs"]["told"] == backs["told"]
    assert backs["viewpoints_known"] is True
    assert sum(one["asserted"] for one in backs["hypotheses"]) == 3
    assert {face["state"] for face in backs["faces"]} == {"inferred"}
    assert backs["inferred_m2"] == pytest.approx(0.0054, rel=0.15)
    assert len(told["surfaces"]) == 3
    cloud = read_points(out / "backs.ply")
    measured = read_points(out / "part.ply")
    assert len(cloud.points) > 1.5 * len(measured.points)
    assert np.allclose(cloud.points[: len(measured.points)], measured.points)
    halves = np.array([0.06, 0.04, 0.03]) / 2
    assert np.abs(np.abs(cloud.points) - halves).min(axis=1).max() < 1e-3
    assert "Unseen sides" in (out / "report.html").read_text("utf-8")


def test_least_decides_what_is_inferred_and_one_sentence_says_why_nothing_is(one_side):
    scan = one_side[1].parent / "scan.pcd"
    result = run(scan, "--noise", "2e-5", "--backs", "--least", "1", "-o", scan.parent / "strict")
    assert result.exit_code == 0, result.output
    assert "no unseen side is inferred: the best of" in result.stdout
    assert not (scan.parent / "strict" / "backs.ply").exists()


def test_points_without_scanner_or_sides_are_not_completed(folder):
    result = run(folder / "corner.npz", "--backs", "-o", folder / "no_sides")
    assert result.exit_code == 0, result.output
    assert "neither where the scanner stood nor which side of the surface it saw" in " ".join(
        result.stdout.split()
    )
