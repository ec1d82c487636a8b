# SPDX-License-Identifier: MIT
"""Verdicts: what several hypotheses together tell of a pose."""

import numpy as np
import pytest

from completion.registration.hypotheses import Hypothesis
from completion.registration.verdict import Verdict, judge, trust_of

STILL, HALF_TURN = np.eye(3), np.diag([-1.0, -1.0, 1.0])
ALONG_X, ALONG_Y = np.array([0.0, 0, 0, 1, 0, 0]), np.array([0.0, 0, 0, 0, 1, 0])


def pose(turn=STILL, shift=(0.0, 0.0, 0.0), **facts):
    """A hypothesis; without further facts one that beams approve of in all."""
    known = {
        "score": 1.4,
        "agree": 0.9,
        "violate": 0.0,
        "stiffness": 0.01,
        "beyond_planes": 0.4,
        "free": ALONG_X,
    }
    return Hypothesis(motion=np.column_stack([turn, shift]), **{**known, **facts})


def test_a_pose_that_nothing_comes_near_is_claimed():
    assert judge([pose(), pose(HALF_TURN, score=0.1, beyond_planes=0.0)], 0.01).verdict is Verdict.REGISTERED


def test_a_pose_of_which_beams_approve_where_less_is_shared_forbids_a_claim():
    """A room that is its own image: turned by half, less of it is in view, and all that is agrees."""
    hypotheses = [pose(), pose(HALF_TURN, score=0.4, beyond_planes=0.3)]
    judged = judge(hypotheses, 0.01)
    assert judged.verdict is Verdict.AMBIGUOUS
    assert trust_of(hypotheses) < 0.8 < trust_of(hypotheses[:1])


def test_one_that_beams_contradict_forbids_none():
    assert judge([pose(), pose(HALF_TURN, score=0.4, beyond_planes=0.3, violate=0.03)], 0.01).verdict is (
        Verdict.REGISTERED
    )


@pytest.mark.parametrize(("level", "verdict"), [(0.001, Verdict.AMBIGUOUS), (0.2, Verdict.REGISTERED)])
def test_the_level_decides_how_sure_a_claim_is(level, verdict):
    assert (
        judge([pose(beyond_planes=0.05), pose(HALF_TURN, score=0.6, beyond_planes=0.01)], level).verdict
        is verdict
    )


def test_a_corridor_slides_whichever_way_one_looks_along_it():
    loose = {"stiffness": 1e-5}
    hypotheses = [
        pose(**loose),
        pose(HALF_TURN, score=1.3, **loose),
        pose(shift=(3, 0, 0), score=1.2, **loose),
    ]
    judged = judge(hypotheses, 0.01)
    assert judged.verdict is Verdict.SLIDES
    np.testing.assert_allclose(judged.direction, [1, 0, 0])


def test_poses_that_slide_along_different_directions_tell_no_direction():
    hypotheses = [pose(stiffness=1e-5), pose(HALF_TURN, score=1.3, stiffness=1e-5, free=ALONG_Y)]
    assert judge(hypotheses, 0.01).verdict is Verdict.AMBIGUOUS


def test_no_hypothesis_and_a_contradicted_one_show_no_overlap():
    assert judge([], 0.01).verdict is Verdict.NO_OVERLAP
    assert judge([pose(violate=0.05)], 0.01).verdict is Verdict.NO_OVERLAP
