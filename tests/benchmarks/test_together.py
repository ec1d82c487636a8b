# SPDX-License-Identifier: MIT
"""A scan more is never harmful: scans of a room together against each alone, with poses that are off."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.cases.frames import Walk
from benchmarks.suites.together import Compared, Trial, is_more_tilted, is_rougher, run, trial_row
from completion import CompletionOptions
from tests.helpers.crate_scans import room, scan

PLAIN = CompletionOptions(texture=False)
OFF = ((0.0, 0.0), (0.2, 0.005), (0.5, 0.02), (1.0, 0.05))
IN_THE_GATE = (OFF[0], OFF[2])
SAME = Compared(0, 0, 0, 1.0, 0.1, 0.1, 0.002, 0.002, 0.5, 0.5)


@cache
def trial(turn_deg: float, shift_m: float, *, moves: bool = True) -> Trial:
    source = Walk("room", "", (0, 0, 0), 4, 1)
    source.__dict__.update(frames=tuple(scan(k) for k in range(4)), caster=room().ray_caster())
    return run(source, range(3), replace(PLAIN, moves_scans=moves), (turn_deg, shift_m), seed=3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("turn", "shift"),
    [pytest.param(*off, marks=() if off in IN_THE_GATE else pytest.mark.long) for off in OFF],
)
def test_no_surface_of_three_scans_with_wrong_poses_is_worse_than_of_one(turn, shift):
    found = trial(turn, shift)
    assert len({one.together for one in found.compared}) >= 3
    assert [one for one in found.compared if is_more_tilted(one) or is_rougher(one)] == []
    exact = trial(0.0, 0.0)
    assert found.kept > 0.95
    assert found.right_m2[1] > 0.9 * exact.right_m2[1]
    assert found.wrong_m2[1] < exact.wrong_m2[1] + 0.05
    assert trial_row(exact).startswith("| room 0+1+2 | ")


@pytest.mark.long
def test_contradictions_grow_with_the_error_of_the_poses_and_are_cured():
    errors = [max(one.offset_m for one in trial(*off).pairs) for off in OFF]
    assert errors == sorted(errors)
    assert errors[0] < 0.001
    assert errors[-1] > 0.03
    for off in OFF[1:]:
        pairs = trial(*off).pairs
        assert sum(one.still_contradicted_m2 for one in pairs) < 0.1 * sum(
            one.contradicted_m2 for one in pairs
        )
        assert trial(*off).moved_m > off[1] / 4


def test_worse_is_told_from_alike():
    assert not is_more_tilted(SAME)
    assert not is_rougher(SAME)
    assert is_more_tilted(replace(SAME, tilt_deg=0.35))
    assert not is_more_tilted(replace(SAME, tilt_deg=0.25))
    assert is_rougher(replace(SAME, rms_m=0.0045))
    assert not is_rougher(replace(SAME, rms_m=0.0035))
    cells = trial_row(Trial("none", (), (), 0.0, (0.0, 0.0), (0.0, 0.0), 1.0)).split(" | ")
    assert cells[1] == "0"
    assert np.isnan(float(cells[2]))
