# SPDX-License-Identifier: MIT
"""What a newcomer mistakes: one line that says what is wrong, and what to do instead."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from nbv.cli import app
from nbv.commands.texture import read_mask
from nbv.cover.overlap import OverlapOptions
from nbv.plan.planning import plan_views
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene

ROOM = "builtin:two_occluders"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that are not what they are taken for."""
    here = tmp_path_factory.mktemp("files")
    (here / "scan.e57").write_bytes(b"ASTM-E57")
    (here / "scan.npz").write_bytes(b"PK")
    (here / "coverage.json").write_text(json.dumps({"total_m2": 1.0}))
    (here / "room.glb").write_bytes(b"glTF")
    (here / "notes.json").write_text("no plan")
    return here


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        ("plan {0}/scan.e57", "holds a scan or points, not a scene; give scans with --scans"),
        ("coverage {0}/scan.npz --plan x.json", "not a scene; give scans with --scans"),
        (f"complete {ROOM}", f"take a scan of it first: unseen scan {ROOM} --at X,Y,Z --look X,Y,Z"),
        ("complete {0}/room.glb", "simulate a scan with `unseen scan SCENE -o FILE.npz`"),
        (f"coverage {ROOM} --plan {{0}}/coverage.json", "give the plan.json that `unseen plan` wrote"),
        (f"coverage {ROOM} --plan {{0}}/notes.json", "is no valid JSON"),
        (f"coverage {ROOM} --plan {{0}}/absent.json", "{0}/absent.json: no such file"),
        (f"plan {ROOM} --target 95", "write 0.95 for 95 %"),
        (f"plan {ROOM} --sensor absent.toml", "absent.toml: no such file"),
        (f"plan {ROOM} --candidates absent.npz", "absent.npz: no such file"),
        (f"scan {ROOM} --at 1,1,1 --look 3,3,1 -o {{0}}/none/a.npz", "no folder {0}/none; make it first"),
        ("plan builtin:nothing", "there are two_occluders"),
        (f"scan {ROOM} --at 1,1,1 --look 3,3,1 --sensor kinect", "there are azure_kinect"),
        (f"scan {ROOM} --at 1,1,1 --look 3,3,1 --noise gausian-2mm", "gaussian-<n>mm"),
    ],
)  # fmt: skip
def test_unusable_input_ends_in_one_line_with_the_cure(line, cure, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, line.format(folder).split())
    assert result.exit_code == 1
    assert cure.format(folder) in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("line", "cure"),
    [
        (f"plan {ROOM} --overlap 0.3", "--overlap is for plans of a known scene: add --method cover"),
        (f"plan {ROOM} --time-budget 3", "--time-budget is for plans of a known scene: add --method cover"),
        (f"plan {ROOM} --scheduler local:2", "add --method cover"),
        ("plan", "give SCENE, or --scans SCAN"),
        ("plna", "Did you mean 'plan'?"),
        ("coverage --plan plan.json", "give SCENE too"),
        (f"scan {ROOM} --at 1,1 --look 3,3,1", "is not 3 finite numbers with commas"),
        ("texture image.png", "give either --mask MASK or --grow HxW"),
    ],
)
def test_wrong_usage_says_what_goes_together(line, cure, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, line.split())
    assert result.exit_code == 2
    assert cure in result.stderr


def test_overlap_is_asked_of_known_scenes_alone():
    with pytest.raises(InputError, match="method cover, not nbv"):
        plan_views(builtin_scene("two_occluders"), overlap=OverlapOptions(), rng=0)


def test_a_mask_with_a_palette_and_transparency_is_read_without_a_word(tmp_path):
    mask = Image.fromarray(np.eye(6, dtype=np.uint8), "L").convert("P")
    mask.putpalette([0, 0, 0, 255, 255, 255])
    mask.save(tmp_path / "mask.png", transparency=bytes([0, 128]))
    assert np.array_equal(read_mask(str(tmp_path / "mask.png")), np.eye(6) > 0)


@pytest.mark.parametrize("command", ["plan", "coverage"])
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--heights -1", "--heights are above the floor, metres, got -1"),
        ("--heights nan", "'nan' is not 1 finite numbers"),
        ("--rooms 0", "--rooms takes all, connected, or whole numbers from 1, got 0"),
        ("--rooms 1.5", "whole numbers from 1, got 1.5"),
        ("--spacing 0", "Invalid value for '--spacing'"),
        ("--spacing inf", "--spacing is a finite number of metres, got inf"),
        ("--clearance nan", "Invalid value for '--clearance'"),
        ("--clearance inf", "--clearance is a finite number of metres, got inf"),
    ],
)
def test_options_of_where_to_stand_are_checked_before_anything_is_read(command, options, said, tmp_path):
    line = f"{command} {ROOM} --plan absent.json" if command == "coverage" else f"{command} {ROOM}"
    result = CliRunner().invoke(app, [*line.split(), *options.split(), "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert said in " ".join(result.stderr.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("start", ["1", "1,x", "nan,1", "1,2,3,4", "1,inf"])
def test_a_start_is_two_or_three_numbers(start, tmp_path):
    result = CliRunner().invoke(app, ["plan", ROOM, "--start", start, "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert f"'{start}' is not" in " ".join(result.stderr.split())


@pytest.mark.parametrize(
    ("options", "cure"),
    [
        ("--start 40,40", "--start 40,40 is no place for a station"),
        ("--start 1,4 --candidates {0}", "leave --start out"),
        ("--start 1,4 --mode object", "leave --start out"),
        ("--start 1,4 --method cover --overlap 0.3", "leave --start out"),
    ],
)
def test_a_start_that_cannot_be_is_refused_in_one_line(options, cure, tmp_path):
    file = tmp_path / "candidates.npz"
    np.savez(file, positions=np.array([[1.0, 1.0, 1.6]]), directions=np.eye(3))
    line = ["plan", ROOM, *options.format(file).split(), "--sensor", "panorama", "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, line)
    assert result.exit_code == 1
    assert cure in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_more_positions_than_can_be_tried_end_at_once_and_name_the_spacing(tmp_path):
    result = CliRunner().invoke(app, ["plan", ROOM, "--spacing", "0.01", "-o", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "--spacing 0.01 puts about" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("command", ["complete", "register", "part"])
def test_a_refused_file_leaves_no_folder_behind(command, tmp_path):
    bad = tmp_path / "bad.e57"
    bad.write_text("no scan")
    assert CliRunner().invoke(app, [command, str(bad), "-o", str(tmp_path / "out")]).exit_code == 1
    assert not (tmp_path / "out").exists()
    there = tmp_path / "there"
    there.mkdir()
    (there / "mine.txt").touch()
    assert CliRunner().invoke(app, [command, str(bad), "-o", str(there)]).exit_code == 1
    assert [path.name for path in there.iterdir()] == ["mine.txt"]
