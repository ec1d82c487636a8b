# SPDX-License-Identifier: MIT
"""Decisions in reports: dimensions that people order by, their intervals, and a word on relying on each."""

from __future__ import annotations

import numpy as np

from completion.export.decisions import DecisionSheet
from completion.export.dimension import Advice, Dimension, told_rule
from nbv.report.blocks.page import Cell, Section, State, Table, Text
from nbv.run.wording import count
from scenes.scan.colour import surface_colour

_MOST_ROWS = 60
_STATES: dict[Advice, State] = {"rely": "measured", "check": "unknown", "do not build": "inferred"}
_UNITS = {"m": "m", "m2": "m\u00b2", "m3": "m\u00b3"}


def decision_sections(sheet: DecisionSheet) -> tuple[Section, ...]:
    """Return a section with what may be relied on; none where there is no dimension."""
    if not sheet.dimensions:
        return ()
    sections = list(zip(sheet.dimensions, sheet.advice, strict=True))
    rows = tuple(_row(dimension, word) for dimension, word in sections[:_MOST_ROWS])
    sentence = ", ".join(f"{n} \u00d7 {word}" for word, n in sheet.counts().items() if n)
    doubt = f" {sheet.told_doubt}" if sheet.told_doubt else ""
    blocks = [Text(f"{count(len(sections), 'dimension')}: {sentence}.{doubt} {told_rule(sheet.tolerance_m)}")]
    columns = ("Dimension", "Surfaces", "#value", "#from", "#to (95 %)", "measured", "Advice")
    table = Table(columns, rows)
    note = (
        "Intervals hold noise, what surfaces share by one sensor and by their relations, how well the scans "
        "are placed, and the systematic errors of sensors of this kind."
    )
    left = len(sections) - _MOST_ROWS
    more = f" {count(left, 'more is', 'more are')} in decisions.csv." if left > 0 else ""
    return (Section("What to rely on", (*blocks, table, Text(note + more, is_note=True))),)


def _row(dimension: Dimension, word: Advice) -> tuple[Cell, ...]:
    digits = int(np.clip(np.ceil(-np.log10(max(dimension.half, 1e-12))) + 1, 2, 4))
    ends = (dimension.low, dimension.high) if np.isfinite(dimension.half) else ()
    numbers = [f"{dimension.value:.{digits}f}", *(f"{end:.{digits}f}" for end in ends), *("not known",) * 2][
        :3
    ]
    return (
        Cell(dimension.kind),
        Cell(" ".join(map(str, dimension.surfaces)), swatch=surface_colour(dimension.surfaces[0])),
        Cell(f"{numbers[0]} {_UNITS[dimension.unit]}"),
        *(Cell(number) for number in numbers[1:]),
        Cell(f"{100 * dimension.measured_share:.0f} %", share=dimension.measured_share),
        Cell(word, state=_STATES[word]),
    )
