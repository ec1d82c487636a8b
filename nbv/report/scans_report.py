# SPDX-License-Identifier: MIT
"""Reports of scans without a model of the scene: what they cover, and where to stand next."""

from __future__ import annotations

from collections.abc import Sequence

from nbv.plan.plan import Plan
from nbv.report.blocks.scan_coverage_blocks import (
    area_bar,
    area_headlines,
    boundary_blocks,
    state_blocks,
    stations_plans,
    surfaces_blocks,
)
from nbv.report.blocks.scan_tables import PLACE_COLUMNS, place_cells, scans_table
from nbv.report.blocks.seen_rooms_blocks import record_blocks, rooms_blocks
from nbv.report.page.page import Block, Cell, Gallery, Headline, Page, Section, Table, Text
from nbv.run.wording import count, square_metres
from nbv.scanning.sensors.sensor import Sensor
from nbv.scans.scan_coverage import ScanCoverage
from nbv.scans.scan_record import ScanRecord
from nbv.scans.state_mesh import StateMesh

_NO_FLOOR = (
    "No floor was seen below the scanners, so stations are wherever space is known to be free; "
    "if the scans' world is not z up, say so (--up)."
)


def next_stations_page(
    plan: Plan,
    coverage: ScanCoverage,
    record: Sequence[ScanRecord],
    title: str,
    *,
    infers: bool = False,
    n_threads: int | None = None,
) -> Page:
    """Return the report of a plan that continues scans in a place without a model.

    `infers` tells whether the stations were chosen by what completion leaves open.
    """
    scan_map = coverage.scan_map
    poses = [view.world_from_sensor for view in plan.views]
    stations = Headline(str(len(poses)), "", "next stations" if len(poses) != 1 else "next station")
    lost = scan_map.mode == "room" and scan_map.rooms is None
    plans, brought = stations_plans(scan_map, plan.sensor, plan), record_blocks(record)
    missing = rooms_blocks(coverage, plan)
    return Page(
        title=title,
        kicker="Next stations",
        summary=f"{_where(plan)} {summary(coverage)}",
        headlines=(stations, *area_headlines(coverage)),
        bar=area_bar(coverage),
        sections=(
            Section(
                "Where to stand next",
                (Gallery(plans, min(len(plans), 2)), *stations_table(plan, infers=infers)),
            ),
            *((Section("What is missing, room by room", missing),) if missing else ()),
            *((Section("What each scan brought", brought),) if brought else ()),
            Section(
                "What was measured, and where the unknown begins",
                state_blocks(
                    coverage,
                    StateMesh.of(coverage),
                    n_threads=n_threads,
                    poses=poses,
                    sensor=plan.sensor,
                    zones=plan.zones,
                ),
            ),
            Section("Where the unknown begins", boundary_blocks(coverage)),
            Section("Scans so far", (scans_table(scan_map.scans, lettered=True),)),
            *((Section("Surfaces", surfaces_blocks(coverage)),) if coverage.completion else ()),
        ),
        warnings=(_NO_FLOOR,) if lost else (),
    )


def _where(plan: Plan) -> str:
    """Where the first station is."""
    if not plan.views:
        return f"No further station: {plan.stopped_because}."
    x, y, z = plan.views[0].world_from_sensor.translation
    return f"The next station with {plan.sensor.name} is at ({x:.2f}, {y:.2f}, {z:.2f}) m."


def stations_table(plan: Plan, *, infers: bool = False) -> tuple[Block, ...]:
    """A row for each station, and why there are no more."""
    rows = tuple(
        (
            Cell(str(number)),
            *place_cells(view.world_from_sensor),
            Cell(square_metres(view.predicted_gain_m2 or 0.0)),
        )
        for number, view in enumerate(plan.views, start=1)
    )
    columns = ("Station", *PLACE_COLUMNS, "#predicted gain, m\u00b2")
    gain = (
        "area that is likely to be news beyond the unknown's boundary, inferred surface by its doubt alone, "
        "and of surface measured worse than required, which counts little where a fitted surface is exact,"
        if infers
        else "area of the unknown's boundary and of surface that was measured worse than required,"
    )
    note = (
        f"Chosen among {count(plan.n_candidates, 'pose')}, of which those count that stand in known free "
        f"space. Gain: {gain} "
        "as far as the voxels say that the station sees it. It is a prediction; from the second station on "
        "it supposes that the ones before have seen what was predicted. The list ends because: "
        f"{plan.stopped_because}."
    )
    return (Table(columns, rows),) * bool(rows) + (Text(note, is_note=True),)


def scan_coverage_page(
    coverage: ScanCoverage,
    state: StateMesh,
    sensor: Sensor,
    title: str,
    n_threads: int | None = None,
) -> Page:
    """Return the report of a coverage, with its mesh and the sensor that was reckoned with."""
    scans, rooms = coverage.scan_map.scans, rooms_blocks(coverage)
    plans = stations_plans(coverage.scan_map, sensor)
    return Page(
        title=title,
        kicker="Coverage of scans",
        summary=summary(coverage),
        headlines=area_headlines(coverage),
        bar=area_bar(coverage),
        sections=(
            Section(
                "What was measured, and where the unknown begins", state_blocks(coverage, state, n_threads)
            ),
            Section(
                "Stations",
                (Gallery(plans, min(len(plans), 2)), scans_table(scans, lettered=True)),
            ),
            *((Section("Room by room", rooms),) if rooms else ()),
            Section("Where the unknown begins", boundary_blocks(coverage)),
            Section("Surfaces", surfaces_blocks(coverage)),
        ),
    )


def summary(coverage: ScanCoverage) -> str:
    """What was measured, and how well, in a sentence or two."""
    area, model = coverage.measured, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    share = f"{100 * area.met_m2 / area.total_m2:.1f} %" if area.total_m2 > 0 else "nothing"
    text = (
        f"{scans[0].upper()}{scans[1:]} measured {square_metres(area.total_m2)} m\u00b2 of surface, {share} "
        f"of it at {coverage.requirement.describe()}."
    )
    if model is not None:
        text += f" {square_metres(model.hypothesised_m2)} m\u00b2 more were inferred behind occluders."
    return text + " How much there is in all nobody knows: no model of the scene was given."
