# SPDX-License-Identifier: MIT
"""Study: plan every case that is not planned yet, then tell what all of them found.

A case is a pure function of what its key names, and its plan is written whole or not at all. So a study that
was killed goes on where it stopped, and ends with the same bytes, whoever does the work.
"""

from __future__ import annotations

from pathlib import Path

from nbv.run.workers import ThisProcess, Workers
from nbv.study.case import Case, PlanArchive, cases_of, run_case
from nbv.study.outcome import Outcome, outcome_of
from nbv.study.spec import StudySpec
from nbv.visibility.visibility import Progress


def run_study(
    spec: StudySpec,
    folder: Path,
    *,
    first_seed: int = 0,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Run a study and return the outcome of each case, in the order of the study file.

    Parameters
    ----------
    spec : StudySpec
        What to plan.
    folder : Path
        Keeps a plan for each case; those that are there already and were made of the same are not made again.
    first_seed : int
        Added to every seed of the study.
    workers : Workers, optional
        Who plans; this process when not given. The outcomes do not depend on it.
    progress : callable, optional
        Called with ("cases", done, total).

    Raises
    ------
    InputError
        A scene or sensor that cannot be used; nothing has been planned then. A single case that cannot be
        planned has an outcome that says why.
    """
    cases, archive = cases_of(spec, first_seed), PlanArchive(folder)
    missing = [case for case in cases if not archive.holds(case)]
    done, times = len(cases) - len(missing), dict[str, dict[str, float]]()
    _tell(progress, done, cases)
    for number, record in (workers or ThisProcess()).each(run_case, missing, [case.key for case in missing]):
        archive.keep(missing[number], record)
        times[missing[number].name] = record.get("times", {})
        done += 1
        _tell(progress, done, cases)
    return tuple(outcome_of(case, archive.read(case), times.get(case.name, {})) for case in cases)


def _tell(progress: Progress | None, done: int, cases: tuple[Case, ...]) -> None:
    if progress is not None:
        progress("cases", done, len(cases))
