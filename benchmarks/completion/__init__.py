# SPDX-License-Identifier: MIT
"""Evaluation of completion on scenes whose truth is known: `python -m benchmarks.completion`; names."""

from benchmarks.completion.scores.other_scans import HiddenScore, score_by_others
from benchmarks.completion.scores.score import Score, score
from benchmarks.completion.truth.cells import TrueCells, look
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.samples import sample
from benchmarks.completion.truth.strata import Stratum
from benchmarks.completion.truth.tally import Tally
from benchmarks.completion.truth.truth import TrueChart, TrueModel, true_charts

__all__ = [
    "HiddenScore",
    "Hypothesis",
    "Score",
    "Stratum",
    "Tally",
    "TrueCells",
    "TrueChart",
    "TrueModel",
    "look",
    "sample",
    "score",
    "score_by_others",
    "true_charts",
]
