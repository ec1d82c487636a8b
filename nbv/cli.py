# SPDX-License-Identifier: MIT
"""Command line: `unseen` and its commands; a thin edge that imports nothing slow before a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from nbv.commands.arguments import parse_bytes, parse_numbers, parse_shape
from nbv.commands.options import (
    AsJson,
    AveragingRadius,
    CandidatesFile,
    DepthScale,
    Incidence,
    Intrinsics,
    KViews,
    MaxMemory,
    MaxRange,
    MaxSd,
    Method,
    MinDensity,
    ModeOption,
    MostViews,
    NoiseOption,
    Out,
    OverlapShare,
    PlanFile,
    PolishSteps,
    Poses,
    Quiet,
    RegistrationSd,
    ScanFiles,
    SceneArgument,
    Seed,
    SensorOption,
    Target,
    Threads,
    TimeBudget,
    UnitsOption,
    UpOption,
)
from nbv.commands.run import Shared

_JOBS = """Scan what can be scanned, infer what cannot, and say which is which.

  study     how many views does a scene need, where, and what do they miss?
            unseen plan builtin:two_occluders -o out/plan
  complete  what is behind the chair? surfaces continued, textured, marked as inferred
            unseen complete scan.e57 -o out/completed
  coverage  which surface did these stations measure well enough, and why not the rest?
            unseen coverage room.glb --plan out/plan/plan.json -o out/coverage

All of it at once: unseen demo -o out/demo      All commands: unseen --help"""

app = typer.Typer(
    name="unseen",
    help="Scan what can be scanned, infer what cannot, and say which is which.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _shared(
    out: Path | None, seed: int, as_json: bool, quiet: bool, threads: int | None, max_memory: str | None
) -> Shared:
    return Shared(
        out=out,
        seed=seed,
        as_json=as_json,
        quiet=quiet,
        threads=threads,
        max_memory=None if max_memory is None else parse_bytes(max_memory, "--max-memory"),
    )


@app.callback(invoke_without_command=True)
def _jobs(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(_JOBS)


@app.command()
def demo(
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Plan, scan, complete, texture and report on a built-in room with two occluders."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    from nbv.demo import run_demo

    run_demo(shared)


@app.command()
def scan(
    scene: SceneArgument,
    at: Annotated[str, typer.Option("--at", metavar="X,Y,Z", help="Where the sensor stands, metres.")],
    look: Annotated[str, typer.Option("--look", metavar="X,Y,Z", help="The point it looks at, metres.")],
    sensor: SensorOption = "generic60",
    noise: NoiseOption = "none",
    no_truth: Annotated[bool, typer.Option("--no-truth", help="Leave out what was really met.")] = False,
    up: UpOption = "z",
    units: UnitsOption = "m",
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Take one simulated scan of a scene: -o FILE.npz, .ply, .pcd, .ptx or .e57."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    eye, target = parse_numbers(at, 3, "--at"), parse_numbers(look, 3, "--look")
    from nbv.commands.scan import run_scan

    run_scan(
        shared,
        scene,
        eye=eye,
        target=target,
        sensor=sensor,
        noise=noise,
        truth=not no_truth,
        up=up,
        units=units,
    )


@app.command()
def plan(
    scene: SceneArgument,
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
    noise: NoiseOption = "none",
    polish_steps: PolishSteps = 100_000,
    time_budget: TimeBudget = None,
    overlap: OverlapShare = None,
    up: UpOption = "z",
    units: UnitsOption = "m",
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Plan views of a scene: plan.json, coverage.json, report.html; of cover also stations.json."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    from nbv.commands.plan import PlanRequest, run_plan

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
        target=target,
        views=views,
        mode=mode,
        candidates=candidates,
        scans=tuple(scans or ()),
        noise=noise,
        up=up,
        units=units,
    )
    run_plan(shared, scene, request)


@app.command()
def coverage(
    scene: SceneArgument,
    plan: PlanFile = None,
    scans: ScanFiles = None,
    sensor: SensorOption = "generic60",
    max_incidence: Incidence = 60.0,
    max_range: MaxRange = None,
    mode: ModeOption = None,
    up: UpOption = "z",
    units: UnitsOption = "m",
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Report which surface was measured well enough: coverage.json, .csv, .ply and report.html."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    if (plan is None) == (not scans):
        raise typer.BadParameter("give either --plan plan.json or --scans FILE, one or more times")
    from nbv.commands.coverage import CoverageRequest, run_coverage

    request = CoverageRequest(
        plan=plan,
        scans=tuple(scans or ()),
        sensor=sensor,
        max_incidence_deg=max_incidence,
        max_range_m=max_range,
        mode=mode,
        up=up,
        units=units,
    )
    run_coverage(shared, scene, request)


@app.command()
def complete(
    scans: Annotated[list[str], typer.Argument(metavar="SCAN...", help="Files or RGB-D folders; PATH#k.")],
    mode: Annotated[
        Literal["conservative", "standard", "bold"], typer.Option("--mode", help="How far to continue.")
    ] = "standard",
    sigma: Annotated[
        float | None,
        typer.Option("--sigma", metavar="M", min=0, help="Range noise.", show_default="from the scans"),
    ] = None,
    max_sd: Annotated[
        float, typer.Option("--max-sd", metavar="M", min=0, help="Continue only where known to this.")
    ] = 0.02,
    registration: Annotated[
        float, typer.Option("--registration", metavar="M", min=0, help="Error of several scans' poses.")
    ] = 0.005,
    origin: Annotated[
        list[str] | None,
        typer.Option(
            "--origin",
            metavar="X,Y,Z",
            help="Where the scanner stood, for files of mere points; repeat it for each.",
            show_default="from the files",
        ),
    ] = None,
    edits: Annotated[
        str | None,
        typer.Option(
            "--edits", metavar="FILE", help="Your say: completion.json with edits.", show_default=False
        ),
    ] = None,
    no_texture: Annotated[bool, typer.Option("--no-texture", help="Leave inferred area plain.")] = False,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    poses: Poses = None,
    units: UnitsOption = "m",
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Continue surfaces behind occluders: completed.glb, observed.ply, hypothesised.ply, report.html."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    camera = None if intrinsics is None else parse_numbers(intrinsics, 4, "--intrinsics")
    from nbv.commands.complete import CompleteRequest, run_complete
    from nbv.commands.scans import ScanRequest

    stood = tuple(parse_numbers(text, 3, "--origin") for text in origin or ())
    request = ScanRequest(tuple(scans), camera, depth_scale, poses, units, stood)
    how = CompleteRequest(
        mode=mode,
        sigma_m=sigma,
        max_sd_m=max_sd,
        registration_m=registration,
        texture=not no_texture,
        edits=edits,
    )
    run_complete(shared, request, how)


@app.command()
def texture(
    image: Annotated[str, typer.Argument(metavar="IMAGE", help="PNG, JPEG, WebP or TIFF.")],
    mask: Annotated[
        str | None,
        typer.Option("--mask", metavar="MASK", help="Fill where it is not zero.", show_default=False),
    ] = None,
    grow: Annotated[
        str | None,
        typer.Option("--grow", metavar="HxW", help="Grow a texture of this size.", show_default=False),
    ] = None,
    window: Annotated[
        int | None, typer.Option("--window", metavar="N", help="Odd, pixels.", show_default="from the sample")
    ] = None,
    order: Annotated[
        Literal["paper", "window"],
        typer.Option("--order", help="The paper's, or the one that keeps structure better."),
    ] = "paper",
    surface: Annotated[
        bool, typer.Option("--surface", help="With --mask: shading apart, plain areas as such.")
    ] = False,
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Fill a hole in an image, or grow a texture from it, by Efros-Leung sampling."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    if (mask is None) == (grow is None):
        raise typer.BadParameter("give either --mask MASK or --grow HxW")
    if surface and mask is None:
        raise typer.BadParameter("--surface fills a hole: give --mask MASK")
    shape = None if grow is None else parse_shape(grow, "--grow")
    from nbv.commands.texture import run_texture

    run_texture(shared, image, mask=mask, shape=shape, window=window, order=order, is_surface=surface)


@app.command()
def fit(
    points: Annotated[str, typer.Argument(metavar="POINTS", help="A file of points or scans; PATH#k.")],
    shape: Annotated[
        Literal["auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone"],
        typer.Option("--shape", help="What to fit; auto chooses by evidence."),
    ] = "auto",
    metric: Annotated[
        Literal["euclidean", "taubin", "algebraic"],
        typer.Option("--metric", help="What is least: distances, or a stand-in for them."),
    ] = "euclidean",
    robust: Annotated[
        bool, typer.Option("--robust", help="Many points may belong to something else.")
    ] = False,
    rays: Annotated[
        bool,
        typer.Option("--rays", help="Errors lie along the scanner's rays, as range noise does."),
    ] = False,
    origin: Annotated[
        str | None,
        typer.Option(
            "--origin",
            metavar="X,Y,Z",
            help="Where the scanner stood, for --rays.",
            show_default="from the file",
        ),
    ] = None,
    units: UnitsOption = "m",
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Fit a surface to points: JSON with parameters and their standard deviations on stdout, in metres."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    stood = None if origin is None else parse_numbers(origin, 3, "--origin")
    from nbv.commands.fit import run_fit

    run_fit(shared, points, shape=shape, metric=metric, robust=robust, rays=rays, origin=stood, units=units)


@app.command()
def info(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A scene, a scan, or an RGB-D folder.")],
    up: UpOption = "z",
    units: UnitsOption = "m",
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    out: Out = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    threads: Threads = None,
    max_memory: MaxMemory = None,
) -> None:
    """Tell what a scene or scan holds, with warnings; -o FILE.json keeps it."""
    shared = _shared(out, seed, as_json, quiet, threads, max_memory)
    camera = None if intrinsics is None else parse_numbers(intrinsics, 4, "--intrinsics")
    from nbv.commands.info import run_info

    run_info(shared, file, up=up, units=units, intrinsics=camera, depth_scale=depth_scale)


def main() -> None:
    """Run `unseen`."""
    app()


if __name__ == "__main__":
    main()
