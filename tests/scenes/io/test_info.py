# SPDX-License-Identifier: MIT
"""`unseen info` on anything: points, poses, images, what unseen writes, and a plain word on the rest."""

import json

import numpy as np
import pytest
from PIL import Image

from nbv.commands.info import describe_output, read_record
from scenes.checks import InputError
from scenes.io.checks.limits import limits
from scenes.io.describe import describe
from scenes.io.scan_files import write_scan
from tests.helpers.scan_examples import PROJECTIONS, example_scan
from tests.nbv.commands.test_cli import TINY, assert_fails_in_one_line, run, succeed

ROOM = "builtin:two_occluders"


def info(path, *more):
    """What `unseen info --json` says; the table is there as well."""
    said = json.loads(succeed("info", path, *more, "--json").stdout)
    table = succeed("info", path, *more).stdout
    assert str(said["kind"]) in table
    for warning in said["warnings"]:
        assert f"warning: {warning}" in table
    return said


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A sensor, a plan with its coverage, a scan and its completion."""
    folder = tmp_path_factory.mktemp("written")
    sensor = folder / "tiny.toml"
    sensor.write_text(TINY)
    plan = ("--sensor", sensor, "--views", 2, "--method", "cover", "--polish-steps", 0)
    positions = np.array([[3.0, 1.0, 1.6], [1.0, 4.0, 1.0], [5.0, 1.0, 1.0]])
    np.savez(folder / "candidates.npz", positions=positions, directions=np.vstack([np.eye(3), -np.eye(3)]))
    succeed("plan", ROOM, *plan, "--candidates", folder / "candidates.npz", "-o", folder / "plan", "-q")
    succeed("coverage", ROOM, "--plan", folder / "plan" / "plan.json", "-o", folder / "coverage", "-q")
    aim = ("--at", "0.4,0.4,1.7", "--look", "4,3,0.8", "--sensor", sensor)
    succeed("scan", ROOM, *aim, "-o", folder / "scan.npz", "-q")
    exports = ("--no-texture", "--export", "obj", "--export", "e57", "--export", "obj")
    succeed("complete", folder / "scan.npz", *exports, "-o", folder / "completed", "-q")
    return folder


@pytest.mark.long
def test_a_plan_and_what_lies_beside_it(written):
    plan = info(written / "plan" / "plan.json")
    assert (plan["kind"], plan["views"], plan["sensor"], plan["method"]) == ("plan", 2, "tiny", "cover")
    assert plan["requirement"]["max_incidence_deg"] == 60
    assert info(written / "plan" / "stations.json")["stations"] == 2
    assert info(written / "plan" / "coverage.json")["met"] == pytest.approx(plan["coverage"]["met"])
    assert info(written / "plan" / "plan.csv")["stations"] == 2
    assert info(written / "plan" / "trajectory.txt")["poses"] == 2
    assert info(written / "plan" / "manifest.json")["command"] == "plan"
    assert info(written / "plan" / "report.html")["kind"] == "report"


def test_an_output_folder_gives_its_summary(written):
    folder = info(written / "plan")
    assert (folder["kind"], folder["command"], folder["plan"]["views"]) == ("output folder", "plan", 2)
    assert folder["inputs"][0] == ROOM
    assert folder["warnings"] == []
    completed = info(written / "completed")
    assert completed["completion"]["hypothesised_m2"] > 0
    assert set(completed["outputs"]) >= {"completed.obj", "completed.e57", "polygons.json"}


@pytest.mark.long
def test_stations_whose_overlaps_nobody_asked_after_are_told_without(written, tmp_path):
    plan = ("--sensor", written / "tiny.toml", "--views", 1, "--method", "nbv")
    succeed("plan", ROOM, *plan, "-o", tmp_path / "plan", "-q")
    stations = info(tmp_path / "plan")["stations"]
    assert stations["stations"] == 1
    assert "overlaps" not in stations


def test_json_of_ours_is_told_by_its_manifest_alone(written, tmp_path):
    content = (written / "plan" / "plan.json").read_bytes()
    (tmp_path / "plan.json").write_bytes(b'{"views": 3}')
    assert_fails_in_one_line(run("info", tmp_path / "plan.json"), "plan.json: is JSON without its manifest")
    (tmp_path / "coverage.json").write_bytes((written / "plan" / "coverage.json").read_bytes())
    assert_fails_in_one_line(run("info", tmp_path / "coverage.json"), "is JSON without its manifest")
    (tmp_path / "manifest.json").write_bytes((written / "plan" / "manifest.json").read_bytes())
    (tmp_path / "plan.json").write_bytes(content)
    assert info(tmp_path / "plan.json")["kind"] == "plan"
    (tmp_path / "other.json").write_bytes(content)
    assert info(tmp_path / "other.json")["kind"] == "poses"
    np.savetxt(tmp_path / "plane.xyz", np.random.default_rng(0).random((50, 3)) * [1, 1, 0.01])
    succeed("fit", tmp_path / "plane.xyz", "--shape", "plane", "-o", tmp_path / "any.json", "-q")
    assert info(tmp_path / "any.json")["shape"] == "plane"


def test_missing_and_changed_outputs_are_warned_of(written, tmp_path):
    for name in ("manifest.json", "coverage.json", "coverage.csv"):
        (tmp_path / name).write_bytes((written / "coverage" / name).read_bytes())
    (tmp_path / "coverage.csv").write_text("id,name,area_m2\n")
    warnings = info(tmp_path)["warnings"]
    assert "coverage.ply is missing" in warnings
    assert "coverage.csv was changed since it was written" in warnings


def test_a_completion_and_its_meshes(written):
    record = info(written / "completed" / "completion.json")
    inferred = info(written / "completed" / "hypothesised.ply")
    assert inferred["kind"] == "inferred surface"
    assert inferred["area_m2"] == pytest.approx(record["hypothesised_m2"], rel=1e-6)
    assert inferred["warnings"] == ["nobody measured this surface: it was inferred"]
    assert "measured" not in inferred["provenance"]
    measured = info(written / "completed" / "observed.ply")
    assert set(measured["provenance"]) == {"measured"}
    model = info(written / "completed" / "completed.glb", "--up", "y")
    assert model["parts"]["hypothesised"] > 0
    assert "nobody measured them" in model["warnings"][0]
    assert info(written / "completed" / "completed.obj")["parts"] == model["parts"]
    assert info(written / "completed" / "polygons.json")["surfaces"]["floor"] == 1
    scans = info(written / "completed" / "completed.e57")
    assert (scans["kind"], scans["count"]) == ("scan", 1)


def test_coverage_candidates_and_sensors(written):
    assert info(written / "coverage" / "coverage.csv")["kind"] == "table of coverage"
    assert info(written / "coverage" / "coverage.ply")["kind"] == "coverage mesh"
    candidates = info(written / "candidates.npz")
    assert (candidates["positions"], candidates["directions"], candidates["poses"]) == (3, 6, 18)
    sensor = info(written / "tiny.toml")
    assert (sensor["kind"], sensor["name"]) == ("sensor", "tiny")
    assert info(written / "scan.npz")["kind"] == "scan"


def test_points_poses_and_images(tmp_path):
    np.savetxt(tmp_path / "a.xyz", np.random.default_rng(0).random((50, 3)))
    points = info(tmp_path / "a.xyz")
    assert (points["kind"], points["points"], points["scanner_places_m"]) == ("points", 50, [])
    assert "--origin X,Y,Z" in points["warnings"][0]
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / "b.csv")
    assert info(tmp_path / "b.csv")["kind"] == "scan"
    np.savez(tmp_path / "c.npz", points=np.eye(3))
    assert info(tmp_path / "c.npz")["points"] == 3
    np.savez(tmp_path / "d.npz", rows=np.zeros((2, 5), np.int32))
    assert info(tmp_path / "d.npz")["arrays"] == {"rows": ["int32", 2, 5]}
    Image.fromarray(np.full((4, 6, 3), 9, np.uint8)).save(tmp_path / "e.png")
    assert info(tmp_path / "e.png")["width"] == 6
    depth = np.arange(1, 25, dtype=np.uint16).reshape(4, 6) * 100
    Image.fromarray(depth).save(tmp_path / "f.png")
    said = info(tmp_path / "f.png")
    assert (said["kind"], said["counts"]["max"]) == ("depth image", 2400)
    assert said["depth"][0] == "median 1.25 m if millimetres (Kinect, RealSense)"
    Image.fromarray(depth * 0).save(tmp_path / "g.png")
    assert info(tmp_path / "g.png")["warnings"] == ["no pixel holds a depth"]
    (tmp_path / "images.txt").write_text("1 1 0 0 0 1 2 3 1 a.png\n\n")
    assert "COLMAP" in info(tmp_path / "images.txt")["warnings"][0]
    (tmp_path / "camera.json").write_text('{"fx": 1, "fy": 1, "cx": 0, "cy": 0}')
    assert info(tmp_path / "camera.json")["kind"] == "camera"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("LICENSE", b"words", "LICENSE: is text, of no kind that is known here; known: meshes"),
        ("a.doc", b"\0\1", "is binary, of no kind"),
        ("a.zip", b"PK\3\4", "is an archive; unpack it first"),
        ("a.pdf", b"%PDF-1.4", "is a PDF"),
        ("a.xml", b"<?xml", "is XML"),
        ("a.json", b'{"a": 1}', "a.json: is JSON without its manifest, of no kind that is known here"),
        ("b.json", b"[1,", "b.json: is no valid JSON"),
        (
            "c.json",
            b'{"command": 1, "versions": 2, "outputs": 3}',
            "c.json: looks like a file of unseen, but",
        ),
        (
            "a.txt",
            b"some words\n",
            "a.txt: is text that holds neither poses nor points: no point in its first",
        ),
        ("a.toml", b"kind = 3", "a.toml: "),
        ("a.png", b"no image", "a.png: is no image that is known"),
        ("a.csv", b"id;b\n", "a.csv: is text that holds neither poses nor points"),
        ("a.html", b"<html>", "is text, of no kind"),
        ("empty.xyz", b"", "empty.xyz: is empty"),
        ("a.e57", b"nothing", "a.e57: not an E57 file"),
    ],
)
def test_what_is_not_known_gets_a_plain_sentence(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    assert_fails_in_one_line(run("info", tmp_path / name), words)


def test_folders_that_are_nothing_are_refused(tmp_path):
    assert_fails_in_one_line(run("info", tmp_path), "is not an RGB-D folder")
    (tmp_path / "manifest.json").write_text("{}")
    assert_fails_in_one_line(run("info", tmp_path), "manifest.json: is no manifest of unseen")


def test_huge_records_and_archives_are_refused(tmp_path):
    (tmp_path / "a.json").write_text("[1, 2, 3, 4]")
    assert read_record(tmp_path / "a.json") is None
    with limits(json_bytes=4), pytest.raises(InputError, match="exceed the limit json_bytes=4"):
        read_record(tmp_path / "a.json")
    np.savez(tmp_path / "a.npz", a=np.zeros(100))
    with limits(unpacked_bytes=10), pytest.raises(InputError, match="exceed the limit unpacked_bytes=10"):
        describe_output(tmp_path / "a.npz")


def test_lengths_of_poses_follow_the_unit(tmp_path):
    (tmp_path / "a.txt").write_text("0 0 0 0 0 0 1\n1000 0 0 0 0 0 1\n")
    assert describe(tmp_path / "a.txt", units="mm")["way_m"] == pytest.approx(1)


@pytest.mark.parametrize("suffix", [".ptx", ".csv", ".xyz", ".pcd", ".ply", ".las"])
def test_scans_damaged_inside_are_one_line(tmp_path, suffix):
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / f"a{suffix}")
    data = bytearray((tmp_path / f"a{suffix}").read_bytes())
    for place in range(300, len(data), 97):
        data[place] = ord("?")
    (tmp_path / f"a{suffix}").write_bytes(data)
    result = run("info", tmp_path / f"a{suffix}")
    if result.exit_code:
        assert_fails_in_one_line(result, f"a{suffix}: ")
