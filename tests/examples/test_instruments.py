# SPDX-License-Identifier: MIT
"""The page of instruments: its tables are those of the profiles, its pictures are made and shown."""

import importlib.util

import pytest
from PIL import Image

from nbv.scanning.sensor_profile import sensor_names
from tests.helpers.data_paths import ROOT

PAGE = ROOT / "docs/guides/instruments.md"
GENERIC = {"generic60", "generic60cone", "panorama", "line_profiler"}
SETTINGS = {"phase_terrestrial", "pulsed_terrestrial", "triangulation_laser"}


@pytest.fixture(scope="module")
def instruments():
    spec = importlib.util.spec_from_file_location("plot_instruments", ROOT / "examples/plot_instruments.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_has_every_instrument_as_its_profile_has_it(instruments):
    page = PAGE.read_text("utf-8")
    assert instruments.with_tables(page) == page, "python examples/plot_instruments.py"
    assert all(instruments.table(family) in page for family in instruments.FAMILIES)
    named = {name for family in instruments.FAMILIES.values() for name in family}
    assert named == set(sensor_names()) - GENERIC - SETTINGS


@pytest.mark.long
def test_every_picture_is_made_and_shown(instruments, tmp_path, capsys):
    instruments.main(["--docs", str(tmp_path)])
    for name in capsys.readouterr().out.split():
        with Image.open(tmp_path / "pictures" / name) as picture:
            assert picture.size[0] > 900
        assert f"](../pictures/{name})" in PAGE.read_text("utf-8")
        assert (ROOT / "docs/pictures" / name).is_file()
