# SPDX-License-Identifier: MIT
"""Charts of completed textures: a picture of each that is asked for, small enough for the docs."""

import importlib.util
import sys

import numpy as np
import pytest
from PIL import Image

from completion import CompletionOptions, TexturingOptions, complete
from tests.helpers.data_paths import ROOT


@pytest.mark.long
def test_a_chart_asked_for_has_a_picture_and_no_page(tmp_path, monkeypatch, capsys):
    name = "plot_surface_textures"
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    quick = CompletionOptions(texturing=TexturingOptions(window=5, max_texels=20_000, max_samples=2000))
    monkeypatch.setattr(module, "complete", lambda scan, rng: complete(scan, quick, rng=rng))
    module.main(["wall_with_window", "-o", str(tmp_path)])
    assert "Difference from the true colour in patches of 5 cm: median" in capsys.readouterr().out
    picture = tmp_path / "pictures/chart_wall_with_window.png"
    assert picture.stat().st_size < 400_000
    with Image.open(picture) as image:
        assert image.height == 420
        levels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    assert (np.abs(levels - module._BLUE).max(axis=1) < 20).mean() > 0.02
    assert not list(tmp_path.glob("*.md"))


def test_the_page_shows_every_chart():
    page = (ROOT / "docs/results/surface-textures.md").read_text("utf-8")
    for name in ("textured_cylinder", "wall_with_window", "cape_tunnel"):
        assert f"](../pictures/chart_{name}.png)" in page
        assert (ROOT / f"docs/pictures/chart_{name}.png").stat().st_size < 400_000
