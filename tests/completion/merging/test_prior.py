# SPDX-License-Identifier: MIT
"""Prior odds of a join: by the number of regions and by the gap, and how often chance joins what is apart."""

from itertools import combinations

import numpy as np
import pytest

from completion.fitting.result import SurfaceFit
from completion.merging.agreement import FittedPart, Prior, compare
from scenes.surfaces.catalogue import Cylinder, Plane

STRONG = np.log(20.0)


def part(surface, low, high, sd=(1e-3, 1e-2, 1e-2)):
    """A part that covers a rectangle of its surface's chart."""
    u, v = np.meshgrid(np.linspace(low[0], high[0], 15), np.linspace(low[1], high[1], 15))
    points = surface.from_uv(np.stack([u.ravel(), v.ravel()], axis=1))
    corners = surface.from_uv(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]))
    fit = SurfaceFit(surface, 1e-3, np.diag(np.square(sd)), 225)
    return FittedPart.of(fit, np.concatenate([corners, points]), 1e-3, 1e-3)


CYLINDER_SD = (1e-3, 1e-3, 1e-2, 1e-2, 1e-3)
WALL = Plane(np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0]))


def log_odds(*parts, n_scans=1):
    """Of the first two of some parts."""
    return Prior.of(parts, n_scans).log_odds(0, 1)


def test_odds_fall_with_the_number_of_parts_that_are_nearer():
    left, right = part(WALL, [0, 0], [1, 1]), part(WALL, [2, 0], [3, 1])
    between = [
        part(Plane(np.array([1.5, 0, 0.1 * k]), np.array([1.0, 0, 0])), [0, 0], [0.1, 0.1]) for k in range(9)
    ]
    alone, crowded = log_odds(left, right), log_odds(left, right, *between)
    assert alone - crowded == pytest.approx(np.log(10))
    assert log_odds(left, right, *between, n_scans=3) == pytest.approx(alone - np.log(4))


def test_cylinders_are_no_rivals_of_planes():
    left, right = part(WALL, [0, 0], [1, 1]), part(WALL, [2, 0], [3, 1])
    pipe = part(Cylinder(np.array([1.5, 0, 0]), np.array([0.0, 0, 1]), 0.1), [0, 0], [0.1, 1], CYLINDER_SD)
    assert log_odds(left, right, pipe) == log_odds(left, right)


@pytest.mark.parametrize("gap", [0.0, 0.5, 2.0, 8.0])
def test_odds_fall_with_the_gap_beside_what_was_measured(gap):
    left, right = part(WALL, [0, 0], [1, 1]), part(WALL, [1 + gap, 0], [2 + gap, 1])
    assert log_odds(left, right) == pytest.approx(-np.log((2 + gap) / 2), abs=1e-6)


def test_across_the_seam_of_a_cylinder_the_gap_is_the_short_way():
    pipe = Cylinder(np.zeros(3), np.array([0.0, 0, 1]), 1.0)
    before, after = part(pipe, [2.0, 0], [3.0, 1], CYLINDER_SD), part(pipe, [-3.0, 0], [-2.0, 1], CYLINDER_SD)
    assert log_odds(before, after) == pytest.approx(-np.log((2 * np.pi - 4) / 2), abs=1e-6)


def test_clutter_seldom_joins_by_chance_though_its_parts_are_badly_known():
    rng, joined, by_evidence = np.random.default_rng(0), 0, 0
    for _ in range(5):
        clutter = []
        for _ in range(40):
            plane = Plane(rng.uniform(0, 1.5, 3), [0, 0, 1] + rng.normal(0, 0.15, 3))
            clutter.append(part(plane, [0, 0], rng.uniform(0.05, 0.15, 2), sd=(5e-3, 0.1, 0.1)))
        prior = Prior.of(clutter, 1)
        for i, j in combinations(range(40), 2):
            found = compare(clutter[i], clutter[j])
            if found.chi2 <= 1 and found.log_evidence >= STRONG:
                by_evidence += 1
                joined += found.log_evidence + prior.log_odds(i, j) >= STRONG
    assert by_evidence > 100
    assert joined < by_evidence / 10
