# SPDX-License-Identifier: MIT
"""The self-check: which windows it tries, on which holes, and when it prefers a larger one."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from texture import Lattice, fill, find_lattice
from texture.window import (
    WINDOWS,
    FillPiece,
    check_windows,
    choose_first,
    choose_window,
    find_fullest_part,
    list_holes,
)


def test_the_self_check_says_what_it_tried_and_the_result_is_that_of_its_window() -> None:
    image = data.brick()[128:278, 128:228]
    hole = np.zeros(image.shape, dtype=np.bool_)
    hole[10:26, 30:46] = True
    found = fill(image, hole, rng=0)
    tried = list(found.window_distances)
    assert tried == [tried[0], *(window for window in WINDOWS if window > tried[0])]
    assert tried[0] == choose_window(image[..., None].astype(np.int64), ~hole)
    assert found.window in tried
    again = fill(image, hole, window=found.window, rng=0)
    np.testing.assert_array_equal(found.image, again.image)
    assert again.window_distances == {}


def draw_fills(errors: dict[int, tuple[float, float]]) -> tuple[list[tuple[int, int]], FillPiece]:
    """Return a list of calls, and a filler that errs by so many levels with each window, in turns."""
    calls: list[tuple[int, int]] = []

    def fill_piece(
        image: NDArray[np.uint8], hole: NDArray[np.bool_], known: NDArray[np.bool_], window: int
    ) -> NDArray[np.uint8]:
        assert not (hole & known).any()
        calls.append((window, int(image[hole].sum())))
        return np.where(hole[..., None], image + errors[window][len(calls) % 2], image).astype(np.uint8)

    return calls, fill_piece


def test_a_larger_window_must_be_clearly_better_on_every_hole() -> None:
    levels = np.random.default_rng(0).integers(60, 120, (150, 150, 1))
    everywhere = np.ones((150, 150), dtype=np.bool_)
    cases: list[tuple[list[tuple[float, float]], int, list[int]]] = [
        ([(20, 20)] * 5, 7, [6, 1, 1, 1, 1]),  # one failure is enough
        ([(20, 20), (19, 19), (19, 19), (19, 19), (19, 19)], 7, [6] * 5),  # better, but not by a tenth
        ([(20, 20), (10, 10), (9.5, 9.5), (4, 4), (30, 30)], 23, [6, 6, 6, 6, 1]),
        ([(20, 20), (1, 30), (30, 1), (30, 30), (30, 30)], 7, [6]),  # better on half of the holes
    ]
    for errors, expected, n_fills in cases:
        calls, fill_piece = draw_fills(dict(zip((7, *WINDOWS), errors, strict=True)))
        check = check_windows(levels, everywhere, fill_piece)
        assert check.window == expected
        assert list(check.distances) == [7, *WINDOWS]
        found = [sum(window == side for window, _ in calls) for side in (7, *WINDOWS)]
        assert found[: len(n_fills)] == n_fills
        assert len({truth for window, truth in calls if window == 7}) == 6


@pytest.mark.parametrize(("period", "expected"), [(9, 15), (16, 25), (21, 31), (30, 31)])
def test_the_first_window_keeps_a_lattice_in_step(period: int, expected: int) -> None:
    cell = np.random.default_rng(1).integers(0, 256, (period, period, 1))
    image = np.tile(cell, (8, 8, 1))[:150, :150]
    everywhere = np.ones(image.shape[:2], dtype=np.bool_)
    lattice = find_lattice(image.astype(np.uint8))
    assert choose_first(image, everywhere, lattice) == max(expected, choose_window(image, everywhere))
    coarse = Lattice(np.array([[0.0, 40.0]]), 0.9)
    assert choose_first(image, everywhere, coarse) == choose_window(image, everywhere)


def test_features_are_looked_for_where_most_of_the_sample_is() -> None:
    usable = np.zeros((700, 900), dtype=np.bool_)
    usable[350:640, 500:780] = True
    part = find_fullest_part(usable)
    assert np.count_nonzero(usable[part]) == np.count_nonzero(usable)
    assert usable[part].shape == (320, 320)
    assert usable[:200, :100][find_fullest_part(usable[:200, :100])].shape == (200, 100)


def test_small_samples_have_no_room_for_holes() -> None:
    usable = np.ones((120, 100), dtype=np.bool_)
    usable[:, :4] = False
    holes = list_holes(usable)
    assert len(holes) == 6
    assert len(list_holes(usable[:40, :44])) == 1
    assert list_holes(usable[:39]) == []
    for row, column in holes:
        around = usable[row - 8 : row + 32, column - 8 : column + 32]
        assert around.shape == (40, 40)
        assert around.all()
    usable[::30, ::30] = False
    assert list_holes(usable) == []
    check = check_windows(np.zeros((*usable.shape, 1), dtype=np.int64), usable, lambda image, *_: image)
    assert check.window == 7
    assert check.distances == {}
