# SPDX-License-Identifier: MIT
"""Outcome: what came of one method on one case, all that summaries are made of."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.completion.scores.score import Score
from benchmarks.completion.scores.splits import PairCounts
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """One method on one case.

    Attributes
    ----------
    case : str
        Name of the case.
    breaks_prior : bool
        Whether the scene breaks the prior (S7).
    method : str
        A mode of ours, with or without a cue, or a baseline.
    noise : str
        What the scans err by.
    score : Score
        What came of it.
    merges : PairCounts
        Parts of surfaces joined across occluders; empty for baselines, whose segmentation is the truth.
    radius_m : (n,) float
        For each true cylinder in view how far its radius is missed, metres; inf where no cylinder was found.
    hypothesised_m2, violation_m2 : float
        Inferred area, and by our audit how much of it beams went through.
    kinds : tuple of (str, int)
        Kind of furniture and surface id, for figures by kind.
    measured : float
        What a sweep measures on the noise-free rays of the case, see there; NaN elsewhere.
    """

    case: str
    breaks_prior: bool
    method: str
    noise: str
    score: Score
    merges: PairCounts
    radius_m: FloatArray
    hypothesised_m2: float
    violation_m2: float
    kinds: tuple[tuple[str, int], ...]
    measured: float = float("nan")
