# SPDX-License-Identifier: MIT
"""Lock: one run at a time writes to a folder; the system lets go of it when the run ends, however it ends."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from scenes.checks import InputError

_WAIT_S = 2.0  # that a run which was just killed may need to be gone
_POLL_S = 0.02
_LEFTOVER = re.compile(r"\..+\.\d+\.tmp(\.[^.]+)?")  # of `scenes.run.atomic.atomic_path`


@contextmanager
def locked(folder: Path, name: str = "", wait_s: float = _WAIT_S) -> Iterator[None]:
    """Hold the lock of a folder, or of one file in it, and clear it of what a killed run left half-written.

    The lock is an empty file, removed at the end; one that a killed run left behind locks nothing. Where the
    file system knows no locks, or the folder cannot be written, nothing is held.

    Parameters
    ----------
    folder : Path
        Where outputs go.
    name : str
        Of the output file; "" for the whole folder.
    wait_s : float
        How long to wait for a run that holds it, seconds.

    Raises
    ------
    InputError
        Another run holds it.
    """
    file = lock_file(folder, name)
    try:
        stream = _opened(file, wait_s)
    except OSError:
        yield
        return
    with stream:
        if not name:
            remove_leftovers(folder)
        try:
            yield
        finally:
            with suppress(OSError):  # Windows keeps files that are open
                file.unlink()


def lock_file(folder: Path, name: str = "") -> Path:
    """Return the file that is the lock of a folder, or of the file `name` in it."""
    return folder / (f".unseen.{name}.lock" if name else ".unseen.lock")


def _opened(file: Path, wait_s: float) -> BinaryIO:
    """Return the lock's file, locked: the one that stands there now, not one that was just removed."""
    until = time.monotonic() + wait_s
    while True:
        stream = file.open("ab")
        if not _taken(stream.fileno()):
            stream.close()
            if time.monotonic() < until:
                time.sleep(_POLL_S)
                continue
            raise InputError(f"{file.parent}: another run writes there; wait for it, or give another --out")
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(stream.fileno()), file.stat()):
                return stream
        stream.close()


def remove_leftovers(folder: Path) -> None:
    """Remove what killed runs left in a folder and the folders in it; only who holds the lock may."""
    for file in sorted([*folder.glob(".*"), *folder.glob("*/.*")]):
        if _LEFTOVER.fullmatch(file.name) and file.is_file():
            with suppress(OSError):
                file.unlink()


def _taken(descriptor: int) -> bool:
    """Take the lock; False where another process holds it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, 0, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return True  # a file system without locks
    return True
