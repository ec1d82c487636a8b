# SPDX-License-Identifier: MIT
"""`unseen fit`: a surface or a patch through points, with its uncertainty, as JSON on stdout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import typer

from completion.export.step.kernel import kernel, patch_step
from completion.fitting.patches.joins import PatchRequest, read_boundaries
from completion.fitting.patches.pipeline import PatchFit, fit_patch
from completion.fitting.pipeline import fit
from completion.fitting.result import FitError, Metric, Shape, SurfaceFit, inflated, surface_parameters
from completion.fitting.selection import Selection, select
from nbv.commands.process.run import Shared, running
from scenes.checks import InputError
from scenes.io.format import Units
from scenes.io.point_files import PointCloud, read_points
from scenes.run.atomic import json_text, write_bytes, write_json

_PLACES = 9  # along u and along v, at which a patch's deviation is told


def run_fit(
    shared: Shared,
    points: str,
    *,
    shape: Shape,
    metric: Metric,
    robust: bool,
    rays: bool,
    origin: tuple[float, ...] | None,
    given: dict[str, Any],
    units: Units,
) -> None:
    """Fit `shape` to the points of a file and print it as JSON; with an output file also there.

    `given` holds `radius` and `axis`, None where they are not given.
    """
    default = Path(f"{Path(points.partition('#')[0]).name or 'points'}.fit.json")
    with running("fit", shared, default=str(default), is_folder=False, writes=shared.out is not None) as run:
        run.watch.enter("load")
        if shared.out is not None:
            run.read([points])
        cloud = read_points(points, units)
        along = cloud.rays(origin) if rays or origin is not None else None
        run.watch.enter("fit")
        options = {
            "shape": shape, "metric": metric, "robust": robust, "rays": along is not None, "origin": origin,
            "units": units, **given,
        }  # fmt: skip
        try:
            is_auto = shape == "auto" and not any(value is not None for value in given.values())
            selection = select(cloud.points, robust=robust) if is_auto else None
            chosen = shape if selection is None else selection.decided()
            start = None if selection is None else selection.fits[chosen].surface
            fitted = fit(cloud.points, chosen, metric=metric, robust=robust, start=start, rays=along, **given)
            held = fit_record(fitted, cloud, options, selection)
        except FitError as error:
            raise FitError(f"{points}: {error}") from error
        if shared.out is not None:
            write_json(run.path(), held)
            run.keep(options)
        if shared.as_json or not shared.quiet:
            typer.echo(json_text(held).rstrip())


def fit_record(
    fitted: SurfaceFit, cloud: PointCloud, options: dict[str, Any], selection: Selection | None = None
) -> dict[str, Any]:
    """Return a fit ready for JSON: first what scripts rely on, in this order, then more.

    Lengths in metres; deviations of directions in radians, what ends in `_deg` in degrees. The deviations
    hold for independent residuals; `standard_deviation_correlated` allows for neighbours that err alike.
    `evidence` says how many times more probable the chosen shape is than each other, null where the shape
    was asked for. `held` names what was given and held exactly; its deviation is 0.
    """
    correlated = inflated(fitted, cloud.points)
    return {
        "shape": fitted.surface.kind,
        "parameters": fitted.parameters(),
        "standard_deviation": fitted.parameter_deviations(),
        "rms": fitted.rms,
        "n": fitted.n,
        "standard_deviation_correlated": correlated.parameter_deviations(),
        "inflation": correlated.inflation,
        "n_points": len(cloud.points),
        "converged": fitted.converged,
        "held": list(fitted.held),
        "evidence": None if selection is None else selection.evidence,
        "not_fitted": {} if selection is None else selection.failures,
        "options": options,
        "warnings": list(cloud.warnings),
    }


def run_patch_fit(
    shared: Shared, points: str, *, between: Path, exports: tuple[str, ...] = (), units: Units = "m"
) -> None:
    """Fit a patch between the surfaces of a file, and print it as JSON; with an output file also there.

    STEP is written beside the output file.
    """
    default = Path(f"{Path(points.partition('#')[0]).name or 'points'}.fit.json")
    with running("fit", shared, default=str(default), is_folder=False, writes=shared.out is not None) as run:
        run.watch.enter("load")
        if "step" in exports:
            if shared.out is None:
                raise InputError("--export step writes its file beside the output file: give -o FILE")
            kernel()  # what is missing is said before the work
        asked = read_boundaries(between)
        if shared.out is not None:
            run.read([points, str(between), *(str(file) for file in asked.files)])
        cloud = read_points(points, units)
        run.watch.enter("fit")
        try:
            found = fit_patch(cloud.points, asked.boundaries, controls=asked.controls, free=asked.free)
        except InputError as error:
            raise FitError(f"{points} between {between}: {error}") from error
        options = {"shape": "patch", "between": between.name, "export": list(exports), "units": units}
        held = patch_record(found, cloud, asked, options)
        run.warn(held["warnings"])
        if shared.out is not None:
            run.watch.enter("save")
            write_json(run.path(), held)
            if "step" in exports:
                write_bytes(run.path(f"{run.out.stem}.step"), patch_step(found.patch, run.out.stem))
            run.keep(options)
        if shared.as_json or not shared.quiet:
            typer.echo(json_text(held).rstrip())


def patch_record(
    found: PatchFit, cloud: PointCloud, asked: PatchRequest, options: dict[str, Any]
) -> dict[str, Any]:
    """Return a patch ready for JSON: the spline, how well points and boundaries are met, how sure it is.

    Lengths in metres, angles in radians; `angle` is null along a boundary that is connected alone.
    `deviation` is by u, then by v.
    """
    places = np.linspace(0.0, 1.0, _PLACES)
    grid = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1)
    deviation = found.deviation(grid.reshape(-1, 2)).reshape(_PLACES, _PLACES)
    knots_u, knots_v = found.patch.knots
    boundaries = {
        side: {
            "join": str(one.join),
            "surface": {"shape": one.surface.kind, "parameters": surface_parameters(one.surface)},
            "angle": None if np.isnan(found.joins[side].angle) else found.joins[side].angle,
            "gap": found.joins[side].gap,
        }
        for side, one in found.boundaries.items()
    }
    return {
        "shape": "patch",
        "controls": found.patch.controls.tolist(),
        "knots": {"u": knots_u.tolist(), "v": knots_v.tolist()},
        "degree": list(found.patch.degree),
        "rms": found.rms,
        "n": found.n,
        "unconstrained_rms": found.unconstrained_rms,
        "ratio": found.ratio,
        "boundaries": boundaries,
        "deviation": {
            "median": float(np.median(deviation)), "largest": float(deviation.max()),
            "u": places.tolist(), "v": places.tolist(), "at": deviation.tolist(),
        },
        "free": asked.free,
        "n_points": len(cloud.points),
        "options": options,
        "warnings": [*cloud.warnings, *found.warnings],
    }  # fmt: skip
