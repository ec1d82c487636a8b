# SPDX-License-Identifier: MIT
"""`unseen fit --shape patch`: its JSON, its STEP file, and failures in one line."""

import importlib.util
import json

import numpy as np
import pytest
from scipy.interpolate import BSpline
from typer.testing import CliRunner

from nbv.cli import app
from tests.helpers.patch_examples import blend

BETWEEN = {
    "u0": {"surface": {"shape": "plane", "point": [0, 0, 0], "normal": [1, 0, 0]}, "join": "tangent"},
    "u1": {"surface": {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}, "join": "tangent"},
    "controls": [6, 7],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("patch")
    np.savetxt(made / "blend.xyz", blend(1500, 0.1, 0))
    (made / "between.json").write_text(json.dumps(BETWEEN))
    return made


def run(folder, *more):
    words = ["fit", str(folder / "blend.xyz"), "--shape", "patch", "--units", "mm", *map(str, more)]
    return CliRunner().invoke(app, words)


def test_the_record_is_a_spline_that_meets_its_planes(folder) -> None:
    result = run(folder, "--between", folder / "between.json", "-o", folder / "out.json")
    assert result.exit_code == 0, result.output
    held = json.loads(result.stdout)
    assert held == json.loads((folder / "out.json").read_text())
    assert list(held)[:5] == ["shape", "controls", "knots", "degree", "rms"]
    controls = np.array(held["controls"])
    assert controls.shape == (6, 7, 3)
    assert held["rms"] == pytest.approx(1e-4, rel=0.1)  # metres
    assert np.abs(controls[:2, :, 0]).max() < 1e-15
    assert held["boundaries"]["u1"]["angle"] < 1e-12
    assert 0 < held["deviation"]["median"] < held["rms"] < held["deviation"]["largest"] * 100
    along_u, along_v = (BSpline(held["knots"][name], np.eye(n), 3)(0.4) for name, n in (("u", 6), ("v", 7)))
    at = np.einsum("i,j,ijk->k", along_u, along_v, controls)
    assert np.linalg.norm(at - 1e-3 * blend(20_000, 0.0, 3), axis=1).min() < 1e-3
    manifest = json.loads((folder / "out.json.manifest.json").read_text())
    assert [name.rsplit("/")[-1] for name in map(str, manifest["inputs"])][:1] != []


def test_what_does_not_go_together_is_said(folder) -> None:
    for words, text in (
        ((), "--shape patch and --between FILE belong together"),
        (("--between", folder / "between.json", "--robust"), "a patch has no --metric, --robust"),
        (("--between", folder / "between.json", "--export", "dxf"), "'dxf' is none of step"),
    ):
        result = run(folder, *words)
        assert result.exit_code == 2
        assert text in " ".join(result.output.replace("│", " ").split())
    result = CliRunner().invoke(app, ["fit", str(folder / "blend.xyz"), "--export", "step"])
    assert result.exit_code == 2


def test_unusable_input_is_one_line(folder) -> None:
    (folder / "far.json").write_text(json.dumps({"u0": {**BETWEEN["u0"], "surface": {
        "shape": "plane", "point": [9, 0, 0], "normal": [1, 0, 0]}}}))  # fmt: skip
    for words, text in (
        (("--between", folder / "gone.json"), "no such file"),
        (("--between", folder / "far.json"), "is it the right surface, in the unit of the points?"),
        (("--between", folder / "between.json", "--export", "step"), "give -o FILE"),
    ):
        result = run(folder, *words)
        assert result.exit_code == 1
        assert text in result.stderr
        assert len(result.stderr.strip().splitlines()) == 1


@pytest.mark.skipif(importlib.util.find_spec("OCP") is not None, reason="the kernel is installed")
def test_without_the_kernel_one_line_says_what_to_install(folder) -> None:
    result = run(folder, "--between", folder / "between.json", "-o", folder / "x.json", "--export", "step")
    assert result.exit_code == 1
    assert 'pip install "unseen[step]"' in result.stderr
