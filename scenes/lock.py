# SPDX-License-Identifier: MIT
"""Lock: one run at a time writes to a folder; the system lets go of it when the run ends, however it ends."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from scenes.checks import InputError

LOCK_NAME = ".unseen.lock"
_LEFTOVER = re.compile(r"\..+\.\d+\.tmp(\.[^.]+)?")  # of `scenes.atomic.atomic_path`


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, and clear it of what a killed run left half-written.

    The lock is an empty file, removed at the end; one that a killed run left behind locks nothing. Where the
    file system knows no locks, or the folder cannot be written, nothing is held.

    Raises
    ------
    InputError
        Another run holds it.
    """
    file = folder / LOCK_NAME
    try:
        stream = _opened(file)
    except OSError:
        yield
        return
    with stream:
        remove_leftovers(folder)
        try:
            yield
        finally:
            with suppress(OSError):  # Windows keeps files that are open
                file.unlink()


def _opened(file: Path) -> BinaryIO:
    """Return the lock's file, locked: the one that stands there now, not one that was just removed."""
    while True:
        stream = file.open("ab")
        if not _taken(stream.fileno()):
            stream.close()
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
