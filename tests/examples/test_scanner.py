# SPDX-License-Identifier: MIT
"""The pictures of docs/guides/scanner.md: coarse ones are quick, and the page shows all."""

import importlib.util

import numpy as np
import pytest
from PIL import Image

from tests.helpers.data_paths import ROOT


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("plot_scanner", ROOT / "examples/plot_scanner.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
def test_every_picture_is_made_and_shown(gallery, tmp_path, capsys):
    gallery.main(["--docs", str(tmp_path), "--scale", "0.15"])
    names = capsys.readouterr().out.split()
    assert len(names) == len(gallery.PICTURES)
    page = (ROOT / "docs/guides/scanner.md").read_text("utf-8")
    for name in names:
        with Image.open(tmp_path / "pictures" / name) as picture:
            assert picture.size[0] > 900
            assert len(np.unique(np.asarray(picture.convert("L")))) > 10
        assert f"](../pictures/{name})" in page
        assert (ROOT / "docs/pictures" / name).is_file()
