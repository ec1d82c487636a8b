# SPDX-License-Identifier: MIT
"""The demo, with a small sensor and few views: all files, honest numbers, same bytes again."""

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import nbv.commands.demo
from nbv.cli import app
from nbv.coverage.coverage import MET, UNREACHABLE, Coverage
from nbv.report.demo_report import INFERRED, MEASURED, UNKNOWN, Comparison, compare, unreached_share
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from scenes.mesh.triangle_distance import distances
from scenes.world.builtin import builtin_scene

SENSOR = 'kind = "pinhole"\nname = "tiny"\nfov_deg = 75.0\nwidth = 96\nheight = 96\n'


def run_small(out, threads, monkeypatch, tmp_path):
    sensor = tmp_path / "tiny.toml"
    sensor.write_text(SENSOR)
    for name, value in {"SENSOR": str(sensor), "MOST_VIEWS": 5, "N_SCANS": 2}.items():
        monkeypatch.setattr(nbv.commands.demo, name, value)
    result = CliRunner().invoke(app, ["demo", "-o", str(out), "--json", "--threads", str(threads)])
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


@pytest.fixture
def demo(tmp_path, monkeypatch):
    return tmp_path / "demo", run_small(tmp_path / "demo", 1, monkeypatch, tmp_path)


def test_demo_writes_everything(demo):
    out, summary = demo
    names = {
        "completed.glb", "observed.ply", "hypothesised.ply", "completion.json", "plan.json", "coverage.json",
        "report.html", "manifest.json", "plan.csv", "trajectory.txt", "polygons.json", "model.ply",
        "decisions.csv",
    }  # fmt: skip
    assert {file.name for file in out.iterdir()} == names
    assert summary["measured"] + summary["inferred"] + summary["unknown"] == pytest.approx(1.0)
    assert summary["measured"] > 0.2
    assert summary["inferred_within_2cm"] > 0.9
    assert len(summary["scans"]) == 2
    html = (out / "report.html").read_text()
    for words in ("Before and after", "Compared with the truth", "stays unknown", "inferred"):
        assert words in html
    assert "of true surface that bound the room; 3.78 m\u00b2 that bound no room are set apart" in html
    assert "faces the open air, or lies below all floors" in html


@pytest.mark.long
def test_demo_writes_the_same_bytes_on_two_threads(demo, tmp_path, monkeypatch):
    out, _ = demo
    names = {file.name for file in out.iterdir()}
    again = tmp_path / "again"
    run_small(again, 2, monkeypatch, tmp_path)
    for name in names - {"manifest.json"}:
        assert (again / name).read_bytes() == (out / name).read_bytes(), name


def test_distances_are_those_to_a_plane_and_to_an_edge():
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=float)
    points = np.array([[0.3, 0.6, 0.25], [2.0, 0.5, 0.0], [-3.0, -4.0, 0.0]])
    assert distances(points, square) == pytest.approx([0.25, 1.0, 5.0])


def test_distances_to_many_triangles_find_the_nearest():
    step = np.arange(12)
    origin = np.stack(np.meshgrid(step, step, [0.0], indexing="ij"), axis=-1).reshape(-1, 1, 3)
    corners = np.concatenate([
        origin + np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0]]),
        origin + np.array([[0, 0, 0], [1, 1, 0], [0, 1, 0.0]]),
    ])  # fmt: skip
    points = np.random.default_rng(0).uniform([1, 1, -1], [11, 11, 1], (200, 3))
    assert distances(points, corners) == pytest.approx(np.abs(points[:, 2]))


def test_without_inferred_area_nothing_is_wrong_and_nothing_is_inferred():
    scene = builtin_scene("two_occluders")
    samples = sample_surface(scene.mesh, 0.5)

    class Empty:
        class hypothesised:  # noqa: N801 - stands in for an attribute
            faces = np.zeros((0, 3), np.int32)

    found = compare(Empty(), [], scene.mesh, samples)
    assert found.share(UNKNOWN) == 1.0
    assert found.within_close == 1.0


def test_shares_are_of_area():
    samples = sample_surface(builtin_scene("two_occluders").mesh, 0.5)
    state = np.where(samples.points[:, 2] < 0.01, MEASURED, INFERRED).astype(np.int8)
    found = Comparison(samples, state, 1.0, 0.0)
    area = samples.areas[samples.points[:, 2] < 0.01].sum() / samples.total_m2
    assert found.share(MEASURED) == pytest.approx(area)
    assert found.share(MEASURED) + found.share(INFERRED) == pytest.approx(1.0)


@pytest.mark.parametrize(("share", "told"), [(0.0, ""), (0.0004, ""), (0.0006, "0.1"), (0.03, "3.0")])
def test_what_no_view_reaches_is_told_only_where_it_is_something(share, told):
    samples = sample_surface(builtin_scene("two_occluders").mesh, 0.5).some(np.arange(2))
    samples = replace(samples, areas=np.array([share, 1 - share]))
    none = np.zeros(2)
    coverage = Coverage(samples, Requirement(), none, none, np.array([UNREACHABLE, MET]), none, ("a",), 1)
    assert unreached_share(coverage) == told
