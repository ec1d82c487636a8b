# SPDX-License-Identifier: MIT
"""Archive: records of pieces of work by the hash of what each depends on; what is missing is done."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from nbv.run.workers import Work, Workers
from nbv.visibility.visibility import Progress
from scenes.checks import InputError
from scenes.io.checks.documents import read_json
from scenes.run.atomic import make_folder, write_json


def part_of(text: str) -> tuple[int, int]:
    """Return the number of a part, from 1, and how many there are, of a text like "2/8".

    Raises
    ------
    InputError
        Another text, or a part that is not one of them.

    Examples
    --------
    >>> part_of("2/8")
    (2, 8)
    """
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    number, of = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= number <= of:
        raise InputError(f"--part {text}: give a part and how many there are, as 2/8; parts count from 1")
    return number, of


class StudyCase(Protocol):
    """A piece of work: its name in files, and the hash of all that its result depends on.

    One with a `file` also writes that, before its record.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def key(self) -> str: ...  # noqa: D102


class RecordArchive:
    """Records of cases in a folder, which is made where it is not there.

    Parameters
    ----------
    folder : Path
        Where they are.

    Raises
    ------
    InputError
        The folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = make_folder(folder)

    def path(self, case: StudyCase) -> Path:
        """Return where the record of a case is, or will be."""
        return self.folder / f"{case.name}.json"

    def holds(self, case: StudyCase) -> bool:
        """Tell whether the complete record of this very case is there, and the file that it says it has."""
        file = getattr(case, "file", None)
        try:
            self.read(case)
        except InputError:
            return False
        return file is None or file.is_file()

    def keep(self, case: StudyCase, record: Mapping[str, Any]) -> None:
        """Write the record of a case, whole or not at all, without its times: they differ from run to run."""
        write_json(self.path(case), {name: value for name, value in record.items() if name != "times"})

    def read(self, case: StudyCase) -> dict[str, Any]:
        """Return the record of a case.

        Raises
        ------
        InputError
            None there, damaged, or made of something else.
        """
        file = self.path(case)
        record = read_json(file, dict)
        if record.get("key") != case.key:
            raise InputError(f"{file}: belongs to another case: its key differs")
        return record


def do_missing(
    cases: Sequence[Any],
    archive: RecordArchive,
    work: Work[Any, dict[str, Any]],
    *,
    workers: Workers,
    progress: Progress | None = None,
    stage: str = "cases",
) -> dict[str, Mapping[str, float]]:
    """Do the cases whose records are not there; return the times of what was done, by name.

    Records are kept as they come, so that a run that dies loses what was in work alone. `progress` is called
    with (stage, done, total).
    """
    missing = [case for case in cases if not archive.holds(case)]
    done, times = len(cases) - len(missing), dict[str, Mapping[str, float]]()

    def tell() -> None:
        if progress is not None:
            progress(stage, done, len(cases))

    tell()
    for number, record in workers.each(work, missing, [case.key for case in missing]):
        archive.keep(missing[number], record)
        times[missing[number].name] = record.get("times", {})
        done += 1
        tell()
    return times
