# SPDX-License-Identifier: MIT
"""Two versions side by side: decoded depth images, figures, and the picture of a pair."""

import importlib.util
import sys

import numpy as np
import pytest

from tests.helpers.completion_examples import completed, example
from tests.helpers.data_paths import ROOT

NAME = "plot_before_after"


@pytest.fixture
def script(monkeypatch):
    spec = importlib.util.spec_from_file_location(NAME, ROOT / f"examples/{NAME}.py")
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, NAME, module)
    spec.loader.exec_module(module)
    return module


def test_depth_images_of_others_are_decoded(script):
    raw = np.array([[986, 2047]], np.uint16).byteswap().astype(np.float64)
    assert script._from_disparity(raw) == pytest.approx(np.array([[351.3 / (1092.5 - 986), 0.0]]))
    turned = np.array([[(2720 << 3) & 0xFFFF | 2720 >> 13]], np.float64)
    assert script._from_turned(turned) == pytest.approx(np.array([[2.72]]))


@pytest.mark.long
def test_a_pair_shows_what_is_inferred_and_counts_small_surfaces(script, tmp_path):
    made = completed("chair_before_wall")
    made.save(tmp_path)
    surfaces, small, measured, inferred = script.figures(tmp_path)
    assert surfaces == len(made.patches)
    assert small == sum(patch.observed_m2 < script.SMALL_M2 for patch in made.patches)
    assert (measured, inferred) == pytest.approx((made.observed_m2, made.hypothesised_m2), rel=1e-6)
    drawn = script.Drawn.of(tmp_path)
    scan = example("chair_before_wall")
    picture = np.asarray(script.pair(scan, [drawn, drawn], 120))
    assert picture.shape[1] == 2 * 120 + script._GAP
    assert np.array_equal(picture[:, :120], picture[:, -120:])
    through = drawn.picture(scan.origin, script.own_view(scan, 120), through=True)
    coloured = np.ptp(through, axis=2) > 0.2
    assert 0.005 < coloured.mean() < 0.4


def test_the_page_shows_its_pictures():
    page = (ROOT / "docs/results/real-scans.md").read_text("utf-8")
    pictures = [part.split(")")[0] for part in page.split("](../pictures/")[1:]]
    assert len(pictures) == 6
    for picture in pictures:
        assert (ROOT / "docs/pictures" / picture).stat().st_size < 150_000
