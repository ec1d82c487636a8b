# SPDX-License-Identifier: MIT
"""Journal: the views that were chosen, each kept before it is taken, so that a killed exploration goes on.

Choosing is what takes time. An exploration that is run again with the same input scans again from the views
that it remembers, without choosing them anew, and comes to the same voxels and the same end.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields
from pathlib import Path
from shutil import rmtree
from typing import Protocol

import numpy as np

from nbv.gain import BestView
from nbv.glimpse import Glimpse
from scenes.atomic import atomic_path, json_text, make_folder, write_text
from scenes.pose import Pose

_KEY_FILE = "key.json"
_PARTS = tuple(field.name for field in fields(Glimpse))


class Journal(Protocol):
    """Remembers which view was chosen after so many views."""

    def remembered(self, number: int) -> BestView | None:
        """Return the view that was chosen after `number` views, None where none was."""

    def remember(self, number: int, best: BestView) -> None:
        """Keep the view that was chosen after `number` views."""


class FileJournal:
    """A journal in a folder of its own; one that was made of something else is thrown away.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    key : str
        Tells what the exploration is made of: scene, sensor, options, seed, versions.

    Raises
    ------
    InputError
        The folder cannot be written.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder = folder
        if self._key() != key:
            self.forget()
            make_folder(folder)
            write_text(folder / _KEY_FILE, json_text({"key": key}))

    def remembered(self, number: int) -> BestView | None:
        """Return the view that was chosen after `number` views, None where none was."""
        try:
            with self._file(number).open("rb") as file, np.load(file, allow_pickle=False) as stored:
                sees = Glimpse(*(stored[name] for name in _PARTS))
                return BestView(Pose(stored["world_from_sensor"]), float(stored["gain_m2"]), sees)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def remember(self, number: int, best: BestView) -> None:
        """Keep the view that was chosen after `number` views, whole or not at all."""
        parts = {name: getattr(best.sees, name) for name in _PARTS}
        with atomic_path(self._file(number)) as temporary:
            np.savez(temporary, world_from_sensor=best.pose.matrix, gain_m2=np.float64(best.gain_m2), **parts)

    def forget(self) -> None:
        """Remove the journal: the exploration has ended."""
        rmtree(self.folder, ignore_errors=True)

    def _file(self, number: int) -> Path:
        return self.folder / f"view-{number:04d}.npz"

    def _key(self) -> str | None:
        try:
            return str(json.loads((self.folder / _KEY_FILE).read_text("utf-8"))["key"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
