# SPDX-License-Identifier: MIT
"""Studies of scans: errors against closed forms, and runs that go on where they stopped."""

import csv
import json

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

from nbv.cli import app
from nbv.report.scan_study_report import scan_study_page
from nbv.scanning.beam import Footprint
from nbv.scanning.effects import Effects
from nbv.scanning.noise_models import ConstantNoise
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.study.scan_errors import CLASSES, ErrorTally, merged, tally_errors
from nbv.study.scan_results import scan_results
from nbv.study.scans import run_scan_study, sets_of
from nbv.study.spec import ScanStudySpec, read_study
from scenes.checks import InputError
from scenes.io.scan_files import read_scan
from scenes.pose import Pose
from scenes.world.scene import Scene
from tests.helpers.study_examples import contents

SIGMA = 0.002
SENSOR = PinholeSensor(
    fov_deg=70, width=120, height=120, effects=Effects(noise=ConstantNoise(constant_m=SIGMA))
)
STUDY = """
[study]
kind = "scans"
complete = true
[[scenes]]
scene = "builtin:two_occluders"
spacing_m = 0.2
[[sensors]]
sensor = "small.toml"
noise = "profile"
[[poses]]
name = "corners"
at = [[0.7, 0.7, 1.5], [3.0, 2.5, 1.5]]
look = [2.0, 2.0, 0.8]
[[poses]]
farthest = 2
[[requirements]]
max_incidence_deg = 60
[[requirements]]
max_incidence_deg = 80
k = 2
"""
SMALL = """
kind = "pinhole"
fov_deg = 70
width = 48
height = 48
[noise]
model = "constant"
constant_m = 0.003
"""


def plates(*boxes):
    """A scene of axis-aligned rectangles: x and y from and to, and z."""
    corners = [
        [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]] for x0, x1, y0, y1, z in boxes
    ]  # fmt: skip
    faces = np.array([[[0, 1, 2], [0, 2, 3]]]) + 4 * np.arange(len(boxes))[:, None, None]
    return Scene.from_mesh((np.reshape(corners, (-1, 3)).astype(float), faces.reshape(-1, 3)), mode="object")


def sphere():
    """A finely faceted sphere of 1 m."""
    from trimesh.creation import icosphere

    return Scene.from_mesh(icosphere(subdivisions=4, radius=1.0), mode="object")


@pytest.mark.parametrize("scene", [plates((-9, 9, -9, 9, 0.0)), sphere()], ids=["plane", "sphere"])
def test_errors_are_those_of_the_closed_form(scene):
    """Range noise of sd s is s cos(incidence) across a surface, in each class within 3 se."""
    scan = scan_scene(
        scene, Pose.looking_at([0, 0, 2.5], [0, 0, 0], up=[0, 1, 0]), SENSOR, noise="profile", rng=0
    )
    tallies = tally_errors(scan, scene, SENSOR, SENSOR.effects)
    cosine = np.cos(scan.truth.incidence)
    degrees, compared = np.degrees(scan.truth.incidence), 0
    limits = CLASSES["incidence_deg"]
    for low, high, row in zip(limits[:-1], limits[1:], tallies["incidence_deg"].rows(), strict=True):
        sd = SIGMA * cosine[scan.valid & (degrees >= low) & (degrees < high)]
        n = len(sd)
        if n < 100:
            continue
        compared += 1
        assert row["points"] == n
        together = np.sqrt(np.mean(sd**2))
        assert abs(row["bias_m"]) < 3 * together / np.sqrt(n)
        assert row["sd_m"] == pytest.approx(
            together, abs=3 * together * np.sqrt(np.mean(sd**4) / together**4 * 0.75 / n)
        )
        below = np.mean(2 * norm.cdf(row["p95_m"] / sd) - 1)
        assert below == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / n) + 0.001)
        assert row["mixed_share"] == row["lost_share"] == 0
    assert compared >= 3


def test_mixed_pixels_of_a_step_are_those_whose_beam_meets_both_sides():
    """Beams of 24 mm across, 10 mm apart, over a step of half a metre: two columns meet both plates."""
    beam = Footprint(divergence_rad=0.0, exit_diameter_m=0.024, returns="mean", range_resolution_m=0.0)
    width = 80
    fov = 2 * np.degrees(np.arctan(0.005 * width / 2.0))
    sensor = PinholeSensor(fov_deg=fov, width=width, height=width, effects=Effects(footprint=beam))
    scene = plates((-3, 0, -3, 3, 0.0), (0, 3, -3, 3, -0.5))
    scan = scan_scene(
        scene, Pose.looking_at([0, 0, 2.0], [0, 0, 0], up=[0, 1, 0]), sensor, noise="profile", rng=0
    )
    columns = np.tan(np.radians(fov / 2)) * 2.0 * (np.arange(width) + 0.5 - width / 2) / (width / 2)
    straddle = int((np.abs(columns) < 0.012).sum())
    tally = tally_errors(scan, scene, sensor, sensor.effects)["edge_px"]
    assert straddle == 2
    assert tally.counts[:, 1].tolist() == [straddle * width, 0, 0, 0]
    assert max(row["p95_m"] for row in tally.rows() if row["points"]) < 1e-4


def test_lost_pixels_are_those_that_met_surface_within_reach():
    sensor = PinholeSensor(fov_deg=60, width=40, height=40, min_range_m=0.1, max_range_m=2.2)
    scene = plates((-9, 9, -9, 9, 0.0))
    scan = scan_scene(scene, Pose.looking_at([0, 0, 2.0], [0, 0, 0], up=[0, 1, 0]), sensor)
    tally = tally_errors(scan, scene, sensor, Effects())["all"]
    assert tally.counts[0].tolist() == [int(scan.valid.sum()), 0, 0]
    with pytest.raises(InputError, match="only a scan with truth"):
        tally_errors(scan_scene(scene, Pose.identity(), sensor, truth=False), scene, sensor, Effects())


def test_tallies_add_up_whatever_the_parts():
    rng = np.random.default_rng(0)
    error, which = rng.normal(0, SIGMA, 5000), rng.integers(-1, 3, 5000)
    no = np.zeros(5000, np.bool_)
    whole = ErrorTally.of(which, 3, error, mixed=no, lost=no)
    parts = [
        {"one": ErrorTally.of(which[part], 3, error[part], mixed=no[part], lost=no[part])}
        for part in np.array_split(np.arange(5000), 7)
    ]
    total = merged(parts)["one"]
    again = ErrorTally.from_json(json.loads(json.dumps(total.to_json())))
    np.testing.assert_array_equal(again.counts, whole.counts)
    np.testing.assert_array_equal(again.sizes, whole.sizes)
    np.testing.assert_allclose(again.sums, whole.sums)
    for k, row in enumerate(whole.rows()):
        mine = error[which == k]
        assert row["points"] == len(mine)
        assert row["sd_m"] == pytest.approx(np.std(mine, ddof=1))
        assert row["p95_m"] == pytest.approx(np.quantile(np.abs(mine), 0.95), rel=0.02)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    (folder / "small.toml").write_text(SMALL, "utf-8")
    (folder / "study.toml").write_text(STUDY, "utf-8")
    return folder / "study.toml"


def test_a_study_of_scans_goes_on_where_it_stopped(file, tmp_path):
    out = tmp_path / "out"
    run = CliRunner().invoke(app, ["study", str(file), "-o", str(out), "--json"])
    assert run.exit_code == 0, run.output
    rows = list(csv.DictReader((out / "results.csv").read_text("utf-8").splitlines()))
    assert [(row["poses"], row["requirement"]) for row in rows] == [
        (poses, asked)
        for poses in ("corners", "2 farthest")
        for asked in ("60° incidence or less", "2 views, 80° incidence or less")
    ] or len(rows) == 4
    for row in rows:
        shares = [float(row[name]) for name in ("met", "modelled", "inferred", "unknown")]
        assert sum(shares) == pytest.approx(1)
        assert 0.001 < float(row["sd_m"]) < 0.003
        assert float(row["met"]) <= float(row["seen"])
    scans = list(csv.DictReader((out / "scans.csv").read_text("utf-8").splitlines()))
    assert len(scans) == 8
    before = contents(out)
    records = sorted((out / "records").iterdir())
    records[0].unlink()
    records[-1].write_text("{", "utf-8")
    again = CliRunner().invoke(app, ["study", str(file), "-o", str(out), "--json", "--threads", "2"])
    assert again.exit_code == 0, again.output
    assert contents(out) == before


def test_parts_do_each_case_once_and_the_whole_finds_them(file, tmp_path):
    """Two parts leave all records; the run that follows scans nothing and has the bytes of one alone."""
    out, alone = tmp_path / "out", tmp_path / "alone"
    for part in ("1/2", "2/2"):
        told = CliRunner().invoke(app, ["study", str(file), "-o", str(out), "--part", part, "--json"])
        assert told.exit_code == 0, told.output
        assert json.loads(told.output)["cases"] == 3
        assert not (out / "results.csv").exists()
    written = {path: path.stat().st_mtime_ns for path in (out / "records").iterdir()}
    assert len(written) == 6
    for folder in (out, alone):
        assert CliRunner().invoke(app, ["study", str(file), "-o", str(folder), "--quiet"]).exit_code == 0
    assert {path: path.stat().st_mtime_ns for path in (out / "records").iterdir()} == written
    assert contents(out) == contents(alone)


@pytest.mark.parametrize("text", ["0/2", "3/2", "2", "a/b", "1/0"])
def test_a_part_that_is_none_is_told(file, tmp_path, text):
    told = CliRunner().invoke(app, ["study", str(file), "-o", str(tmp_path / "out"), "--part", text])
    assert told.exit_code == 1
    assert f"--part {text}: give a part" in told.output


def test_scans_that_are_kept_are_those_of_the_command(file, tmp_path):
    """They are those of `unseen scan --poses` with the same seed; one that is gone is taken anew."""
    spec = read_study(file)
    kept = spec.model_copy(update={"keep": "npz", "complete": False, "poses": spec.poses[:1]})
    found = run_scan_study(kept, tmp_path)
    files = [case.file for one in found for case in one.scans.scans]
    first = read_scan(files[0])
    files[0].unlink()
    run_scan_study(kept, tmp_path)
    np.testing.assert_array_equal(read_scan(files[0]).ranges, first.ranges)
    poses = tmp_path / "poses.json"
    poses.write_text(
        json.dumps([np.array(case.true_pose).tolist() for case in found[0].scans.scans]), "utf-8"
    )
    arguments = ["scan", "builtin:two_occluders", "--poses", f"{poses}#1", "--sensor",
                 str(file.parent / "small.toml"), "--noise", "profile", "-o",
                 str(tmp_path / "one.npz")]  # fmt: skip
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(read_scan(tmp_path / "one.npz").ranges, first.ranges, rtol=1e-12)


def test_scans_said_to_be_elsewhere_have_errors_as_large(file, tmp_path):
    """Of scans placed 5 cm off in each axis the bias of single scans is of that size."""
    spec = read_study(file).model_copy(update={"pose_sd_m": 0.05, "complete": False, "seeds": (0, 1)})
    sets = sets_of(spec, tmp_path)
    off = [np.subtract(case.pose, case.true_pose)[:3, 3] for one in sets for case in one.scans]
    assert 0.02 < np.std(off) < 0.09
    assert len({case.key for one in sets for case in one.scans}) == 8


AROUND = """
kind = "spherical"
elevation_min_deg = -60.0
elevation_max_deg = 90.0
width = 360
height = 150
[noise]
model = "constant"
constant_m = 0.001
"""
REGISTERED = """
[study]
kind = "scans"
register = true
pose_sd_m = 0.05
pose_sd_deg = 1.0
[[scenes]]
scene = "builtin:two_occluders"
spacing_m = 0.5
[[sensors]]
sensor = "around.toml"
noise = "profile"
[[poses]]
at = [[0.7, 0.7, 1.5], [3.0, 0.8, 1.5], [5.2, 4.2, 1.5]]
look = [2.0, 2.0, 0.8]
"""


def test_registered_scans_are_compared_with_the_truth(tmp_path):
    """Scans said to be 9 cm and 1.7 deg off are brought together to millimetres, and that is told."""
    (tmp_path / "around.toml").write_text(AROUND, "utf-8")
    (tmp_path / "study.toml").write_text(REGISTERED, "utf-8")
    spec = read_study(tmp_path / "study.toml")
    (result,) = scan_results(spec, run_scan_study(spec, tmp_path))
    assert result.row["placed"] == 3
    assert 0 < result.row["pose_shift_m"] < 0.005
    assert 0 < result.row["pose_turn_deg"] < 0.2
    assert result.row["modelled"] == 0.0  # not asked for
    page, _ = scan_study_page(spec, (result,), "a study")
    assert "Registered" in str(page)
    assert "3 of 3" in str(page)


@pytest.mark.parametrize(
    ("poses", "why"),
    [
        ("farthest = 0", "greater than or equal to 1"),
        ("at = [0, 0, 1]", "look is one place"),
        ("at = [0, 0, 1]\nlook = [0, 0, 1]", "same place"),
        ("name = 'x'", "give one of file"),
        ("at = [0, 0, 1]\nlook = [1, 0, 1]\nfarthest = 2", "give one of file"),
    ],
)
def test_poses_that_cannot_be_are_named(tmp_path, poses, why):
    text = f'kind = "scans"\n[[scenes]]\nscene = "builtin:office"\n[[poses]]\n{poses}\n'
    (tmp_path / "study.toml").write_text(text, "utf-8")
    with pytest.raises(InputError, match=why) as error:
        read_study(tmp_path / "study.toml")
    assert "poses[0]" in str(error.value)


def test_a_study_of_scans_needs_poses(tmp_path):
    (tmp_path / "study.toml").write_text('kind = "scans"\n[[scenes]]\nscene = "builtin:office"\n', "utf-8")
    with pytest.raises(InputError, match="poses"):
        read_study(tmp_path / "study.toml")
    assert ScanStudySpec.model_fields["keep"].default == "none"


@pytest.mark.parametrize(
    ("head", "why"),
    [
        ('kind = "scan"', "a study is of plans or of scans, not of 'scan'"),
        ("study = 3", "study: there is no such"),
    ],
)
def test_what_is_no_kind_of_study_is_told(tmp_path, head, why):
    text = f'{head}\n[[scenes]]\nscene = "builtin:office"\n[[planners]]\nmethod = "nbv"\n'
    (tmp_path / "study.toml").write_text(text, "utf-8")
    with pytest.raises(InputError, match=why):
        read_study(tmp_path / "study.toml")


def test_scans_without_returns_are_told(file, tmp_path):
    text = STUDY.replace("complete = true", "").replace("[[0.7, 0.7, 1.5], [3.0, 2.5, 1.5]]", "[1e6, 1, 1]")
    text = text.replace("[2.0, 2.0, 0.8]", "[1e6, 2, 1]").replace("[[poses]]\nfarthest = 2\n", "")
    (file.parent / "far.toml").write_text(text, "utf-8")
    told = CliRunner().invoke(app, ["study", str(file.parent / "far.toml"), "-o", str(tmp_path / "out")])
    assert told.exit_code == 0, told.output
    assert "1 scan has no returns" in told.output
