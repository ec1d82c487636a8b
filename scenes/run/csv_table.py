# SPDX-License-Identifier: MIT
"""CSV tables: full precision, plain line ends, and no cell that a spreadsheet would run as a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

_FORMULA = ("=", "+", "-", "@", "\t", "\r")  # OWASP, "CSV injection"


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as text.

    Parameters
    ----------
    columns : sequence of str
        Names.
    rows : iterable of sequences
        Floats are written by repr, None as an empty cell. Texts that begin as a formula does, and are no
        number, have an apostrophe in front: names may come from files of strangers.

    Examples
    --------
    >>> print(csv_text(["name", "area_m2"], [["=1+1", 0.1], ["-0.5", None]]), end="")
    name,area_m2
    '=1+1,0.1
    -0.5,
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, str) and value.startswith(_FORMULA) and not _is_number(value):
        return f"'{value}"
    return value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
