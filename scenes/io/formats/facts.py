# SPDX-License-Identifier: MIT
"""Facts of a format, a row of docs/format-table.md: what is read and lost, and where all of it comes from."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

ESTIMATED = "estimated from the points"


@dataclass(frozen=True, slots=True, kw_only=True)
class FormatFacts:
    """What a user should know of a format, in Markdown.

    Attributes
    ----------
    title : str
        What it is called.
    read : str
        What is read of it.
    lost : str
        What it holds that is left out, or what it cannot hold.
    written : str
        What is written, and how far a point 5 m away is off after writing and reading.
    poses : str
        Where places and poses come from.
    units : str
        Where the unit of lengths comes from.
    colours : str
        Where colours and intensity come from.
    noise : str
        Where the noise of ranges comes from.
    """

    title: str
    read: str
    lost: str = ""
    written: str = "no"
    poses: str = "none"
    units: str = "metres, or `--units`"
    colours: str = "none"
    noise: str = ESTIMATED

    @classmethod
    def head(cls) -> str:
        """Return the first two lines of a table of facts."""
        names = [field.name for field in fields(cls)]
        return f"| {' | '.join(['format', *names[1:]])} |\n|{'---|' * len(names)}\n"

    def row(self) -> str:
        """Return its line of the table."""
        return f"| {' | '.join(astuple(self))} |\n"
