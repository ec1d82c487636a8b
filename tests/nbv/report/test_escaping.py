# SPDX-License-Identifier: MIT
"""Names from strangers' files are shown as they are written, and do nothing: every report, in a browser."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.io.scan_files import write_scan
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene
from tests.helpers.browser import Browser, needs_chromium
from tests.helpers.long_cases import first_in_gate

pytestmark = needs_chromium
HACK = "<img src=x onerror=window.hacked=1>"  # no slash, so that a file can be called so
BREAK = f"</script></style>{HACK}<script>window.hacked=1</script>\"'`"
SENSOR = f'kind = "pinhole"\nname = {HACK!r}\nfov_deg = 70.0\nwidth = 60\nheight = 60\n'
ROOM = builtin_scene("two_occluders")
EYES = {"one": ((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), "two": ((1.0, 4.4, 1.5), (3.0, 2.0, 0.6))}


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A scene, scans, a sensor and a study in which all that may have a name is called by a script."""
    folder = tmp_path_factory.mktemp("strange")
    corners = ROOM.mesh.vertices[ROOM.mesh.faces].reshape(-1, 3)
    lines = [f"mtllib {HACK}.mtl", f"o {BREAK}", f"usemtl {BREAK}"]
    lines += [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    half = len(corners) // 6 * 3
    for first in range(1, len(corners), 3):
        lines += [f"o {HACK}", f"usemtl {HACK}"] if first == half + 1 else []
        lines.append(f"f {first} {first + 1} {first + 2}")
    (folder / f"{HACK}.obj").write_text("\n".join(lines) + "\n")
    materials = [f"newmtl {name}\nKd 0.5 0.4 0.3\nmap_Kd {HACK}.png\n" for name in (BREAK, HACK)]
    (folder / f"{HACK}.mtl").write_text("".join(materials))
    for name, (eye, target) in EYES.items():
        view = View(Pose.looking_at(eye, target), PinholeSensor(fov_deg=70, width=72, height=60))
        scan = scan_scene(ROOM, view, noise="gaussian-2mm", rng=0)
        write_scan(replace(scan, name=BREAK, sensor=BREAK, noise=HACK), folder / f"{name}{HACK}.npz")
    (folder / f"{HACK}.toml").write_text(SENSOR)
    (folder / "study.toml").write_text(
        f"title = {HACK!r}\ndescription = '''{BREAK.replace(chr(39), '')}'''\nname = {HACK!r}\n"
        "sampling = {spacing_m = 0.5, subdivisions = 0}\n"
        f"scenes = [{{scene = {HACK + '.obj'!r}, name = {BREAK[:60]!r}}}]\n"
        f"sensors = [{{sensor = {HACK + '.toml'!r}}}]\nrequirements = [{{name = {HACK!r}}}]\n"
        f"planners = [{{method = 'random', views = 3, name = {HACK!r}}}]\n"
    )
    return folder


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    running = Browser(tmp_path_factory.mktemp("chromium"))
    yield running
    running.close()


SCENE, SCANS = f"{HACK}.obj", [f"one{HACK}.npz", f"two{HACK}.npz"]


@pytest.mark.parametrize(
    "words",
    first_in_gate(
        1,
        [
            ["study", "study.toml"],
            ["plan", SCENE, "--sensor", f"{HACK}.toml", "--views", "2"],
            ["plan", "--scans", SCANS[0], "--scans", SCANS[1], "--sensor", f"{HACK}.toml", "--views", "1"],
            ["coverage", SCENE, "--scans", SCANS[0], "--scans", SCANS[1]],
            ["coverage", "--scans", SCANS[0], "--scans", SCANS[1]],
            ["check", SCENE, *SCANS, "--tolerance", "0.05"],
            ["complete", *SCANS, "--no-texture"],
        ],
    ),
    ids=["study", "plan", "next-stations", "coverage", "scan-coverage", "check", "completion"],
)
def test_names_of_strangers_are_shown_and_do_nothing(words, here, browser, tmp_path, monkeypatch):
    monkeypatch.chdir(here)
    result = CliRunner().invoke(app, [*words, "-o", str(tmp_path)])
    assert result.exit_code == 0, result.stderr
    tab = browser.open(tmp_path / "report.html", 1000, 800)
    tab.wait_for("document.readyState === 'complete'")
    assert HACK in tab.run("document.body.innerText + document.title")
    assert tab.run("window.hacked") is None
    assert tab.run("document.querySelectorAll('[onerror], img[src=x]').length") == 0
    assert tab.complaints() == []
    tab.close()


@pytest.mark.long
def test_the_viewers_labels_are_text(here, browser, tmp_path, monkeypatch):
    """What the pointer reads off a surface is a name as well."""
    monkeypatch.chdir(here)
    assert (
        CliRunner().invoke(app, ["coverage", SCENE, "--scans", SCANS[0], "-o", str(tmp_path)]).exit_code == 0
    )
    tab = browser.open(tmp_path / "report.html", 1000, 800)
    tab.wait_for("[...document.querySelectorAll('figure.view')].every(f => f.view?.placed)")
    left, top, width, height = tab.box("canvas")
    shown = set()
    for column in np.linspace(0.2, 0.8, 7):
        for row in np.linspace(0.3, 0.8, 5):
            tab.click(left + width * column, top + height * row)
            shown.add(tab.run("document.querySelector('figure.view').innerText"))
    assert any(HACK in text for text in shown)
    assert tab.run("window.hacked") is None
    assert tab.complaints() == []
    tab.close()
