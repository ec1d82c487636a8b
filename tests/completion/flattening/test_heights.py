# SPDX-License-Identifier: MIT
"""Height maps: ripple goes, relief stays, p values say how sure that is."""

import numpy as np
import pytest
from scipy.stats import kstest

from completion.flattening.flat import FlatteningOptions, RegionKind
from completion.flattening.pipeline import NullModel, flatten_heights
from scenes.checks import InputError
from tests.helpers.wall_examples import CELL, PANEL, SHAPE, SWITCH, panelled, ripple

RELIEF = np.zeros(SHAPE, bool)
RELIEF[PANEL] = RELIEF[SWITCH] = True


@pytest.fixture(scope="module")
def flat():
    return flatten_heights(panelled(0), CELL)


def test_ripple_goes_and_relief_stays(flat) -> None:
    assert (flat.kept == RELIEF).mean() > 0.998
    assert np.all(flat.heights[~flat.kept] == 0)
    tall = sorted(one.height_m for one in flat.regions if one.kind is RegionKind.RELIEF)
    assert tall == pytest.approx([0.005, 0.009], abs=0.0005)
    area = sorted(one.area_m2 for one in flat.regions if one.kind is RegionKind.RELIEF)
    assert area == pytest.approx([0.0096, 0.0784], rel=0.02)


@pytest.mark.long
def test_relief_loses_its_ripple_too_and_keeps_its_noise(flat) -> None:
    inner = np.s_[15:37, 13:35]
    assert np.std(flat.heights[inner]) < 0.3 * np.std(panelled(0)[inner])
    assert np.mean(flat.heights[inner]) == pytest.approx(0.005, abs=0.0004)
    left = flatten_heights(panelled(0), CELL, FlatteningOptions(clears_relief=False))
    assert np.array_equal(left.heights[left.kept], panelled(0)[left.kept])
    assert not any(one.is_cleared for one in left.regions if one.kind is RegionKind.RELIEF)


def test_what_was_taken_for_ripple_is_ripple(flat) -> None:
    assert flat.ripple_sd_m == pytest.approx(np.std(ripple(0)), rel=0.1)
    assert flat.noise_sd_m == pytest.approx(0.0003, rel=0.2)
    assert np.std(flat.ripple - ripple(0)) < 0.2 * np.std(ripple(0))


def test_relief_has_small_p_and_what_was_flattened_has_not(flat) -> None:
    for one in flat.regions:
        assert (one.p <= 0.01) == (one.kind is RegionKind.RELIEF)
        assert 0 <= one.p <= 1


def test_plane_in_plane_out() -> None:
    out = flatten_heights(np.zeros(SHAPE), CELL)
    assert np.all(out.heights == 0)
    assert not any(one.kind is RegionKind.RELIEF for one in out.regions)


@pytest.mark.long
def test_flattened_again_nothing_more_goes(flat) -> None:
    again = flatten_heights(flat.heights, CELL)
    assert (again.kept == flat.kept).mean() > 0.999


@pytest.mark.long
def test_heights_in_other_units_give_the_same_regions(flat) -> None:
    large = flatten_heights(1000 * panelled(0), 1000 * CELL)
    assert (large.kept == flat.kept).mean() > 0.999
    assert np.allclose(large.heights[large.kept & flat.kept], 1000 * flat.heights[large.kept & flat.kept])


@pytest.mark.long
def test_the_same_seed_gives_the_same_bytes(flat) -> None:
    again = flatten_heights(panelled(0), CELL, rng=0)
    assert again.heights.tobytes() == flat.heights.tobytes()
    assert [one.p for one in again.regions] == [one.p for one in flat.regions]


@pytest.mark.long
def test_another_seed_gives_the_same_relief(flat) -> None:
    assert np.array_equal(flatten_heights(panelled(0), CELL, rng=1).kept, flat.kept)


@pytest.mark.long
def test_gaps_stay_gaps_and_cost_little(flat) -> None:
    holed = panelled(0).copy()
    holed[5:15, 45:60] = np.nan
    holed[50:, :20] = np.nan
    out = flatten_heights(holed, CELL)
    assert np.array_equal(np.isnan(out.heights), np.isnan(holed))
    assert np.all(out.label[np.isnan(holed)] == -1)
    assert (out.kept == flat.kept)[np.isfinite(holed)].mean() > 0.997


@pytest.mark.long
def test_a_strip_askew_in_its_frame_is_flattened_too() -> None:
    strip = np.full((176, 176), np.nan)
    for row in range(176):
        strip[row, row : row + 6] = ripple(0)[row % SHAPE[0], 10:16][: 176 - row]
    out = flatten_heights(strip, CELL)
    assert not out.reason
    assert np.array_equal(np.isnan(out.heights), np.isnan(strip))


@pytest.mark.long
def test_level_of_the_test_decides() -> None:
    weak = ripple(0) + 0.3 * (panelled(0) - ripple(0))
    flat = flatten_heights(weak, CELL)
    p = sorted(one.p for one in flat.regions if one.kind is RegionKind.RELIEF)
    assert 0 < p[0] < p[-1] < 0.01
    strict = flatten_heights(weak, CELL, FlatteningOptions(level=float(np.sqrt(p[-1] * p[0]))))
    assert 0 < strict.kept.sum() < flat.kept.sum()


def test_too_few_cells_are_left_alone_and_why_is_said() -> None:
    out = flatten_heights(np.full((20, 40), 0.001), CELL)
    assert out.reason.startswith("800 cells of 10 mm on 20 x 40 are too few to tell ripple from relief")
    assert np.all(out.heights == 0.001)


@pytest.mark.parametrize(
    ("heights", "cell", "text"),
    [
        (np.zeros(9), 0.01, r"expected heights with shape \(rows, columns\), got \(9,\)"),
        (np.zeros((50, 50)), 0.0, "the side of a cell is a length above 0, not 0.0 m"),
    ],
)
def test_bad_heights_are_named(heights, cell, text) -> None:
    with pytest.raises(InputError, match=text):
        flatten_heights(heights, cell)


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ({"level": 0.0}, "a probability between 0 and 1, not 0.0"),
        ({"cell_m": -1.0}, "a length above 0, not -1.0 m"),
        ({"most_cells": 10}, "at least 1,000 cells are needed, not 10"),
    ],
)
def test_bad_options_are_named(option, text) -> None:
    with pytest.raises(InputError, match=text):
        FlatteningOptions(**option)


@pytest.mark.long
def test_p_of_the_most_evident_region_is_uniform_without_relief() -> None:
    p = [
        min((one.p for one in flatten_heights(ripple(100 + seed), CELL).regions), default=1.0)
        for seed in range(60)
    ]
    assert np.mean(np.array(p) <= 0.05) <= 0.12
    assert kstest(p, "uniform", alternative="greater").pvalue > 0.01


@pytest.mark.long
def test_steps_of_rounding_are_no_relief_and_higher_ones_are() -> None:
    rounded = 0.002 * np.round(panelled(0) / 0.002)
    kept = flatten_heights(rounded, CELL)
    flat = flatten_heights(rounded, CELL, FlatteningOptions(rounding_m=0.0022))
    steps = [abs(one.height_m) for one in flat.regions if one.kind is RegionKind.RELIEF]
    assert kept.kept.sum() > flat.kept.sum()
    assert flat.kept[SWITCH].mean() > 0.9
    assert min(steps) > 0.0022
    with pytest.raises(InputError, match="rounding"):
        FlatteningOptions(rounding_m=-1.0)


def test_p_of_another_peak_is_uniform_whatever_the_place_and_scale():
    """Few peaks of Gumbel's distribution predict another: the p of 600 is uniform, in the tail too."""
    rng = np.random.default_rng(0)
    peaks = rng.gumbel(3.0, 2.0, (600, 7))
    p = np.array([NullModel(tuple(row[:6]), 100).p(row[6], 100) for row in peaks])
    assert kstest(p, "uniform").pvalue > 0.01
    assert (p <= 0.05).mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / 600))
    moved = NullModel(tuple(5 + 3 * peaks[0, :6]), 100).p(5 + 3 * peaks[0, 6], 100)
    assert moved == pytest.approx(p[0], rel=1e-9)
    null = NullModel(tuple(peaks[0, :6]), 100)
    assert null.p(4.0, 100) > null.p(5.0, 100) > null.p(1e3, 100) > 0
    assert null.p(4.0, 400) > null.p(4.0, 100)
