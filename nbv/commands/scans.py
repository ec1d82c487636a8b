# SPDX-License-Identifier: MIT
"""`unseen coverage --scans SCAN...` and `unseen plan --scans SCAN...` without a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from completion.options import CompletionOptions
from completion.pipeline import complete
from nbv.commands.coverage import CoverageRequest
from nbv.commands.plan import PlanRequest
from nbv.commands.process.run import Shared, running
from nbv.coverage.surface_classes import CompletedSurfaces
from nbv.online.planner import PlannerOptions
from nbv.plan.plan import Plan
from nbv.plan.plan_files import CSV_NAME, TRAJECTORY_NAME, write_plan_files
from nbv.report.scans_report import next_stations_page, scan_coverage_page
from nbv.run.csv_table import csv_text
from nbv.run.wording import count, square_metres
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.next_stations import check_aperture, plan_next_stations, room_entries
from nbv.scans.registering import placed_of, register_request
from nbv.scans.scan_coverage import ScanCoverage, cover_by_scans
from nbv.scans.scan_map import ScanMap, with_known_noise
from nbv.scans.scan_mesh import MOST_PIXELS
from nbv.scans.scan_record import Said, ScanRecord, last_scan_in_words, record_scans, said_before
from nbv.scans.state_mesh import STATES, StateMesh
from nbv.visibility.instances import with_aperture
from nbv.visibility.requirement import Requirement
from nbv.visibility.viewpoints import allowed, load_candidates
from scenes.checks import InputError
from scenes.io.ply import write_mesh_ply
from scenes.io.scan_request import read_request
from scenes.run.atomic import write_json, write_text
from scenes.scan.range_image import RangeImage


def run_next_stations(shared: Shared, request: PlanRequest) -> None:
    """Plan the next stations after the scans of `request`, and write plan, coverage so far and report."""
    with running("plan", shared, default="out/plan", is_folder=True) as run:
        run.watch.enter("load")
        before = _earlier_plan(request, run.out)
        run.read([*request.inputs, *([] if before is None else [str(before)])])
        zones, requirement, site = request.zones(), request.requirement(), request.site
        candidates = None if request.candidates is None else load_candidates(request.candidates)
        sensor = check_aperture(with_aperture(load_sensor(request.sensor), candidates))
        given = read_request(request.scans, request.up)
        run.warn(given.doubts)
        said = _said(before, given.scans, is_asked_for=request.plan is not None)
        run.watch.enter("complete")
        scans = [with_known_noise(scan) for scan in given.scans]
        few = [scan.thinned(MOST_PIXELS) for scan in scans]
        completed = CompletedSurfaces.of(few, requirement.max_sd_m, relates=False, n_threads=shared.threads)
        run.watch.enter("voxels")
        options = PlannerOptions(zones=zones, clearance_m=site.clearance_m)
        scan_map = ScanMap.of(
            scans, sensor, mode=request.mode or "room", options=options, requirement=requirement,
            completed=completed, zones=zones,
        )  # fmt: skip
        candidates = allowed(candidates or scan_map.candidates(sensor, site), zones)
        chosen, warnings = ((), []) if scan_map.rooms is None else scan_map.rooms.chosen(site)
        run.warn(warnings)
        run.watch.enter("plan")
        plan = plan_next_stations(
            scan_map,
            sensor,
            requirement,
            views=request.views or 1,
            candidates=candidates,
            options=options,
            completed=completed if request.infer else None,
            n_threads=shared.threads,
        )
        run.watch.enter("coverage")
        coverage = cover_by_scans(scan_map, requirement, completion=completed.completion, zones=zones)
        plan = replace(plan, rooms=room_entries(coverage, plan, chosen))
        record = record_scans(coverage, said)
        run.watch.enter("report")
        entries = {"seed": shared.seed, "record": [scan.to_json() for scan in record]}
        write_json(run.path("plan.json"), {**plan.to_json(), **entries})
        write_plan_files(plan.views, plan.visiting_order, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
        write_json(run.path("coverage.json"), coverage.to_json())
        asked = {**request.options(), "mode": scan_map.mode, "instruments": given.instruments}
        page = next_stations_page(
            plan, coverage, record, request.scans.title, infers=request.infer, n_threads=shared.threads
        )
        run.report(page, asked)
        resolved = {**asked, "resolved_sensor": plan.sensor.to_json()}
        run.finish(resolved, summary_of(plan, coverage, record), lines_of(plan, coverage, record))


def _earlier_plan(request: PlanRequest, out: Path) -> Path | None:
    """Return the plan that was made after fewer scans: the one that is given, or that in the folder."""
    if request.plan is not None:
        return Path(request.plan)
    left = out / "plan.json"
    return left if left.is_file() else None


def _said(before: Path | None, scans: Sequence[RangeImage], *, is_asked_for: bool) -> tuple[Said | None, ...]:
    """Return what an earlier plan said of the scans; one left in the folder may be of other scans."""
    if before is None:
        return ()
    try:
        return said_before(before, [scan.world_from_sensor for scan in scans])
    except InputError:
        if is_asked_for:
            raise
        return ()


def summary_of(plan: Plan, coverage: ScanCoverage, record: Sequence[ScanRecord]) -> dict[str, Any]:
    """Return the headline numbers."""
    content = coverage.to_json()
    return {
        "method": plan.method,
        "views": len(plan.views),
        "predicted_gain_m2": [view.predicted_gain_m2 for view in plan.views],
        "resumed_from": plan.resumed_from.summary() if plan.resumed_from else None,
        "rooms": list(plan.rooms),
        "record": [scan.to_json() for scan in record],
        "surface": content["surface"],
        "boundary": content["boundary"],
        "stopped_because": plan.stopped_because,
    }


def lines_of(plan: Plan, coverage: ScanCoverage, record: Sequence[ScanRecord]) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    inferred = "" if model is None else f"; {square_metres(model.hypothesised_m2)} m2 more are inferred"
    lines = [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface, "
        f"{square_metres(area.met_m2)} m2 of it as required{inferred}",
        f"shadows begin on {square_metres(unseen.occluded_m2)} m2, fields of view end on "
        f"{square_metres(unseen.frontier_m2)} m2 (areas of boundary, not of surface)",
        *(room.describe() for room in coverage.rooms),
        *last_scan_in_words(record),
        *_stations(plan),
        f"stopped because: {plan.stopped_because}",
    ]
    if coverage.scan_map.mode == "room" and coverage.scan_map.rooms is None:
        lines.append("no floor was seen below the scanners: stations are where space is known to be free")
    return lines


def _stations(plan: Plan) -> Sequence[str]:
    """A line for each station."""
    lines = []
    for number, view in enumerate(plan.views, start=1):
        place = ", ".join(f"{c:.2f}" for c in view.world_from_sensor.translation)
        way = ", ".join(f"{c:.2f}" for c in view.world_from_sensor.rotation[:, 2])
        looks = "" if plan.sensor.kind == "spherical" else f", looking along {way}"
        gain = square_metres(view.predicted_gain_m2 or 0.0)
        names = [str(room["name"]) for room in plan.rooms if number in room["stations"]]
        where = f" in {names[0]}" if names else ""
        lines.append(f"station {number}{where}: at {place}{looks}; predicted to settle {gain} m2")
    return lines


_COLOURS = np.array(
    [[158, 163, 163], [244, 211, 158], [46, 122, 204], [230, 159, 26], [219, 219, 214]], np.uint8
)


def run_scan_coverage(shared: Shared, request: CoverageRequest) -> None:
    """Report what the scans of `request` have measured, and what completion makes of it."""
    with running("coverage", shared, default="out/coverage", is_folder=True) as run:
        run.watch.enter("load")
        run.read([request.sensor, *request.scans.inputs])
        requirement = Requirement(
            max_incidence_deg=request.max_incidence_deg, max_range_m=request.max_range_m
        )
        sensor = load_sensor(request.sensor)
        options, placement = CompletionOptions(mode=request.inference, texture=False), []
        if request.register:
            placed = register_request(
                request.scans, request.up, n_threads=shared.threads, progress=run.progress
            )
            given, options = placed.given, replace(options, pose_deviations_m=placed.deviations_m)
            placement = [placed.told]
        else:
            given = read_request(request.scans, request.up)
        run.warn(given.doubts)
        run.watch.enter("voxels")
        scans = [with_known_noise(scan) for scan in given.scans]
        model = complete(scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress)
        completed = CompletedSurfaces(model, options.max_sd_m)
        scan_map = ScanMap.of(
            scans, sensor, mode=request.mode or "room", requirement=requirement, completed=completed
        )
        coverage = cover_by_scans(scan_map, requirement, completion=model)
        run.watch.enter("report")
        write_json(run.path("coverage.json"), coverage.to_json())
        write_text(run.path("coverage.csv"), csv_of(coverage))
        state = StateMesh.of(coverage)
        _write_ply(run.path("coverage.ply"), state)
        asked = {
            **request.options(),
            "inference": request.inference,
            "mode": scan_map.mode,
            "instruments": given.instruments,
        }
        run.report(scan_coverage_page(coverage, state, sensor, request.scans.title, shared.threads), asked)
        run.finish(
            asked, {**coverage.to_json(), **placed_of(placement)}, placement + coverage_lines(coverage)
        )


def csv_of(coverage: ScanCoverage) -> str:
    """Return a row for each recognised surface: id, kind, measured area, share as required, inferred area."""
    return csv_text(
        ["id", "kind", "observed_m2", "met", "hypothesised_m2"],
        ((one.id, one.kind, one.observed_m2, one.met, one.hypothesised_m2) for one in coverage.surfaces),
    )


def coverage_lines(coverage: ScanCoverage) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    inferred = 0.0 if model is None else model.hypothesised_m2
    return [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface: "
        f"{square_metres(area.met_m2)} m2 as required, {square_metres(area.worse_m2)} m2 worse",
        f"inferred: {square_metres(inferred)} m2 of surface",
        f"not explained: shadows begin on {square_metres(unseen.occluded_m2)} m2, fields of view end on "
        f"{square_metres(unseen.frontier_m2)} m2 (areas of boundary, not of surface)",
        *(room.describe() for room in coverage.rooms),
    ]


def _write_ply(path: Path, state: StateMesh) -> None:
    """Write surface and boundary with the state of every vertex."""
    colours = _COLOURS[state.state]
    properties: dict[str, Any] = {
        **{name: colours[:, k] for k, name in enumerate(("red", "green", "blue"))},
        "state": state.state,
        "cosine": state.cosine,
    }
    legend = [f"state {value} {name}" for value, name in enumerate(STATES)]
    write_mesh_ply(path, state.mesh.vertices, state.mesh.faces, properties, legend)
