# SPDX-License-Identifier: MIT
"""No room to write: one line that says so, and the result of an earlier run as it was."""

import signal
from contextlib import contextmanager

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from nbv.cli import app
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.study_examples import write_study

resource = pytest.importorskip("resource", reason="limits of files are POSIX")
ROOM = "builtin:two_occluders"
SCAN = ["scan", ROOM, "--sensor", "tiny.toml", "--at", "5,1.5,1.4", "--look", "2,2,0.6"]
PLAN = ["plan", ROOM, "--sensor", "tiny.toml", "--candidates", "few.npz", "--views", "1"]
COMMANDS = {
    **{
        f"scan to {kind}": [*SCAN, "-o", f"scan.{kind}"]
        for kind in ("npz", "e57", "ply", "pcd", "las", "laz", "xyz")
    },
    "plan": [*PLAN, "-o", "plan"],
    "coverage": ["coverage", "--scans", "given.npz", "-o", "coverage"],
    "complete": ["complete", "given.npz", "--export", "obj", "--no-texture", "-o", "completed"],
    "texture": ["texture", "image.png", "--mask", "mask.png", "-o", "filled.png"],
    "study": ["study", "study.toml", "-o", "study"],
    "fit": ["fit", "points.xyz", "--shape", "plane", "-o", "fit.json"],
}
STUDY = """
sampling = {spacing_m = 0.5, subdivisions = 0}
scenes = [{scene = "builtin:two_occluders"}]
sensors = [{sensor = "tiny.toml"}]
planners = [{method = "random", target = 0.3}]
"""
LONG = {"plan", "coverage", "study"}  # what a full disk leaves of a completion stays in the gate
LEAST = {"fit": 300, "texture": 3_000}  # bytes a file may have, such that something can be written


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    folder = tmp_path_factory.mktemp("disk")
    write_study(folder, STUDY)
    view = View(
        Pose.looking_at((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), PinholeSensor(fov_deg=70, width=48, height=36)
    )
    write_scan(
        scan_scene(builtin_scene("two_occluders"), view, noise="gaussian-2mm", rng=0), folder / "given.npz"
    )
    places = np.array([[1.0, 1.0, 1.5], [5.0, 4.0, 1.5]])
    np.savez(folder / "few.npz", positions=places, directions=np.array([[1.0, 1, 0], [-1, -1, -0.3]]))
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 255, (48, 48, 3), np.uint8)).save(folder / "image.png")
    mask = np.zeros((48, 48), np.uint8)
    mask[20:26, 20:26] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    np.savetxt(folder / "points.xyz", rng.normal(size=(50, 3)) * [1, 1, 0.001])
    return folder


@contextmanager
def files_of_at_most(n_bytes):
    """What writes more gets EFBIG, as it would get ENOSPC on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


def contents(folder):
    """All files, hidden ones too, but what a run that did not end keeps to go on from."""
    files = (file.relative_to(folder) for file in folder.rglob("*") if file.is_file())
    return {str(file): (folder / file).read_bytes() for file in files if ".journal" not in file.parts}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in COMMANDS]
)
def test_a_full_disk_leaves_the_old_result(name, here, monkeypatch):
    monkeypatch.chdir(here)
    first = CliRunner().invoke(app, COMMANDS[name])
    assert first.exit_code == 0, first.stderr
    before = contents(here)
    with files_of_at_most(LEAST.get(name, 10_000)):
        second = CliRunner().invoke(app, [*COMMANDS[name], "--seed", "1"])
    assert second.exit_code == 1, second.exception
    assert len(second.stderr.strip().splitlines()) == 1
    assert "cannot write: " in second.stderr
    assert [word for word in ("File too large", "is the disk full?") if word in second.stderr]
    assert before.items() <= contents(here).items()
    assert all(name.startswith("study/plans/") for name in contents(here).keys() - before.keys())


@pytest.mark.long
def test_once_there_is_room_the_run_goes_on(here, monkeypatch):
    monkeypatch.chdir(here)
    words = [*PLAN, "-o", "again"]
    with files_of_at_most(10_000):
        assert CliRunner().invoke(app, words).exit_code == 1
    assert list(here.glob("again/.journal/*.npz"))
    second = CliRunner().invoke(app, words)
    assert second.exit_code == 0, second.stderr
    assert not list(here.glob("again/.*"))
