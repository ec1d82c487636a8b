# SPDX-License-Identifier: MIT
"""Tiles: large holes are filled as small ones are, in bounded memory; nothing shows where tiles meet."""

import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from texture import SurfaceFill, fill_surface
from texture.quality import list_patches
from texture.surface_fill import densest_block

SIDE = 48


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of 48 pixels, so that a hole of 100 has nine."""
    monkeypatch.setattr("texture.surface_fill.SIDE", SIDE)
    monkeypatch.setattr("texture.surface_fill.SAMPLE_SIDE", 96)
    monkeypatch.setattr("texture.surface_fill.SAMPLE_SIDE", 96)
    monkeypatch.setattr("texture.surface_fill.MOST_PIXELS", 10_000)


def grass(side: int = 200) -> NDArray[np.uint8]:
    return np.asarray(data.grass()[:side, :side], dtype=np.uint8)


def hole_in(side: int, low: int, high: int) -> NDArray[np.bool_]:
    hole = np.zeros((side, side), dtype=np.bool_)
    hole[low:high, low:high] = True
    return hole


@pytest.fixture(name="filled", scope="module")
def fill_grass() -> SurfaceFill:
    with pytest.MonkeyPatch.context() as patch:
        small_tiles.__wrapped__(patch)
        return fill_surface(
            np.where(hole_in(200, 50, 150), 0, grass()), hole_in(200, 50, 150), window=9, rng=0
        )


def test_all_is_filled_and_the_rest_is_left(filled: SurfaceFill) -> None:
    hole = hole_in(200, 50, 150)
    assert filled.synthesis.is_complete
    np.testing.assert_array_equal(filled.image[~hole], grass()[~hole])
    assert filled.synthesis.window == 9
    assert 0.5 < filled.synthesis.confidence[hole].mean() <= 1


def test_each_pixel_is_a_copy_of_its_source(filled: SurfaceFill) -> None:
    hole, made = hole_in(200, 50, 150), filled.synthesis
    rows, columns = made.source_rows, made.source_cols
    own = np.indices(hole.shape)
    np.testing.assert_array_equal(np.stack([rows, columns])[:, ~hole], own[:, ~hole])
    assert not hole[rows[hole], columns[hole]].any()
    np.testing.assert_array_equal(made.image[hole], made.image[rows[hole], columns[hole]])


def test_nothing_shows_where_tiles_meet(filled: SurfaceFill) -> None:
    hole = hole_in(200, 50, 150)
    pixels = filled.image[..., None].astype(np.float64)
    known = list_patches(pixels, ~hole)[::4]

    def seam(line: int) -> float:
        at = np.zeros_like(hole)
        at[line, ::2] = at[::2, line] = True
        patches = list_patches(pixels, hole, at=at)
        squares = (known**2).sum(axis=1) - 2 * patches @ known.T + (patches**2).sum(axis=1)[:, None]
        return float(np.sqrt(np.maximum(squares.min(axis=1), 0) / known.shape[1]).mean())

    borders = [seam(line) for line in (95, 96, 143, 144)]
    within = [seam(line) for line in range(56, 144, 2) if min(abs(line - 96), abs(line - 144)) > 6]
    assert np.mean(borders) < np.mean(within) + 2 * np.std(within)
    torn = np.roll(pixels, 7, axis=0)
    pixels[96:144], pixels[:, 96:144] = torn[96:144], np.roll(pixels, 5, axis=0)[:, 96:144]
    assert np.mean([seam(line) for line in (95, 96)]) > np.mean(within) + 2 * np.std(within)


def test_same_seed_same_pixels_on_any_number_of_threads() -> None:
    hole = hole_in(150, 40, 110)
    image = np.where(hole, 0, grass(150))
    one, two = (fill_surface(image, hole, window=5, rng=3, n_threads=n).image for n in (1, 2))
    np.testing.assert_array_equal(one, two)
    assert (one != fill_surface(image, hole, window=5, rng=4).image).any()


def test_stripes_go_on_around_a_cylinder() -> None:
    stripes = np.tile(np.repeat(np.array([40, 200], np.uint8), 6), (120, 10))
    hole = np.zeros(stripes.shape, dtype=np.bool_)
    hole[30:90, :36] = hole[30:90, -40:] = True  # across the seam
    filled = fill_surface(np.where(hole, 0, stripes), hole, window=15, wrap=(False, True), rng=0)
    assert (np.abs(filled.image.astype(int) - stripes) > 16).mean() < 0.01


def test_progress_counts_the_whole_hole_and_a_spent_budget_is_told() -> None:
    hole = hole_in(150, 30, 120)
    image = np.where(hole, 0, grass(150))
    told: list[tuple[int, int]] = []
    fill_surface(image, hole, window=5, rng=0, progress=lambda *step: told.append(step))
    done = [step[0] for step in told]
    assert done == sorted(done)
    assert told[-1] == (hole.sum(), hole.sum())
    some = fill_surface(image, hole, window=5, rng=0, time_budget_s=1e-6)
    assert not some.synthesis.is_complete
    assert (some.synthesis.source_rows[hole] == -1).any()
    np.testing.assert_array_equal(some.image[~hole], image[~hole])


@pytest.mark.long
def test_memory_does_not_grow_with_the_hole() -> None:
    peaks = []
    for low, high in ((250, 350), (60, 540)):
        hole = hole_in(600, low, high)
        image = np.where(hole, 0, np.tile(grass(), (3, 3)))
        tracemalloc.start()
        fill_surface(image, hole, window=3, rng=0, time_budget_s=3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < 80 * 600 * 600 + 40e6


def test_the_densest_block_holds_most() -> None:
    usable = np.random.default_rng(0).random((40, 60)) < np.linspace(0, 1, 60)
    rows, columns = densest_block(usable, 20)
    count = usable[np.ix_(rows, columns)].sum()
    every = [usable[top : top + 20, left : left + 20].sum() for top in range(21) for left in range(41)]
    assert count == max(every)
    assert [len(side) for side in densest_block(usable, 50)] == [40, 50]
