# SPDX-License-Identifier: MIT
"""Report of what a person, and later scans, say of a completion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from completion.result.completion import Completion
from nbv.report.page.page import Block, Cell, Section, Table, Text
from nbv.report.pictures.picture import surface_colour
from nbv.run.wording import square_metres

_AREAS = ("confirmed_m2", "refuted_m2", "hidden_m2")


def edit_sections(completion: Completion) -> tuple[Section, ...]:
    """A section with a row for each edited surface; none without edits."""
    if not completion.edits:
        return ()
    rows = []
    for number, surface in enumerate(completion.derived.surfaces, start=1):
        if surface.patch.verdict.actions:
            effect = surface.effect
            areas = (effect.filled_m2, effect.vetoed_m2, effect.measured_m2)
            cells = tuple(Cell(square_metres(area)) for area in areas)
            name = Cell(str(number), swatch=surface_colour(number))
            rows.append((name, Cell(", ".join(surface.patch.verdict.actions)), *cells))
    columns = ("Surface", "Edits", "#filled, m\u00b2", "#stays empty, m\u00b2", "#measured, m\u00b2")
    note = (
        "filled: inferred because a person says so, whatever the method's confidence. stays empty: accepted, "
        "but beams went through it, which nobody may overrule. measured: inside a declared opening or beyond "
        "an end that was set, and kept."
    )
    blocks: tuple[Block, ...] = (Table(columns, tuple(rows)), Text(note, is_note=True))
    return (Section("What a person said", blocks),)


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
