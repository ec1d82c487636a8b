# SPDX-License-Identifier: MIT
"""Score: one completion against the truth, on one page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.completion.scores.claims import Claims, judge_claims
from benchmarks.completion.scores.findings import Findings, judge_findings
from benchmarks.completion.scores.opening_match import OpeningScore, match_openings
from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.hypothesis import Hypothesis
from benchmarks.completion.truth.samples import sample
from benchmarks.completion.truth.strata import strata_of
from benchmarks.completion.truth.tally import Tally
from benchmarks.completion.truth.truth import TrueModel
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_SAMPLE_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """One completion against the truth.

    Attributes
    ----------
    claims : Claims
        How much of what was inferred is right.
    findings : Findings
        How much of what is hidden was inferred.
    openings : OpeningScore
        Openings found and missed.
    """

    claims: Claims
    findings: Findings
    openings: OpeningScore

    @property
    def areas(self) -> Tally:
        """Areas by true surface (the last row: none) and stratum."""
        claims, findings = self.claims, self.findings
        return Tally(findings.hidden, findings.found, claims.claimed, claims.right)

    @property
    def in_breaks(self) -> Tally:
        """Areas where the scene breaks the prior, without axes."""
        claims, findings = self.claims, self.findings
        return Tally(
            findings.in_breaks_hidden,
            findings.in_breaks_found,
            claims.in_breaks_claimed,
            claims.in_breaks_right,
        )


def score(
    model: TrueModel,
    cells: Sequence[TrueCells],
    scans: Sequence[RangeImage],
    hypothesis: Hypothesis,
    *,
    n_threads: int | None = None,
) -> Score:
    """Score inferred area against the truth.

    A place of inferred area is claimed where it is hidden from all scans or looked through by some, and
    right within 1, 2 or 5 cm of a true surface of the same direction. A hidden place of a true surface that
    is connected with what is seen of it is found where inferred area of its direction is as near.

    Parameters
    ----------
    model : TrueModel
        The truth.
    cells : sequence of TrueCells
        What `look` makes of it with the same scans.
    scans : sequence of RangeImage
        Simulated scans with truth.
    hypothesis : Hypothesis
        What was inferred from them, world coordinates.
    n_threads : int, optional
        Threads that cast.

    Raises
    ------
    InputError
        A scan without truth.
    """
    strata = [strata_of(cell) for cell in cells]
    samples = sample(hypothesis, _SAMPLE_M)
    caster = RayCaster(model.mesh.vertices, model.mesh.faces, n_threads)
    return Score(
        judge_claims(
            model, cells, strata=strata, scans=scans, hypothesis=hypothesis, samples=samples, caster=caster
        ),
        judge_findings(
            model, cells, strata=strata, hypothesis=hypothesis, samples=samples, n_threads=n_threads
        ),
        match_openings(model, cells, hypothesis),
    )
