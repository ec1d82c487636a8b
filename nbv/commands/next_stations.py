# SPDX-License-Identifier: MIT
"""`unseen plan --scans SCAN...` without a scene: where to put the scanner next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nbv.commands.plan import PlanRequest
from nbv.commands.process.run import Shared, running
from nbv.coverage.completed_surfaces import CompletedSurfaces
from nbv.online.planner import PlannerOptions
from nbv.plan.plan import Plan
from nbv.plan.plan_files import CSV_NAME, TRAJECTORY_NAME, write_plan_files
from nbv.plan.planning import with_aperture
from nbv.report.next_stations_report import next_stations_page
from nbv.run.wording import count, square_metres
from nbv.scanning.sensors.sensor_profile import load_sensor
from nbv.scans.next_stations import check_aperture, plan_next_stations
from nbv.scans.scan_coverage import ScanCoverage, cover_by_scans
from nbv.scans.scan_map import ScanMap
from nbv.visibility.viewpoints import allowed, load_candidates
from scenes.files.scan_request import read_request
from scenes.run.atomic import write_json


def run_next_stations(shared: Shared, request: PlanRequest) -> None:
    """Plan the next stations after the scans of `request`, and write plan, coverage so far and report."""
    with running("plan", shared, default="out/plan", is_folder=True) as run:
        run.watch.enter("load")
        run.read(request.inputs)
        zones, requirement = request.zones(), request.requirement()
        candidates = None if request.candidates is None else load_candidates(request.candidates)
        sensor = check_aperture(with_aperture(load_sensor(request.sensor), candidates))
        given = read_request(request.scans, request.up)
        run.warn(given.doubts)
        run.watch.enter("voxels")
        options = PlannerOptions(zones=zones)
        scan_map = ScanMap.of(given.scans, sensor, mode=request.mode or "room", options=options, zones=zones)
        candidates = allowed(candidates or scan_map.candidates(sensor, options.clearance_m), zones)
        completed = None
        if request.infer:
            run.watch.enter("complete")
            completed = CompletedSurfaces.of(scan_map.scans, requirement.max_sd_m, n_threads=shared.threads)
        run.watch.enter("plan")
        plan = plan_next_stations(
            scan_map,
            sensor,
            requirement,
            views=request.views or 1,
            candidates=candidates,
            options=options,
            completed=completed,
            n_threads=shared.threads,
        )
        run.watch.enter("coverage")
        model = None if completed is None else completed.completion
        coverage = cover_by_scans(scan_map, requirement, completion=model, zones=zones)
        run.watch.enter("report")
        write_json(run.path("plan.json"), {**plan.to_json(), "seed": shared.seed})
        write_plan_files(plan, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
        write_json(run.path("coverage.json"), coverage.to_json())
        asked = {**request.options(), "mode": scan_map.mode, "instruments": given.instruments}
        page = next_stations_page(
            plan,
            coverage,
            title=request.scans.title,
            options=asked,
            seed=shared.seed,
            n_threads=shared.threads,
        )
        run.report(page)
        resolved = {**asked, "resolved_sensor": plan.sensor.to_json()}
        run.finish(resolved, summary_of(plan, coverage), lines_of(plan, coverage))


def summary_of(plan: Plan, coverage: ScanCoverage) -> dict[str, Any]:
    """Return the headline numbers."""
    content = coverage.to_json()
    return {
        "method": plan.method,
        "views": len(plan.views),
        "predicted_gain_m2": [view.predicted_gain_m2 for view in plan.views],
        "resumed_from": plan.resumed_from.summary() if plan.resumed_from else None,
        "floor_m": coverage.scan_map.floor_m,
        "surface": content["surface"],
        "boundary": content["boundary"],
        "stopped_because": plan.stopped_because,
    }


def lines_of(plan: Plan, coverage: ScanCoverage) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen = coverage.measured, coverage.unseen
    scans = count(len(coverage.scan_map.scans), "scan")
    model = coverage.completion
    inferred = "" if model is None else f"; {square_metres(model.hypothesised_m2)} m2 more are inferred"
    lines = [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface, "
        f"{square_metres(area.met_m2)} m2 of it as required{inferred}",
        f"shadows begin on {square_metres(unseen.occluded_m2)} m2, fields of view end on "
        f"{square_metres(unseen.frontier_m2)} m2 (areas of boundary, not of surface)",
        *_stations(plan),
        f"stopped because: {plan.stopped_because}",
    ]
    if coverage.scan_map.mode == "room" and coverage.scan_map.floor_m is None:
        lines.append("no floor was seen below the scanners: stations are where space is known to be free")
    return lines


def _stations(plan: Plan) -> Sequence[str]:
    """A line for each station."""
    lines = []
    for number, view in enumerate(plan.views, start=1):
        place = ", ".join(f"{c:.2f}" for c in view.world_from_sensor.translation)
        way = ", ".join(f"{c:.2f}" for c in view.world_from_sensor.rotation[:, 2])
        gain = square_metres(view.predicted_gain_m2 or 0.0)
        lines.append(f"station {number}: at {place}, looking along {way}; predicted to settle {gain} m2")
    return lines
