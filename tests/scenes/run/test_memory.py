# SPDX-License-Identifier: MIT
"""Memory: blocks follow from what is left, results do not; too much is refused, in words or by the system."""

import json
import os
import re
import resource
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.sparse import csr_array
from typer import Exit
from typer.testing import CliRunner

from completion.options import CompletionOptions
from completion.pipeline import complete
from examples.check_limits import commands, digests, run
from nbv import plan_views, scan_scene
from nbv.cli import app
from nbv.commands.options.shared import Shared
from nbv.commands.process import start_run
from nbv.commands.texture import texture_bytes
from nbv.cover import dual
from nbv.cover.dual import reduce_instance
from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions
from nbv.scanning.beam import Footprint
from nbv.scanning.effects import Effects
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import find_reachable, visible_from_positions
from scenes import builtin_scene
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.run.memory import machine_bytes, memory_limit, require, room, rows_within, threads, threads_within
from tests.helpers.data_paths import ROOT
from tests.helpers.long_cases import first_in_gate
from texture import grow

MB = 1_000_000
ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=60, width=64, height=48)
TIGHT = 1  # byte: the process has more already, so that nothing is left
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts memory as Linux does")


def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_what_is_left_is_what_the_limit_leaves():
    assert 0 < room() <= machine_bytes()
    with memory_limit(TIGHT):
        assert room() == 0
        assert rows_within(1 << 20) == 16
        assert threads_within(1, 8) == 1
    with memory_limit(10**15):
        assert rows_within(1e6, most=100) == 100
        assert threads_within(1e6, 8) == 8
    assert rows_within(1e18) == 1


def test_threads_know_the_limit_of_who_started_them():
    with memory_limit(TIGHT), threads(0.0, 2) as pool:
        assert list(pool.map(lambda _: room(), range(4))) == [0] * 4


def test_what_does_not_fit_is_refused_in_words():
    with (
        memory_limit(TIGHT),
        pytest.raises(InputError, match=r"a thing needs about 3\.1 GB, and 0 MB are left; buy"),
    ):
        require(3.1e9, "a thing", "buy more")
    require(1, "a thing", "buy more")


@linux
def test_the_system_refuses_what_would_go_beyond_and_no_more():
    before = resource.getrlimit(resource.RLIMIT_DATA)
    with memory_limit(resident() + 200 * MB, enforced=True):
        assert np.ones(100 * MB, np.uint8).nbytes == 100 * MB
        with pytest.raises(MemoryError):
            np.ones(400 * MB, np.uint8)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
    with pytest.raises(
        InputError, match=r"a limit of 1 MB is less than the .* [MG]B that this command needs"
    ):
        memory_limit(MB, enforced=True).__enter__()


def test_a_refused_allocation_is_one_line(tmp_path, capsys):
    shared = Shared(out=tmp_path / "x.json", seed=0, as_json=False, quiet=True, threads=None, max_memory=None)
    with pytest.raises(Exit) as left, start_run("fit", shared, default="", is_folder=False):
        np.ones(1 << 60, np.uint8)
    assert left.value.exit_code == 1
    assert re.fullmatch("unseen fit: not enough memory for this input; .*\n", capsys.readouterr().err)


SAMPLES = sample_surface(ROOM.mesh, 0.3)
POSITIONS = np.array([[1.0, 1.0, 1.2], [3.0, 2.5, 1.5], [5.0, 4.0, 1.0]])
STANDS = Candidates(POSITIONS, np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0]]))
VIEW = View(Pose.looking_at(POSITIONS[0], POSITIONS[1]), SENSOR)


def looks(n_threads):
    limits = Requirement().visibility(SENSOR)
    seen = visible_from_positions(ROOM.ray_caster(n_threads), POSITIONS, SAMPLES, limits, n_threads=n_threads)
    return seen.data.tobytes() + seen.indices.tobytes()


def reaches(n_threads):
    caster = ROOM.ray_caster(n_threads)
    found = find_reachable(caster, SAMPLES, STANDS, SENSOR, Requirement(), n_threads=n_threads)
    return found.reason.tobytes()


def measures(n_threads):
    effects = Effects(footprint=Footprint(divergence_rad=0.004))
    wide = PinholeSensor(fov_deg=60, width=200, height=180, effects=effects)
    taken = scan_scene(ROOM, View(VIEW.world_from_sensor, wide), noise="profile", rng=0, n_threads=n_threads)
    return taken.ranges.tobytes()


def completes(n_threads):
    model = complete(scan_scene(ROOM, VIEW, rng=0), CompletionOptions(texture=False), n_threads=n_threads)
    return model.hypothesised.vertices.tobytes()


def plans(method, n_threads):
    fixed = {"samples": SAMPLES, "candidates": STANDS, "budgets": CoverOptions(polish_steps=50), "rng": 0}
    plan = plan_views(ROOM, SENSOR, method=method, views=2, n_threads=n_threads, **fixed)
    return json.dumps(plan.to_json())


def grows(n_threads):
    noise = np.random.default_rng(0).integers(0, 255, (32, 32, 3), np.uint8)
    return grow(noise, (20, 20), window=5, rng=0, n_threads=n_threads).image.tobytes()


WORKS = {
    "visibility": looks,
    "reachability": reaches,
    "scan": measures,
    "complete": completes,
    "plan nbv": partial(plans, "nbv"),
    "plan cover": partial(plans, "cover"),
    "texture": grows,
}


@pytest.mark.parametrize("work", WORKS.values(), ids=WORKS.keys())
def test_no_result_depends_on_memory_or_threads(work):
    with memory_limit(resident() + 120 * MB):
        tight = work(8)
    assert tight == work(1) == work(2)


def test_a_bound_that_does_not_fit_is_refused_and_not_made_another_one():
    reduction = reduce_instance(CoverInstance(csr_array(np.eye(4) + np.eye(4, k=1)), np.ones(4)))
    with memory_limit(TIGHT), pytest.raises(InputError, match=r"a linear programme of .* needs about"):
        dual.find_certificate(reduction, np.ones(4), 4)


def test_scans_that_do_not_fit_are_refused():
    with (
        memory_limit(TIGHT),
        pytest.raises(InputError, match="completing 1 scans of 3,072 pixels needs about"),
    ):
        complete(scan_scene(ROOM, VIEW, rng=0))


@pytest.mark.long
@linux
def test_the_estimate_of_a_texture_is_what_it_takes(tmp_path):
    """By the difference of two sizes: what libraries and compiled code take is the same in both."""
    peak, said = {}, {}
    for side in (300, 1000):
        noise = np.random.default_rng(0).integers(0, 255, (side, side, 3), np.uint8)
        hole = np.zeros(noise.shape[:2], np.uint8)
        hole[:3, :3] = 255
        Image.fromarray(noise).save(tmp_path / "noise.png")
        Image.fromarray(hole).save(tmp_path / "hole.png")
        fill = ["texture", "noise.png", "--mask", "hole.png", "--window", "3", "-o", "filled.png"]
        peak[side], said[side] = run(fill, tmp_path).peak_bytes, texture_bytes(noise.shape, None)
    assert 0.6 < (said[1000] - said[300]) / (peak[1000] - peak[300]) < 1.5, (said, peak)


@linux
def test_a_texture_that_does_not_fit_is_refused_in_words(tmp_path, monkeypatch):
    Image.fromarray(np.zeros((900, 900, 3), np.uint8)).save(tmp_path / "black.png")
    monkeypatch.chdir(tmp_path)
    limit = str(resident() + 40 * MB)
    result = CliRunner().invoke(app, ["texture", "black.png", "--grow", "2x2", "--max-memory", limit])
    assert result.exit_code == 1
    words = r"unseen texture: a texture from 900 x 900 pixels needs about \d+ MB, and \d+ MB are left; use .*"
    assert re.fullmatch(words, result.stderr.strip())
    assert not (tmp_path / "texture.png").exists()


@linux
@pytest.mark.parametrize("limit", first_in_gate(1, [50, 100, 400, 860]))
def test_under_a_limit_on_address_space_a_command_ends_and_its_old_output_stays(tmp_path, limit):
    fit = commands(tmp_path)["fit"]
    (tmp_path / "fit.json").write_text("{}")
    before = digests(tmp_path)
    ending = run(fit, tmp_path, limit=limit * MB)
    assert ending.kind != "hung", ending
    assert ending.code == 0 or digests(tmp_path) == before


SMALL = 'kind = "pinhole"\nname = "small"\nfov_deg = 70.0\nwidth = 64\nheight = 48\n'
SCAN = ("scan", "builtin:two_occluders", "--at", "1,1,1.5", "--look", "3,3,1", "--sensor", "small.toml")


@linux
def test_a_command_writes_the_same_with_little_memory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL)
    for name, options in {"free": ("--threads", "1"), "tight": ("--threads", "8")}.items():
        budget = ("--max-memory", str(resident() + 200 * MB)) if name == "tight" else ()
        result = CliRunner().invoke(
            app, [*SCAN, "--noise", "gaussian-2mm", "-o", f"{name}.npz", *options, *budget]
        )
        assert result.exit_code == 0, result.stderr
    assert Path("free.npz").read_bytes() == Path("tight.npz").read_bytes()


@linux
def test_what_is_freed_is_used_again_where_it_was_given_back_at_once():
    """As of dask's workers, whose setting makes each array of a megabyte new pages of memory."""
    program = (
        "import resource, sys\nimport numpy as np\nfrom scenes.run.memory import reuse_freed\n"
        "if sys.argv[1] == 'reuse': reuse_freed()\n"
        "for _ in range(20): np.ones(1 << 20)\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "for _ in range(50): np.ones(1 << 20)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)\n"
    )
    faults = {}
    for how in ("as set", "reuse"):
        command = [sys.executable, "-c", program, how]
        given = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536", "PYTHONPATH": str(ROOT)}
        ran = subprocess.run(command, env=given, check=True, capture_output=True, text=True)
        faults[how] = int(ran.stdout)
    assert faults["as set"] > 20 * max(faults["reuse"], 1)
