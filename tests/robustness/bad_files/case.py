# SPDX-License-Identifier: MIT
"""Case: one bad file, how it is written and read, and what must come of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Outcome = Literal["refused", "warned", "read", "silent", "crashed", "hung"]
Write = Callable[[Path], Path | str]  # into an empty folder; returns what is read
Read = Callable[[Path | str], Sequence[str]]  # returns warnings

CLASSES = {
    1: "numbers that are not finite",
    2: "nothing in it",
    3: "faces: flat, double, turned, without a corner",
    4: "far too large or small, millimetres as metres",
    5: "cut short, wrong byte order, a header that lies",
    6: "bombs: small files that unpack to much",
    7: "names that lead out of the folder",
    8: "without its grid, rows and columns swapped",
    9: "degenerate: one pixel, one line, one place",
    10: "poses: scaled, mirrored, OpenGL's, of the wrong number",
    11: "depths: 8 bits, another scale, negative",
    16: "Python objects (pickles)",
}


@dataclass(frozen=True, slots=True)
class Case:
    """One bad file.

    Attributes
    ----------
    kind : int
        A key of `CLASSES`.
    reader : str
        Column of the table, and which door is tried.
    name : str
        What is wrong, in words.
    write : function
        Writes it.
    read : function
        Reads it.
    expected : tuple of Outcome
        What may come of it; "read" only where the file is right as it is.
    """

    kind: int
    reader: str
    name: str
    write: Write
    read: Read
    expected: tuple[Outcome, ...] = ("refused",)

    @property
    def title(self) -> str:
        """What tells it from all others."""
        return f"{self.reader}, class {self.kind}: {self.name}"


def cut(data: bytes, share: float) -> bytes:
    """The first part of a file."""
    return data[: int(len(data) * share)]
