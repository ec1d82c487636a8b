# SPDX-License-Identifier: MIT
"""Compiled code: made at installation, or told of by the first run on a machine."""

import json
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit
from PIL import Image
from typer.testing import CliRunner

from completion.observe.tiles import solve_plane
from nbv.cli import app
from nbv.commands import process as run
from nbv.commands import warm
from tests.helpers.data_paths import ROOT


def test_a_loop_is_cold_until_its_code_is_stored(tmp_path):
    def loop(stored):
        stats = SimpleNamespace(cache_path=str(tmp_path) if stored else None)
        return SimpleNamespace(stats=stats, py_func=solve_plane.py_func)

    assert run.is_cold(loop(stored=True))
    (tmp_path / "tiles.solve_plane_too-1.py311.nbi").touch()
    assert run.is_cold(loop(stored=True))
    (tmp_path / "tiles.solve_plane-142.py311.nbi").touch()
    assert not run.is_cold(loop(stored=True))
    assert not run.is_cold(loop(stored=False))
    assert not run.is_cold(solve_plane.py_func)


def test_the_name_of_stored_code_is_the_one_that_is_looked_for(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "doubling.py").write_text("def double(x):\n    return 2 * x\n")
    import doubling

    double = njit(cache=True)(doubling.double)
    assert run.is_cold(double)
    assert double(2) == 4
    assert not run.is_cold(double)


@pytest.mark.parametrize(("more", "is_told"), [((), True), (("--quiet",), False), (("--json",), False)])
def test_a_first_run_says_that_it_compiles(tmp_path, monkeypatch, more, is_told):
    monkeypatch.setattr(run, "is_cold", lambda _loop: True)
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (16, 16), np.uint8)).save(tmp_path / "a.png")
    texture = ["texture", str(tmp_path / "a.png"), "--grow", "4x4", "--window", "3"]
    said = CliRunner().invoke(app, [*texture, "-o", str(tmp_path / "b.png"), *more]).stderr
    words = "unseen texture: compiling the inner loops for this machine, once: about 20 s\n"
    assert said == (words if is_told else "")


COMMANDS = {
    "complete": ["missing.npz"],
    "coverage": ["builtin:two_occluders", "--scans", "missing.npz"],
    "plan": ["builtin:two_occluders", "--scans", "missing.npz"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_unusable_input_stays_one_line_on_a_first_run(command, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "is_cold", lambda _loop: True)
    said = CliRunner().invoke(app, [command, *COMMANDS[command], "-o", str(tmp_path / "out")]).stderr
    assert said.splitlines() == [f"unseen {command}: missing.npz: no such file or folder"]


def test_warming_calls_every_stage(tmp_path, monkeypatch):
    called = []
    for name in ("run_scan", "run_texture", "run_plan", "run_complete"):
        monkeypatch.setattr(warm, name, lambda shared, *_, **__: called.append(shared.out.name))
    warm.warm_completion(tmp_path)
    warm.warm_planning(tmp_path)
    assert called == ["scan.npz", "completed", "grown.png", "nbv", "online-frontier", "cover"]


def test_the_gate_warms_where_sources_changed_and_the_demo_does_not():
    recipes = (ROOT / "Makefile").read_text()
    gate = recipes.partition("\ntest: ")[2].partition("\n\n")[0]
    assert 0 < gate.find(" .venv/warm &&") < gate.find("$(PYTEST)")
    for target, is_warmed in ((".venv/demo: pyproject", False), (".venv/warm: .venv/dev", True)):
        recipe = recipes.partition(target)[2].partition("\n\n")[0]
        assert ("unseen warm" in recipe) == is_warmed


@pytest.mark.parametrize(("threads", "n_processes"), [(1, 1), (2, 2), (5, 2)])
def test_warm_runs_both_parts_and_says_where_code_is_stored(monkeypatch, threads, n_processes):
    pools, folders = [], []

    def pool(n, mp_context):
        pools.append(n)
        return ThreadPoolExecutor(n)

    monkeypatch.setattr(warm, "ProcessPoolExecutor", pool)
    for name in ("warm_completion", "warm_planning"):
        monkeypatch.setattr(warm, name, lambda folder: folders.append(folder.is_dir()))
    ran = CliRunner().invoke(app, ["warm", "--threads", str(threads), "--json"])
    assert json.loads(ran.stdout) == {"command": "warm", "folder": solve_plane.stats.cache_path}
    assert pools == [n_processes]
    assert folders == [True, True]
    assert CliRunner().invoke(app, ["warm", "--quiet"]).output == ""


def test_warm_without_a_folder_for_code_fails_in_one_line(monkeypatch):
    monkeypatch.setattr(warm, "solve_plane", SimpleNamespace(stats=SimpleNamespace(cache_path=None)))
    ran = CliRunner().invoke(app, ["warm"])
    assert ran.exit_code == 1
    assert ran.stderr.splitlines() == [
        "unseen warm: numba found no folder that it can store compiled code in; set NUMBA_CACHE_DIR to one"
    ]
