# SPDX-License-Identifier: MIT
"""`unseen part --export step` and `part.export`: the same file, or one line that says why there is none."""

import json
import sys

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from completion import model_part
from completion.export.step import kernel as kernel_file
from nbv.cli import app
from scenes.checks import InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from tests.helpers.step_examples import box, drilled

SIZE = (0.018, 0.012, 0.008)


def run(*arguments):
    return CliRunner().invoke(app, ["part", *(str(argument) for argument in arguments)])


@pytest.fixture(scope="module")
def points():
    return np.concatenate([own for _, own in box(SIZE)])


@pytest.fixture(scope="module")
def file(points, tmp_path_factory):
    path = tmp_path_factory.mktemp("step") / "block.npz"
    np.savez(path, points=points)
    return path


@pytest.fixture
def without_kernel(monkeypatch):
    """As where the optional package is not installed."""
    monkeypatch.setitem(sys.modules, "OCP", None)
    monkeypatch.setattr(kernel_file, "_loaded", {})


def test_the_command_writes_what_python_exports(file, points, tmp_path):
    pytest.importorskip("OCP", reason='OCP is not installed: pip install "unseen[step]"')
    done = run(file, "--export", "step", "-o", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)["step"]
    assert told["solid"] is True
    assert told["valid"] is True
    assert told["reason"] is None
    assert told["volume_m3"] == pytest.approx(np.prod(SIZE), rel=1e-6)
    assert json.loads((tmp_path / "out/part.json").read_text("utf-8"))["step"] == told
    assert json.loads((tmp_path / "out/manifest.json").read_text("utf-8"))["options"]["step"] == told
    assert json.loads(done.stdout)["features"] == []
    assert not (tmp_path / "out/part.features.step").exists()
    model_part(points).export(tmp_path / "block.step")
    assert (tmp_path / "block.step").read_bytes() == (tmp_path / "out/part.step").read_bytes()


def test_features_are_in_the_summary_and_their_tree_is_that_of_python(tmp_path):
    pytest.importorskip("OCP", reason='OCP is not installed: pip install "unseen[step]"')
    points = np.concatenate([own for _, own in drilled(SIZE, 0.003)])
    np.savez(tmp_path / "drilled.npz", points=points)
    done = run(tmp_path / "drilled.npz", "--export", "step", "-o", tmp_path / "out", "--json")
    assert done.exit_code == 0, done.output
    (hole,) = json.loads(done.stdout)["features"]
    assert (hole["name"], hole["size"]) == ("hole 1", "diameter 6.00 mm, through")
    assert json.loads((tmp_path / "out/part.json").read_text("utf-8"))["features"] == [hole]
    model_part(points).export(tmp_path / "drilled.step")
    for name in ("part.step", "part.features.step"):
        own = (tmp_path / name.replace("part", "drilled")).read_bytes().replace(b"'drilled'", b"'part'")
        assert own == (tmp_path / "out" / name).read_bytes().replace(b"'drilled'", b"'part'")
    told = run(tmp_path / "drilled.npz", "-o", tmp_path / "again").output
    assert "features   1 hole\n" in told


def test_a_mesh_of_few_triangles_is_a_solid(tmp_path):
    pytest.importorskip("OCP", reason='OCP is not installed: pip install "unseen[step]"')
    held = trimesh.creation.box(SIZE)
    part = model_part(LabelledMesh(np.asarray(held.vertices), np.asarray(held.faces, dtype=np.int32)))
    assert part.export(tmp_path / "box.stp") == [tmp_path / "box.stp"]
    assert b"MANIFOLD_SOLID_BREP" in (tmp_path / "box.stp").read_bytes()


def test_a_part_without_surfaces_is_refused_in_one_line(tmp_path):
    pytest.importorskip("OCP", reason='OCP is not installed: pip install "unseen[step]"')
    np.savez(tmp_path / "few.npz", points=np.random.default_rng(0).uniform(0, 1, (5, 3)))
    done = run(tmp_path / "few.npz", "--export", "step", "-o", tmp_path / "out")
    assert done.exit_code == 1
    assert "there is no surface to export as STEP" in done.stderr
    assert not (tmp_path / "out/part.json").exists()


def test_without_the_kernel_one_line_names_the_cure(file, points, tmp_path, without_kernel):
    done = run(file, "--export", "step", "-o", tmp_path / "out")
    assert done.exit_code == 1
    (line,) = done.stderr.strip().splitlines()
    assert 'OCP is not installed; the cure: pip install "unseen[step]"' in line
    with pytest.raises(InputError, match=r"unseen\[step\]"):
        model_part(points).export(tmp_path / "block.step")
    assert not (tmp_path / "block.step").exists()


def test_other_formats_are_refused(file, points, tmp_path):
    assert run(file, "--export", "iges").exit_code == 2
    with pytest.raises(InputError, match=r"cannot export a part to \.iges; known: \.step, \.stp"):
        model_part(points[:500]).export(tmp_path / "block.iges")
