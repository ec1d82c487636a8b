# SPDX-License-Identifier: MIT
"""`unseen plan` and `unseen coverage` on the command line; nothing slow is imported before one runs."""

from __future__ import annotations

import typer

from nbv.commands.options.options import (
    DepthScale,
    Intrinsics,
    NoiseOption,
    Origins,
    Poses,
    RegisterFlag,
    Scheduler,
    SensorOption,
    UnitsOption,
    UpOption,
    asked_scans,
    parse_numbers,
    with_shared,
)
from nbv.commands.options.site_options import AskedSite, with_planned_site, with_site
from nbv.commands.options.view_options import (
    AveragingRadius,
    CandidatesFile,
    CompletionMode,
    EarlierPlan,
    Incidence,
    Infer,
    KeepOut,
    KnownScene,
    KViews,
    MaxRange,
    MaxSd,
    Method,
    MinDensity,
    ModeOption,
    MostViews,
    OverlapShare,
    PlanFile,
    PolishSteps,
    Region,
    RegistrationSd,
    ScanFiles,
    Target,
    TimeBudget,
)
from nbv.commands.process.run import Shared


@with_shared
@with_planned_site
def plan(
    shared: Shared,
    site: AskedSite,
    scene: KnownScene = None,
    method: Method = "nbv",
    sensor: SensorOption = "generic60",
    max_incidence: Incidence = 60.0,
    max_range: MaxRange = None,
    min_density: MinDensity = None,
    max_sd: MaxSd = None,
    registration_sd: RegistrationSd = 0.0,
    averaging_radius: AveragingRadius = 0.0,
    k: KViews = 1,
    target: Target = 0.99,
    views: MostViews = None,
    mode: ModeOption = None,
    candidates: CandidatesFile = None,
    scans: ScanFiles = None,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    poses: Poses = None,
    origin: Origins = None,
    earlier: EarlierPlan = None,
    region: Region = None,
    keep_out: KeepOut = None,
    noise: NoiseOption = "none",
    polish_steps: PolishSteps = 100_000,
    time_budget: TimeBudget = None,
    overlap: OverlapShare = None,
    infer: Infer = False,
    scheduler: Scheduler = None,
    up: UpOption = "z",
    units: UnitsOption = "m",
) -> None:
    """Plan views of a scene, or the next station after scans: plan.json, coverage.json, report.html."""
    if scene is None and not scans:
        raise typer.BadParameter("give SCENE, or --scans SCAN one or more times, or both")
    if scene is None and method == "cover":
        raise typer.BadParameter("--method cover knows the scene: give SCENE, or leave the method out")
    if scene is not None and earlier is not None:
        raise typer.BadParameter("--plan is an earlier plan of next stations: leave SCENE out, or --plan")
    if scene is None and (site.without or site.options.start is not None):
        option = "--without" if site.without else "--start"
        raise typer.BadParameter(f"{option} is for plans of a known scene: give SCENE, or leave it out")
    if scheduler is not None and method != "cover":
        raise typer.BadParameter("--scheduler casts for planners that know the scene: add --method cover")
    if method != "cover" and (overlap is not None or time_budget is not None):
        option = "--time-budget" if overlap is None else "--overlap"
        raise typer.BadParameter(f"{option} is for plans of a known scene: add --method cover")
    box = None if region is None else parse_numbers(region, 6, "--region")
    boxes = tuple(parse_numbers(text, 6, "--keep-out") for text in keep_out or ())
    given = asked_scans(scans, intrinsics, depth_scale, poses, origin=origin, units="m" if scene else units)
    from nbv.commands.plan import PlanRequest, run_plan
    from nbv.commands.scans import run_next_stations

    request = PlanRequest(
        method=method,
        sensor=sensor,
        max_incidence_deg=max_incidence,
        max_range_m=max_range,
        min_density_per_m2=min_density,
        max_sd_m=max_sd,
        registration_sd_m=registration_sd,
        averaging_radius_m=averaging_radius,
        k=k,
        polish_steps=polish_steps,
        time_budget_s=time_budget,
        overlap=overlap,
        infer=infer,
        scheduler=scheduler,
        target=target,
        views=views,
        mode=mode,
        site=site.options,
        without=site.without,
        candidates=candidates,
        scans=given,
        plan=earlier,
        region=box,
        keep_out=boxes,
        noise=noise,
        up=up,
        units=units,
    )
    if scene is None:
        run_next_stations(shared, request)
    else:
        run_plan(shared, scene, request)


@with_shared
@with_site
def coverage(
    shared: Shared,
    site: AskedSite,
    scene: KnownScene = None,
    plan: PlanFile = None,
    scans: ScanFiles = None,
    register: RegisterFlag = False,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    poses: Poses = None,
    origin: Origins = None,
    sensor: SensorOption = "generic60",
    max_incidence: Incidence = 60.0,
    max_range: MaxRange = None,
    mode: ModeOption = None,
    inference: CompletionMode = "standard",
    up: UpOption = "z",
    units: UnitsOption = "m",
) -> None:
    """Report which surface was measured well enough: coverage.json, .csv, .ply and report.html."""
    if (plan is None) == (not scans):
        raise typer.BadParameter("give either --plan plan.json or --scans SCAN, one or more times")
    if scene is None and plan is not None:
        raise typer.BadParameter("a plan alone measures nothing: give SCENE too")
    if register and scene is not None:
        raise typer.BadParameter("--register places scans to each other, not to SCENE: leave one of them out")
    given = asked_scans(scans, intrinsics, depth_scale, poses, origin=origin, units="m" if scene else units)
    from nbv.commands.coverage import CoverageRequest, run_coverage
    from nbv.commands.scans import run_scan_coverage

    request = CoverageRequest(
        plan=plan,
        scans=given,
        register=register,
        sensor=sensor,
        max_incidence_deg=max_incidence,
        max_range_m=max_range,
        mode=mode,
        site=site.options,
        without=site.without,
        inference=inference,
        up=up,
        units=units,
    )
    if scene is None:
        run_scan_coverage(shared, request)
    else:
        run_coverage(shared, scene, request)
