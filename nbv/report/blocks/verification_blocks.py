# SPDX-License-Identifier: MIT
"""Report of what later scans say of what the first one alone inferred."""

from __future__ import annotations

from completion.pipeline import Completion
from completion.result.verification import Finding, Verification, counterpart
from nbv.report.page.page import Cell, Section, Table, Text
from nbv.report.pictures.picture import surface_colour
from nbv.run.wording import square_metres

_FINDINGS = (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)


def verification_sections(completion: Completion, verification: Verification | None) -> tuple[Section, ...]:
    """A section with a row for each surface of which something was inferred; none without verification."""
    if verification is None:
        return ()
    rows = []
    for surface in verification.surfaces:
        areas = [surface.area_m2(finding) for finding in _FINDINGS]
        if sum(areas) > 0:
            number = counterpart(surface, completion)
            name = Cell(str(number), swatch=surface_colour(number)) if number else Cell("none now")
            rows.append((name, *(Cell(square_metres(area)) for area in areas)))
    rows.append((Cell("all"), *(Cell(square_metres(verification.area_m2(found))) for found in _FINDINGS)))
    columns = ("Surface", "#confirmed, m\u00b2", "#refuted, m\u00b2", "#still hidden, m\u00b2")
    note = (
        "What the first scan alone had inferred. confirmed: another scan measured the surface there. "
        "refuted: beams of another scan went through, so it is not in this model. still hidden: no other "
        "scan sees it."
    )
    blocks = (Table(columns, tuple(rows)), Text(note, is_note=True))
    return (Section("What the other scans say of the first one", blocks),)
