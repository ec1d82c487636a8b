# SPDX-License-Identifier: MIT
"""`unseen plan`: views of a scene, what they cover, and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.process.run import Shared, running
from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.coverage import Coverage
from nbv.coverage.surface_classes import Shares
from nbv.coverage.unreachable import coverage_record
from nbv.plan.baselines import Baseline, compare_with_baselines
from nbv.plan.plan import Plan
from nbv.plan.plan_files import CSV_NAME, TRAJECTORY_NAME, write_plan_files
from nbv.plan.planning import Method, plan_views
from nbv.plan.remote_visibility import remote_visibility
from nbv.plan.rules import compare_with_rules
from nbv.report.blocks.rooms import rule_sentences
from nbv.report.building_files import write_building_files
from nbv.report.coverage_report import plan_page
from nbv.run.wording import count, percent, percent_within, square_metres
from nbv.scanning.sensor import chosen_effects
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.standing.site_options import SiteOptions
from nbv.visibility.viewpoints import load_candidates
from nbv.visibility.visibility import facing
from nbv.visibility.zones import Box, Zones
from scenes.io.format import Units
from scenes.io.scan_request import GivenScans, ScanRequest, read_request
from scenes.io.scene_files import open_scene
from scenes.mesh.orientation import Axis
from scenes.run.atomic import write_json
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode, Scene


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """What to plan: angles in degrees, lengths in metres, the target a fraction of the reachable area."""

    method: Method = "nbv"
    sensor: str = "generic60"
    max_incidence_deg: float = 60.0
    max_range_m: float | None = None
    min_density_per_m2: float | None = None
    max_sd_m: float | None = None
    registration_sd_m: float = 0.0
    averaging_radius_m: float = 0.0
    k: int = 1
    polish_steps: int = CoverOptions().polish_steps
    time_budget_s: float | None = None
    overlap: float | None = None
    infer: bool = False
    scheduler: str | None = None
    target: float = 0.99
    views: int | None = None
    mode: Mode | None = None
    site: SiteOptions = field(default_factory=SiteOptions)
    without: tuple[str, ...] = ()
    candidates: str | None = None
    scans: ScanRequest = field(default_factory=lambda: ScanRequest(()))
    plan: str | None = None
    region: tuple[float, ...] | None = None
    keep_out: tuple[tuple[float, ...], ...] = ()
    noise: str = "none"
    up: Axis = "z"
    units: Units = "m"

    def requirement(self) -> Requirement:
        """Return what counts as measured."""
        return Requirement(**{one.name: getattr(self, one.name) for one in fields(Requirement)})

    def zones(self) -> Zones:
        """Return where surface counts, and where no station may be."""
        boxes = [Box(np.array(box[:3]), np.array(box[3:])) for box in self.keep_out]
        region = self.region
        return Zones(None if region is None else Box(np.array(region[:3]), np.array(region[3:])), boxes)

    def budgets(self) -> CoverOptions:
        """Return the offline planner's budgets."""
        return CoverOptions(polish_steps=self.polish_steps, time_budget_s=self.time_budget_s)

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        own = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "scheduler"}
        named = {
            "sensor": Path(self.sensor).name,
            "candidates": None if self.candidates is None else Path(self.candidates).name,
            "plan": None if self.plan is None else Path(self.plan).name,
            **self.scans.options(),
            "up": self.up,
            "units": self.units,
            "site": asdict(self.site),
        }
        return {**own, **named}

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists beside the scene."""
        return [self.sensor, *([self.candidates] if self.candidates else []), *self.scans.inputs]


def run_plan(shared: Shared, scene: str, request: PlanRequest) -> None:
    """Plan views of `scene` and write plan, coverage and report."""
    with running("plan", shared, default="out/plan", is_folder=True) as run:
        run.watch.enter("load")
        run.read([scene, *request.inputs])
        zones = request.zones()
        world = open_scene(scene, up=request.up, units=request.units, mode=request.mode)
        world = world.without(request.without)
        run.warn(world.warnings)
        sensor = load_sensor(request.sensor)
        candidates = None if request.candidates is None else load_candidates(request.candidates)
        given = read_request(request.scans) if request.scans.paths else GivenScans.of(())
        scans = given.scans
        run.warn(given.doubts)
        journal = run.journal(request.options())
        run.will_call(facing, 20)
        with remote_visibility(request.scheduler, shared.threads, run.out) as remote:
            plan = plan_views(
                world,
                sensor,
                method=request.method,
                requirement=request.requirement(),
                target=request.target,
                views=request.views,
                mode=request.mode,
                site=request.site,
                candidates=candidates,
                noise=request.noise,
                budgets=request.budgets(),
                overlap=None if request.overlap is None else OverlapOptions(min_overlap=request.overlap),
                infer=request.infer,
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
        write_json(run.path("plan.json"), {**plan.to_json(), "seed": shared.seed, **beside})
        write_plan_files(plan.views, plan.visiting_order, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
        write_json(run.path("coverage.json"), coverage_record(coverage))
        if plan.stations is not None:
            write_json(run.path("stations.json"), plan.stations.to_json())
        write_building_files(world, plan, run.path)
        options = {**request.options(), "mode": request.mode or world.mode}
        options["effects"] = chosen_effects(sensor, request.noise).describe()
        page = plan_page(world, plan, coverage, shared.threads, baselines=baselines, rules=rules, scans=scans)
        run.report(page, options)
        resolved = {**options, "resolved_sensor": plan.sensor.to_json()}
        warnings = [*world.warnings, *(plan.site.warnings if plan.site else ())]
        summary = {**summary_of(plan), "rules": beside["rules"], "warnings": warnings}
        run.finish(resolved, summary, [*lines_of(plan), *rule_sentences(plan, rules)])


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
    if plan.lower_bound:
        lines.append(plan.lower_bound.describe())
    return lines


def _rooms_line(plan: Plan) -> str:
    """How many rooms have a station, and which have none."""
    inside = [room for room in plan.rooms if room["is_asked_for"]]
    empty = [f"{room['name']} ({room['floor_m2']:.1f} m2)" for room in inside if not room["stations"]]
    none = f"; none in {', '.join(empty)}" if empty else ""
    return f"stations in {len(inside) - len(empty)} of {count(len(inside), 'room')}{none}"


def _classes_line(shares: Shares, errors: Mapping[str, float]) -> str:
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
