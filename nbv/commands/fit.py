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
from completion.fitting.result import FitError, SurfaceFit, inflated, surface_parameters
from completion.fitting.rounding import allow_for_rounding
from completion.fitting.selection import Selection, select
from completion.fitting.shape import Shape
from nbv.commands.options.shapes import FitOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import start_run
from scenes.checks import InputError
from scenes.io.point_files import PointCloud, read_points
from scenes.run.atomic import json_text, write_bytes, write_json

_PLACES = 9  # along u and along v, at which a patch's deviation is told


def run_fit(shared: Shared, asked: FitOptions) -> None:
    """Fit a surface or a patch to the points of a file, print it as JSON, and write it to an output file."""
    if asked.shape == "patch":
        _run_patch(shared, asked)
    else:
        _run_surface(shared, asked, asked.shape)


def _run_surface(shared: Shared, asked: FitOptions, shape: Shape) -> None:
    points, metric, robust, origin = asked.points, asked.metric, asked.robust, asked.origin
    given: dict[str, Any] = {"radius": asked.radius, "axis": asked.axis}
    default = Path(f"{Path(points.partition('#')[0]).name or 'points'}.fit.json")
    with start_run(
        "fit", shared, default=str(default), is_folder=False, writes=shared.out is not None
    ) as run:
        run.watch.enter("load")
        if shared.out is not None:
            run.read([points])
        cloud = read_points(points, asked.units)
        place = None if origin is None else np.array(origin) * cloud.metres_per_unit
        along = cloud.rays(place) if asked.rays or place is not None else None
        run.watch.enter("fit")
        options = {
            "shape": shape, "metric": metric, "robust": robust, "rays": along is not None, "origin": origin,
            "units": asked.units, **given,
        }  # fmt: skip
        try:
            is_auto = shape == "auto" and not any(value is not None for value in given.values())
            selection = select(cloud.points, robust=robust) if is_auto else None
            chosen = shape if selection is None else selection.decide()
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
    hold for independent residuals and coordinates in steps; `standard_deviation_correlated` allows for
    neighbours that err alike.
    `evidence` says how many times more probable the chosen shape is than each other, null where the shape
    was asked for. `held` names what was given and held exactly; its deviation is 0.
    """
    used = cloud.points if fitted.inliers is None else cloud.points[fitted.inliers]
    correlated = allow_for_rounding(inflated(fitted, cloud.points), used, cloud.step_m)
    fitted = allow_for_rounding(fitted, used, cloud.step_m)
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


def _run_patch(shared: Shared, asked: FitOptions) -> None:
    """Fit a patch between the surfaces of a file; STEP is written beside the output file."""
    points, exports = asked.points, asked.export
    between = asked.between or Path()
    default = Path(f"{Path(points.partition('#')[0]).name or 'points'}.fit.json")
    with start_run(
        "fit", shared, default=str(default), is_folder=False, writes=shared.out is not None
    ) as run:
        run.watch.enter("load")
        if "step" in exports:
            if shared.out is None:
                raise InputError("--export step writes its file beside the output file: give -o FILE")
            kernel()  # what is missing is said before the work
        bounds = read_boundaries(between)
        if shared.out is not None:
            run.read([points, str(between), *(str(file) for file in bounds.files)])
        cloud = read_points(points, asked.units)
        run.watch.enter("fit")
        try:
            fitted = fit_patch(cloud.points, bounds.boundaries, controls=bounds.controls, free=bounds.free)
        except InputError as error:
            raise FitError(f"{points} between {between}: {error}") from error
        options = {"shape": "patch", "between": between.name, "export": list(exports), "units": asked.units}
        held = patch_record(fitted, cloud, bounds, options)
        run.warn(held["warnings"])
        if shared.out is not None:
            run.watch.enter("save")
            write_json(run.path(), held)
            if "step" in exports:
                write_bytes(run.path(f"{run.out.stem}.step"), patch_step(fitted.patch, run.out.stem))
            run.keep(options)
        if shared.as_json or not shared.quiet:
            typer.echo(json_text(held).rstrip())


def patch_record(
    fitted: PatchFit, cloud: PointCloud, request: PatchRequest, options: dict[str, Any]
) -> dict[str, Any]:
    """Return a patch ready for JSON: the spline, how well points and boundaries are met, how sure it is.

    Lengths in metres, angles in radians; `angle` is null along a boundary that is connected alone.
    `deviation` is by u, then by v.
    """
    places = np.linspace(0.0, 1.0, _PLACES)
    grid = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1)
    deviation = fitted.deviation(grid.reshape(-1, 2)).reshape(_PLACES, _PLACES)
    knots_u, knots_v = fitted.patch.knots
    boundaries = {
        side: {
            "join": str(boundary.join),
            "surface": {"shape": boundary.surface.kind, "parameters": surface_parameters(boundary.surface)},
            "angle": None if np.isnan(fitted.joins[side].angle) else fitted.joins[side].angle,
            "gap": fitted.joins[side].gap,
        }
        for side, boundary in fitted.boundaries.items()
    }
    return {
        "shape": "patch",
        "controls": fitted.patch.controls.tolist(),
        "knots": {"u": knots_u.tolist(), "v": knots_v.tolist()},
        "degree": list(fitted.patch.degree),
        "rms": fitted.rms,
        "n": fitted.n,
        "unconstrained_rms": fitted.unconstrained_rms,
        "ratio": fitted.ratio,
        "boundaries": boundaries,
        "deviation": {
            "median": float(np.median(deviation)), "largest": float(deviation.max()),
            "u": places.tolist(), "v": places.tolist(), "at": deviation.tolist(),
        },
        "free": request.free,
        "n_points": len(cloud.points),
        "options": options,
        "warnings": [*cloud.warnings, *fitted.warnings],
    }  # fmt: skip
