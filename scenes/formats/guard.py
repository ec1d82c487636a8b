# SPDX-License-Identifier: MIT
"""Guard around parsers: whatever a broken file makes them raise becomes one InputError that names it."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError

MAX_BYTES = 4 << 30  # what one file may unpack to; a lying header or a zip bomb asks for more
MAX_PIXELS = 200_000_000


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn every exception inside into an InputError that names `path`.

    Third-party parsers raise anything from IndexError to RuntimeError on a broken file, so this is the one
    place that catches `Exception`; the original stays attached as the cause.

    Parameters
    ----------
    path : Path
        The file that is being read.
    what : str
        What it should be, for the message: "an E57 file".
    """
    try:
        with np.errstate(all="ignore"):  # what overflows is no finite number and found by its check
            yield
    except InputError as error:
        cause = _one_line(str(error))
        raise InputError(cause if cause.startswith(_one_line(str(path))) else f"{path}: {cause}") from error
    except MemoryError as error:
        raise InputError(f"{path}: does not fit into memory") from error
    except Exception as error:
        lines = str(error).strip().splitlines()
        cause = _one_line(lines[0])[:200] if lines else type(error).__name__
        raise InputError(f"{path}: cannot be read as {what}: {cause}") from error


def _one_line(text: str) -> str:
    """Return `text` without line ends and control characters; a damaged file's own words may hold any."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def check_file(path: Path) -> Path:
    """Return `path` when it is a file with something in it; raise InputError otherwise."""
    if not path.exists():
        raise InputError(f"{path}: no such file")
    if path.is_dir():
        raise InputError(f"{path}: is a folder, not a file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: is empty (0 bytes)")
    return path


def check_size(rows: int, columns: int) -> None:
    """Raise InputError when an image of rows x columns would be unreasonable."""
    if rows < 1 or columns < 1 or rows * columns > MAX_PIXELS:
        raise InputError(
            f"a grid of {rows} x {columns} pixels is not usable (1 to {MAX_PIXELS:,} pixels); "
            "is the header damaged?"
        )


def import_extra(module: str, extra: str) -> Any:
    """Import an optional dependency, or raise an InputError that names the cure."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(f'{module} is not installed; the cure: pip install "unseen[{extra}]"') from error
