# SPDX-License-Identifier: MIT
"""Grouping: which groups are asked whether they join."""

from itertools import combinations
from types import SimpleNamespace

from completion.registration import network
from completion.registration.motions import STILL
from completion.registration.network import ScanGroup, group_scans
from completion.registration.verdict import Judgement, Verdict


def test_each_two_groups_are_judged_by_themselves(monkeypatch):
    """What was said of two groups is never taken for what is said of others, whatever memory they lie in."""
    judged = set()

    def joint(first, second, views, pairs, level):
        judged.add((first.scans, second.scans))
        verdict = Verdict.NO_OVERLAP if 0 in first.scans else Verdict.REGISTERED
        lead = 1.0 / (first.scans[0] + second.scans[0])
        best = SimpleNamespace(motion=STILL, score=lead)
        return network._Joint([best], Judgement(verdict, ""))

    monkeypatch.setattr(network, "_joint", joint)
    groups = group_scans([None] * 9, {}, 0.01, lambda group: ScanGroup(dict(group.poses)))
    assert [group.scans for group in groups] == [(0,), tuple(range(1, 9))]
    asked = set(combinations([(k,) for k in range(9)], 2))
    asked |= {((0,), tuple(range(1, last))) for last in range(3, 10)}
    assert asked <= judged
