# SPDX-License-Identifier: MIT
"""Blocks of reports on flattening: what became of each plane and of its relief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from completion.flattening.flat import FlatSurface, Region, RegionKind
from nbv.report.blocks.page import Block, Cell, Table, Text
from scenes.scan.colour import surface_colour

_MOST_ROWS, _MOST_AREAS = 100, 40
_LEAST_P = 1e-6
_LONG = "are too few to tell ripple from relief"
_NOTE = (
    "ripple: distance of the points from their plane, root mean square, without relief. least p flattened: "
    "of the most evident area that was flattened. Areas of fewer than four cells always are, and those no "
    "higher than the steps that a sensor's ranges come in."
)
_NOTE_AREAS = (
    "p: how probably a plane of this size with this ripple and without relief shows an area as evident "
    "anywhere. without ripple: whether its ripple was told from its shape and taken from it too."
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
        "#least p flattened", "Left as it was",
    )  # fmt: skip
    blocks: list[Block] = [Table(columns, tuple(_row(row) for row in rows[:_MOST_ROWS]))]
    if len(rows) > _MOST_ROWS:
        blocks.append(Text(f"{len(rows) - _MOST_ROWS} others are not shown; the JSON file holds them."))
    blocks.append(Text(_NOTE, is_note=True))
    areas = [
        (row, region) for row in rows for region in row.surface.regions if region.kind is RegionKind.RELIEF
    ]
    if not areas:
        return (*blocks, Text("No relief was found."))
    areas.sort(key=lambda pair: -pair[1].area_m2)
    of_areas = ("Relief on", "#height, mm", "#sd, mm", "#area, cm\u00b2", "#p", "Without ripple")
    blocks.append(Table(of_areas, tuple(_area_row(*area) for area in areas[:_MOST_AREAS])))
    if len(areas) > _MOST_AREAS:
        blocks.append(
            Text(f"{len(areas) - _MOST_AREAS} smaller areas are not shown; the JSON file holds them.")
        )
    return (*blocks, Text(_NOTE_AREAS, is_note=True))


def _row(row: FlatRow) -> tuple[Cell, ...]:
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
        Cell(p_text(min(gone)) if gone else ""),
        Cell(surface.reason.replace(_LONG, "too few").partition(";")[0]),
    )


def _area_row(row: FlatRow, region: Region) -> tuple[Cell, ...]:
    return (
        Cell(row.name, swatch=surface_colour(row.place)),
        Cell(f"{1000 * region.height_m:+.1f}"),
        Cell(f"{1000 * region.sd_m:.2f}"),
        Cell(f"{1e4 * region.area_m2:.3g}"),
        Cell(p_text(region.p)),
        Cell("yes" if region.is_cleared else "no"),
    )


def p_text(p: float) -> str:
    """A probability to one digit, and how small it is at most where it is tiny."""
    return f"{p:.1g}" if p >= _LEAST_P else f"<{_LEAST_P:.0e}"
