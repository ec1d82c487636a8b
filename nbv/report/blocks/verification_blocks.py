# SPDX-License-Identifier: MIT
"""Report of what later scans say of what the first one alone inferred."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nbv.report.page.page import Cell, Section, Table, Text
from nbv.report.pictures.picture import surface_colour
from nbv.run.wording import square_metres

_AREAS = ("confirmed_m2", "refuted_m2", "hidden_m2")


def verification_sections(first_scan: Mapping[str, Any] | None) -> tuple[Section, ...]:
    """Return a section with a row for each surface of which something was inferred; none without such.

    Parameters
    ----------
    first_scan : dict or None
        What later scans say of what the first one alone inferred, as completion.json holds it.
    """
    if first_scan is None:
        return ()
    rows = []
    for surface in first_scan["surfaces"]:
        if sum(surface[area] for area in _AREAS) > 0:
            number = surface["surface"]
            name = Cell(str(number), swatch=surface_colour(number)) if number else Cell("none now")
            rows.append((name, *(Cell(square_metres(surface[area])) for area in _AREAS)))
    rows.append((Cell("all"), *(Cell(square_metres(first_scan[area])) for area in _AREAS)))
    columns = ("Surface", "#confirmed, m\u00b2", "#refuted, m\u00b2", "#still hidden, m\u00b2")
    note = (
        "What the first scan alone had inferred. confirmed: another scan measured the surface there. "
        "refuted: beams of another scan went through, so it is not in this model. still hidden: no other "
        "scan sees it."
    )
    blocks = (Table(columns, tuple(rows)), Text(note, is_note=True))
    return (Section("What the other scans say of the first one", blocks),)
