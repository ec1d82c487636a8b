# SPDX-License-Identifier: MIT
"""Filling coarse to fine: what it promises, and that large holes close in step."""

import numpy as np
import pytest
from skimage import data

from texture import fill, fill_surface, measure_distance, measure_seam


def cut(image: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an image with a square hole in its middle, zeroed, and the hole."""
    hole = np.zeros(image.shape[:2], bool)
    top, left = ((size - side) // 2 for size in hole.shape)
    hole[top : top + side, left : left + side] = True
    emptied = image.copy()
    emptied[hole] = 0
    return emptied, hole


BRICK = data.brick()[:256, :255]  # an odd side


@pytest.mark.parametrize("wrap", [(False, False), (True, True)])
@pytest.mark.parametrize("n_channels", [1, 3])
def test_each_pixel_is_a_copy_of_a_usable_one_and_the_rest_stays(n_channels, wrap):
    image = np.stack([BRICK] * n_channels, axis=2) // np.arange(1, n_channels + 1, dtype=np.uint8)
    emptied, hole = cut(image, 70)
    usable = ~hole
    usable[:, 200:] = False
    filled = fill(emptied, hole, search="budget", window=9, sample_mask=usable, wrap=wrap, rng=0)
    rows, columns = filled.source_rows[hole], filled.source_cols[hole]
    assert filled.is_complete
    assert usable[rows, columns].all()
    assert (filled.image[hole] == image[rows, columns]).all()
    assert (filled.image[~hole] == image[~hole]).all()


def test_a_small_hole_is_searched_exactly():
    emptied, hole = cut(BRICK, 30)
    exact, budget = (
        fill(emptied, hole, search=search, window=11, rng=3).image for search in ("exact", "budget")
    )
    assert (exact == budget).all()


def test_the_result_depends_on_the_seed_alone():
    emptied, hole = cut(BRICK, 68)
    first = fill(emptied, hole, search="budget", window=9, rng=1, n_threads=1)
    again = fill(emptied, hole, search="budget", window=9, rng=1, n_threads=2)
    other = fill(emptied, hole, search="budget", window=9, rng=2)
    assert (first.image == again.image).all()
    assert (first.source_rows == again.source_rows).all()
    assert (first.image != other.image).any()


@pytest.mark.long
@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_wide_holes_come_as_near_to_the_truth_as_by_the_exact_search(name):
    image = getattr(data, name)()[64:448, 64:448]
    emptied, hole = cut(image, 144)
    distances, seams = {}, {}
    for search in ("exact", "budget"):
        fills = [fill(emptied, hole, search=search, window=11, order="window", rng=k).image for k in range(4)]
        distances[search] = np.mean([measure_distance(one, image, hole, hole) for one in fills])
        seams[search] = np.mean([measure_seam(one, hole) for one in fills]) / measure_seam(image, hole)
    assert distances["budget"] < 1.1 * distances["exact"]
    assert seams["budget"] < 1.2


def test_stripes_as_wide_as_the_window_come_back_exactly_across_a_wide_hole():
    stripes = np.tile(np.repeat(np.array([40, 200], np.uint8), 8), (192, 12))
    emptied, hole = cut(stripes, 88)
    filled = fill(emptied, hole, search="budget", order="window", window=9, rng=0)
    assert (filled.image == stripes).all()


def test_where_half_the_size_would_leave_too_few_samples_the_search_is_exact():
    emptied, hole = cut(BRICK[:80, :80], 66)
    exact, budget = (
        fill(emptied, hole, search=search, window=5, rng=0).image for search in ("exact", "budget")
    )
    assert (exact == budget).all()


def test_a_surface_is_filled_by_a_budget_too():
    emptied, hole = cut(BRICK, 70)
    filled = fill_surface(emptied, hole, search="budget", window=11, rng=0)
    assert (filled.image[~hole] == BRICK[~hole]).all()
    assert measure_distance(filled.image, BRICK, hole, hole) < 20


def test_an_unknown_search_is_refused():
    with pytest.raises(ValueError, match="search: expected one of"):
        fill(*cut(BRICK, 10), search="quick")  # type: ignore[arg-type]
