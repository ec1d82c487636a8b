# SPDX-License-Identifier: MIT
"""Rooms that scans show: a floor plan of each storey, what each room lacks, and what the scans brought."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.plan.plan import Plan
from nbv.plan.plan_files import aim_of
from nbv.report.blocks.stations import cut_of
from nbv.report.blocks.storeys import CUT_M, around_rooms, label_of, label_place, level_of
from nbv.report.figures.storey_plan import StoreyPlan
from nbv.report.page.page import Block, Cell, Table, Text
from nbv.run.wording import count, letters, square_metres
from nbv.scans.room_coverage import RoomCoverage
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_record import ScanRecord
from nbv.scans.seen_rooms import SeenRooms
from nbv.visibility.zones import EVERYWHERE

_BELOW_M = 0.5


def seen_storey_plans(seen: SeenRooms, places: np.ndarray, plan: Plan | None = None) -> list[StoreyPlan]:
    """Return the floor plan of each storey, the lowest first, by what scans at `places` (s, 3) measured."""
    rooms = seen.rooms
    levels = {storey: level_of(rooms.rooms, storey) for storey in {room.storey for room in rooms.rooms}}
    views = () if plan is None else plan.views
    stood = [(letters(k), place) for k, place in enumerate(places)]
    planned = [(str(k), view.world_from_sensor) for k, view in enumerate(views, start=1)]
    turns = plan is not None and plan.sensor.kind == "spherical"
    found = []
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
        there = np.array([one[1] for one in [*given, *stations]]).reshape(-1, 2)
        shown = [room for room in rooms.rooms if room.storey == storey]
        found.append(
            StoreyPlan(
                storey=storey,
                title=f"storey {storey}",
                outline=around_rooms(cut_of(seen.mesh, level + CUT_M), rooms, storey),
                cut_m=CUT_M,
                rooms=[(label_of(room), label_place(rooms, room, there)) for room in shown],
                stations=stations,
                given=given,
                zones=EVERYWHERE if plan is None else plan.zones,
            )
        )
    return found


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
        _row(one, entries, with_stations=plan is not None) for one in coverage.rooms if _matters(one)
    )
    note = (
        "Missing of a room is what was measured worse than required, and what lies behind the shadows and "
        "the frontier, of which nobody knows how much it is. Inferred is what completion covers without "
        "another station; where it passes along a shadow, that is explained. Shadows and frontier are areas "
        "of boundary, not of surface. Rooms are floor that was seen or inferred, parted at doorways; they "
        "are numbered anew as scans come in. A room that is called outside has no ceiling that was seen."
    )
    return Table(columns, rows), Text(note, is_note=True)


def _matters(one: RoomCoverage) -> bool:
    return one.room is not None or one.met_m2 + one.worse_m2 + one.shadow_m2 + one.frontier_m2 > 0


def _row(
    one: RoomCoverage, entries: dict[int, dict[str, object]], *, with_stations: bool
) -> tuple[Cell, ...]:
    room = one.room
    scans = ", ".join(letters(number - 1) for number in one.scans) or "none"
    entry = {} if room is None else entries.get(room.number, {})
    stations = entry.get("stations") or ()
    text = ", ".join(map(str, stations)) if isinstance(stations, list | tuple) and stations else "none"
    areas = (
        one.met_m2, one.worse_m2, one.inferred_m2, one.shadow_m2, one.explained_m2, one.frontier_m2,
    )  # fmt: skip
    return (
        Cell(one.name),
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
    known = count(sum(scan.said is not None for scan in record), "scan")
    note = (
        "Expected is what the scans before say that a scan settles from where it really stood: boundary of "
        "the unknown that it should see, and surface seen worse than required that it should see well. "
        f"Settled is what of that it did. An earlier plan named the place of {known}: the plan.json in the "
        "output folder, or --plan, tells what was predicted there. The order is that in which the scans were "
        "given."
    )
    return Table(columns, rows), Text(note, is_note=True)


def _record_row(number: int, scan: ScanRecord) -> tuple[Cell, ...]:
    said = scan.said
    station = "" if said is None else f"{said.station}, {said.off_m:.2f} m off"
    gain = "" if said is None or said.predicted_gain_m2 is None else square_metres(said.predicted_gain_m2)
    expected = "" if scan.expected_m2 is None else square_metres(scan.expected_m2)
    done = "" if scan.settled_m2 is None else square_metres(scan.settled_m2)
    share = ""
    if scan.expected_m2 and scan.settled_m2 is not None:
        share = f"{100 * scan.settled_m2 / scan.expected_m2:.0f}"
    cells = (letters(number), station, gain, expected, done, share)
    return (*map(Cell, cells), Cell(square_metres(scan.measured_m2)), Cell(square_metres(scan.met_m2)))
