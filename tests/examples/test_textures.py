# SPDX-License-Identifier: MIT
"""The pictures of docs/results/texture.md: small ones are quick, and the page shows all."""

import importlib.util
import sys

import numpy as np
import pytest
from PIL import Image

from tests.helpers.data_paths import ROOT, data_path


@pytest.fixture
def gallery(monkeypatch):
    spec = importlib.util.spec_from_file_location("plot_textures", ROOT / "examples/plot_textures.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "plot_textures", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_every_picture_is_made_and_shown(gallery, tmp_path, capsys):
    gallery.main(["--docs", str(tmp_path), "--quick"])
    lines = capsys.readouterr().out.splitlines()
    made = [line for line in lines if line in gallery.PICTURES]
    has_data = data_path("textures/ambientcg_Bricks.webp").exists()
    assert made == list(gallery.PICTURES)[: 3 if has_data else 2]
    page = (ROOT / "docs/results/texture.md").read_text("utf-8")
    for name in gallery.PICTURES:
        assert f"](../pictures/{name})" in page
        assert (ROOT / "docs/pictures" / name).stat().st_size < 250_000
    for name in made:
        with Image.open(tmp_path / "pictures" / name) as picture:
            assert picture.size[0] > 600
            assert len(np.unique(np.asarray(picture.convert("L")))) > 10
    rows = [line for line in lines if line.startswith("| ")][1:]
    assert [row.split(" | ")[0] for row in rows][:3] == ["| brick", "| grass", "| gravel"]
    assert all(row.count("|") == 9 for row in rows)


def test_without_the_data_it_says_so(gallery, monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("UNSEEN_DATA", str(tmp_path))
    assert gallery.read_tiles() == []
    assert "its tiles are left out (set UNSEEN_DATA)" in capsys.readouterr().out
