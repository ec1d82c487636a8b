# SPDX-License-Identifier: MIT
"""Command line: `unseen` and its commands; a thin edge that imports nothing slow before a command runs."""

from __future__ import annotations

import os
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from nbv.commands.options.options import (
    AsJson,
    DepthScale,
    Intrinsics,
    NoiseOption,
    Origins,
    Poses,
    Quiet,
    RegisterFlag,
    ScanUpOption,
    SceneArgument,
    Scheduler,
    SensorOption,
    Threads,
    UnitsOption,
    UpOption,
    asked_scans,
    parse_choices,
    parse_numbers,
    parse_shape,
    with_shared,
)
from nbv.commands.options.shapes_cli import feature, fit, part
from nbv.commands.options.views_cli import coverage, plan
from nbv.commands.process.run import Shared

_KINDS = ("walls", "floors", "ceilings", "pipes", "planes", "cylinders")
_JOBS = """Scan what can be scanned, infer what cannot, and say which is which.

  plan      how many views does a scene need, where, and what do they miss?
            unseen plan builtin:two_occluders -o out/plan
  complete  what is behind the chair? surfaces continued, textured, marked as inferred
            unseen complete scan.e57 -o out/completed
  coverage  which surface did these stations measure well enough, and why not the rest?
            unseen coverage room.glb --plan out/plan/plan.json -o out/coverage

All of it at once: unseen demo -o out/demo      All commands: unseen --help
Many of them, overnight: unseen study STUDY.toml    Tab completion: unseen --install-completion"""


class _Commands(TyperGroup):
    """Commands with flags that are False when not given; to read None as a flag typer loads pydantic."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for option in self.get_params(ctx):
            if getattr(option, "is_flag", False) and option.default is None:
                option.default = False
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="unseen",
    cls=_Commands,
    help="Scan what can be scanned, infer what cannot, and say which is which.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _jobs(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(_JOBS)


@app.command(short_help="All of it on a built-in room: plan, scan, complete, report.")
@with_shared
def demo(shared: Shared) -> None:
    """Plan, scan, complete, texture and report on a built-in room with two occluders."""
    from nbv.commands.demo import run_demo

    run_demo(shared)


@app.command(short_help="One simulated scan of a scene.")
@with_shared
def scan(
    shared: Shared,
    scene: SceneArgument,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="X,Y,Z", help="Where the sensor stands, metres.", show_default=False),
    ] = None,
    look: Annotated[
        str | None,
        typer.Option("--look", metavar="X,Y,Z", help="The point it looks at, metres.", show_default=False),
    ] = None,
    poses: Annotated[
        str | None,
        typer.Option(
            "--poses",
            metavar="FILE[#k]",
            help="Instead: plan.json or a trajectory; several go to .e57 or a folder.",
            show_default=False,
        ),
    ] = None,
    sensor: SensorOption = "generic60",
    noise: NoiseOption = "none",
    no_truth: Annotated[bool, typer.Option("--no-truth", help="Leave out what was really met.")] = False,
    up: UpOption = "z",
    units: UnitsOption = "m",
) -> None:
    """Take a simulated scan of a scene, or one a pose: -o FILE.npz, .ply, .pcd, .ptx, .e57, .las, .xyz ..."""
    if poses is None and (at is None or look is None):
        raise typer.BadParameter("give --at X,Y,Z and --look X,Y,Z, or --poses FILE")
    if poses is not None and (at is not None or look is not None):
        raise typer.BadParameter("--poses tells all there is to know: leave out --at and --look")
    eye = None if at is None else parse_numbers(at, 3, "--at")
    target = None if look is None else parse_numbers(look, 3, "--look")
    from nbv.commands.scan import Stand, run_scan

    stand = Stand(eye, target, poses)
    run_scan(shared, scene, stand, sensor, noise, truth=not no_truth, up=up, units=units)


app.command(short_help="Where to scan from, and how much that measures.")(plan)
app.command(short_help="Which surface was measured well enough, and why not.")(coverage)


@app.command(short_help="Scenes x sensors x requirements x planners x seeds.")
@with_shared
def study(
    shared: Shared,
    file: Annotated[str, typer.Argument(metavar="STUDY.toml", help="What to plan.")],
    scheduler: Scheduler = None,
) -> None:
    """Plan scenes x sensors x requirements x planners x seeds; run it again to go on where it stopped."""
    from nbv.commands.study import run_study_file

    run_study_file(shared, file, scheduler)


@app.command(short_help="Continue surfaces behind their occluders.")
@with_shared
def complete(
    shared: Shared,
    scans: Annotated[list[str], typer.Argument(metavar="SCAN...", help="Files or RGB-D folders; PATH#k.")],
    mode: Annotated[
        Literal["conservative", "standard", "bold"], typer.Option("--mode", help="How far to continue.")
    ] = "standard",
    sigma: Annotated[
        float | None,
        typer.Option("--sigma", metavar="M", min=0, help="Range noise.", show_default="from the scans"),
    ] = None,
    projector: Annotated[
        float | None,
        typer.Option(
            "--projector",
            metavar="M",
            min=-1.0,
            max=1.0,
            help="A Kinect's projector, right of the camera (left: negative); 0: none.",
            show_default="from the scans",
        ),
    ] = None,
    max_sd: Annotated[
        float, typer.Option("--max-sd", metavar="M", min=0, help="Continue only where known to this.")
    ] = 0.02,
    flatness: Annotated[
        float | None,
        typer.Option(
            "--flatness",
            metavar="M",
            min=0,
            help="How uneven real surfaces are.",
            show_default="from the scans",
        ),
    ] = None,
    min_area: Annotated[
        float, typer.Option("--min-area", metavar="M2", min=0, help="Leave smaller surfaces as measured.")
    ] = 0.0,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="KINDS",
            help="Continue these only: walls, floors, ceilings, pipes, planes, cylinders.",
            show_default="all",
        ),
    ] = None,
    registration: Annotated[
        float, typer.Option("--registration", metavar="M", min=0, help="Error of poses, where scans hide it.")
    ] = 0.005,
    keep_poses: Annotated[
        bool, typer.Option("--keep-poses", help="Move no scan, though its pose contradicts the others.")
    ] = False,
    register: RegisterFlag = False,
    resolution: Annotated[
        float | None,
        typer.Option(
            "--resolution", metavar="M", min=1e-4, max=1.0, help="Side of a cell.", show_default="the pixels'"
        ),
    ] = None,
    origin: Origins = None,
    edits: Annotated[
        str | None,
        typer.Option(
            "--edits", metavar="FILE", help="Your say: completion.json with edits.", show_default=False
        ),
    ] = None,
    relations: Annotated[
        str,
        typer.Option(
            "--relations",
            metavar="auto|off|FILE",
            help="Square, parallel, in one plane: inferred; off; or with what a file states and forbids.",
        ),
    ] = "auto",
    features: Annotated[
        str,
        typer.Option(
            "--features",
            metavar="auto|off|FILE",
            help="Doorways and windows fitted whole; off; or what a features.json found, rows of holes too.",
        ),
    ] = "auto",
    flatten: Annotated[
        bool, typer.Option("--flatten", help="Take the ripple from measured planes, leave their relief.")
    ] = False,
    texture: Annotated[
        Literal["exact", "budget"] | None,
        typer.Option("--texture", help="Search exactly, or quickly.", show_default="by how much is hidden"),
    ] = None,
    no_texture: Annotated[bool, typer.Option("--no-texture", help="Leave inferred area plain.")] = False,
    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            metavar="obj|e57|dxf|svg|ifc",
            help="Also completed.obj, .e57, drawings as .dxf, .svg, BIM as .ifc; repeat it.",
            show_default=False,
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            "--tolerance", metavar="M", min=1e-6, max=100.0, help="Half an interval that may be relied on."
        ),
    ] = 0.01,
    observed: Annotated[
        Literal["auto", "full"],
        typer.Option("--observed", help="observed.ply: ten million points at most, or all."),
    ] = "auto",
    scheduler: Scheduler = None,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    poses: Poses = None,
    units: UnitsOption = "m",
    up: ScanUpOption = "auto",
) -> None:
    """Continue surfaces behind occluders: completed.glb, .ply files, decisions.csv, report.html."""
    request = asked_scans(scans, intrinsics, depth_scale, poses, origin=origin, units=units, up=up)
    wanted = parse_choices(export or (), ("obj", "e57", "dxf", "svg", "ifc"), "--export")
    named = [kind.strip() for some in only or () for kind in some.split(",")]
    kinds = parse_choices(named, _KINDS, "--only")
    if texture is not None and no_texture:
        raise typer.BadParameter("give --texture or --no-texture, not both")
    if register and scheduler is not None:
        raise typer.BadParameter(
            "--register works in one process: run `unseen register` first, then complete its posed/"
        )
    from nbv.commands.complete import CompleteRequest, run_complete

    how = CompleteRequest(
        mode=mode,
        sigma_m=sigma,
        projector_m=projector,
        max_sd_m=max_sd,
        flatness_m=flatness,
        min_area_m2=min_area,
        only=kinds,
        registration_m=registration,
        moves_scans=not keep_poses,
        register=register,
        texture=not no_texture,
        edits=edits,
        relations=relations,
        features=features,
        flatten=flatten,
        exports=wanted,
        tolerance_m=tolerance,
        observed=observed,
        search=texture or "auto",
        cell_m=resolution,
        scheduler=scheduler,
    )
    run_complete(shared, request, how)


@app.command(short_help="Fill a hole in an image, or grow a texture.")
@with_shared
def texture(
    shared: Shared,
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
) -> None:
    """Fill a hole in an image, or grow a texture from it, by Efros-Leung sampling."""
    if (mask is None) == (grow is None):
        raise typer.BadParameter("give either --mask MASK or --grow HxW")
    if surface and mask is None:
        raise typer.BadParameter("--surface fills a hole: give --mask MASK")
    shape = None if grow is None else parse_shape(grow, "--grow")
    from nbv.commands.texture import run_texture

    run_texture(shared, image, mask=mask, shape=shape, window=window, order=order, is_surface=surface)


app.command(short_help="Fit a surface to points, with its uncertainty.")(fit)
app.command(short_help="A part as surfaces, and what these are to each other.")(part)
app.command(short_help="Doorways, rows of holes, junctions, stairs: found whole.")(feature)


@app.command(short_help="Poses of scans from any start.")
@with_shared
def register(
    shared: Shared,
    scans: Annotated[list[str], typer.Argument(metavar="SCAN...", help="Files or RGB-D folders; PATH#k.")],
    upright: Annotated[
        bool, typer.Option("--upright", help="The scanner stood level: only turns about the vertical.")
    ] = False,
    start: Annotated[
        str | None,
        typer.Option("--start", metavar="FILE", help="Poses to try as well, one a scan.", show_default=False),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Compute no pose: say what beams contradict of those given.")
    ] = False,
    level: Annotated[
        float, typer.Option("--level", metavar="P", help="Accepted probability of a false claim.")
    ] = 0.01,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    units: UnitsOption = "m",
    up: UpOption = "z",
) -> None:
    """Find the poses of scans to each other: registration.json, posed/, report.html.

    A pose is claimed where no other one comes near; else the report shows all that are possible.
    """
    from nbv.commands.register import RegisterRequest, run_register

    request = asked_scans(scans, intrinsics, depth_scale, start, origin=None, units=units, up=up)
    how = RegisterRequest(upright=upright, checks=check, level=level)
    run_register(shared, request, how)


@app.command(short_help="What a scene, a scan or another file holds.")
@with_shared
def info(
    shared: Shared,
    file: Annotated[str, typer.Argument(metavar="FILE", help="Any file, or an output folder.")],
    up: UpOption = "z",
    units: UnitsOption = "m",
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
) -> None:
    """Tell what a file or an output folder holds, with warnings; -o FILE.json keeps it."""
    camera = None if intrinsics is None else parse_numbers(intrinsics, 4, "--intrinsics")
    from nbv.commands.info import run_info

    run_info(shared, file, up=up, units=units, intrinsics=camera, depth_scale=depth_scale)


@app.command(short_help="Compile all inner loops now, as for a container image.")
def warm(as_json: AsJson = False, quiet: Quiet = False, threads: Threads = None) -> None:
    """Compile all inner loops and store them, so that no later command has to; see NUMBA_CACHE_DIR."""
    from nbv.commands.warm import run_warm

    run_warm(Shared(as_json=as_json, quiet=quiet, threads=threads))


def main() -> None:
    """Run `unseen`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads are ours; each of its own reserves memory
    app()


if __name__ == "__main__":
    main()
