# SPDX-License-Identifier: MIT
"""A set of pixels is its mask, and sets of labels are the labels."""

import numpy as np
import pytest

from completion.observe.observation import PixelSet, ScanPixels


@pytest.mark.parametrize("n_labels", [1, 5, 70_000])
def test_sets_by_label_are_the_masks_of_the_labels(n_labels):
    labels = np.random.default_rng(0).integers(0, min(n_labels, 5) + 1, (13, 17)).astype(np.int32)
    labels[labels == 3] = n_labels
    each = PixelSet.by_label(labels, n_labels)
    assert len(each) == n_labels
    for number in {1, 2, min(n_labels, 5), n_labels}:
        if number <= n_labels:
            np.testing.assert_array_equal(each[number - 1].mask, labels == number)
    assert sum(map(len, each)) == np.count_nonzero(labels)


def test_a_set_picks_as_its_mask_does_and_a_union_holds_all():
    rng = np.random.default_rng(1)
    image, labels = rng.random((6, 7, 3)), rng.integers(0, 3, (6, 7)).astype(np.int32)
    one, two = PixelSet.by_label(labels, 2)
    np.testing.assert_array_equal(one.pick(image), image[labels == 1])
    both = PixelSet.union([two, one], one.shape)
    np.testing.assert_array_equal(both.mask, labels > 0)
    np.testing.assert_array_equal(both.flat, PixelSet.of(labels > 0).flat)
    assert len(PixelSet.union([], one.shape)) == 0


MASKS = [
    np.zeros((3, 4), np.bool_),
    np.eye(5, 2, dtype=np.bool_),
    np.zeros((2, 2), np.bool_),
    np.ones((1, 3), np.bool_),
]


@pytest.fixture(scope="module")
def pixels() -> ScanPixels:
    return ScanPixels.of([PixelSet.of(mask) for mask in MASKS])


def test_each_scan_has_its_own_pixels(pixels):
    assert len(pixels) == len(MASKS)
    for own, mask in zip(pixels, MASKS, strict=True):
        np.testing.assert_array_equal(own.mask, mask)
    np.testing.assert_array_equal(pixels[-1].mask, MASKS[-1])
    assert [len(own) for own in pixels[1:3]] == [2, 0]
    assert pixels.n_pixels == 5


def test_scans_without_pixels_are_not_kept(pixels):
    assert [scan for scan, _ in pixels.held] == [1, 3]


def test_there_are_no_more_scans(pixels):
    with pytest.raises(IndexError):
        pixels[len(MASKS)]
