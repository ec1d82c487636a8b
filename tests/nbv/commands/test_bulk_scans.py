# SPDX-License-Identifier: MIT
"""`unseen scan --poses`: one scan in memory, same bytes whoever scans, parts, and runs that are killed."""

import json
import os
import signal
import subprocess
import sys
import weakref
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from nbv.commands.options.planning import ScanFormat
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor_profile import load_sensor
from nbv.study import bulk
from scenes import builtin_scene
from scenes.io.formats.format import written_suffixes
from scenes.io.poses.trajectory import read_poses, write_poses
from scenes.io.scan_files import read_scan, read_scans, write_scans
from scenes.pose import Pose
from tests.helpers.study_examples import contents
from tests.nbv.commands.test_cli import assert_fails_in_one_line, run, succeed

ROOT = Path(__file__).parents[3]
SCENE, N = "builtin:chair_before_wall", 5
SCANNER = 'like = "phase_terrestrial"\nwidth = 60\nheight = 25\n'
CAMERA = """
kind = "pinhole"
fov_deg = 60
width = 32
height = 24
[noise]
model = "constant"
constant_m = 0.002
"""


@pytest.fixture
def place(tmp_path):
    """A folder with two sensors and five poses."""
    (tmp_path / "scanner.toml").write_text(SCANNER)
    (tmp_path / "camera.toml").write_text(CAMERA)
    at = np.array([[0.4, -1.7, 1.2]]) + 0.1 * np.arange(N)[:, None]
    write_poses(tmp_path / "poses.txt", [Pose.looking_at(point, (0, 0.8, 0.7)) for point in at])
    return tmp_path


def words(place, out, *more, sensor="scanner"):
    """The words of a command that scans from all poses."""
    given = (
        SCENE,
        "--poses",
        place / "poses.txt",
        "--sensor",
        place / f"{sensor}.toml",
        "--noise",
        "profile",
    )
    return ("scan", *given, "-o", place / out, *more)


@pytest.mark.parametrize(
    ("out", "sensor", "more"),
    [
        ("a.e57", "scanner", ()), ("frames", "camera", ()), ("files", "scanner", ("--format", "npz")),
        ("clouds", "scanner", ("--format", "las")),
    ],
)  # fmt: skip
def test_no_scan_is_held_when_the_next_is_taken_or_read(place, monkeypatch, out, sensor, more):
    """Counted by the arrays of ranges that are alive whenever a scan is taken or read."""
    ranges, alive = [], []

    def counted(made):
        def make(*given, **options):
            alive.append(sum(array() is not None for array in ranges))
            scans = made(*given, **options)
            ranges.extend(
                weakref.ref(scan.ranges) for scan in (scans if isinstance(scans, list) else [scans])
            )
            return scans

        return make

    monkeypatch.setattr(bulk, "scan_scene", counted(bulk.scan_scene))
    monkeypatch.setattr(bulk, "read_npz", counted(bulk.read_npz))
    succeed(*words(place, out, *more, sensor=sensor))
    assert len(alive) >= N * (1 if more else 2)
    assert set(alive) == {0}


def test_a_file_of_several_scans_has_the_bytes_of_scans_that_were_all_in_memory(place):
    succeed(*words(place, "a.e57", "--seed", 3))
    scene, sensor = builtin_scene("chair_before_wall"), load_sensor(place / "scanner.toml")
    scans = [
        scan_scene(scene, pose, sensor, noise="profile", rng=np.random.default_rng([3, k]), name=f"view {k}")
        for k, pose in enumerate(read_poses(place / "poses.txt"), start=1)
    ]
    write_scans(scans, place / "b.e57")
    assert (place / "a.e57").read_bytes() == (place / "b.e57").read_bytes()
    assert not list(place.glob(".*"))


@pytest.mark.parametrize("kind", get_args(ScanFormat))
def test_a_folder_has_a_file_a_scan_in_each_format(place, kind):
    succeed(*words(place, "out", "--format", kind))
    files = sorted((place / "out").glob("view-*"))
    assert [file.name for file in files] == [f"view-{k:04d}.{kind}" for k in range(1, N + 1)]
    listed = json.loads((place / "out" / "manifest.json").read_text())["outputs"]
    assert [entry["name"] for entry in listed] == [file.name for file in files]
    for file, pose in zip(files, read_poses(place / "poses.txt"), strict=True):
        np.testing.assert_allclose(read_scan(file).origin, pose.translation, atol=1e-6)


def test_the_formats_are_those_that_scans_are_written_to():
    assert {f".{name}" for name in get_args(ScanFormat)} == set(written_suffixes())


def test_without_a_format_a_scanner_gives_npz_and_a_camera_images(place):
    succeed(*words(place, "scanner"))
    assert len(list((place / "scanner").glob("view-*.npz"))) == N
    succeed(*words(place, "camera", sensor="camera"))
    assert len(read_scans(place / "camera")) == N
    assert len(list((place / "camera" / "depth").iterdir())) == N


def files_in(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


@pytest.mark.parametrize("out", ["whole.e57", pytest.param("files", marks=pytest.mark.long)])
def test_parts_on_any_number_of_threads_and_workers_give_the_same_bytes(place, out):
    """Two parts leave nothing but what the run without a part puts in place, without scanning."""
    more = () if out.endswith("e57") else ("--format", "e57")
    one, other, far = (place / name for name in ("one", "other", "far"))
    for folder in (one, other, far):
        folder.mkdir()
    succeed(*words(place, one / out, *more, "--threads", 1))
    for part, n_scans in (("2/2", 2), ("1/2", 3)):
        told = json.loads(succeed(*words(place, other / out, *more, "--part", part, "--json")).stdout)
        assert (told["scans"], told["scans_of_all_parts"]) == (n_scans, N)
        assert all(any(word[0] == "." for word in file.relative_to(other).parts) for file in files_in(other))
    taken = {file: file.stat().st_mtime_ns for file in other.rglob("scans/*")}
    assert len(taken) == N
    succeed(*words(place, other / out, *more, "--threads", 2))
    succeed(*words(place, far / out, *more, "--scheduler", "local:2"))
    if more:
        moved = {file.stat().st_mtime_ns for file in (other / out).glob("view-*")}
        assert moved == set(taken.values())
    names = [name for name in contents(one) if not name.endswith("manifest.json")]
    assert names == [name for name in contents(far) if not name.endswith("manifest.json")]
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes() == (far / name).read_bytes()


KILL = """
import os, signal, sys
from nbv.cli import app
from nbv.study import bulk

taken, take = [], bulk.scan_scene
def scan(*given, **options):
    taken.append(1)
    if len(taken) > 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return take(*given, **options)
bulk.scan_scene = scan
app(sys.argv[1:])
"""


@pytest.mark.parametrize("out", ["whole.e57", pytest.param("files", marks=pytest.mark.long)])
def test_a_run_that_was_killed_goes_on_and_ends_with_the_same_bytes(place, out):
    more = () if out.endswith("e57") else ("--format", "e57")
    one, other = place / "one", place / "other"
    one.mkdir()
    other.mkdir()
    succeed(*words(place, one / out, *more))
    command = [sys.executable, "-c", KILL, *map(str, words(place, other / out, *more))]
    ended = subprocess.run(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert not list(other.rglob("*.manifest.json")) + list(other.rglob("view-????.e57"))
    kept = {file: file.stat().st_mtime_ns for file in other.rglob("records/*.json")}
    assert len(kept) == 3
    seen = []
    assert bulk.scan_scene is scan_scene
    succeed(*words(place, other / out, *more, "--json"))
    for name in contents(one):
        if not name.endswith("manifest.json"):
            assert (one / name).read_bytes() == (other / name).read_bytes()
            seen.append(name)
    assert seen
    assert not [path for path in other.rglob(".*") if path.name != ".unseen.lock"]
    costs = json.loads(next(other.rglob("*manifest.json")).read_text())["times"]["costs"]
    assert len(costs) == N - len(kept)  # the others were not taken again


def test_other_options_take_other_scans(place):
    """What an unfinished run with another seed left is not taken for this one's."""
    succeed(*words(place, "files", "--part", "1/1"))
    succeed(*words(place, "files", "--seed", 1))
    succeed(*words(place, "alone", "--seed", 1))
    for k in range(1, N + 1):
        one, other = (read_scan(place / out / f"view-{k:04d}.npz") for out in ("files", "alone"))
        np.testing.assert_array_equal(one.ranges, other.ranges)


def test_what_could_not_be_written_is_refused_before_anything_is_scanned(place, monkeypatch):
    monkeypatch.setattr(bulk, "scan_scene", None)
    assert_fails_in_one_line(run(*words(place, "a.ply")), "holds one scan, not 5")
    assert_fails_in_one_line(run(*words(place, "a.abc")), "cannot write scans to .abc")
    assert_fails_in_one_line(run(*words(place, "a.e57", "--format", "e57")), "--format is of the files")
    assert_fails_in_one_line(run(*words(place, "x", "--part", "3/2")), "--part 3/2: give a part")
    (place / "out").mkdir()
    (place / "out" / "view-0009.npz").touch()
    assert_fails_in_one_line(run(*words(place, "out")), "holds 1 scan of another run, view-0009.npz")
    for more in (("--part", "1/2"), ("--format", "e57"), ("--scheduler", "local:2")):
        refused = run("scan", SCENE, "--at", "0,0,1", "--look", "0,1,1", *more)
        assert refused.exit_code == 2
        assert "give --poses FILE" in refused.stderr


def test_one_pose_of_a_file_gives_one_scan_with_truth(place):
    """In parts as well, of which the second has nothing to do."""
    poses = f"{place / 'poses.txt'}#2"
    one = ("scan", SCENE, "--poses", poses, "--sensor", place / "camera.toml", "-o", place / "one.npz")
    for part in ("1/2", "2/2"):
        succeed(*one, "--part", part)
        assert not (place / "one.npz").exists()
    succeed(*one)
    scan = read_scan(place / "one.npz")
    assert scan.name == "view 2"
    assert scan.truth is not None
    assert not list(place.glob(".*"))
