# SPDX-License-Identifier: MIT
"""Rooms in a report: where stations stand, and what surface is none of the rooms'."""

from __future__ import annotations

from nbv.coverage.coverage import Coverage
from nbv.plan.plan import Plan
from nbv.report.page.page import Block, Cell, Section, Table, Text
from nbv.run.wording import square_metres

APART_TEXTS = {
    "inside_a_solid": "within walls, slabs and furniture, or where two of these touch",
    "another_room": "bounds only rooms that were not asked for",
    "another_storey": "bounds only rooms of storeys that were not asked for",
    "outside": "faces the open air, or lies below all floors",
}


def rooms_section(plan: Plan) -> tuple[Section, ...]:
    """A row for each room with its stations; nothing where the scene is one room, or none."""
    if len(plan.rooms) < 2:
        return ()
    columns = ("Room", "#storey", "#floor, m\u00b2", "#level, m", "Stations", "Leads to")
    rows = tuple(_row(room) for room in plan.rooms)
    note = (
        "A room is floor between doorways that has headroom; what stands on it is none. Rooms whose doors "
        "are shut lead nowhere: leave doors out by their names (--without) where one will find them open."
    )
    return (Section("Rooms", (Table(columns, rows), Text(note, is_note=True))),)


def _row(room: dict[str, object]) -> tuple[Cell, ...]:
    stations = ", ".join(map(str, _numbers(room["stations"]))) or (
        "none" if room["is_asked_for"] else "not asked for"
    )
    ways = [str(number) for number in _numbers(room["joined"])]
    ways += [f"{number} by stairs" for number in _numbers(room["stairs"])]
    return (
        Cell(str(room["name"])),
        Cell(str(room["storey"])),
        Cell(square_metres(float(str(room["floor_m2"])))),
        Cell(f"{float(str(room['level_m'])):.2f}"),
        Cell(stations),
        Cell(", ".join(ways) or "no other"),
    )


def _numbers(value: object) -> list[int]:
    return [int(number) for number in value] if isinstance(value, list | tuple) else []


def set_apart(coverage: Coverage) -> tuple[Block, ...]:
    """A row for each reason for which surface counts for nothing; nothing where all of it counts."""
    if not coverage.apart_m2:
        return ()
    rows = tuple(
        (Cell(name.replace("_", " ")), Cell(APART_TEXTS.get(name, "")), Cell(square_metres(area)))
        for name, area in coverage.apart_m2.items()
    )
    note = "This surface bounds none of the rooms that were asked for. All shares are of the rest."
    return Table(("Set apart", "What it means", "#area, m\u00b2"), rows), Text(note, is_note=True)
