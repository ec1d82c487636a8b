# SPDX-License-Identifier: MIT
"""The ledger of claims, on a wall whose hidden part is known, and on entries made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.frames import RealFrames, Walk, groups
from benchmarks.suites.ledger import Entry, bin_of, outcome, rows_by, table
from benchmarks.suites.ledger import pooled as pool
from completion import CompletionOptions
from nbv.scanning.scanner import scan_scene
from scenes.pose import Pose
from tests.helpers.evaluation_examples import CAMERA, plain_wall

HIDDEN_M2 = 0.6 * 0.4  # the shadow of the board less 10 cm all around
ENTRY = Entry("here", (0,), 1, "plane", "wall", "edges", 1, 2.0, 0.85, 0.3, 0.1, 0.2)


@pytest.mark.parametrize("is_known", [True, False])
def test_a_wall_behind_a_board_comes_true(is_known: bool) -> None:
    wall = plain_wall()
    other = scan_scene(wall.scene, Pose.looking_at((1.2, 0, 0), (0, 2, 0)), CAMERA)
    source = Walk("wall", "", (0, 0, 0), 2, 1) if is_known else RealFrames("wall", 2, 0.005)
    source.__dict__.update(frames=(wall.scan, other), caster=wall.scene.ray_caster())
    found = outcome(source, [0], CompletionOptions(texture=False))
    assert {one.reason for one in found.entries} == {"interior"}
    assert sum(one.right_m2 for one in found.entries) == pytest.approx(HIDDEN_M2, rel=0.15)
    assert sum(one.wrong_m2 for one in found.entries) == 0
    n_hidden, n_found, n_reachable, n_reached = found.found
    assert 0 < n_reached <= n_reachable <= n_hidden
    assert n_reached <= n_found
    assert n_reachable > 0.9 * n_hidden  # nothing is hidden but the wall, of which the frame saw the rest
    assert found.found[0] == found.found[1] > 0


def test_of_a_known_place_other_frames_may_judge_instead_of_the_truth() -> None:
    wall = plain_wall()
    off = scan_scene(wall.scene, Pose.looking_at((0.0, 0, 0), (0, -2, 0)), CAMERA)  # sees nothing of the wall
    source = Walk("wall", "", (0, 0, 0), 2, 1)
    source.__dict__.update(frames=(wall.scan, off), caster=wall.scene.ray_caster())
    found = outcome(source, [0], CompletionOptions(texture=False), by_truth=False)
    assert sum(one.right_m2 + one.wrong_m2 for one in found.entries) == 0
    assert sum(one.unknown_m2 for one in found.entries) == pytest.approx(HIDDEN_M2, rel=0.15)


def test_surfaces_are_pooled_and_drawn_anew() -> None:
    entries = [
        replace(ENTRY, surface=k, right_m2=float(k % 4 > 0), wrong_m2=float(k % 4 == 0)) for k in range(40)
    ]
    pooled = pool("all", [*entries, replace(ENTRY, surface=99, right_m2=0, wrong_m2=0, unknown_m2=9)])
    assert (pooled.n_surfaces, pooled.right_m2, pooled.wrong_m2) == (40, 30, 10)
    assert pooled.unknown_m2 == pytest.approx(17)
    assert pooled.precision == 0.75
    assert pooled.stated == pytest.approx(0.85)
    # Three quarters of forty surfaces: binomial, 2 sd are .137.
    assert pooled.low == pytest.approx(0.75 - 0.137, abs=0.03)
    assert pooled.high == pytest.approx(0.75 + 0.137, abs=0.03)
    assert table([pooled]).splitlines()[-1].endswith("| off |")  # more than .05 beside the precision
    blind = pool("none", [replace(ENTRY, unknown_m2=4.0)])
    assert not blind.decides
    assert table([blind]).splitlines()[-1].endswith("| decides nothing |")
    assert np.isnan(pool("nothing", []).precision)


def test_entries_are_sorted_into_bins() -> None:
    assert bin_of(ENTRY) == "0.80-0.90"
    assert bin_of(replace(ENTRY, confidence=1.0)) == "0.95-1.00"
    assert bin_of(replace(ENTRY, confidence=0.0)) == "0.00-0.50"
    rows = rows_by([ENTRY, replace(ENTRY, confidence=0.2)], bin_of)
    assert [one.name for one in rows] == ["0.00-0.50", "0.80-0.90"]


def test_frames_are_completed_with_others_far_from_them() -> None:
    assert list(groups(4, 1)) == [[0], [1], [2], [3]]
    assert list(groups(4, 2)) == [[0, 2], [1, 3], [2, 0], [3, 1]]
