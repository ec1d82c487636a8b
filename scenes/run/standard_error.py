# SPDX-License-Identifier: MIT
"""The standard error, kept for our own lines: what libraries in other languages print there is dropped."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

_ONE_AT_A_TIME = Lock()  # the descriptor is the whole process's


@contextmanager
def libraries_muted() -> Iterator[None]:
    """Drop what is written to file descriptor 2; what it says, the caller raises as an error of one line.

    Rust prints a panic and its trace there before Python hears of it.
    """
    with _ONE_AT_A_TIME:
        with suppress(OSError, ValueError):  # there may be none
            sys.stderr.flush()
        try:
            kept = os.dup(2)
        except OSError:
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(nowhere)
            os.close(kept)
