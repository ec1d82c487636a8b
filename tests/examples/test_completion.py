# SPDX-License-Identifier: MIT
"""The gallery of completions: a picture of each scene asked for, small enough for the docs."""

import importlib.util
import sys

import pytest
from PIL import Image

from completion import CompletionOptions, complete
from tests.helpers.data_paths import ROOT


@pytest.mark.long
def test_a_scene_asked_for_has_a_picture_and_no_page(tmp_path, monkeypatch, capsys):
    name = "plot_completion"
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    plain = CompletionOptions(texture=False)  # synthesis has tests of its own
    monkeypatch.setattr(module, "complete", lambda scan, rng: complete(scan, plain, rng=rng))
    module.main(["chair_before_wall", "-o", str(tmp_path)])
    assert capsys.readouterr().out.startswith("chair_before_wall: Measured 11.")
    picture = tmp_path / "pictures/chair_before_wall.png"
    assert picture.stat().st_size < 150_000
    with Image.open(picture) as image:
        assert image.width == 3 * 600 + 2 * 12
    assert not list(tmp_path.glob("*.md"))


def test_the_page_shows_every_scene():
    page = (ROOT / "docs/results/completion-gallery.md").read_text("utf-8")
    pictures = [part.split(")")[0] for part in page.split("](../pictures/")[1:]]
    assert len(pictures) == 15
    for picture in pictures:
        assert (ROOT / "docs/pictures" / picture).stat().st_size < 150_000
