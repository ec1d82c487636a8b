# SPDX-License-Identifier: MIT
"""Guard around parsers: whatever a broken file makes them raise becomes one InputError that names it."""

from __future__ import annotations

import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.limits import check_limit, current_limits

_LONGEST = 1200  # characters of a message: a path may have hundreds


@contextmanager
def guard_reading(path: Path, what: str) -> Iterator[None]:
    """Turn every exception inside into an InputError that names `path`, which should be `what`: "a PLY".

    Third-party parsers raise anything from IndexError to RuntimeError on a broken file, so this is the one
    place that catches `Exception`; the original stays attached as the cause.
    """
    try:
        with np.errstate(all="ignore"):  # what overflows is no finite number and found by its check
            yield
    except InputError as error:
        cause = one_line(str(error))
        raise InputError(cause if cause.startswith(one_line(str(path))) else f"{path}: {cause}") from error
    except MemoryError as error:
        raise InputError(f"{path}: does not fit into memory") from error
    except Exception as error:
        lines = str(error).strip().splitlines()
        cause = one_line(lines[0])[:200] if lines else type(error).__name__
        raise InputError(f"{path}: cannot be read as {what}: {cause}") from error


def one_line(text: str) -> str:
    """Return `text` as a line of bounded length without control characters; damaged files hold any words."""
    line = " ".join(
        "".join(letter if letter.isprintable() else " " for letter in text[: 4 * _LONGEST]).split()
    )
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 4 :]}"


def check_file(path: Path, limit: str = "file_bytes") -> Path:
    """Return `path`, its links followed, when it is a file with something in it, no larger than a limit.

    `limit` is the field of `scenes.io.checks.limits.ReadLimits` that its bytes are held against. Raises
    InputError: nothing there, a folder, a pipe or device, 0 bytes, or too large.
    """
    try:
        state = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        cause = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"{one_line(str(path))}: cannot be read: {cause}") from error
    if stat.S_ISDIR(state.st_mode):
        raise InputError(f"{path}: is a folder, not a file")
    if not stat.S_ISREG(state.st_mode):
        raise InputError(f"{path}: is a pipe or device, not a file; write its contents to a file first")
    if state.st_size == 0:
        raise InputError(f"{path}: is empty (0 bytes)")
    check_limit(limit, state.st_size, f"{path}: its bytes")
    return path


def check_size(rows: int, columns: int) -> None:
    """Raise InputError when an image of rows x columns would be unreasonable."""
    if rows < 1 or columns < 1:
        raise InputError(
            f"a grid of {rows} x {columns} pixels is not usable (1 to {current_limits().pixels:,} pixels); "
            "is the header damaged?"
        )
    check_limit("pixels", rows * columns, f"pixels of a grid of {rows} x {columns} (is its header damaged?)")
