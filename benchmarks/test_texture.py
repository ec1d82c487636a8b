# SPDX-License-Identifier: MIT
"""Efros-Leung: the readable reference beside the compiled scan, same hole, same result."""

import numpy as np
import pytest
from skimage import data

from texture import fill


@pytest.fixture(scope="module")
def brick():
    """A hole of 24 x 24 in a 128 x 128 crop of brick."""
    image = data.brick()[128:256, 128:256]
    hole = np.zeros(image.shape, dtype=bool)
    hole[52:76, 52:76] = True
    return image, hole


@pytest.mark.benchmark(group="hole 24 x 24 in 128 x 128, window 11")
@pytest.mark.parametrize("engine", ["reference", "numba"])
def test_fill(benchmark, brick, engine):
    image, hole = brick
    warm = engine == "numba"
    result = benchmark.pedantic(
        fill, (image, hole), {"window": 11, "rng": 0, "engine": engine}, rounds=2, warmup_rounds=int(warm)
    )
    assert result.n_seeds == 0
