# SPDX-License-Identifier: MIT
"""`unseen plan`: views of a scene, what they cover, and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.options.parsing import record_of
from nbv.commands.options.planning import PlanOptions
from nbv.commands.options.shared import ReadOptions, Shared
from nbv.commands.process import Run, start_run
from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import check_scans
from nbv.coverage.surface_classes import ClassShares, KnownSurfaces
from nbv.coverage.unreachable import coverage_record
from nbv.online.limits import MOST_SCAN_PIXELS
from nbv.online.planner import PlannerOptions
from nbv.plan.baselines import Baseline, compare_with_baselines
from nbv.plan.plan import CSV_NAME, TRAJECTORY_NAME, Plan, cost_sentences, write_plan_files
from nbv.plan.planning import plan_views
from nbv.plan.problem import remote_visibility
from nbv.plan.rules import compare_with_rules
from nbv.plan.site_time import SitePace, knees
from nbv.report.blocks.room_tables import rule_sentences, write_building_files
from nbv.report.coverage_report import plan_page
from nbv.report.scans_report import next_stations_page
from nbv.run.wording import count, percent, percent_within, square_metres
from nbv.scanning.sensor import chosen_effects, missing_errors
from nbv.scanning.sensor_profile import load_sensor
from nbv.scans.next_stations import check_aperture, plan_next_stations, room_entries
from nbv.scans.scan_coverage import ScanCoverage, cover_by_scans
from nbv.scans.scan_map import ScanMap, with_known_noise
from nbv.scans.scan_record import (
    ScanRecord,
    StationPrediction,
    last_scan_in_words,
    read_predictions,
    record_scans,
)
from nbv.scans.upright import UprightScans
from nbv.visibility.candidates import with_aperture
from nbv.visibility.requirement import Requirement
from nbv.visibility.viewpoints import allowed_candidates, load_candidates
from nbv.visibility.visibility import select_facing
from nbv.visibility.zones import Box, Zones
from scenes.checks import InputError
from scenes.inclination import Up
from scenes.io.scan_request import GivenScans, read_request
from scenes.io.scene_files import open_scene
from scenes.run.atomic import write_json
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene


def options_record(asked: PlanOptions) -> dict[str, Any]:
    """Return the options for manifest and report; files by name."""
    record = record_of(
        asked,
        files=("sensor", "candidates", "before"),
        without=("scene", "scans", "site", "scheduler", *(entry.name for entry in fields(ReadOptions))),
    )
    scans = asked.request().options()
    up = scans["up"] if asked.scene is None else asked.up
    return {**record, **scans, "up": up, "units": asked.units, "site": asdict(asked.site)}


def zones_of(asked: PlanOptions) -> Zones:
    """Return where surface counts, and where no station may be."""
    boxes = [Box(np.array(box[:3]), np.array(box[3:])) for box in asked.keep_out]
    region = asked.region
    return Zones(None if region is None else Box(np.array(region[:3]), np.array(region[3:])), boxes)


def run_plan(shared: Shared, asked: PlanOptions) -> None:
    """Plan views of a scene, or next stations after scans, and write plan, coverage and report."""
    if asked.scene is None:
        _run_next_stations(shared, asked)
    else:
        _run_scene_plan(shared, asked.scene, asked)


def _run_scene_plan(shared: Shared, scene: str, request: PlanOptions) -> None:
    """Plan views of `scene` and write plan, coverage and report."""
    with start_run("plan", shared, default="out/plan", is_folder=True) as run:
        run.watch.enter("load")
        run.read([scene, *request.inputs])
        zones = zones_of(request)
        world = open_scene(scene, up=request.scene_up, units=request.units, mode=request.mode)
        world = world.without(request.without)
        sensor = load_sensor(request.sensor)
        doubts = [*world.warnings, *missing_errors(sensor, request.noise)]
        run.warn(doubts)
        candidates = None if request.candidates is None else load_candidates(request.candidates)
        search = request.search
        given = (
            read_request(request.request()).with_z_up(world.file_up) if request.scans else GivenScans.of(())
        )
        scans = given.scans
        run.warn([*given.doubts, *check_scans(world.mesh, world.ray_caster(shared.threads), scans)])
        journal = run.journal(options_record(request))
        run.will_call(select_facing, 20)
        with remote_visibility(request.scheduler, shared.threads, run.out) as remote:
            plan = plan_views(
                world,
                sensor,
                method=search.method,
                requirement=Requirement.of(request.requirement),
                target=search.target,
                views=search.views,
                mode=request.mode,
                site=request.site,
                candidates=candidates,
                noise=request.noise,
                budgets=CoverOptions(polish_steps=search.polish_steps, time_budget_s=search.time_budget_s),
                overlap=None if search.overlap is None else OverlapOptions(min_overlap=search.overlap),
                infer=search.infer,
                pace=SitePace.of(request.pace),
                scans=scans,
                zones=zones,
                remote=remote,
                journal=journal,
                rng=shared.seed,
                n_threads=shared.threads,
                progress=run.progress,
            )
        coverage = coverage_of(plan)
        if plan.site is not None:
            run.warn(plan.site.warnings)
        run.watch.enter("baselines")
        baselines = baselines_of(world, plan, scans, shared)
        rules = compare_with_rules(world.ray_caster(shared.threads), plan)
        run.watch.enter("report")
        beside = {
            "baselines": {baseline.name: baseline.to_json() for baseline in baselines[1:]},
            "rules": {rule.name: rule.to_json() for rule in rules},
        }
        _write_plan(run, world, plan, {"seed": shared.seed, **beside})
        options = {**options_record(request), "mode": request.mode or world.mode}
        options["effects"] = chosen_effects(sensor, request.noise).describe()
        page = plan_page(world, plan, coverage, shared.threads, baselines=baselines, rules=rules, scans=scans)
        run.report(page, options)
        resolved = {**options, "resolved_sensor": plan.sensor.to_json()}
        warnings = [*doubts, *(plan.site.warnings if plan.site else ())]
        summary = {**summary_of(plan), "rules": beside["rules"], "warnings": warnings}
        run.finish(resolved, summary, [*lines_of(plan), *rule_sentences(plan, rules)])


def _write_plan(run: Run, world: Scene, plan: Plan, beside: Mapping[str, Any]) -> None:
    """Write plan, views, coverage, stations and the files of a building; `beside` is what plan.json adds."""
    write_json(run.path("plan.json"), {**plan.to_json(), **beside})
    write_plan_files(plan.views, plan.visiting_order, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
    write_json(run.path("coverage.json"), coverage_record(coverage_of(plan)))
    if plan.stations is not None:
        write_json(run.path("stations.json"), plan.stations.to_json())
    write_building_files(world, plan, run.path)


def baselines_of(
    scene: Scene, plan: Plan, scans: Sequence[RangeImage], shared: Shared
) -> tuple[Baseline, ...]:
    """Return the plan and simple planners beside it; nothing for a plan without views."""
    if plan.candidates is None or not plan.views:
        return ()
    caster = scene.ray_caster(shared.threads)
    return compare_with_baselines(caster, plan, scans=scans, rng=shared.seed, n_threads=shared.threads)


def coverage_of(plan: Plan) -> Coverage:
    """Return the full coverage that a fresh plan holds."""
    if not isinstance(plan.coverage, Coverage):
        raise TypeError("a plan read from a file holds only the summary of its coverage")
    return plan.coverage


def summary_of(plan: Plan) -> dict[str, Any]:
    """Return the headline numbers."""
    coverage = coverage_of(plan)
    return {
        "method": plan.method,
        "views": len(plan.views),
        "resumed_from": plan.resumed_from.summary() if plan.resumed_from else None,
        "coverage": coverage.summary().to_json(),
        "met_of_reachable": coverage.met_of_reachable,
        "met_of_reachable_standard_error": coverage.met_of_reachable_error,
        "inference": plan.shares[-1].to_json() if plan.shares else None,
        "lower_bound": plan.lower_bound.to_json() if plan.lower_bound else None,
        "stopped_because": plan.stopped_because,
        "tour_m": plan.stations.tour.length_m if plan.stations else None,
        "legs_without_way": plan.stations.tour.n_without_way if plan.stations else None,
        "time": plan.time.to_json() if plan.time else None,
        "knees": [{"views": at, "met": plan.met_curve[at]} for at in knees(plan.met_curve)],
        "lost_if_blocked": list(plan.lost_if_blocked),
        "most_in_time": plan.most_in_time,
        "rooms": list(plan.rooms),
    }


def lines_of(plan: Plan) -> list[str]:
    """Return the headline numbers for people."""
    coverage, before = coverage_of(plan), plan.resumed_from
    errors = coverage.standard_errors()
    after = "" if before is None else f" after {len(before.poses)} scans"
    reached = percent_within(coverage.met_of_reachable, coverage.met_of_reachable_error)
    of_reachable = f", {reached} % of what can be reached"
    lines = [
        f"{count(len(plan.views), 'view')}{after} {'measures' if len(plan.views) == 1 else 'measure'} "
        f"{percent_within(coverage.met, errors['met'])} % of the area"
        f"{_classes_line(plan.shares[-1], errors) if plan.shares else of_reachable}",
        f"stopped because: {plan.stopped_because}",
    ]
    if plan.site is not None and len(plan.site.rooms.rooms) > 1:
        lines.append(_rooms_line(plan))
    if plan.stations is not None:
        tour = plan.stations.tour
        which = "the way from scan to scan" if tour.is_given else "a tour of all stations"
        lines.append(f"{which} takes {tour.describe()}")
    lines += cost_sentences(plan)
    if plan.lower_bound:
        lines.append(plan.lower_bound.describe())
    return lines


def _rooms_line(plan: Plan) -> str:
    """How many rooms have a station, and which have none."""
    inside = [room for room in plan.rooms if room["is_asked_for"]]
    empty = [f"{room['name']} ({room['floor_m2']:.1f} m2)" for room in inside if not room["stations"]]
    none = f"; none in {', '.join(empty)}" if empty else ""
    return f"stations in {len(inside) - len(empty)} of {count(len(inside), 'room')}{none}"


def _classes_line(shares: ClassShares, errors: Mapping[str, float]) -> str:
    """What completion adds to what was measured as required, and how much of what it infers is right."""
    text = (
        f"; modelled {percent_within(shares.modelled, errors['modelled'])} %, "
        f"inferred {percent_within(shares.inferred, errors['inferred'])} %, "
        f"unknown {percent_within(shares.unknown, errors['unknown'])} %"
    )
    if not shares.inferred_m2:
        return text
    right = percent(shares.right_m2 / shares.inferred_m2)
    claimed = square_metres(shares.inferred_m2)
    return f"{text}; {right} % of {claimed} m2 inferred lies within 2 cm of the true surface"


def _run_next_stations(shared: Shared, request: PlanOptions) -> None:
    """Plan the next stations after scans, and write plan, coverage so far and report."""
    with start_run("plan", shared, default="out/plan", is_folder=True) as run:
        run.watch.enter("load")
        before = _earlier_plan(request, run.out)
        run.read([*request.inputs, *([] if before is None else [str(before)])])
        zones, requirement = zones_of(request), Requirement.of(request.requirement)
        site, scan_request = request.site, request.request()
        candidates = None if request.candidates is None else load_candidates(request.candidates)
        sensor = check_aperture(with_aperture(load_sensor(request.sensor), candidates))
        given = read_request(scan_request)
        predictions = _earlier_predictions(before, given.scans, is_asked_for=request.before is not None)
        upright = UprightScans.of(given.scans, Up.along(scan_request.up), n_threads=shared.threads)
        doubts = upright.doubts("plan.json")
        run.warn([*given.doubts, *doubts])
        run.watch.enter("complete")
        scans = [with_known_noise(scan) for scan in upright.scans]
        few = [scan.thin(MOST_SCAN_PIXELS) for scan in scans]
        completed = KnownSurfaces.of(few, requirement.max_sd_m, relates=False, n_threads=shared.threads)
        run.watch.enter("voxels")
        options = PlannerOptions(zones=zones, clearance_m=site.clearance_m)
        scan_map = ScanMap.of(
            scans, sensor, mode=request.mode or "room", options=options, requirement=requirement,
            completed=completed, zones=zones,
        )  # fmt: skip
        candidates = allowed_candidates(candidates or scan_map.candidates(sensor, site), zones)
        chosen, warnings = ((), []) if scan_map.rooms is None else scan_map.rooms.choose_rooms(site)
        run.warn(warnings)
        run.watch.enter("plan")
        plan = plan_next_stations(
            scan_map,
            sensor,
            requirement,
            views=request.search.views or 1,
            candidates=candidates,
            options=options,
            completed=completed if request.search.infer else None,
            n_threads=shared.threads,
        )
        run.watch.enter("coverage")
        coverage = cover_by_scans(scan_map, requirement, completion=completed.completion, zones=zones)
        plan = replace(plan, rooms=room_entries(coverage, plan, chosen))
        record = record_scans(coverage, predictions)
        run.watch.enter("report")
        entries = {"seed": shared.seed, "record": [scan.to_json() for scan in record], **upright.to_json()}
        write_json(run.path("plan.json"), {**plan.to_json(), **entries})
        write_plan_files(plan.views, plan.visiting_order, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
        write_json(run.path("coverage.json"), {**coverage.to_json(), **upright.to_json()})
        asked = {**options_record(request), "mode": scan_map.mode, "instruments": given.instruments}
        page = next_stations_page(
            plan, coverage, record, scan_request.title, infers=request.search.infer, n_threads=shared.threads
        )
        run.report(replace(page, warnings=(*doubts, *page.warnings)), asked)
        resolved = {**asked, "resolved_sensor": plan.sensor.to_json()}
        summary = {**next_summary(plan, coverage, record), "warnings": [*given.doubts, *doubts]}
        run.finish(resolved, summary, next_lines(plan, coverage, record))


def _earlier_plan(request: PlanOptions, out: Path) -> Path | None:
    """Return the plan that was made after fewer scans: the one that is given, or that in the folder."""
    if request.before is not None:
        return Path(request.before)
    left = out / "plan.json"
    return left if left.is_file() else None


def _earlier_predictions(
    before: Path | None, scans: Sequence[RangeImage], *, is_asked_for: bool
) -> tuple[StationPrediction | None, ...]:
    """Return what an earlier plan said of the scans; one left in the folder may be of other scans."""
    if before is None:
        return ()
    try:
        return read_predictions(before, [scan.world_from_sensor for scan in scans])
    except InputError:
        if is_asked_for:
            raise
        return ()


def next_summary(plan: Plan, coverage: ScanCoverage, record: Sequence[ScanRecord]) -> dict[str, Any]:
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


def next_lines(plan: Plan, coverage: ScanCoverage, record: Sequence[ScanRecord]) -> list[str]:
    """Return the headline numbers for people."""
    area, unseen, model = coverage.measured, coverage.unseen, coverage.completion
    scans = count(len(coverage.scan_map.scans), "scan")
    inferred = "" if model is None else f"; {square_metres(model.hypothesised_m2)} m2 more are inferred"
    lines = [
        f"{scans} measured {square_metres(area.total_m2)} m2 of surface, "
        f"{square_metres(area.met_m2)} m2 of it as required{inferred}",
        unseen.describe(),
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
        lines.append(f"station {number}{where}: at {place}{looks}; predicted gain {gain} m2")
    return lines
