# SPDX-License-Identifier: MIT
"""Journal: what each step of a long run came to, so that one that was killed goes on after the last.

A step is a pure function of what the journal's key names. A run that is made of the same takes the steps that
are there as they are, and comes to the same end.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from typing import Any, Protocol, TypeVar

from scenes.checks import InputError
from scenes.run.atomic import atomic_path, json_text, make_folder, write_text
from scenes.run.packing import PackingError, pack, unpack

_KEY_FILE = "key.json"
_Value = TypeVar("_Value")
_TRIES = 3  # to remove a folder that a worker may be writing to


class Journal(Protocol):
    """Remembers what steps came to."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; where it is not known `work` does it, and it is known from then on."""

    def turn(self, n_steps: int) -> Sequence[int]:
        """Return in which order to offer steps that are numbered from 0; none where nobody else does any."""

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Have a step done, unless it is known or another does it."""


class NoJournal:
    """Remembers nothing: every step is done."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:  # noqa: ARG002 - what is not kept needs no name
        """Return what `work` returns."""
        return work()

    def turn(self, n_steps: int) -> Sequence[int]:  # noqa: ARG002 - nobody else does any
        """Return nothing."""
        return ()

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do nothing: `step` will."""


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
        file = self._file(name)
        try:
            with file.open("rb") as stream:
                known: _Value = unpack(stream)
        except (OSError, PackingError):
            value = work()
            with atomic_path(file) as temporary:
                with temporary.open("wb") as stream:
                    pack(value, stream)
                if self._key() != self.key:
                    raise InputError(f"{self.folder}: is the journal of another run by now") from None
            return value
        return known

    def turn(self, n_steps: int) -> Sequence[int]:  # noqa: ARG002 - nobody else does any
        """Return nothing."""
        return ()

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do nothing: `step` will."""

    def part(self, name: str) -> FileJournal:
        """Return the journal of a part of the run, whose steps are called as those of the whole."""
        return FileJournal(self.folder / name, self.key)

    def forget(self) -> None:
        """Remove the journal: the run has ended. What a worker of it comes to later is not kept."""
        with suppress(OSError):
            (self.folder / _KEY_FILE).unlink()
        for _ in range(_TRIES):
            rmtree(self.folder, ignore_errors=True)
            if not self.folder.exists():
                return

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npz"

    def _key(self) -> str | None:
        try:
            held: Any = json.loads((self.folder / _KEY_FILE).read_text("utf-8"))
            return str(held["key"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None
