# SPDX-License-Identifier: MIT
"""Relations in reports: what surfaces are to each other, before and after; which were rejected, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations.graph import Misfit, RelationGraph, misfit_of
from completion.relations.relation import Relation, Status
from nbv.report.blocks.page import Block, Cell, Section, Table, Text
from nbv.run.wording import count
from scenes.scan.colour import surface_colour

_MOST_ROWS = 40  # of each kind of status
FAULT_SD = 3.0
"""Standard deviations by which no surface should be moved: more is a fault of covariances or relations."""

_ORDER = (Status.ACCEPTED, Status.REJECTED, Status.UNDECIDED, Status.IMPLIED, Status.REDUNDANT)
_WORDS = {
    "parallel": "parallel",
    "perpendicular": "at right angles",
    "angle": "at an angle of {value:g}\u00b0",
    "coplanar": "in one plane",
    "coaxial": "on one axis",
    "distance": "{value:g} m apart",
    "equal_distance": "as far apart, pair by pair",
    "radius": "of radius {value:g} m",
    "equal_radius": "of one radius",
    "equal_ring_radius": "rings of one radius",
    "half_angle": "of half angle {value:g}\u00b0",
    "axis_in_plane": "plane and axis in it",
    "vertical": "vertical",
    "horizontal": "horizontal",
    "symmetric": "mirror images",
    "regular": "evenly spaced",
}


def relation_section(
    graph: RelationGraph,
    before: Sequence[SurfaceFit],
    numbers: Sequence[int],
    *,
    title: str = "What the surfaces are to each other",
    stayed: int = 0,
) -> tuple[Section, ...]:
    """Return a section with the relations of a graph; none where there are none.

    Parameters
    ----------
    graph : RelationGraph
        The relations, and the n surfaces for which they hold.
    before : sequence of SurfaceFit
        The surfaces (n,) without.
    numbers : sequence of int
        What the report calls them (n,); 0 for one without a number.
    title : str
        Of the section.
    stayed : int
        How many surfaces stayed where they were measured, since a sensor bent them.
    """
    if not graph.relations:
        return ()
    rows: list[tuple[Cell, ...]] = []
    left = 0
    for status in _ORDER:
        relations = [relation for relation in graph.relations if relation.status is status]
        rows += [_row(relation, graph, before, numbers) for relation in relations[:_MOST_ROWS]]
        left += max(len(relations) - _MOST_ROWS, 0)
    columns = ("Surfaces", "Relation", "Status", "#off before", "#off after", "#p", "Why")
    note = (
        "off: degrees between directions, millimetres between places. p: how probable so large a misfit is "
        f"if the relation holds. {_tolerance_text(graph)}"
        + (f" {count(left, 'other is', 'others are')} not shown." if left else "")
    )
    blocks: list[Block] = [Text(_summary(graph, numbers, stayed))]
    blocks += [Table(columns, tuple(rows)), Text(note, is_note=True)]
    return (Section(title, tuple(blocks)),)


def _tolerance_text(graph: RelationGraph) -> str:
    angle, length = graph.options.tolerance_deg or 0.0, graph.options.tolerance_m or 0.0
    if angle == 0 and length == 0:
        return "What holds is taken to hold exactly."
    return f"Things were taken to be built within {angle:.2g}\u00b0 and {1000 * length:.2g} mm of it."


def _summary(graph: RelationGraph, numbers: Sequence[int], stayed: int) -> str:
    """How many hold, how far surfaces were moved for it, and what is free."""
    holding = sum(relation.holds for relation in graph.relations)
    text = (
        f"{count(holding, 'relation holds', 'relations hold')} among {count(len(graph.fits), 'surface')}; "
        f"{graph.numbered(Status.REJECTED)} rejected, {graph.numbered(Status.UNDECIDED)} undecided. "
        f"{graph.free} of {graph.unknowns} parameters are still free."
    )
    if graph.moved_sd and max(graph.moved_sd) > 0:
        most = int(np.argmax(graph.moved_sd))
        name = f"surface {numbers[most]}" if numbers[most] else "a surface without number"
        text += f" The largest move is {graph.moved_sd[most]:.1f} standard deviations, of {name}"
        fault = graph.moved_sd[most] > FAULT_SD
        text += ": more than chance explains." if fault else ", which chance explains."
    if stayed:
        text += (
            f" {count(stayed, 'surface stays', 'surfaces stay')} where measured, though a relation holds: "
            "the measured points would show the move."
        )
    return text


def _row(
    relation: Relation, graph: RelationGraph, before: Sequence[SurfaceFit], numbers: Sequence[int]
) -> tuple[Cell, ...]:
    names = ", ".join(str(numbers[place] or "\u2013") for place in relation.surfaces)
    first = numbers[relation.surfaces[0]]
    value = 0.0 if relation.value is None else relation.value
    shown = float(np.degrees(value)) if relation.kind in ("angle", "half_angle") else value
    needs_up = relation.kind in ("vertical", "horizontal")
    was, now = (None, None) if needs_up else (misfit_of(relation, before), misfit_of(relation, graph.fits))
    return (
        Cell(names, swatch=surface_colour(first) if first else ""),
        Cell(_WORDS[relation.kind].format(value=shown)),
        Cell(relation.status.value + (" (stated)" if relation.is_given else "")),
        Cell(_misfit_text(was)),
        Cell(_misfit_text(now)),
        Cell("" if np.isnan(relation.p) else f"{relation.p:.2g}"),
        Cell(relation.reason),
    )


def _misfit_text(misfit: Misfit | None) -> str:
    if misfit is None:
        return ""
    parts = []
    if np.isfinite(misfit.angle_deg):
        parts.append(f"{misfit.angle_deg:.3f}\u00b0")
    if np.isfinite(misfit.length_m):
        parts.append(f"{1000 * misfit.length_m:.2f} mm")
    return " ".join(parts)
