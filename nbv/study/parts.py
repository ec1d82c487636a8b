# SPDX-License-Identifier: MIT
"""Parts of a study: every Nth of its cases, as the jobs of an array on a cluster without a scheduler of ours.

Parts write records into one folder, each whole or not at all, and wait for none; the same study without a
part then finds all records there, and writes the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nbv.run.workers import ThisProcess, Work, Workers
from nbv.study.archive import RecordArchive, do_missing
from nbv.study.case import cases_of, run_case
from nbv.study.scans import run_scan, run_together, sets_of
from nbv.study.spec import ScanStudySpec, StudySpec
from nbv.visibility.visibility import Progress


def run_part(
    spec: StudySpec | ScanStudySpec,
    folder: Path,
    part: tuple[int, int],
    *,
    first_seed: int = 0,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[int, int]:
    """Do the cases of one part that are not done yet; return how many it has, and how many all have.

    Parameters
    ----------
    spec : StudySpec or ScanStudySpec
        The study.
    folder : Path
        Its output folder.
    part : (int, int)
        Number of the part, from 1, and how many there are.
    first_seed, workers, progress
        As for `nbv.run_study`.

    Raises
    ------
    InputError
        A scene, sensor or file that cannot be used.
    """
    number, of = part
    mine = every = 0
    for cases, archive, work in _stages(spec, folder, first_seed):
        own = cases[number - 1 :: of]
        do_missing(own, archive, work, workers=workers or ThisProcess(), progress=progress)
        mine, every = mine + len(own), every + len(cases)
    return mine, every


def _stages(
    spec: StudySpec | ScanStudySpec, folder: Path, first_seed: int
) -> list[tuple[Sequence[Any], RecordArchive, Work[Any, dict[str, Any]]]]:
    """Cases, where their records are, and what is done of each."""
    if isinstance(spec, StudySpec):
        return [(cases_of(spec, first_seed), RecordArchive(folder / "plans"), run_case)]
    sets, archive = sets_of(spec, folder / "scans", first_seed), RecordArchive(folder / "records")
    scans = [case for one in sets for case in one.scans]
    together = [(sets, archive, run_together)] if spec.joins_scans else []
    return [(scans, archive, run_scan), *together]
