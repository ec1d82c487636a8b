# SPDX-License-Identifier: MIT
"""The gallery in small: it knows every script that makes pictures, runs the quickest, names what failed."""

import importlib.util
import re
import shutil

import numpy as np
import pytest
from PIL import Image

from tests.helpers.data_paths import ROOT


def load(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def gallery():
    return load("gallery")


def test_it_knows_every_script_that_plots(gallery):
    assert set(gallery.SMALL) == {file.stem for file in (ROOT / "examples").glob("plot_*.py")}


def test_pictures_of_the_readme_come_from_scripts():
    pictures = set(re.findall(r"docs/pictures/(\w+)\.png", (ROOT / "README.md").read_text("utf-8")))
    made = {"chair_before_wall": "plot_completion", "first_report": "plot_report"}
    assert pictures == set(made)
    for picture, script in made.items():
        assert picture in (ROOT / f"examples/{script}.py").read_text("utf-8")


@pytest.mark.long
def test_a_script_runs_small(gallery, tmp_path, capfd):
    gallery.main(["plot_scanner", "-o", str(tmp_path)])
    assert re.search(r"plot_scanner: done, \d+ s", capfd.readouterr().out)
    assert len(list((tmp_path / "pictures").iterdir())) == 7


def test_what_fails_is_named(gallery, tmp_path, monkeypatch, capfd):
    monkeypatch.setitem(gallery.SMALL, "plot_report", ["--no-such-option"])
    with pytest.raises(SystemExit, match="failed: plot_report"):
        gallery.main(["plot_report", "-o", str(tmp_path)])
    assert "plot_report: FAILED" in capfd.readouterr().out


def test_unknown_scripts_are_refused(gallery, capsys):
    with pytest.raises(SystemExit):
        gallery.main(["plot_nothing"])
    assert "there is no plot_nothing" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium")
def test_a_report_is_photographed(tmp_path, capsys):
    page = tmp_path / "report.html"
    page.write_text("<body style='margin:0;background:#2e7acc'><h1 style='color:#fff'>A report</h1></body>")
    load("plot_report").main([str(page), "--docs", str(tmp_path)])
    assert capsys.readouterr().out == "first_report.png\n"
    with Image.open(tmp_path / "pictures/first_report.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    blue = np.abs(pixels.astype(int) - [0x2E, 0x7A, 0xCC]).max(axis=1) < 6
    assert 0.9 < blue.mean() < 1


def test_without_browser_or_report_it_says_so(tmp_path, monkeypatch, capsys):
    script = load("plot_report")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    script.main(["--docs", str(tmp_path)])
    monkeypatch.setattr(shutil, "which", lambda name: name)
    script.main([str(tmp_path / "absent.html"), "--docs", str(tmp_path)])
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("skipped: none of chromium")
    assert told[1].endswith("run `make demo`, or name a report")
    assert not list(tmp_path.iterdir())
