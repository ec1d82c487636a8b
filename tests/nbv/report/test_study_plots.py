# SPDX-License-Identifier: MIT
"""Plots of studies with many planners: lines that can be told apart, and legends that fit."""

from nbv.report.study_report import _DASHES, _fitting_columns, colour_of


def test_lines_of_eighteen_planners_differ() -> None:
    assert len({(colour_of(k), str(_DASHES[k % len(_DASHES)])) for k in range(18)}) == 18
    assert len({colour_of(k) for k in range(9)}) == 9


def test_a_legend_has_as_many_columns_as_fit() -> None:
    assert (
        _fitting_columns(["online", "offline", "greedy", "visibility only", "farthest point", "random"]) == 6
    )
    assert _fitting_columns(["ours", "random"]) == 2
    assert _fitting_columns(["online: a planner with a name of fifty characters!"] * 9) == 2
    assert _fitting_columns(["x" * 120] * 3) == 1
    assert _fitting_columns([]) == 1
