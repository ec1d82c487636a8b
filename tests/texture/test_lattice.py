# SPDX-License-Identifier: MIT
"""Laws of lattices: periods that were put in come out, a shift by k pixels is k / period out of step."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from texture import fill, find_lattice, measure_phase_error
from texture.lattice import Correlator, _refine


def tiled(
    seed: int, period: tuple[int, int], shape: tuple[int, int] = (96, 96), n_channels: int = 1
) -> NDArray[np.uint8]:
    cell = np.random.default_rng(seed).integers(0, 256, (*period, n_channels), dtype=np.uint8)
    rows, columns = np.indices(shape)
    return np.asarray(cell[rows % period[0], columns % period[1]])


def hole_in(shape: tuple[int, ...], side: int) -> NDArray[np.bool_]:
    hole = np.zeros(shape[:2], dtype=np.bool_)
    first = (shape[0] - side) // 2
    hole[first : first + side, first : first + side] = True
    return hole


def test_correlation_is_that_of_each_pair_of_overlaps() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(120, 30, (2, 7, 9, 2))
    first_mask, second_mask = rng.random((2, 7, 9)) < 0.7
    found, counts = Correlator(second, second_mask).correlate(first, first_mask)
    for down in range(-6, 7):
        for right in range(-8, 9):
            here = np.s_[max(0, -down) : 7 - max(0, down), max(0, -right) : 9 - max(0, right)]
            there = np.s_[max(0, down) : 7 + min(0, down), max(0, right) : 9 + min(0, right)]
            both = first_mask[here] & second_mask[there]
            assert counts[6 + down, 8 + right] == np.count_nonzero(both)
            if np.count_nonzero(both) > 1:
                a, b = (values[both] - values[both].mean(axis=0) for values in (first[here], second[there]))
                expected = (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())
                assert found[6 + down, 8 + right] == pytest.approx(expected)


def test_an_image_correlates_with_itself_as_with_another_alike() -> None:
    rng = np.random.default_rng(1)
    image, mask = rng.normal(120, 30, (21, 17, 3)), rng.random((21, 17)) < 0.7
    whole, whole_counts = Correlator(image, mask).correlate(image, mask)
    found, counts = Correlator(image, mask, (6, 4)).correlate_itself()
    near = np.s_[20 - 6 : 20 + 7, 16 - 4 : 16 + 5]
    np.testing.assert_array_equal(counts, whole_counts[near])
    np.testing.assert_allclose(found, whole[near], atol=1e-12)


@pytest.mark.parametrize("period", [(5, 7), (12, 12), (9, 20), (3, 4)])
@pytest.mark.parametrize("n_channels", [1, 3])
def test_periods_are_found(period: tuple[int, int], n_channels: int) -> None:
    found = find_lattice(tiled(1, period, n_channels=n_channels))
    expected = sorted([(float(period[0]), 0.0), (0.0, float(period[1]))], key=np.linalg.norm)
    assert sorted(np.abs(found.periods).tolist()) == sorted(map(list, expected))
    assert found.correlation == pytest.approx(1)


def test_a_period_between_pixels_is_found_by_its_repetitions() -> None:
    wave = 120 + 80 * np.cos(2 * np.pi * np.arange(120) / 7.3) * np.ones((60, 1))
    found = find_lattice(wave.astype(np.uint8)).periods
    assert len(found) == 1
    np.testing.assert_allclose(np.abs(found[0]), [0, 7.3], atol=0.5 / 5)  # five of them lie in a third


def test_the_repetition_before_is_none_of_the_next() -> None:
    """What resembles itself at every small displacement would lead a short period back to nothing."""
    rows, columns = np.indices((43, 53))
    correlation = 1 - 0.1 * np.hypot(rows - 21, columns - 26)
    refined = _refine(correlation, (21, 26), np.array([2, -1]))
    assert np.abs(refined - [2, -1]).max() <= 1


def test_turning_the_image_turns_its_lattice() -> None:
    image = tiled(2, (6, 11))
    assert sorted(np.abs(find_lattice(image.T[0].T).periods).tolist()) == sorted(
        np.abs(find_lattice(np.swapaxes(image, 0, 1)).periods[:, ::-1]).tolist()
    )


def test_running_bond_has_a_slanting_lattice() -> None:
    rows, columns = np.indices((96, 96))
    shifted = columns + rows // 8 % 2 * 10
    image = np.where((rows % 8 < 2) | (shifted % 20 < 2), 200, 90).astype(np.uint8)
    periods = find_lattice(image).periods
    np.testing.assert_array_equal(np.abs(periods), [[8, 10], [8, 10]])
    assert abs(np.linalg.det(periods)) == pytest.approx(160)


@pytest.mark.parametrize("name", ["grass", "gravel", "noise", "flat"])
def test_what_does_not_repeat_has_no_lattice(name: str) -> None:
    made = {
        "noise": np.random.default_rng(0).integers(0, 256, (90, 90), dtype=np.uint8),
        "flat": np.full((60, 60), 70, dtype=np.uint8),
    }
    image = made[name] if name in made else getattr(data, name)()[:200, :200]
    assert find_lattice(image).periods.shape == (0, 2)
    assert find_lattice(image).correlation == 0
    assert np.isnan(measure_phase_error(image, hole_in(image.shape, 20)))


@pytest.mark.parametrize("period", [(8, 8), (10, 16)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_shift_by_k_pixels_is_k_periods_out_of_step(period: tuple[int, int], axis: int) -> None:
    image = tiled(3, period)
    hole = hole_in(image.shape, 30)
    lattice = find_lattice(image, ~hole)
    for k in range(-2, period[axis] // 2 + 1):
        moved = np.where(hole[..., None], np.roll(image, k, axis=axis), image)
        error = measure_phase_error(moved, hole, lattice=lattice)
        assert error == pytest.approx(abs(k) / period[axis])
    assert measure_phase_error(moved, hole) == error


def test_contrast_and_type_do_not_matter() -> None:
    image = tiled(4, (8, 8))
    hole = hole_in(image.shape, 30)
    moved = np.where(hole[..., None], np.roll(image, 3, axis=0), image)
    assert measure_phase_error(moved / 510 + 0.2, hole) == measure_phase_error(moved, hole)


def test_half_a_hole_out_of_step_counts_half() -> None:
    image = tiled(5, (8, 8))
    hole = hole_in(image.shape, 32)
    upper = hole & (np.arange(96) < 48)[:, None]
    moved = np.where(upper[..., None], np.roll(image, 4, axis=1), image)
    assert measure_phase_error(moved, hole) == pytest.approx(0.25)


def test_a_flat_fill_is_wholly_out_of_step() -> None:
    image = tiled(6, (8, 8))
    hole = hole_in(image.shape, 30)
    assert measure_phase_error(np.where(hole[..., None], 100, image).astype(np.uint8), hole) == 0.5


def test_nothing_filled_or_nothing_known_is_nan() -> None:
    image = tiled(7, (8, 8))
    assert np.isnan(measure_phase_error(image, np.zeros((96, 96))))
    assert np.isnan(measure_phase_error(image, np.ones((96, 96))))
    hole = hole_in(image.shape, 30)
    lattice = find_lattice(image)
    assert np.isnan(measure_phase_error(image, hole, np.zeros((96, 96)), lattice))


@pytest.mark.parametrize("window", [11, 23])
def test_brick_stays_in_step(window: int) -> None:
    image = data.brick()[128:288, 128:288]
    hole = hole_in(image.shape, 40)
    filled = fill(image, hole, window=window, order="window", rng=0).image
    assert measure_phase_error(filled, hole) <= 0.1
    assert measure_phase_error(np.where(hole, np.roll(image, 18, axis=1), image), hole) > 0.3
