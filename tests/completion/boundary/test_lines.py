# SPDX-License-Identifier: MIT
"""The compiled search for lines against the plain formulas."""

import numpy as np
import pytest

from completion.boundary.edges import ChartLine, best_line, in_runs, line_through, near_line
from completion.boundary.limits import GAP, MIN_POINTS, SLACK


def _cloud(seed: int, n: int = 120):
    """Points about a line, in two runs, some way off it, and the steps to the next pixels."""
    rng = np.random.default_rng(seed)
    angle, at = rng.uniform(0, np.pi), rng.uniform(-1, 1, 2)
    along = np.array([np.cos(angle), np.sin(angle)])
    place = 0.01 * np.arange(n) + (np.arange(n) >= n // 2) * 0.3
    uv = at + place[:, None] * along + rng.normal(0, 0.002, (n, 2))
    stray = rng.random(n) < 0.2
    uv[stray] += rng.uniform(-0.5, 0.5, (int(stray.sum()), 2))
    step = 0.01 * rng.choice([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], n) + rng.normal(
        0, 1e-4, (n, 2)
    )
    return uv, step, ChartLine(at, along)


def _slack(line, step):
    return SLACK[0] * np.abs(step @ line.normal) + SLACK[1] * np.linalg.norm(step, axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_points_are_near_a_line_by_their_steps(seed):
    uv, step, line = _cloud(seed)
    numbers = np.concatenate([line.point, line.direction])
    for least in (0.0, 0.05):
        expected = np.abs(line.across(uv)) <= np.maximum(_slack(line, step), least)
        np.testing.assert_array_equal(near_line(numbers, uv, step, least), expected)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_is_that_of_least_squares_with_the_weights_it_gives_itself(seed):
    uv, step, line = _cloud(seed)
    chosen = np.abs(line.across(uv)) < 0.01
    weight = np.ones(int(chosen.sum()))
    for _ in range(3):
        mean = np.average(uv[chosen], axis=0, weights=weight)
        offset = uv[chosen] - mean
        fitted = ChartLine(mean, np.linalg.eigh((weight[:, None] * offset).T @ offset)[1][:, 1])
        weight = 1 / _slack(fitted, step[chosen]) ** 2
    found = line_through(uv, step, chosen)
    np.testing.assert_allclose(found[:2], fitted.point, atol=1e-12)
    np.testing.assert_allclose(found[2:], fitted.direction, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_runs_are_cut_at_gaps_and_short_ones_left_out(seed):
    uv, step, line = _cloud(seed)
    members = (np.abs(line.across(uv)) < 0.01) & (np.random.default_rng(seed).random(len(uv)) < 0.7)
    index, along, size = np.flatnonzero(members), line.along(uv), np.linalg.norm(step, axis=1)
    order = index[np.argsort(along[index], kind="stable")]
    wide = np.diff(along[order]) > GAP * np.maximum(size[order][1:], size[order][:-1])
    expected = np.zeros(len(uv), dtype=np.bool_)
    for run in np.split(order, np.flatnonzero(wide) + 1):
        expected[run] = len(run) >= MIN_POINTS and np.ptp(along[run]) > 3 * np.median(size[run])
    found = in_runs(np.concatenate([line.point, line.direction]), uv, step, members)
    np.testing.assert_array_equal(found, expected)
    assert expected.any()


@pytest.mark.parametrize("seed", range(5))
def test_the_best_line_is_found_among_points_that_lie_on_none(seed):
    uv, step, line = _cloud(seed)
    found, members = best_line(uv, step, np.ones(len(uv), dtype=np.bool_))
    assert abs(found[2:] @ line.normal) < 0.01
    assert abs(line.across(found[:2])) < 0.005
    assert members[np.abs(line.across(uv)) < 0.001].mean() > 0.5
    few = np.arange(len(uv)) < MIN_POINTS - 1
    assert not best_line(uv, step, few)[1].any()
