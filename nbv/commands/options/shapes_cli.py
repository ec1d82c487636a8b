# SPDX-License-Identifier: MIT
"""`unseen fit`, `part` and `feature` on the command line: shapes; nothing slow is imported before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from nbv.commands.options.options import (
    DepthScale,
    Intrinsics,
    Origins,
    Poses,
    ScanUpOption,
    UnitsOption,
    asked_scans,
    parse_choices,
    parse_numbers,
    with_shared,
)
from nbv.commands.process.run import Shared

_FEATURES = (
    "doorway", "window", "niche", "hole-row", "hole-grid", "bolt-circle", "junction", "elbow", "column",
    "stairs",
)  # fmt: skip


@with_shared
def fit(
    shared: Shared,
    points: Annotated[str, typer.Argument(metavar="POINTS", help="A file of points or scans; PATH#k.")],
    shape: Annotated[
        Literal["auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone", "torus", "patch"],
        typer.Option("--shape", help="What to fit; auto chooses by evidence; a patch needs --between."),
    ] = "auto",
    metric: Annotated[
        Literal["euclidean", "taubin", "algebraic"],
        typer.Option("--metric", help="What is least: distances, or a stand-in for them."),
    ] = "euclidean",
    robust: Annotated[
        bool, typer.Option("--robust", help="Many points may belong to something else.")
    ] = False,
    rays: Annotated[
        bool, typer.Option("--rays", help="Errors lie along the scanner's rays, as range noise does.")
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
    radius: Annotated[
        float | None,
        typer.Option(
            "--radius",
            metavar="R",
            help="Given, in metres, and held: of a sphere, cylinder, or a torus' circle.",
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            "--axis", metavar="X,Y,Z", help="A direction, given and held: of the axis, or a plane's normal."
        ),
    ] = None,
    between: Annotated[
        Path | None,
        typer.Option(
            "--between",
            metavar="FILE",
            help="JSON: the planes and cylinders around a free-form patch, and how it joins each.",
            show_default=False,
        ),
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            metavar="step",
            help="Of a patch, with -o: also its B-spline face for CAD.",
            show_default=False,
        ),
    ] = None,
    units: UnitsOption = "m",
) -> None:
    """Fit a surface to points: JSON with parameters and their standard deviations on stdout, in metres.

    A patch is a free-form surface, connected, tangent or orthogonal to the surfaces of --between FILE.
    """
    together = typer.BadParameter("--shape patch and --between FILE belong together")
    exports = parse_choices(export or (), ("step",), "--export")
    if shape == "patch":
        if between is None:
            raise together
        if metric != "euclidean" or robust or rays or any(one is not None for one in (origin, radius, axis)):
            raise typer.BadParameter(
                "a patch knows no --metric, --robust, --rays, --origin, --radius, --axis"
            )
        from nbv.commands.fit import run_patch_fit

        run_patch_fit(shared, points, between=between, exports=exports, units=units)
        return
    if between is not None:
        raise together
    if exports:
        raise typer.BadParameter("--export is for --shape patch")
    stood = None if origin is None else parse_numbers(origin, 3, "--origin")
    given = {"radius": radius, "axis": None if axis is None else parse_numbers(axis, 3, "--axis")}
    from nbv.commands.fit import run_fit

    run_fit(
        shared, points, shape=shape, metric=metric, robust=robust, rays=rays, origin=stood, given=given,
        units=units,
    )  # fmt: skip


@with_shared
def part(
    shared: Shared,
    shape: Annotated[str, typer.Argument(metavar="POINTS|MESH", help="A file of points, or a mesh.")],
    relations: Annotated[
        str,
        typer.Option(
            "--relations",
            metavar="auto|off|FILE",
            help="Parallel, coaxial, of one radius: inferred; off; or with what a file states and forbids.",
        ),
    ] = "auto",
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise",
            metavar="M",
            min=0,
            help="Deviation of the points along the normal.",
            show_default="estimated",
        ),
    ] = None,
    ignore_labels: Annotated[
        bool, typer.Option("--ignore-labels", help="Divide the points anew, whatever labels the file holds.")
    ] = False,
    flatten: Annotated[
        bool, typer.Option("--flatten", help="Also flat.ply: ripple taken from planes, relief left.")
    ] = False,
    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export", metavar="step", help="Also part.step: trimmed faces for CAD.", show_default=False
        ),
    ] = None,
    units: UnitsOption = "m",
) -> None:
    """Divide a part into planes, spheres, cylinders, cones and tori: part.json, part.ply, report.html.

    What these are to each other (parallel, coaxial, of one radius) is inferred, tested and imposed:
    relations.json.
    """
    from nbv.commands.part import PartRequest, run_part

    request = PartRequest(
        shape=shape,
        relations=relations,
        noise_m=noise,
        ignores_labels=ignore_labels,
        flatten=flatten,
        exports=parse_choices(export or (), ("step",), "--export"),
        units=units,
    )
    run_part(shared, request)


@with_shared
def feature(
    shared: Shared,
    material: Annotated[
        list[str], typer.Argument(metavar="SCAN|POINTS|MESH...", help="Files or RGB-D folders; PATH#k.")
    ],
    find: Annotated[
        list[str],
        typer.Option(
            "--find",
            metavar="KIND",
            help="doorway, window, niche, hole-row, hole-grid, bolt-circle, junction, elbow, column, stairs.",
        ),
    ],
    given: Annotated[
        str | None,
        typer.Option(
            "--given",
            metavar="FILE",
            help='What is known, held exactly: {"hole-row": {"count": 6}}.',
            show_default=False,
        ),
    ] = None,
    evaluations: Annotated[
        int, typer.Option("--evaluations", metavar="N", min=1, help="Of each search at most.")
    ] = 200_000,
    origin: Origins = None,
    intrinsics: Intrinsics = None,
    depth_scale: DepthScale = None,
    poses: Poses = None,
    units: UnitsOption = "m",
    up: ScanUpOption = "auto",
) -> None:
    """Find objects by what is known of them: features.json, features.ply, report.html.

    Each is fitted whole from what fragments show of it, accepted or refused with the reason, and what nobody
    saw of it is said. An interrupt leaves the best so far.
    """
    from nbv.commands.feature import FeatureRequest, run_feature

    kinds = parse_choices(find, _FEATURES, "--find")
    request = asked_scans(material, intrinsics, depth_scale, poses, origin=origin, units=units, up=up)
    run_feature(shared, request, FeatureRequest(kinds=kinds, given=given, evaluations=evaluations))
