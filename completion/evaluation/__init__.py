# SPDX-License-Identifier: MIT
"""Evaluation: scores inferred surface against arrays of truth; names, `score` is the page to read."""

from completion.evaluation.cells import TrueCells, look
from completion.evaluation.hypothesis import Hypothesis
from completion.evaluation.other_scans import HiddenScore, score_by_others
from completion.evaluation.samples import sample
from completion.evaluation.score import Score, score
from completion.evaluation.strata import Stratum
from completion.evaluation.tally import Tally
from completion.evaluation.truth import TrueChart, TrueModel, true_charts

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
