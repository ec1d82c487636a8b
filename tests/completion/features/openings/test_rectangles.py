# SPDX-License-Identifier: MIT
"""Proposals: holes that wall or a floor divides, strips that are no wall, floors, and the null's tail."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.suites.openings import tail_lines
from completion.features.engine.template import FeatureStatus
from completion.features.openings.decision import (
    LEVELS,
    N_WALLS,
    WALLS_AS_GOOD,
    false_fit_probability,
    is_strip,
)
from completion.features.openings.pipeline import floors_of
from completion.features.openings.recess import Recess, SideEstimate, fit_depth
from completion.features.openings.rectangles import WallChart, propose
from completion.fitting.result import SurfaceFit
from scenes.surfaces.plane import Plane
from tests.completion.features.openings.test_openings import NICHE, beams_at, expected_of

CELL = 0.05


def chart_of(nats):
    return WallChart(np.zeros(2), CELL, nats.astype(np.float64))


def boxes(chart, floors=()):
    """Rows and columns of the proposals, to the half cell that they are wider."""
    holes = [rough for rough, _ in propose(chart, floors)]
    return sorted(
        (round(hole.left / CELL + 0.5), round(hole.right / CELL - 0.5),
         round(hole.bottom / CELL + 0.5), round(hole.top / CELL - 0.5)) for hole in holes
    )  # fmt: skip


def test_two_holes_with_wall_between_are_two() -> None:
    nats = np.full((40, 60), -6.0)
    nats[8:30, 8:28] = nats[8:30, 31:50] = 6.0  # three columns of wall between cost less than a hole is worth
    assert boxes(chart_of(nats)) == [(8, 28, 8, 30), (31, 50, 8, 30)]
    nats[8:30, 28:31] = 0.0  # which nobody saw: one hole behind a post
    assert boxes(chart_of(nats)) == [(8, 50, 8, 30)]


def test_no_hole_goes_on_past_a_floor() -> None:
    nats = np.full((80, 40), -6.0)
    nats[4:70, 10:30] = 6.0
    assert boxes(chart_of(nats)) == [(10, 30, 4, 70)]
    floor = np.column_stack([np.linspace(0.0, 2.0, 400), np.full(400, 40.5 * CELL)])
    assert boxes(chart_of(nats), [floor]) == [(10, 30, 4, 40), (10, 30, 41, 70)]


def strips(wall_to: float) -> np.ndarray:
    """Beams of a wall that has a hole in it and goes on around it for so far."""
    beams = beams_at(NICHE, np.random.default_rng(5), n=120)
    u, v = beams.uv.T
    off = np.maximum(np.maximum(NICHE.left - u, u - NICHE.right), np.maximum(NICHE.bottom - v, v - NICHE.top))
    return replace(beams, nats=np.where((off > 0) & (off < wall_to), -6.0, 6.0))


@pytest.mark.parametrize("side", ["left", "right", "bottom", "top"])
def test_a_frame_is_a_strip_and_a_wall_is_none(side) -> None:
    known = SideEstimate(0.0, 0.001)
    assert is_strip(strips(0.09), NICHE, side, known)
    assert not is_strip(strips(0.6), NICHE, side, known)


def test_the_next_opening_beyond_a_post_says_nothing() -> None:
    known, next_to = SideEstimate(0.0, 0.001), Recess(0.44, 1.4, bottom=-0.4, top=0.8)
    beams = strips(0.09)
    assert is_strip(beams, NICHE, "right", known)
    assert not is_strip(beams, NICHE, "right", known, others=[next_to])


def test_reveals_without_a_back_are_an_opening() -> None:
    """Out of a window nothing comes back; behind a doorway the wall of a corridor is no back."""
    beams = beams_at(NICHE, np.random.default_rng(6))
    window = replace(NICHE, is_closed=False)
    reveals = np.isfinite(expected_of(beams, window))
    silent = replace(beams, ranges=np.where(reveals, beams.ranges, np.inf), is_silent=~reveals)
    recess, depth, _ = fit_depth(silent, replace(window, depth=0.0))
    assert not recess.is_closed
    assert depth.value > NICHE.depth - 0.01
    corridor = beams_at(replace(NICHE, depth=1.0), np.random.default_rng(7))
    assert not fit_depth(corridor, replace(window, depth=0.0))[0].is_closed
    assert fit_depth(beams, replace(window, depth=0.0))[0].is_closed


def level(low, high, height, n=3000):
    rng = np.random.default_rng(8)
    places = np.column_stack([rng.uniform(low, high, (n, 2)), np.full(n, height)])
    fit = SurfaceFit(Plane((0.0, 0.0, height), (0.0, 0.0, 1.0)), 0.001, 1e-6 * np.eye(3), n)
    return SimpleNamespace(fit=fit, points=lambda _seen, _most: places)


def test_seats_and_sills_are_no_floors() -> None:
    floor, above = level((0, 0), (5, 4), 0.0), level((0, 0), (5, 4), 2.9)
    seat, sill = level((1, 1), (2, 2), 0.45), level((0.5, 4.0), (2.0, 4.2), 0.5)
    platform = level((5, 0), (8, 4), 0.4)
    kept = floors_of([seat, floor, sill, above, platform], [], np.array([0.0, 0.0, 1.0]))
    assert [level.fit for level in kept] == [floor.fit, above.fit, platform.fit]


def test_the_chance_of_a_false_fit_falls_with_what_a_fit_has_come_to() -> None:
    for status in FeatureStatus:
        chances = [false_fit_probability(status, nats) for nats in (-50.0, 0.0, 20.0, 100.0, 1000.0)]
        assert chances == sorted(chances, reverse=True)
        assert min(chances) >= 1 / N_WALLS
        assert max(chances) <= 1.0
    at = [
        false_fit_probability(status, 40.0)
        for status in (FeatureStatus.FOUND, FeatureStatus.AMBIGUOUS, FeatureStatus.NONE)
    ]
    assert at == sorted(at)
    assert all(len(held) == len(LEVELS) for held in WALLS_AS_GOOD.values())


def test_the_tail_counts_walls_with_one_as_good() -> None:
    walls = [[(FeatureStatus.NONE, 10.0), (FeatureStatus.NONE, 70.0)], [(FeatureStatus.AMBIGUOUS, 20.0)], []]
    lines = tail_lines(walls)
    assert lines[0] == "N_WALLS = 3"
    assert "FOUND: (0, 0, 0, 0, 0, 0, 0, 0)" in lines[1]
    assert "AMBIGUOUS: (1, 1, 1, 1, 0, 0, 0, 0)" in lines[2]
    assert "NONE: (2, 2, 2, 2, 2, 2, 1, 1)" in lines[3]
