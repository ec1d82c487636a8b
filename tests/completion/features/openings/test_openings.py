# SPDX-License-Identifier: MIT
"""Openings: exact rectangles, honest sides, walls without any refused, mirrors named."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from benchmarks.cases.walls import null_case, opening_case
from completion.features.engine.template import FeatureStatus, SideState
from completion.features.openings.decision import false_fit_probability
from completion.features.openings.pipeline import find_openings_of_scans
from completion.features.openings.recess import Recess, expect, fit_depth, fit_side, log_likelihoods, recesses
from completion.features.openings.rectangles import best_rectangle
from completion.features.openings.walls import WallBeams, odds_of
from completion.merging.scan_surfaces import SurfaceOptions, find_surfaces
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL
from scenes.run.steps import Steps
from tests.helpers.crate_scans import misplaced
from tests.helpers.crate_scans import scan as crate
from tests.helpers.long_cases import first_in_gate

KINDS = ("doorway", "window", "niche")


def find(*scans, given=None):
    with Steps.over([scan.ranges.size for scan in scans], 1, None, NO_JOURNAL) as steps:
        surfaces = find_surfaces(scans, SurfaceOptions(), steps)
        up = np.array([0.0, 0.0, 1.0])
        return find_openings_of_scans(scans, surfaces, KINDS, given or {}, steps=steps, up=up)


def test_the_best_rectangle_is_that_of_trying_all():
    rng = np.random.default_rng(0)
    for _ in range(20):
        values = rng.normal(-0.3, 1.0, (6, 7))
        best = best_rectangle(values)
        every = [
            values[a:b, c:d].sum() for a, b, c, d in product(range(6), range(1, 7), range(7), range(1, 8))
            if a < b and c < d
        ]  # fmt: skip
        assert best.total == pytest.approx(max(every))
        assert values[best.top : best.bottom, best.left : best.right].sum() == pytest.approx(best.total)


def beams_at(recess, rng, *, noise=0.005, eye=(-0.4, -3.0, 0.1), n=90):
    """Beams from a place before a wall with a recess in it, in the wall's frame."""
    u, v = np.meshgrid(np.linspace(-1.5, 1.5, n), np.linspace(-1.5, 1.5, n))
    uv = np.column_stack([u.ravel(), v.ravel()]) + rng.uniform(-0.5, 0.5, (n * n, 2)) * 3 / n
    slope = (uv - [eye[0], eye[2]]) / -eye[1]
    stretch = np.sqrt(1 + np.square(slope).sum(axis=1))
    wall, none = stretch * -eye[1], np.zeros(len(uv), np.int64)
    beams = WallBeams(
        uv, slope, stretch, wall, ranges=wall, deviation=np.full(len(uv), noise),
        gap=np.full(len(uv), 3 / n), nats=np.zeros(len(uv)), is_silent=none > 0, farthest=12.0, scan=none,
        pixel=none,
    )  # fmt: skip
    expected = expected_of(beams, recess)
    ranges = np.where(np.isfinite(expected), expected, rng.uniform(6.0, 12.0, len(uv)))
    ranges = ranges + rng.normal(0.0, noise, len(uv))
    return replace(beams, ranges=ranges, nats=odds_of(ranges, wall, beams.deviation, 12.0))


def expected_of(beams, recess):
    sides = {name: np.array([getattr(recess, name)]) for name in ("bottom", "top", "depth")}
    left, right = np.array([recess.left]), np.array([recess.right])
    return expect(beams, left, right, **sides, is_closed=recess.is_closed)[0][:, 0]


NICHE = Recess(-0.45, 0.35, -0.3, 0.7, depth=0.2, is_closed=True)


def test_beams_expect_walls_reveals_and_backs():
    beams = beams_at(NICHE, np.random.default_rng(1), noise=1e-9)
    into = (expected_of(beams, NICHE) - beams.wall_range) / beams.stretch
    inside = NICHE.holds(beams.uv)
    assert (into[~inside] == 0).all()
    assert (into[inside] <= 0.2 + 1e-9).all()
    assert (into[inside] < 0.19).any()
    ends = beams.uv + into[:, None] * beams.slope
    assert NICHE.left - 1e-9 <= ends[inside, 0].min()
    assert ends[inside, 0].max() <= NICHE.right + 1e-9
    opening = replace(NICHE, is_closed=False)
    assert np.isinf(expected_of(beams, opening)).sum() == np.isclose(into, 0.2).sum()


def test_the_likelihood_is_that_of_the_ranges_that_are_expected():
    rng = np.random.default_rng(2)
    beams = beams_at(NICHE, rng)
    values = np.array([-0.47, -0.45, -0.40])
    tile = rng.integers(0, 5, len(beams))
    densities = log_likelihoods(beams, recesses(NICHE, "left", values), is_closed=True, tile=tile)
    for k, left in enumerate(values):
        expected = expected_of(beams, replace(NICHE, left=left))
        z = (beams.ranges - expected) / beams.deviation
        density = 0.79 * np.exp(-0.5 * z**2) / (beams.deviation * np.sqrt(2 * np.pi)) + 0.01 / 12.0
        density += 0.2 * (z < 0) / expected
        assert densities[:, k] == pytest.approx(np.bincount(tile, np.log(density)), rel=1e-9)


def test_sides_and_depth_are_right_as_often_as_their_deviations_say():
    z = []
    for seed in range(12):
        beams = beams_at(NICHE, np.random.default_rng([3, seed]))
        rough = replace(NICHE, left=-0.43, depth=0.0, is_closed=False)
        recess, depth, odds = fit_depth(beams, replace(rough, left=-0.45))
        assert recess.is_closed
        assert odds > 10
        left = fit_side(beams, replace(recess, left=-0.43), "left", 0.1)
        z += [(left.value + 0.45) / left.deviation, (depth.value - 0.2) / depth.deviation]
        assert abs(left.value + 0.45) < 0.01
        assert abs(depth.value - 0.2) < 0.002
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 2.0


def test_where_nothing_is_seen_a_side_stays_and_nothing_is_known_of_it():
    beams = beams_at(NICHE, np.random.default_rng(4))
    hidden = np.abs(beams.uv[:, 0] - NICHE.left) < 0.5
    left = fit_side(beams.select(~hidden), NICHE, "left", 0.1)
    assert left.value == NICHE.left
    assert np.isinf(left.deviation)


@pytest.fixture(scope="module")
def door():
    case = opening_case(102, "doorway", 0.3)
    return case, find(case.scan)[0]


def test_a_doorway_is_found_and_what_nobody_saw_of_it_is_said(door):
    case, fits = door
    fit = fits[0]
    assert fit.status is FeatureStatus.FOUND
    corners = np.asarray(fit.geometry["corners"])[:, 1:]
    y0, _z0, y1, z1 = case.hole
    at = {
        "left": corners[:, 0].max() - y1,
        "right": corners[:, 0].min() - y0,
        "top": corners[:, 1].max() - z1,
    }
    for side in fit.sides:
        if side.state is SideState.CONFIRMED and side.name in at:
            assert abs(at[side.name]) < 0.005
            assert abs(at[side.name]) < 6 * side.deviation
        if case.seen[side.name] == 0 and side.name != "bottom":
            assert side.name in fit.unseen
    assert (fit.assignment > 0).sum() > 20
    assert len(fit.assignment) == case.scan.valid.sum()


@pytest.mark.long
def test_a_moved_world_moves_the_doorway(door):
    case, fits = door
    pose = Pose.looking_at(np.array([3.0, 1.0, 2.0]), np.array([4.0, 2.5, 2.0]))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, pose.translation
    moved = case.scan.with_facts(world_from_sensor=Pose(matrix) @ case.scan.world_from_sensor)
    again = find(moved)[0][0]
    expected = np.asarray(fits[0].geometry["corners"]) @ turn.T + pose.translation
    assert np.asarray(again.geometry["corners"]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.long
def test_what_is_given_is_held_and_places_the_side_that_nobody_saw(door):
    case, _ = door
    width = case.hole[2] - case.hole[0]
    fit = find(case.scan, given={kind: {"width": width} for kind in KINDS})[0][0]
    corners = np.asarray(fit.geometry["corners"])[:, 1]
    assert "width" in fit.held
    assert fit.deviation("width") == 0
    assert [corners.min(), corners.max()] == pytest.approx([case.hole[0], case.hole[2]], abs=0.005)


@pytest.mark.parametrize("kind", first_in_gate(2, ["table", "wardrobes", "wall end", "cupboards"]))
def test_walls_without_openings_have_none(kind):
    fits, doubts = find(null_case(101, kind).scan)
    assert not [fit for fit in fits if fit.status is FeatureStatus.FOUND]
    assert doubts
    assert "upright planes" in doubts[0]


def test_poses_that_contradict_what_was_measured_are_told():
    right, off = find(crate(0), crate(1))[1], find(crate(0), misplaced(crate(1), 0.5, 0.02, 0))[1]
    assert not any("poses" in doubt for doubt in right)
    assert any("poses contradict what was measured" in doubt and " mm" in doubt for doubt in off)
    assert not any("--keep-poses" in doubt for doubt in off)  # no option of `unseen feature`


@pytest.mark.long
def test_a_mirror_is_an_opening_or_a_mirror():
    fits, _ = find(null_case(100, "mirror").scan)
    assert fits[0].status is FeatureStatus.AMBIGUOUS
    assert fits[0].false_fit_probability == false_fit_probability(FeatureStatus.AMBIGUOUS, fits[0].evidence)
    assert fits[0].reason.startswith("opening or mirror")
