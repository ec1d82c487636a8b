# SPDX-License-Identifier: MIT
"""Crasher: a file that once made a reader break its promise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.robustness.fuzzing.case import Case


@dataclass(frozen=True)
class Crasher:
    """A file, and what comes of it now.

    Attributes
    ----------
    target : str
        The reader, by its name in `tests.robustness.fuzzing.targets`.
    was : str
        What was wrong.
    make : function
        Returns the file.
    says : str
        What the refusal says, a regular expression; "" where the file is read.
    """

    target: str
    was: str
    make: Callable[[], Case]
    says: str


def patched(case: Case, at: int, new: bytes) -> Case:
    """Return a case whose main file has other bytes at a place, which is counted from its end if negative."""
    data = case.files[case.entry]
    at %= len(data)
    return case.changed(case.entry, data[:at] + new + data[at + len(new) :])


def replaced(case: Case, old: bytes, new: bytes) -> Case:
    """Return a case whose main file has other words where others stood first."""
    data = case.files[case.entry]
    assert old in data, old
    return case.changed(case.entry, data.replace(old, new, 1))
