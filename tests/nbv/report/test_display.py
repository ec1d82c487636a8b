# SPDX-License-Identifier: MIT
"""Display: the full report of each thing is written, complete, and opened in browser or notebook."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import unquote, urlparse

import numpy as np
import pytest

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv import show
from nbv.plan.plan import Plan, read_plan
from nbv.report.coverage_report import noun_of
from nbv.run.wording import percent_within
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, SphericalSensor, View
from nbv.scanning.sensor_profile import load_sensor
from scenes.checks import InputError
from scenes.pose import Pose
from tests.helpers.completion_examples import example
from tests.helpers.room_examples import ROOM, VIEW, covered_by_two


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """Addresses that the browser was told to open, of files that are written beside the test."""
    addresses = []
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("webbrowser.open", lambda address: addresses.append(address))
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    return addresses


@pytest.fixture(scope="module")
def scene():
    return ROOM


@pytest.fixture(scope="module")
def view():
    return VIEW


@pytest.fixture(scope="module")
def coverage():
    return covered_by_two()


@pytest.fixture(scope="module")
def plan(view, coverage):
    views = (replace(view, met_fraction=coverage.met, gain_m2=1.0),)
    return Plan("nbv", view.sensor, coverage.requirement, 0.99, 7, 2, views, coverage, None, "no more")


def read_opened(opened, path):
    """What the browser was told to show: the file that was returned."""
    assert [Path(unquote(urlparse(address).path)) for address in opened] == [path]
    return path.read_text("utf-8")


def test_a_plan_is_shown_with_its_scene(opened, plan, scene, coverage):
    html = read_opened(opened, plan.show(scene, n_threads=1))
    assert "View plan" in html
    assert f"{100 * coverage.met:.1f}" in html
    assert html.count("<html") == html.count("</html>") == 1


@pytest.mark.long
def test_a_plan_that_was_read_is_measured_again(opened, plan, scene, tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps(plan.to_json()), "utf-8")
    html = read_opened(opened, show(read_plan(tmp_path / "plan.json"), scene, n_threads=1))
    assert "What cannot be reached, and why" in html


@pytest.mark.long
def test_a_coverage_is_shown_with_scene_and_stations(opened, coverage, scene, view):
    html = read_opened(opened, coverage.show(scene, [view], n_threads=1))
    met = percent_within(coverage.met, coverage.standard_errors()["met"])
    assert f"1 view measures {met} %" in html.replace("\xa0", " ")
    again = coverage.show(scene, [view], n_threads=2)
    assert again.read_bytes() == html.encode("utf-8")


@pytest.mark.parametrize(
    ("sensor", "noun"),
    [(PinholeSensor(fov_deg=60, aperture="circular"), "view"), (load_sensor("panorama"), "station")],
)
def test_only_what_looks_around_is_called_a_station(scene, sensor, noun):
    pose = Pose.looking_at((0.5, 0.5, 1.5), (3.0, 2.5, 1.0))
    assert noun_of([View(pose, sensor)] * 2) == noun
    assert noun_of([scan_scene(scene, View(pose, PinholeSensor(width=8, height=8)), rng=0)]) == "scan"


def test_a_coverage_by_scans_is_shown(opened, coverage, scene, view):
    scan = scan_scene(scene, view, rng=0)
    assert "Coverage report" in read_opened(opened, show(coverage, scene, [scan], seed=3, n_threads=1))


def test_a_completion_is_shown(opened):
    scan = replace(example("chair_before_wall", pixels=100), name="<b>wall</b>")
    html = read_opened(opened, show(complete(scan, CompletionOptions(texture=False), rng=0), n_threads=1))
    assert "Completion report" in html
    assert "&lt;b&gt;wall&lt;/b&gt;" in html
    assert "<b>wall" not in html


@pytest.mark.parametrize("noise", ["none", "khoshelham2012"])
def test_a_scan_is_shown_with_its_error(opened, scene, view, noise):
    scan = scan_scene(scene, view, noise=noise, rng=0, name="<i>")
    html = read_opened(opened, show(scan))
    error = scan.range_error()
    rms = float(np.sqrt(np.nanmean(error**2)))
    assert f"root mean square {1000 * rms:.3f} mm" in html
    assert "64" in html
    assert "&lt;i&gt;" in html
    assert "<i>" not in html


def test_an_empty_scan_is_shown(opened, scene):
    away = View(Pose.looking_at((50, 50, 50), (90, 90, 90)), SphericalSensor(width=8, height=4))
    empty = replace(scan_scene(scene, away, rng=0), ranges=np.full((4, 8), np.inf))
    html = read_opened(opened, show(empty))
    assert "so there is nothing to show" in html
    assert "No pixel has both" in html


def test_a_notebook_shows_it_below_the_cell(opened, monkeypatch, scene, view):
    shown = []
    display = SimpleNamespace(HTML=str, display=shown.append)
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    path = show(scan_scene(scene, view, rng=0))
    assert path.is_file()
    assert opened == []
    assert len(shown) == 1
    assert "<iframe srcdoc=" in shown[0]
    assert "&lt;html" in shown[0]


def test_a_terminal_of_ipython_opens_the_browser(opened, monkeypatch, scene, view):
    shell = SimpleNamespace()  # no kernel: nowhere to show HTML
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    read_opened(opened, show(scan_scene(scene, view, rng=0)))


def test_what_cannot_be_shown_says_the_cure(plan, coverage):
    with pytest.raises(InputError, match=r"a plan is shown with its scene: show\(plan, scene\)"):
        show(plan)
    with pytest.raises(InputError, match=r"a coverage is shown with its scene"):
        show(coverage)
    with pytest.raises(InputError, match="no report of a int; show a Plan"):
        show(3)
