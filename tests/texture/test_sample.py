# SPDX-License-Identifier: MIT
"""Samples, seeds, weights, windows and random numbers: what a synthesis is made of."""

import numpy as np
import pytest
from skimage import data

from texture.sampling.canvas import Canvas, draw_place, plant_seed
from texture.sampling.randomness import Purpose, draw_key, pick, random_words
from texture.sampling.sample import Sample, gaussian_weights, quantise
from texture.window import choose_window


@pytest.mark.parametrize("window", [3, 7, 11, 23, 99])
def test_weights_are_a_quantised_gaussian_in_which_no_pixel_counts_nothing(window: int) -> None:
    weights = gaussian_weights(window)
    sigma = window / 6.4
    radius = window // 2
    for row, column in [(radius, radius), (0, 0), (radius - 1, radius), (0, radius)]:
        exact = 16383 * np.exp(-((row - radius) ** 2 + (column - radius) ** 2) / (2 * sigma**2))
        assert abs(weights[row, column] - exact) <= 0.5
    assert weights.min() >= 1
    assert weights.max() == weights[radius, radius] == 2**14 - 1
    np.testing.assert_array_equal(weights, weights.T)
    np.testing.assert_array_equal(weights, weights[::-1])


@pytest.mark.parametrize("wrap", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("radius", [1, 5])
def test_the_margin_is_the_other_side_or_nothing(wrap: tuple[bool, bool], radius: int) -> None:
    rng = np.random.default_rng(0)
    levels, usable = rng.integers(0, 256, (3, 7, 2)), rng.random((3, 7)) < 0.7
    sample = Sample(levels, usable, wrap, radius)
    assert sample.margin == radius + 1
    for row, column in np.ndindex(sample.padded_usable.shape):
        at = (row - sample.margin, column - sample.margin)
        inside = (wrap[0] or 0 <= at[0] < 3) and (wrap[1] or 0 <= at[1] < 7)
        assert sample.padded_usable[row, column] == (inside and usable[at[0] % 3, at[1] % 7])
        if inside:
            assert (sample.padded_levels[row, column] == levels[at[0] % 3, at[1] % 7]).all()
    assert sample.positions.tolist() == np.flatnonzero(usable).tolist()


def test_a_sample_is_a_read_only_copy() -> None:
    levels, usable = np.zeros((4, 4, 1), dtype=np.int64), np.ones((4, 4), dtype=np.bool_)
    sample = Sample(levels, usable, (False, False), 1)
    levels[:] = 9
    usable[:] = False
    assert sample.usable.all()
    assert not sample.levels.any()
    for array in (sample.levels, sample.usable, sample.positions, sample.padded_levels, sample.padded_usable):
        assert not array.flags.writeable


def test_quantising_rounds_to_the_nearest_of_256_levels() -> None:
    levels = np.arange(256)
    needed = np.ones((16, 16), dtype=np.bool_)
    shifts = np.random.default_rng(0).uniform(-0.49, 0.49, 256)
    image = np.clip((levels + shifts) / 255, 0, 1).reshape(16, 16)
    np.testing.assert_array_equal(quantise(image, needed).ravel(), levels)
    np.testing.assert_array_equal(quantise(levels.astype(np.uint8).reshape(16, 16), needed).ravel(), levels)


def test_a_seed_is_a_piece_of_the_sample() -> None:
    levels = np.arange(36).reshape(6, 6, 1)
    sample = Sample(levels, np.ones((6, 6), dtype=np.bool_), (False, False), 1)
    planted = set()
    for key in range(200):
        canvas = Canvas.empty((7, 5), 1, (False, False), 3)
        plant_seed(canvas, sample, (3, 2), key)
        assert np.count_nonzero(~canvas.unfilled) == 9
        piece = canvas.levels[2:5, 1:4, 0]
        np.testing.assert_array_equal(piece - piece[0, 0], levels[:3, :3, 0])
        np.testing.assert_array_equal(canvas.sources[2:5, 1:4], piece)
        assert (canvas.errors[2:5, 1:4] == 1).all()
        planted.add(int(piece[1, 1]))
    assert planted == {row * 6 + column for row in range(1, 5) for column in range(1, 5)}


def test_a_seed_in_a_corner_is_cut_and_fills_only_what_is_unfilled() -> None:
    sample = Sample(np.full((3, 3, 1), 50), np.ones((3, 3), dtype=np.bool_), (False, False), 1)
    hole = np.zeros((4, 4), dtype=np.bool_)
    hole[0, :2] = True
    canvas = Canvas.around_hole(np.zeros((4, 4, 1), dtype=np.int64), ~hole, hole, (False, False), 3)
    plant_seed(canvas, sample, (0, 0), key=0)
    assert canvas.levels[0, :2, 0].tolist() == [50, 50]
    assert not canvas.levels[1:].any()


def test_a_ragged_sample_still_seeds_its_centre() -> None:
    usable = np.zeros((5, 5), dtype=np.bool_)
    usable[2, 1] = usable[2, 2] = True
    sample = Sample(np.arange(25).reshape(5, 5, 1), usable, (False, False), 1)
    canvas = Canvas.empty((5, 5), 1, (True, True), 3)
    plant_seed(canvas, sample, (4, 4), key=0)
    assert np.count_nonzero(~canvas.unfilled) == 2
    assert canvas.sources[4, 4] in (11, 12)


def test_a_seed_may_lie_across_the_samples_seam() -> None:
    sample = Sample(np.arange(9).reshape(3, 3, 1), np.ones((3, 3), dtype=np.bool_), (True, True), 1)
    centres = set()
    for key in range(60):
        canvas = Canvas.empty((3, 3), 1, (False, False), 3)
        plant_seed(canvas, sample, (1, 1), key)
        assert sorted(canvas.sources[:3, :3].ravel().tolist()) == list(range(9))
        centres.add(int(canvas.sources[1, 1]))
    assert centres == set(range(9))


def test_places_are_drawn_among_the_unfilled() -> None:
    hole = np.zeros((4, 6), dtype=np.bool_)
    hole[1, 2] = hole[3, 5] = True
    canvas = Canvas.around_hole(np.zeros((4, 6, 1), dtype=np.int64), ~hole, hole, (False, False), 3)
    assert {draw_place(canvas, key, 0) for key in range(20)} == {(1, 2), (3, 5)}


def test_random_words_are_splitmix64() -> None:
    # The published first outputs of splitmix64 from state 0 appear as the streams' start words.
    words = random_words(0, Purpose.ORDER, 0, np.arange(4))
    state = 0xE220A8397B1DCDAF  # splitmix64(0)
    for counter, word in enumerate(words.tolist(), start=1):
        z = (state + counter * 0x9E3779B97F4A7C15) % 2**64
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB % 2**64
        assert word == z ^ (z >> 31)


def test_random_words_are_functions_of_key_purpose_pass_and_pixel() -> None:
    pixels = np.arange(1000)
    words = [
        random_words(key, purpose, pass_number, pixels)
        for key in (0, 2**64 - 1)
        for purpose in Purpose
        for pass_number in (0, 1)
    ]
    assert np.unique(np.concatenate(words)).size == 16 * 1000
    np.testing.assert_array_equal(random_words(0, Purpose.ORDER, 0, pixels[::-1])[::-1], words[0])
    uniform = np.concatenate(words) / 2.0**64
    assert abs(uniform.mean() - 0.5) < 4 * np.sqrt(1 / 12 / uniform.size)


def test_keys_use_all_64_bits() -> None:
    keys = [draw_key(np.random.default_rng(seed)) for seed in range(64)]
    assert np.bitwise_or.reduce(np.array(keys, dtype=np.uint64)) == 2**64 - 1
    assert all(0 <= key < 2**64 for key in keys)


def test_picks_are_uniform_and_within_range() -> None:
    words = random_words(3, Purpose.PICK, 0, np.arange(7000))
    counts = np.bincount([pick(word, 7) for word in words], minlength=7)
    assert counts.size == 7
    assert np.abs(counts - 1000).max() < 4 * np.sqrt(1000)


@pytest.mark.parametrize("period", [8, 10, 16, 22])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_window_holds_a_period(period: int, axis: int) -> None:
    wave = np.where(np.arange(90) % period < period // 2, 200, 40)
    levels = np.broadcast_to(wave[:, None] if axis == 0 else wave, (90, 90))[..., None]
    assert choose_window(levels, np.ones((90, 90), dtype=np.bool_)) == period + 1


def test_the_window_is_small_for_noise_and_large_for_what_never_ends() -> None:
    everywhere = np.ones((40, 40), dtype=np.bool_)
    noise = np.random.default_rng(0).integers(0, 256, (40, 40, 3))
    assert choose_window(noise, everywhere) == 7
    assert choose_window(np.full((40, 40, 3), 77), everywhere) == 7
    # Cosine of a wavelength of four images, in both directions: related over more than 23 pixels.
    rows, columns = np.indices((40, 40))
    slow = (128 + 50 * np.cos(rows / 25) + 50 * np.cos(columns / 25)).astype(np.int64)[..., None]
    assert choose_window(slow, everywhere) == 23


@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_real_textures_get_windows_of_the_usual_size(name: str) -> None:
    levels = getattr(data, name)()[128:384, 128:384, None].astype(np.int64)
    assert 11 <= choose_window(levels, np.ones(levels.shape[:2], dtype=np.bool_)) <= 15


def test_the_window_looks_only_at_the_sample() -> None:
    wave = np.broadcast_to(np.where(np.arange(60) % 12 < 6, 200, 40), (60, 60)).copy()[..., None]
    usable = np.ones((60, 60), dtype=np.bool_)
    usable[20:40, 25:60] = False
    wave[~usable] = 255
    assert choose_window(wave, usable) == 13
    assert choose_window(wave, np.zeros((60, 60), dtype=np.bool_)) == 7
    assert choose_window(wave[:2, :2], usable[:2, :2]) in range(7, 24, 2)
