# SPDX-License-Identifier: MIT
"""Tables of surfaces: relations between them, before and after, rejected ones with the reason; flattening.

Flattening: what became of each plane and of its relief.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.flattening.flat import FlatRegion, FlatSurface, RegionKind
from completion.relations.graph import Misfit, RelationGraph, misfit_of
from completion.relations.relation import Relation, RelationStatus
from nbv.report.blocks.page import Block, Cell, PageSection, Table, Text
from nbv.run.plain_words import chance_text
from nbv.run.wording import count
from scenes.scan.colour import surface_colour

_MOST_ROWS = 40  # of each kind of status
FAULT_SD = 3.0
"""Standard deviations by which no surface should be moved: more is a fault of covariances or relations."""

_ORDER = (
    RelationStatus.ACCEPTED,
    RelationStatus.REJECTED,
    RelationStatus.UNDECIDED,
    RelationStatus.IMPLIED,
    RelationStatus.REDUNDANT,
)
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
    "tangent": "tangent",
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
) -> tuple[PageSection, ...]:
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
    columns = (
        "Surfaces", "Relation", "Status", "#off before, \u00b0 or mm", "#off after, \u00b0 or mm",
        "#by chance, %", "Why",
    )  # fmt: skip
    note = (
        "off: degrees between directions, millimetres between places. by chance: how probable so large a "
        f"misfit is if the relation is true; a low value speaks against it. {_tolerance_text(graph)}"
        + (f" {count(left, 'other is', 'others are')} not shown." if left else "")
    )
    blocks: list[Block] = [Text(_summary(graph, numbers, stayed))]
    blocks += [Table(columns, tuple(rows)), Text(note, is_note=True)]
    return (PageSection(title, tuple(blocks)),)


def _tolerance_text(graph: RelationGraph) -> str:
    angle, length = graph.options.tolerance_deg or 0.0, graph.options.tolerance_m or 0.0
    if angle == 0 and length == 0:
        return "A relation that is accepted is taken to be exact."
    return f"Things were taken to be built within {angle:.2g}\u00b0 and {1000 * length:.2g} mm of it."


def _summary(graph: RelationGraph, numbers: Sequence[int], stayed: int) -> str:
    """How many hold, how far surfaces were moved for it, and what is free."""
    holding = sum(relation.holds for relation in graph.relations)
    n_rejected, n_undecided = map(graph.count_with, (RelationStatus.REJECTED, RelationStatus.UNDECIDED))
    text = (
        f"{count(holding, 'relation', 'relations')} accepted among {count(len(graph.fits), 'surface')} "
        f"({n_rejected} rejected, {n_undecided} undecided). "
        f"The relations leave {graph.free} of {graph.unknowns} surface parameters free."
    )
    if graph.moved_sd and max(graph.moved_sd) > 0:
        most = int(np.argmax(graph.moved_sd))
        name = f"surface {numbers[most]}" if numbers[most] else "a surface without number"
        text += f" The largest move is {graph.moved_sd[most]:.1f} standard deviations, of {name}"
        fault = graph.moved_sd[most] > FAULT_SD
        text += ": more than chance explains." if fault else ", which chance explains."
    if stayed:
        text += (
            f" {count(stayed, 'surface stays', 'surfaces stay')} where measured, though a relation was "
            "accepted: the measured points would show the move."
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
        Cell(chance_text(relation.p)),
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


_MOST_FLAT_ROWS, _MOST_AREAS = 100, 40
_LONG = "are too few to tell ripple from relief"
_NOTE = (
    "ripple: distance of the points from their plane, root mean square, without relief. least by chance: "
    "of the most evident area that was flattened. Areas of fewer than four cells always are, and those no "
    "higher than the steps that a sensor's ranges come in."
)
_NOTE_AREAS = (
    "by chance: how probably a plane of this size with this ripple and without relief shows an area as "
    "evident anywhere. without ripple: whether its ripple was told from its shape and taken from it too."
)


@dataclass(frozen=True, slots=True)
class FlatRow:
    """A plane in the table: its name, the place of its colour, and what became of it."""

    name: str
    place: int
    surface: FlatSurface


def flattening_blocks(rows: Sequence[FlatRow]) -> tuple[Block, ...]:
    """Return a table with a row for each plane, one with a row for each area of relief, and notes."""
    if not rows:
        return (Text("There is no plane."),)
    columns = (
        "Plane", "#ripple, mm", "#flattened, mm", "#with relief, mm", "#flattened, mm", "#relief, %",
        "#least by chance, %", "Left as it was",
    )  # fmt: skip
    blocks: list[Block] = [Table(columns, tuple(_flat_row(row) for row in rows[:_MOST_FLAT_ROWS]))]
    if len(rows) > _MOST_FLAT_ROWS:
        blocks.append(Text(f"{len(rows) - _MOST_FLAT_ROWS} others are not shown; the JSON file holds them."))
    blocks.append(Text(_NOTE, is_note=True))
    areas = [
        (row, region) for row in rows for region in row.surface.regions if region.kind is RegionKind.RELIEF
    ]
    if not areas:
        return (*blocks, Text("No relief was found."))
    areas.sort(key=lambda pair: -pair[1].area_m2)
    of_areas = (
        "Relief on", "#height, mm", "#standard deviation, mm", "#area, cm\u00b2", "#by chance, %",
        "Without ripple",
    )  # fmt: skip
    blocks.append(Table(of_areas, tuple(_area_row(*area) for area in areas[:_MOST_AREAS])))
    if len(areas) > _MOST_AREAS:
        blocks.append(
            Text(f"{len(areas) - _MOST_AREAS} smaller areas are not shown; the JSON file holds them.")
        )
    return (*blocks, Text(_NOTE_AREAS, is_note=True))


def _flat_row(row: FlatRow) -> tuple[Cell, ...]:
    surface = row.surface
    gone = [
        region.p
        for region in surface.regions
        if region.kind is RegionKind.FLATTENED and region.area_m2 >= 3.5 * surface.cell_m**2
    ]
    return (
        Cell(row.name, swatch=surface_colour(row.place)),
        *(Cell(f"{1000 * value:.2f}") for value in (surface.ripple_before_m, surface.ripple_after_m)),
        *(Cell(f"{1000 * value:.2f}") for value in (surface.rms_before_m, surface.rms_after_m)),
        Cell(f"{100 * surface.n_relief / max(surface.n, 1):.1f}"),
        Cell(chance_text(min(gone)) if gone else ""),
        Cell(surface.reason.replace(_LONG, "too few").partition(";")[0]),
    )


def _area_row(row: FlatRow, region: FlatRegion) -> tuple[Cell, ...]:
    return (
        Cell(row.name, swatch=surface_colour(row.place)),
        Cell(f"{1000 * region.height_m:+.1f}"),
        Cell(f"{1000 * region.sd_m:.2f}"),
        Cell(f"{1e4 * region.area_m2:.3g}"),
        Cell(chance_text(region.p)),
        Cell("yes" if region.is_cleared else "no"),
    )
