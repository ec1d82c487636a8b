# SPDX-License-Identifier: MIT
"""Laws of the quality measures and of the examination: closed forms, known good fills, known bad ones."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from texture import examine, fill, measure_distance, measure_seam, measure_verbatim_share
from texture.quality import PATCH, list_patches
from texture.result import list_pieces


def noise(
    seed: int, shape: tuple[int, ...] = (60, 60), mean: float = 120, sigma: float = 20
) -> NDArray[np.uint8]:
    values = np.random.default_rng(seed).normal(mean, sigma, shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def hole_in(shape: tuple[int, ...], side: int) -> NDArray[np.bool_]:
    hole = np.zeros(shape[:2], dtype=np.bool_)
    first = (shape[0] - side) // 2
    hole[first : first + side, first : first + side] = True
    return hole


def test_the_distance_is_a_metric_on_these() -> None:
    first, second, third = noise(0), noise(1, mean=150), noise(2, sigma=40)
    assert measure_distance(first, first) == 0
    assert measure_distance(first, second) == pytest.approx(measure_distance(second, first))
    assert measure_distance(first, third) <= measure_distance(first, second) + measure_distance(second, third)


def test_a_shift_of_brightness_costs_its_mean_projection() -> None:
    # A shift s moves each projection on direction u by s * sum(u); over random unit directions of R^49 the
    # mean of |sum(u)| is that of |N(0, 1)|, 0.798, up to 1 / sqrt(128) of its spread.
    image = noise(3, sigma=5)
    distance = measure_distance(image, image + np.uint8(10), n_levels=1)
    assert distance == pytest.approx(7.98, abs=4 * 10 * 0.603 / np.sqrt(128))


def test_units_are_8_bit_levels_whatever_the_type() -> None:
    first, second = noise(0), noise(1, mean=150)
    assert measure_distance(first, second) == pytest.approx(measure_distance(first / 255, second / 255))


def test_order_of_patches_and_sizes_do_not_matter() -> None:
    columns = np.tile(np.arange(0, 240, 30, dtype=np.uint8), (64, 8))
    assert measure_distance(columns, np.roll(columns, 3, axis=0)) == 0
    assert measure_distance(columns, columns[:40, :40], n_levels=1) < 0.1 * measure_distance(
        columns, columns.T
    )


def test_masks_leave_pixels_out() -> None:
    image = noise(0)
    stained = image.copy()
    stained[20:40, 20:40] = 0
    outside = ~hole_in(image.shape, 20)
    assert measure_distance(image, stained, outside, outside) == 0
    assert measure_distance(image, stained) > 0


def test_distances_that_cannot_be_measured_are_refused() -> None:
    with pytest.raises(ValueError, match="no 7 x 7 patch"):
        measure_distance(noise(0, (6, 30)), noise(1))
    with pytest.raises(ValueError, match="expected 3 channels as first, got 1"):
        measure_distance(noise(0, (20, 20, 3)), noise(1))
    with pytest.raises(ValueError, match="0 patches of 7 x 7 lie across its border"):
        measure_seam(noise(0), np.zeros((60, 60)))


def test_patches_are_windows_in_raster_order() -> None:
    pixels = np.random.default_rng(0).random((9, 11, 2))
    mask = np.ones((9, 11), dtype=np.bool_)
    mask[0, 0] = False
    patches = list_patches(pixels, mask)
    assert patches.shape == (3 * 5 - 1, PATCH**2 * 2)
    np.testing.assert_array_equal(patches[0], pixels[0:7, 1:8].ravel())
    np.testing.assert_array_equal(patches[-1], pixels[2:9, 4:11].ravel())


def test_a_border_shows_when_the_fill_does_not_continue() -> None:
    image = data.brick()[128:224, 128:224]
    hole = hole_in(image.shape, 32)
    good = fill(image, hole, window=11, order="window", rng=0).image
    bad = np.where(hole, np.roll(image, 7, axis=0), image)
    flat = np.where(hole, np.uint8(image.mean()), image)
    assert measure_seam(image, hole, image) == 1
    assert measure_seam(good, hole, image) < measure_seam(bad, hole, image)
    assert measure_seam(good, hole, image) < measure_seam(flat, hole, image)


@pytest.mark.parametrize("shape", [(47, 30), (90, 21, 3)])
def test_the_seam_is_the_mean_distance_to_the_nearest_patch(shape: tuple[int, ...]) -> None:
    image = noise(5, shape)
    hole = np.zeros(shape[:2], dtype=np.bool_)
    hole[15:25, 8:14] = True
    pixels = image.reshape(*shape[:2], -1).astype(np.float64)
    border = np.zeros_like(hole)
    border[[15, 24], 8:14] = True
    border[15:25, [8, 13]] = True
    crossing = list_patches(pixels, np.ones_like(hole), at=border)
    known = list_patches(pixels, ~hole)
    nearest = [np.sqrt(((known - patch) ** 2).mean(axis=1).min()) for patch in crossing]
    assert len(crossing) == 28
    assert measure_seam(image, hole) == pytest.approx(np.mean(nearest), rel=1e-12)


def test_the_verbatim_share_counts_patches_of_one_shift() -> None:
    rows, columns = np.indices((30, 30))
    hole = hole_in(rows.shape, 12)
    assert measure_verbatim_share(rows + 40, columns - 3, hole) == 1
    halves = rows + np.where(columns < 15, 40, 90)
    # 6 x 6 patches have their centres in a 12 x 12 hole; those across the middle column are of two pieces.
    assert measure_verbatim_share(halves, columns, hole) == 0
    assert measure_verbatim_share(rows + np.where(columns < 16, 40, 90), columns, hole) == pytest.approx(
        1 / 6
    )
    assert measure_verbatim_share(rows, columns, hole_in(rows.shape, 5)) == 0


def test_a_good_fill_raises_no_alarm_and_a_bad_one_does() -> None:
    image = data.grass()[128:224, 128:224]
    hole = hole_in(image.shape, 24)
    good = fill(image, hole, window=11, rng=0)
    found = examine(good, hole)
    assert found.alarms == ()
    assert found.distance < found.piece_distance + 4 * found.piece_spread
    assert 0.5 < found.confidence <= 1
    # From a sample of the darkest pixels alone a meadow cannot be made.
    scattered = fill(image, hole, window=11, rng=0, sample_mask=~hole & (image < 40))
    assert "garbage" in examine(scattered, hole).alarms


def test_copies_of_one_piece_are_told() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (60, 90), dtype=np.uint8)
    image[:, 45:] = image[:, :45]
    hole = hole_in(image.shape, 20)
    found = examine(fill(image, hole, window=7, rng=0), hole)
    assert found.verbatim_share == 1
    assert "verbatim" in found.alarms


def test_joints_that_do_not_meet_raise_an_alarm() -> None:
    rows, columns = np.indices((120, 120))
    joints = np.where((rows % 12 < 2) | (columns % 12 < 2), 60, 180) + noise(0, rows.shape, 10, 3)
    hole = hole_in(rows.shape, 36)
    good = fill(joints.astype(np.uint8), hole, window=15, order="window", rng=0)
    assert examine(good, hole).phase_error <= 0.1
    assert examine(good, hole).alarms == ()
    shifted = np.where(hole, np.roll(good.image, (5, 4), axis=(0, 1)), good.image)
    assert "out of step" in examine(replace(good, image=shifted), hole).alarms


def test_what_cannot_be_compared_is_nan() -> None:
    image = noise(0, (20, 20))
    hole = hole_in(image.shape, 4)
    hole[:, 9] = True
    found = examine(fill(image, hole, window=3, rng=0), hole)
    assert np.isnan(found.distance)
    nothing = examine(fill(image, np.zeros(image.shape), window=3, rng=0), np.zeros(image.shape))
    assert nothing.alarms == ()
    assert np.isnan(nothing.seam)


def test_pieces_are_boxes_of_the_holes_shape_where_all_of_it_is_known() -> None:
    hole = np.zeros((40, 70), dtype=np.bool_)
    hole[5:9, 6:16] = hole[9:15, 6:9] = True
    known = ~hole & (np.arange(70) < 60)
    own, *pieces = list_pieces(hole, known)
    assert hole[own].sum() == hole.sum()
    assert len(pieces) == 6
    assert all(known[piece][hole[own]].all() and known[piece].shape == (10, 10) for piece in pieces)
    assert list_pieces(np.zeros((4, 4), dtype=np.bool_), np.ones((4, 4), dtype=np.bool_)) == []
    assert list_pieces(np.ones((4, 4), dtype=np.bool_), np.zeros((4, 4), dtype=np.bool_)) == [np.s_[0:4, 0:4]]
