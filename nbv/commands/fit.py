# SPDX-License-Identifier: MIT
"""`unseen fit`: a surface through points, with the uncertainty of its parameters, as JSON on stdout."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError, Metric, Shape, SurfaceFit, inflated
from completion.fitting.selection import Selection, select
from nbv.commands.process.run import Shared, running
from scenes.files.point_files import PointCloud, read_points
from scenes.files.scan_files import Units
from scenes.run.atomic import json_text, write_json


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
