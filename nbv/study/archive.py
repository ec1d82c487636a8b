# SPDX-License-Identifier: MIT
"""Archive: the plans of a study, one file a case, known by what they were made of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nbv.study.case import Case
from scenes.checks import InputError
from scenes.formats.documents import read_json
from scenes.run.atomic import make_folder, write_json


class PlanArchive:
    """Plans of a study in a folder, which is made where it is not there.

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

    def path(self, case: Case) -> Path:
        """Return where the plan of a case is, or will be."""
        return self.folder / f"{case.name}.json"

    def holds(self, case: Case) -> bool:
        """Tell whether a whole plan is there that was made of the same."""
        try:
            self.read(case)
        except InputError:
            return False
        return True

    def keep(self, case: Case, record: Mapping[str, Any]) -> None:
        """Write the record of a case, whole or not at all."""
        write_json(self.path(case), record)

    def read(self, case: Case) -> dict[str, Any]:
        """Return the record of a case.

        Raises
        ------
        InputError
            None there, damaged, or made of something else.
        """
        file = self.path(case)
        record = read_json(file, dict)
        if record.get("key") != case.key:
            raise InputError(f"{file}: is not the plan of this case: it was made of something else")
        return record
