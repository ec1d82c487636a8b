# SPDX-License-Identifier: MIT
"""Rooms in a report: where stations stand, and what surface is none of the rooms'.

And the files that a surveyor takes along: the list of stations, a floor plan of each storey.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from nbv.coverage.coverage import Coverage
from nbv.online.limits import INSTRUMENT_M
from nbv.plan.plan import Plan, aim_of
from nbv.plan.rules import RuleOutcome
from nbv.plan.station_list import Station, station_csv, stations_of
from nbv.report.blocks.coverage_tables import cut_of
from nbv.report.blocks.page import Block, Cell, PageSection, Table, Text
from nbv.report.figures.floor_plan import StoreyPlan, joined_numbers, sheets_pdf
from nbv.run.wording import count, letters, percent, percent_within, square_metres
from nbv.scans.room_coverage import RoomCoverage
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_record import ScanRecord
from nbv.scans.seen_rooms import SeenRooms
from nbv.visibility.rooms import Rooms, SiteRoom
from nbv.visibility.zones import EVERYWHERE
from scenes.checks import FloatArray
from scenes.run.atomic import write_bytes, write_text
from scenes.world.scene import Scene

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
    sentences = []
    for rule in rules:
        does = f"takes {count(rule.stations, 'station')} and measures {percent(rule.met_of_reachable)} % "
        does += "of what can be reached"
        if rule.stations_to_target is not None and rule.stations_to_target < rule.stations:
            does += f", {percent(plan.target or 1.0)} % with the best {rule.stations_to_target} of them"
        met = plan.coverage.met / max(plan.coverage.reachable, 1e-12) if plan.coverage else 0.0
        sentences.append(f"{_RULES[rule.name]} ({rule.name}) {does}; this plan {mine} and {percent(met)} %")
    return sentences


def rules_section(plan: Plan, rules: Sequence[RuleOutcome]) -> tuple[PageSection, ...]:
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
    message = ". ".join(sentence[0].upper() + sentence[1:] for sentence in rule_sentences(plan, rules))
    note = (
        f"{message}. All are measured on this plan's samples, "
        "from the candidates nearest to where a rule says. "
        "To the target, the station that adds most is taken each time."
    )
    return (PageSection("Beside rules of thumb", (Table(columns, rows), Text(note, is_note=True))),)


def rooms_section(plan: Plan) -> tuple[PageSection, ...]:
    """A row for each room with its stations; nothing where the scene is one room, or none."""
    if len(plan.rooms) < 2:
        return ()
    standing = "Stations" if plan.sensor.kind == "spherical" else "Views"
    columns = (
        "Room", standing, "Leads to", "#storey", "#floor, m\u00b2", "#level, m", "#surface, m\u00b2",
        "#of it as required, %", "#can be reached, %",
    )  # fmt: skip
    rows = tuple(_row(room) for room in plan.rooms)
    note = (
        "A room is floor between doorways that has headroom; what stands on it is none. Its surface is all "
        "that bounds its air, furniture included. Rooms whose doors "
        "are shut lead nowhere: leave doors out by their names (--without) where one will find them open."
    )
    return (PageSection("Rooms", (Table(columns, rows), Text(note, is_note=True))),)


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


_BELOW_STOREY_M = 0.5  # a way so far below a storey's floor still belongs to it
_NEAR_M = 1.2  # a room's label keeps so far from its stations where there is space


def storey_plans(scene: Scene, plan: Plan, *, by_views: bool = False) -> tuple[StoreyPlan, ...]:
    """Return the floor plan of each storey on which stations were asked for, the lowest first.

    It is cut at the height of the instruments that stand there. Nothing without rooms. Stations have their
    numbers in `stations.csv`, or those of their views, as 3-D view and tables of a report have.
    """
    if plan.site is None:
        return ()
    rooms, stations = plan.site.rooms, stations_of(plan)
    asked = [rooms.rooms[number - 1] for number in plan.site.chosen]
    levels = {storey: level_of(rooms.rooms, storey) for storey in {room.storey for room in rooms.rooms}}
    ways = _ways_of(plan, levels)
    plans = []
    for storey in sorted({room.storey for room in asked}):
        here = [station for station in stations if station.room is not None and station.room.storey == storey]
        heights = [station.height_m for station in here]
        height = float(np.median(heights)) if heights else INSTRUMENT_M
        places = np.array([station.position[:2] for station in here]).reshape(-1, 2)
        shown = [room for room in rooms.rooms if room.storey == storey and not room.is_outside]
        shown += [room for room in asked if room.storey == storey and room.is_outside]
        plans.append(
            StoreyPlan(
                storey=storey,
                title=f"{scene.name}, storey {storey}: {count(len(here), 'station')}",
                outline=around_rooms(cut_of(scene.mesh, levels[storey] + height), rooms, storey),
                cut_m=height,
                rooms=[(label_of(room), label_place(rooms, room, places)) for room in shown],
                stations=[
                    (_name_of(station, by_views=by_views), station.position[:2], station.headings_deg)
                    for station in here
                ],
                numbers=_VIEWS_NUMBERS if by_views and len(stations) < len(plan.views) else "their numbers",
                ways=ways.get(storey, ()),
            )
        )
    return tuple(plans)


_VIEWS_NUMBERS = "the numbers of their views"


def _name_of(station: Station, *, by_views: bool) -> str:
    """The number of a station, or those of its views."""
    return joined_numbers([str(view) for view in station.views]) if by_views else str(station.number)


def label_of(room: SiteRoom) -> str:
    """What stands on a room: its name and its floor area."""
    return f"{room.name}\n{square_metres(room.floor_m2)} m\u00b2"


def level_of(rooms: Sequence[SiteRoom], storey: int) -> float:
    """Height of a storey's floor, metres: that of most of it."""
    here = [room for room in rooms if room.storey == storey]
    return max(here, key=lambda room: room.floor_m2).level_m


def label_place(rooms: Rooms, room: SiteRoom, there: FloatArray) -> FloatArray:
    """Where a room's label stands (2,), metres: near its middle, off its walls and the stations (n, 2)."""
    columns = rooms.floors.columns
    inside = np.zeros(columns.shape, np.bool_)
    inside.ravel()[columns.cell[rooms.room == room.number]] = True
    cells = np.flatnonzero(inside)
    off_walls = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1].ravel()[cells] * columns.cell_m
    places = columns.places(cells)
    away = np.full(len(places), _NEAR_M)
    if len(there):
        away = np.minimum(cKDTree(there).query(places)[0], _NEAR_M)
    middle = np.linalg.norm(places - np.array(room.place[:2]), axis=1)
    return np.asarray(places[np.argmax(away + 2 * np.minimum(off_walls, _NEAR_M / 2) - 0.15 * middle)])


def around_rooms(outline: FloatArray, rooms: Rooms, storey: int) -> FloatArray:
    """What of an outline (k, 2, 2) lies around the rooms of a storey: grounds go on far beyond."""
    numbers = [room.number for room in rooms.rooms if room.storey == storey and not room.is_outside]
    columns = rooms.floors.columns
    places = columns.places(columns.cell[np.isin(rooms.room, numbers)])
    if not len(places) or not len(outline):
        return outline
    low, high = places.min(axis=0) - 1.0, places.max(axis=0) + 1.0
    inside = ((outline >= low) & (outline <= high)).all(axis=2).any(axis=1)
    return np.asarray(outline[inside])


def _ways_of(plan: Plan, levels: dict[int, float]) -> dict[int, list[FloatArray]]:
    """What of the tour lies on each storey, as stretches (k, 2), metres.

    A leg between stations of one storey lies on it; of others each stretch on the one below its height.
    """
    if plan.stations is None or plan.site is None or not levels:
        return {}
    storeys = sorted(levels, key=lambda storey: levels[storey])
    floor = np.array([levels[storey] for storey in storeys])
    positions = np.array([view.world_from_sensor.translation for view in plan.views])
    room, storey_of = (
        plan.site.rooms.room_of(positions),
        [0, *(room.storey for room in plan.site.rooms.rooms)],
    )
    tour = plan.stations.tour
    ways: dict[int, list[FloatArray]] = {}
    for (a, b), leg in zip(pairwise(tour.order), tour.legs, strict=True):
        if len(leg.path) < 2:
            continue
        of = np.maximum(np.searchsorted(floor, leg.path[:, 2] + _BELOW_STOREY_M, side="right") - 1, 0)
        storey_a, other = storey_of[room[a]], storey_of[room[b]]
        if storey_a == other > 0:
            of[:] = storeys.index(storey_a)
        ends = [0, *(np.flatnonzero(np.diff(of)) + 1).tolist(), len(of)]
        for first, last in pairwise(ends):
            stretch = leg.path[first : min(last + 1, len(of)), :2]
            if len(stretch) > 1:
                ways.setdefault(storeys[of[first]], []).append(stretch)
    return ways


_BELOW_M = 0.5


def seen_storey_plans(seen: SeenRooms, places: np.ndarray, plan: Plan | None = None) -> list[StoreyPlan]:
    """Return the floor plan of each storey, the lowest first, by what scans at `places` (s, 3) measured."""
    rooms = seen.rooms
    levels = {storey: level_of(rooms.rooms, storey) for storey in {room.storey for room in rooms.rooms}}
    views = () if plan is None else plan.views
    stood = [(letters(k), place) for k, place in enumerate(places)]
    planned = [(str(k), view.world_from_sensor) for k, view in enumerate(views, start=1)]
    turns = plan is not None and plan.sensor.kind == "spherical"
    plans = []
    for storey, level in sorted(levels.items()):
        next_level = min((other for other in levels.values() if other > level), default=np.inf)

        def is_here(z: float, low: float = level - _BELOW_M, high: float = next_level - _BELOW_M) -> bool:
            return low <= z < high

        given = [(name, place[:2]) for name, place in stood if is_here(place[2])]
        stations = [
            (name, pose.translation[:2], () if turns else (aim_of(pose).heading_deg,))
            for name, pose in planned
            if is_here(pose.translation[2])
        ]
        there = np.array([placed[1] for placed in [*given, *stations]]).reshape(-1, 2)
        shown = [room for room in rooms.rooms if room.storey == storey]
        plans.append(
            StoreyPlan(
                storey=storey,
                title=f"storey {storey}",
                outline=around_rooms(cut_of(seen.mesh, level + INSTRUMENT_M), rooms, storey),
                cut_m=INSTRUMENT_M,
                rooms=[(label_of(room), label_place(rooms, room, there)) for room in shown],
                stations=stations,
                given=given,
                zones=EVERYWHERE if plan is None else plan.zones,
            )
        )
    return plans


def rooms_blocks(coverage: ScanCoverage, plan: Plan | None = None) -> tuple[Block, ...]:
    """A row for each room that the scans show: what they measured, what is missing, where to stand."""
    if not coverage.rooms:
        return ()
    entries = {} if plan is None else {room["room"]: room for room in plan.rooms}
    columns = (
        "Room", "Scans", *(("Next stations",) if plan is not None else ()), "#storey", "#floor, m\u00b2",
        "#as required, m\u00b2", "#worse, m\u00b2", "#inferred, m\u00b2", "#shadows, m\u00b2",
        "#of shadows explained, m\u00b2", "#frontier, m\u00b2",
    )  # fmt: skip
    rows = tuple(
        _seen_room_row(room, entries, with_stations=plan is not None)
        for room in coverage.rooms
        if _matters(room)
    )
    note = (
        "Missing of a room is what was measured worse than required, and what lies behind the shadows and "
        "the frontier, of which nobody knows how much it is. Inferred is what completion covers without "
        "another station; where it passes along a shadow, that is explained. Shadows and frontier are areas "
        "of boundary, not of surface. Rooms are floor that was seen or inferred, parted at doorways; they "
        "are numbered anew as scans come in. A room that is called outside has no ceiling that was seen."
    )
    return Table(columns, rows), Text(note, is_note=True)


def _matters(coverage: RoomCoverage) -> bool:
    return (
        coverage.room is not None
        or coverage.met_m2 + coverage.worse_m2 + coverage.shadow_m2 + coverage.frontier_m2 > 0
    )


def _seen_room_row(
    coverage: RoomCoverage, entries: dict[int, dict[str, object]], *, with_stations: bool
) -> tuple[Cell, ...]:
    room = coverage.room
    scans = ", ".join(letters(number - 1) for number in coverage.scans) or "none"
    entry = {} if room is None else entries.get(room.number, {})
    stations = entry.get("stations") or ()
    text = ", ".join(map(str, stations)) if isinstance(stations, list | tuple) and stations else "none"
    areas = (
        coverage.met_m2, coverage.worse_m2, coverage.inferred_m2, coverage.shadow_m2,
        coverage.explained_m2, coverage.frontier_m2,
    )  # fmt: skip
    return (
        Cell(coverage.name),
        Cell(scans),
        *((Cell(text),) if with_stations else ()),
        Cell("" if room is None else str(room.storey)),
        Cell("" if room is None else square_metres(room.floor_m2)),
        *(Cell(square_metres(area)) for area in areas),
    )


def record_blocks(record: Sequence[ScanRecord]) -> tuple[Block, ...]:
    """A row for each scan: what was predicted of it, and what it brought."""
    if len(record) < 2:
        return ()
    columns = (
        "Scan", "Station of the plan before", "#that plan predicted, m\u00b2", "#expected, m\u00b2",
        "#settled, m\u00b2", "#of expected, %", "#new surface, m\u00b2", "#newly as required, m\u00b2",
    )  # fmt: skip
    rows = tuple(_record_row(number, scan) for number, scan in enumerate(record))
    known = count(sum(scan.prediction is not None for scan in record), "scan")
    note = (
        "Expected is what the scans before say that a scan settles from where it really stood: boundary of "
        "the unknown that it should see, and surface seen worse than required that it should see well. "
        f"Settled is what of that it did. An earlier plan named the place of {known}: the plan.json in the "
        "output folder, or --plan, tells what was predicted there. The order is that in which the scans were "
        "given."
    )
    return Table(columns, rows), Text(note, is_note=True)


def _record_row(number: int, scan: ScanRecord) -> tuple[Cell, ...]:
    standing = scan.prediction
    station = "" if standing is None else f"{standing.station}, {standing.off_m:.2f} m off"
    gain = (
        ""
        if standing is None or standing.predicted_gain_m2 is None
        else square_metres(standing.predicted_gain_m2)
    )
    expected = "" if scan.expected_m2 is None else square_metres(scan.expected_m2)
    done = "" if scan.settled_m2 is None else square_metres(scan.settled_m2)
    share = ""
    if scan.expected_m2 and scan.settled_m2 is not None:
        share = f"{100 * scan.settled_m2 / scan.expected_m2:.0f}"
    cells = (letters(number), station, gain, expected, done, share)
    return (*map(Cell, cells), Cell(square_metres(scan.measured_m2)), Cell(square_metres(scan.met_m2)))


STATIONS_NAME, SHEETS_NAME = "stations.csv", "floor-plans.pdf"


def write_building_files(scene: Scene, plan: Plan, path: Callable[[str], Path]) -> None:
    """Write `stations.csv`, `floor-plan-N.svg` for each storey N, and `floor-plans.pdf` with all of them.

    `path` tells where a file of a name goes. Nothing is written of plans without rooms or without views.
    """
    if plan.site is None or not plan.views:
        return
    write_text(path(STATIONS_NAME), station_csv(stations_of(plan)))
    sheets = storey_plans(scene, plan)
    for sheet in sheets:
        write_bytes(path(f"floor-plan-{sheet.storey}.svg"), sheet.svg())
    write_bytes(path(SHEETS_NAME), sheets_pdf(sheets))
