# SPDX-License-Identifier: MIT
"""Report of what a person said of the surfaces, and where the measurements stood against it."""

from __future__ import annotations

from completion.result.completion import Completion
from nbv.report.page.page import Block, Cell, Section, Table, Text
from nbv.report.pictures.picture import surface_colour
from nbv.run.wording import square_metres


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
