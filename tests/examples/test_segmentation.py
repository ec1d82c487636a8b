# SPDX-License-Identifier: MIT
"""The segmentation's pictures: without data it says so; with labels it says where each surface lies."""

import importlib.util

import pytest

from tests.helpers.data_paths import ROOT, data_path, requires_data


@pytest.fixture(scope="module")
def pictures():
    name = "plot_segmentation"
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_without_data_it_says_what_is_missing(pictures, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("UNSEEN_DATA", str(tmp_path))
    pictures.main(["-o", str(tmp_path / "out")])
    assert "skipped: there is no" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@requires_data
def test_a_labelled_scan_has_a_picture_and_a_table(pictures, tmp_path, capsys):
    pictures.main([str(data_path("range/mOSD/learn33.pcd")), "-o", str(tmp_path)])
    assert (tmp_path / "learn33.png").stat().st_size > 10_000
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    assert lines[1].startswith("| 1 | plane |")
    assert lines[1].endswith("100 % on 1 |")
    assert sum("| cylinder |" in line for line in lines) >= 6
