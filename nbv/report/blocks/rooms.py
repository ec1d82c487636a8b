# SPDX-License-Identifier: MIT
"""Rooms in a report: where stations stand, and what surface is none of the rooms'."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nbv.coverage.coverage import Coverage
from nbv.plan.plan import Plan
from nbv.plan.rules import RuleOutcome
from nbv.report.page.page import Block, Cell, Section, Table, Text
from nbv.run.wording import count, percent, percent_within, square_metres

APART_TEXTS = {
    "inside_a_solid": "within walls, slabs and furniture, or where two of these touch",
    "another_room": "bounds only rooms that were not asked for",
    "another_storey": "bounds only rooms of storeys that were not asked for",
    "outside": "faces the open air, or lies below all floors",
}


_RULES = {
    "rule:grid5m": "a station every 5 m",
    "rule:rooms-and-doorways": "a station in each room and each doorway",
}


def rule_sentences(plan: Plan, rules: Sequence[RuleOutcome]) -> list[str]:
    """Say of each rule of thumb how many stations it takes, beside the plan's."""
    mine = count(len(plan.views), "station")
    found = []
    for rule in rules:
        does = f"takes {count(rule.stations, 'station')} and measures {percent(rule.met_of_reachable)} % "
        does += "of what can be reached"
        if rule.stations_to_target is not None and rule.stations_to_target < rule.stations:
            does += f", {percent(plan.target or 1.0)} % with the best {rule.stations_to_target} of them"
        met = plan.coverage.met / max(plan.coverage.reachable, 1e-12) if plan.coverage else 0.0
        found.append(f"{_RULES[rule.name]} ({rule.name}) {does}; this plan {mine} and {percent(met)} %")
    return found


def rules_section(plan: Plan, rules: Sequence[RuleOutcome]) -> tuple[Section, ...]:
    """A row for each rule of thumb; nothing where none was tried."""
    if not rules:
        return ()
    columns = ("Rule of thumb", "#stations", "#of what can be reached, %", "#stations to the target")
    rows = tuple(
        (
            Cell(f"{_RULES[rule.name]} ({rule.name})"),
            Cell(str(rule.stations)),
            Cell(percent(rule.met_of_reachable), share=rule.met_of_reachable, state="measured"),
            Cell("not reached" if rule.stations_to_target is None else str(rule.stations_to_target)),
        )
        for rule in rules
    )
    said = ". ".join(sentence[0].upper() + sentence[1:] for sentence in rule_sentences(plan, rules))
    note = (
        f"{said}. All are measured on this plan's samples, from the candidates nearest to where a rule says. "
        "To the target, the station that adds most is taken each time."
    )
    return (Section("Beside rules of thumb", (Table(columns, rows), Text(note, is_note=True))),)


def rooms_section(plan: Plan) -> tuple[Section, ...]:
    """A row for each room with its stations; nothing where the scene is one room, or none."""
    if len(plan.rooms) < 2:
        return ()
    columns = (
        "Room", "Stations", "Leads to", "#storey", "#floor, m\u00b2", "#level, m", "#surface, m\u00b2",
        "#of it as required, %", "#can be reached, %",
    )  # fmt: skip
    rows = tuple(_row(room) for room in plan.rooms)
    note = (
        "A room is floor between doorways that has headroom; what stands on it is none. Its surface is all "
        "that bounds its air, furniture included. Rooms whose doors "
        "are shut lead nowhere: leave doors out by their names (--without) where one will find them open."
    )
    return (Section("Rooms", (Table(columns, rows), Text(note, is_note=True))),)


def _row(room: dict[str, Any]) -> tuple[Cell, ...]:
    stations = ", ".join(map(str, _numbers(room["stations"]))) or (
        "none" if room["is_asked_for"] else "not asked for"
    )
    ways = [str(number) for number in _numbers(room["joined"])]
    ways += [f"{number} by stairs" for number in _numbers(room["stairs"])]
    return (
        Cell(str(room["name"])),
        Cell(stations),
        Cell(", ".join(ways) or "no other"),
        Cell(str(room["storey"])),
        Cell(square_metres(float(str(room["floor_m2"])))),
        Cell(f"{float(str(room['level_m'])):.2f}"),
        *_shares(room),
    )


def _shares(room: dict[str, Any]) -> tuple[Cell, ...]:
    """How much surface bounds the room, and the shares of it with their standard errors."""
    if not room.get("surface_m2"):
        return (Cell(""), Cell(""), Cell(""))
    met = percent_within(room["met"], room["met_standard_error"])
    reachable = percent_within(room["reachable"], room["reachable_standard_error"])
    return Cell(square_metres(room["surface_m2"])), Cell(met), Cell(reachable)


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
