# SPDX-License-Identifier: MIT
"""Cuts by connected parts and in closed form, against every labelling there is."""

from itertools import product

import numpy as np
import pytest

from completion.boundary.hidden_regions import Borders, HiddenRegions, label_regions


def _hidden_regions(seed: int, n: int) -> HiddenRegions:
    """Regions of one cell each, some pairs parted by an edge, some costs zero."""
    rng = np.random.default_rng(seed)
    pairs = np.array([(a, b) for a in range(n) for b in range(a) if rng.random() < 1.5 / n]).reshape(-1, 2)
    borders = Borders(
        first=pairs[:, 0],
        second=pairs[:, 1],
        edge=np.zeros(len(pairs), np.int32),
        cost=rng.choice([0.1, 1.0], (len(pairs), 2)),
        length=rng.uniform(0.1, 1.0, len(pairs)),
    )
    beside = rng.uniform(0.0, 2.0, (2, n)) * (rng.random((2, n)) < 0.6)
    return HiddenRegions(np.arange(n, dtype=np.int32)[None], n, borders, beside[0], beside[1])


def _cost(regions: HiddenRegions, is_surface: np.ndarray) -> float:
    borders = regions.borders
    here, there = is_surface[borders.first], is_surface[borders.second]
    between = np.where(here & ~there, borders.cost[:, 0], np.where(there & ~here, borders.cost[:, 1], 0.0))
    outer = np.where(is_surface, regions.beside_open, regions.beside_measured)
    return float((between * borders.length).sum() + outer.sum())


@pytest.mark.parametrize("seed", range(20))
def test_cuts_cost_least_of_all_labellings(seed):
    n = 7
    regions = _hidden_regions(seed, n)
    every = np.array(list(product([False, True], repeat=n)))
    cost = np.array([_cost(regions, one) for one in every])
    found = label_regions(regions)
    assert _cost(regions, found.is_surface) == pytest.approx(cost.min(), abs=1e-3)
    least = every[cost <= cost.min() + 1e-9]
    assert (found.is_surface == least.all(axis=0)).all()  # of several the one with least surface
    borders = regions.borders
    outline = regions.beside_measured + regions.beside_open
    outline = outline + np.bincount(borders.first, borders.length, n)
    outline = outline + np.bincount(borders.second, borders.length, n)
    forced = [cost[~every[:, one]].min() - cost[every[:, one]].min() for one in range(n)]
    np.testing.assert_allclose(found.margin, np.array(forced) / np.maximum(outline, 1e-9), atol=5e-3)
