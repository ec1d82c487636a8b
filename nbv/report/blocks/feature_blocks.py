# SPDX-License-Identifier: MIT
"""Features in reports: what each is, how large, which of its sides were seen, and why it was accepted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.templates.engine.template import Seen, Status, TemplateFit
from nbv.report.page.page import Cell, State, Table, Text
from nbv.run.wording import count
from scenes.scan.colour import surface_colour

_MOST_ROWS, _MOST_REFUSED = 80, 12
_STATES: dict[Status, State] = {Status.FOUND: "measured", Status.AMBIGUOUS: "unknown", Status.NONE: ""}
_WORDS = {Status.FOUND: "found", Status.AMBIGUOUS: "ambiguous", Status.NONE: "refused"}
_BETWEEN = {"width": ("left", "right"), "height": ("bottom", "top")}
_NOTHING = 1e-9  # below which a number is rounding
_UNKNOWN = 100.0  # deviation from which on nothing is known
_PLACING = ("u", "v", "centre", "direction", "corner", "axis", "joint")  # first words of what only places it


def feature_blocks(fits: Sequence[TemplateFit]) -> tuple[Text | Table, ...]:
    """Return a table of features with a sentence before it."""
    if not fits:
        return (Text("None was proposed."),)
    refused = [fit for fit in fits if fit.status is Status.NONE]
    told = [fit for fit in fits if fit.status is not Status.NONE][:_MOST_ROWS]
    shown = [*told, *refused[:_MOST_REFUSED]]
    rows = tuple(_row(fits.index(fit) + 1, fit) for fit in shown)
    columns = ("Feature", "Status", "Size", "Sides seen", "Not seen", "#evidence, nats", "#false", "Why")
    left = len(fits) - len(shown)
    more = f" {count(left, 'more is', 'more are')} in features.json." if left else ""
    note = (
        "Size with one standard deviation. A side is seen where tiles along it confirm it: what bounds it "
        "was measured just outside, and nothing just inside. A side that nobody saw is not claimed. False: "
        "how often one as good shows where there is none, of as many simulated nulls as there were."
    )
    return Table(columns, rows), Text(note + more, is_note=True)


def size_of(fit: TemplateFit) -> str:
    """Return the parameters of a feature with their deviations, for people."""
    told = []
    for name, value in zip(fit.names, fit.x, strict=True):
        sd = fit.deviation(name)
        if name.replace("_", " ").split()[0] in _PLACING or not np.isfinite(value):
            continue
        word = name.replace("_", " ")
        value = 0.0 if abs(value) < _NOTHING else value
        if name in fit.held:
            told.append(f"{word} {value:.4g} (given)")
        elif set(_BETWEEN.get(name, ())) & set(fit.unseen):
            told.append(f"{word} at least {value:.3g}")
        elif np.isfinite(sd) and sd < _UNKNOWN:
            told.append(f"{word} {value:.4g} \u00b1 {sd:.2g}")
        else:
            told.append(f"{word} not seen")
    number = fit.geometry.get("count")
    return ", ".join([*([f"{number} of them"] if number is not None else []), *told])


def chance_of(fit: TemplateFit) -> str:
    """Return how probably one as good shows where there is no such feature, in percent; - if not known."""
    chance = fit.false_fit_probability
    return f"{100 * chance:.2g} %" if np.isfinite(chance) else "-"


def _row(number: int, fit: TemplateFit) -> tuple[Cell, ...]:
    seen = [side for side in fit.sides if side.state is Seen.CONFIRMED]
    sides = f"{len(seen)} of {len(fit.sides)}" if len(fit.sides) > 4 else ", ".join(s.name for s in seen)
    unseen = ", ".join(fit.unseen[:6]) + (" ..." if len(fit.unseen) > 6 else "")
    return (
        Cell(f"{number} {fit.kind}", swatch=surface_colour(number)),
        Cell(_WORDS[fit.status] + ("" if fit.is_complete else ", best so far"), state=_STATES[fit.status]),
        Cell(size_of(fit)),
        Cell(sides),
        Cell(unseen),
        Cell(f"{fit.evidence:.0f}" if np.isfinite(fit.evidence) else "-"),
        Cell(chance_of(fit)),
        Cell(fit.reason),
    )
