# SPDX-License-Identifier: MIT
"""Study: cases completed by our method in its modes and by the naive baselines, each scored."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from completion.evaluation.score import Score, score
from completion.evaluation.splits import PairCounts, merge_counts
from completion.limits import Mode
from completion.pipeline import CompletionOptions, complete
from nbv.commands.run import Progress
from nbv.evaluation.baselines import BASELINES, baseline_hypothesis
from nbv.evaluation.cases import Case, hypothesis_of
from nbv.evaluation.rooms import random_case
from nbv.scanning.sensor import PinholeSensor
from nbv.view import View
from scenes.builtin import builtin_scene
from scenes.pose import Pose

BENCH_CAMERA = PinholeSensor(
    fov_deg=math.degrees(2 * math.atan(320 / 525)), width=640, height=480, name="f = 525 px"
)
_OFFICE_EYES = (
    ((0.45, 0.6, 1.55), (3.7424, 2.75502, 0.83166)),
    ((0.71612, 0.51565, 1.72088), (4.00293, 2.72641, 1.16466)),
    ((0.24599, 0.65157, 1.7443), (3.4606, 2.83511, 0.79644)),
    ((0.33761, 0.43459, 1.35921), (3.53624, 2.7204, 0.62176)),
    ((0.65314, 0.71529, 1.37965), (3.91099, 3.0128, 1.05122)),
    ((0.53292, 0.89488, 1.30804), (3.99809, 2.73904, 0.53885)),
    ((0.73944, 0.32424, 1.32367), (3.50836, 3.11063, 0.56923)),
    ((0.53912, 0.58661, 1.55164), (3.79315, 2.64995, 0.47742)),
    ((0.6636, 0.67937, 1.32074), (3.95374, 2.73864, 0.35412)),
    ((0.47625, 0.80485, 1.70005), (3.67282, 2.87233, 0.47226)),
)  # of the benchmark's frames, and what is 4 m ahead of them


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
        A mode of ours, or a baseline.
    noise : str
        Noise model of the scans.
    score : Score
        What came of it.
    merges : PairCounts
        Parts of surfaces joined across occluders; empty for baselines, whose segmentation is the truth.
    hypothesised_m2, violation_m2 : float
        Inferred area, and by our audit how much of it beams went through.
    kinds : tuple of (str, int)
        Kind of furniture and surface id, for figures by kind.
    """

    case: str
    breaks_prior: bool
    method: str
    noise: str
    score: Score
    merges: PairCounts
    hypothesised_m2: float
    violation_m2: float
    kinds: tuple[tuple[str, int], ...]


def office_cases(n: int = 10) -> list[Case]:
    """Return the office from ten places, each a case of its own."""
    scene = builtin_scene("office")
    views = [View(Pose.looking_at(eye, goal), BENCH_CAMERA) for eye, goal in _OFFICE_EYES[:n]]
    return [Case(f"office {index}", scene, (view,)) for index, view in enumerate(views)]


def generated_cases(n: int, first_seed: int = 0) -> list[Case]:
    """Return rooms with the seeds `first_seed` and following."""
    return [random_case(first_seed + index) for index in range(n)]


def evaluate(
    cases: Sequence[Case],
    *,
    noise: str,
    modes: Sequence[Mode],
    with_baselines: bool,
    seed: int,
    n_threads: int | None = None,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Iterator[Outcome]:
    """Complete and score all cases, one after the other.

    Parameters
    ----------
    cases : sequence of Case
        What to complete.
    noise : str
        A model of `nbv.scanning.effects`.
    modes : sequence of str
        Modes of our completion.
    with_baselines : bool
        Whether the naive baselines run too.
    seed : int
        Of the noise.
    n_threads : int, optional
        Threads; results do not depend on it.
    progress : callable, optional
        Called with a stage's name, cases done and cases in all; the manifest's times of stages come from it.
    """
    for index, case in enumerate(cases):
        progress("scan and look", index, len(cases))
        scans = case.scans(noise, seed + 1000 * index)
        cells = case.cells(scans)
        for mode in modes:
            progress(f"complete, {mode}", index, len(cases))
            options = CompletionOptions(mode=mode, texture=False)
            completed = complete(scans, options, rng=seed, n_threads=n_threads)
            progress("score", index, len(cases))
            found = hypothesis_of(completed, scans)
            result = score(case.model, cells, scans, found, n_threads=n_threads)
            merges = merge_counts(scans, completed.owners, case.model.scored)
            areas = completed.hypothesised_m2, completed.free_space_violation_m2
            yield _outcome(case, mode, noise, result, merges, areas)
        for baseline in BASELINES if with_baselines else ():
            progress("baselines", index, len(cases))
            guessed = baseline_hypothesis(baseline, case.model, cells, scans, n_threads)
            result = score(case.model, cells, scans, guessed, n_threads=n_threads)
            areas = float(result.claims.claimed.sum()), result.claims.violation_m2
            yield _outcome(case, baseline.name, noise, result, PairCounts(), areas)
    progress("score", len(cases), len(cases))


def _outcome(
    case: Case, method: str, noise: str, result: Score, merges: PairCounts, areas: tuple[float, float]
) -> Outcome:
    kinds = tuple((_kind(name), number) for number, name in enumerate(case.scene.surface_names))
    return Outcome(case.name, case.breaks_prior, method, noise, result, merges, *areas, kinds)


def _kind(name: str) -> str:
    """Kind of thing that a surface belongs to: "table" for "table top west"."""
    return name.split()[0]
