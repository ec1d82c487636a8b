# SPDX-License-Identifier: MIT
"""Journal: what each step of a long run came to, so that one that was killed goes on after the last.

A step is a pure function of what the journal's key names. A run that is made of the same takes the steps that
are there as they are, and comes to the same end.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from shutil import rmtree
from typing import Any, Protocol, TypeVar

from scenes.run.atomic import json_text, make_folder, write_bytes, write_text
from scenes.run.packing import PackingError, pack, unpack

_KEY_FILE = "key.json"
_Value = TypeVar("_Value")


class Journal(Protocol):
    """Remembers what steps came to."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; where it is not known `work` does it, and it is known from then on."""


class NoJournal:
    """Remembers nothing: every step is done."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:  # noqa: ARG002 - what is not kept needs no name
        """Return what `work` returns."""
        return work()


NO_JOURNAL = NoJournal()


class FileJournal:
    """A journal in a folder of its own; one that was made of something else is thrown away.

    Steps may be done by several threads at a time.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    key : str
        Tells what the run is made of: inputs, options, seed, versions.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key
        if self._key() != key:
            self.forget()
            make_folder(folder)
            write_text(folder / _KEY_FILE, json_text({"key": key}))

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; what is not known yet `work` does, and it is kept.

        Raises
        ------
        InputError
            The folder cannot be written.
        PackingError
            The value is not built of dataclasses of ours, arrays and plain values.
        """
        file = self.folder / f"{name}.npz"
        try:
            known: _Value = unpack(file.read_bytes())
        except (OSError, PackingError):
            value = work()
            write_bytes(file, pack(value))
            return value
        return known

    def part(self, name: str) -> FileJournal:
        """Return the journal of a part of the run, whose steps are called as those of the whole."""
        return FileJournal(self.folder / name, self.key)

    def forget(self) -> None:
        """Remove the journal: the run has ended."""
        rmtree(self.folder, ignore_errors=True)

    def _key(self) -> str | None:
        try:
            held: Any = json.loads((self.folder / _KEY_FILE).read_text("utf-8"))
            return str(held["key"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None
