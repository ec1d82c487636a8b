# SPDX-License-Identifier: MIT
"""Task: one case to scan, the methods that complete the scans, and what comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.completion.cases.archive import Archive
from benchmarks.completion.cases.baselines import Baseline, baseline_hypothesis
from benchmarks.completion.cases.cost import Cost, measured
from benchmarks.completion.cases.outcome import Outcome
from benchmarks.completion.scenes.cases import Case, hypothesis_of
from benchmarks.completion.scores.radii import radius_errors
from benchmarks.completion.scores.score import score
from benchmarks.completion.scores.splits import PairCounts, merge_counts
from benchmarks.completion.truth.cells import TrueCells
from benchmarks.completion.truth.hypothesis import Hypothesis
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.completed_model import CompletedModel
from nbv.commands.process.progress import Progress
from nbv.scanning.effects.effects import Effects
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

Method = CompletionOptions | Baseline


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One case to scan, and the methods that complete the scans.

    Attributes
    ----------
    case : Case
        What to scan.
    methods : mapping of str to CompletionOptions or Baseline
        By the names that reports use.
    noise : str
        What reports call the effects.
    effects : Effects
        By what the scans differ from exact ranges.
    seed : int
        Of the noise.
    measure : callable, optional
        What a sweep measures, from the task itself and the cells that its scans see.
    """

    case: Case
    methods: Mapping[str, Method]
    noise: str
    effects: Effects
    seed: int
    measure: Callable[[Task, Sequence[TrueCells]], float] | None = None

    def key(self, method: str) -> dict[str, Any]:
        """Return all that the outcome of a method depends on, besides the sources."""
        return {
            "case": self.case.name,
            "method": method,
            "noise": self.noise,
            "scene": self.case.fingerprint,
            "options": _named(self.methods[method]),
            "effects": self.effects.to_json(),
            "seed": self.seed,
            "measured": self.measure is not None,
        }


def _named(method: Method) -> str:
    """What tells a method from others, the same in every run."""
    return f"{method.name}, {method.tests_rays}" if isinstance(method, Baseline) else repr(method)


def evaluate(
    tasks: Sequence[Task],
    archive: Archive | None = None,
    *,
    n_threads: int | None = None,
    progress: Progress = lambda _stage, _done, _total: None,
) -> Iterator[tuple[Outcome, Cost | None]]:
    """Complete and score all cases, one after the other, and yield what came of it and what it took.

    Parameters
    ----------
    tasks : sequence of Task
        What to do.
    archive : Archive, optional
        Where outcomes are kept; those that are there are not made again.
    n_threads : int, optional
        Threads; results do not depend on it.
    progress : callable, optional
        Called with a stage's name, cases done and cases in all; the manifest's times of stages come from it.
    """
    for index, task in enumerate(tasks):
        bench: Bench | None = None
        for method in task.methods:
            key = task.key(method)
            known = archive.find(key) if archive is not None else None
            if known is None:
                progress("scan and look", index, len(tasks))
                bench = bench or Bench.of(task, n_threads)
                progress(f"complete and score, {method}", index, len(tasks))
                known = bench.outcome(method)
                if archive is not None:
                    archive.keep(key, *known)
            yield known
    progress("complete and score", len(tasks), len(tasks))


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A task with its scans taken."""

    task: Task
    scans: tuple[RangeImage, ...]
    cells: tuple[TrueCells, ...]
    n_threads: int | None

    @classmethod
    def of(cls, task: Task, n_threads: int | None) -> Bench:
        """Scan the case of a task."""
        scans = task.case.scans(task.effects, task.seed)
        return cls(task, scans, task.case.cells(scans), n_threads)

    def outcome(self, method: str) -> tuple[Outcome, Cost]:
        """Run one of the task's methods and score it."""
        chosen = self.task.methods[method]
        if isinstance(chosen, Baseline):
            return self._of_baseline(method, chosen)
        return self._of_completion(method, chosen)

    def _of_completion(self, method: str, options: CompletionOptions) -> tuple[Outcome, Cost]:
        completed, cost = measured(
            lambda: complete(self.scans, options, rng=self.task.seed, n_threads=self.n_threads)
        )
        return self.outcome_of(method, completed), cost

    def outcome_of(self, method: str, completed: CompletedModel) -> Outcome:
        """Score what a method made of the scans."""
        model = self.task.case.model
        found = hypothesis_of(completed, self.scans)
        surfaces = [patch.source.fit.surface for patch in completed.patches]
        return self._scored(
            method,
            found,
            merge_counts(self.scans, completed.owners, model.scored),
            radius_errors(model, self.scans, surfaces, found.true_surface),
            (completed.hypothesised_m2, completed.free_space_violation_m2),
        )

    def _of_baseline(self, method: str, baseline: Baseline) -> tuple[Outcome, Cost]:
        model = self.task.case.model
        guessed, cost = measured(
            lambda: baseline_hypothesis(baseline, model, self.cells, self.scans, self.n_threads)
        )
        return self._scored(method, guessed, PairCounts(), np.zeros(0), None), cost

    def _scored(
        self,
        method: str,
        found: Hypothesis,
        merges: PairCounts,
        radius_m: FloatArray,
        areas: tuple[float, float] | None,
    ) -> Outcome:
        task = self.task
        result = score(task.case.model, self.cells, self.scans, found, n_threads=self.n_threads)
        hypothesised_m2, violation_m2 = areas or (
            float(result.claims.claimed.sum()),
            result.claims.violation_m2,
        )
        return Outcome(
            case=task.case.name,
            breaks_prior=task.case.breaks_prior,
            method=method,
            noise=task.noise,
            score=result,
            merges=merges,
            radius_m=radius_m,
            hypothesised_m2=hypothesised_m2,
            violation_m2=violation_m2,
            kinds=tuple(
                (name.split()[0], number) for number, name in enumerate(task.case.scene.surface_names)
            ),
            measured=math.nan if task.measure is None else task.measure(task, self.cells),
        )
