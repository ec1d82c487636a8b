# SPDX-License-Identifier: MIT
"""`unseen fit`: a surface through points, with the uncertainty of its parameters, as JSON on stdout."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import typer

from completion.fitting import FitError, SurfaceFit, fit, inflated, select
from completion.selection import Selection
from nbv.commands.run import Shared, running
from scenes.atomic import json_text, write_json
from scenes.checks import FloatArray
from scenes.files import Units
from scenes.points import PointCloud, read_points

Shape = Literal["auto", "plane", "sphere", "cylinder", "elliptic-cylinder", "cone"]
Metric = Literal["euclidean", "taubin", "algebraic"]


def run_fit(shared: Shared, points: str, *, shape: Shape, metric: Metric, robust: bool, units: Units) -> None:
    """Fit `shape` to the points of a file and print it as JSON; with an output file also there."""
    default = Path(f"{Path(points.partition('#')[0]).name or 'points'}.fit.json")
    with running("fit", shared, default=str(default), is_folder=False) as run:
        run.watch.enter("load")
        cloud = read_points(points, units)
        run.watch.enter("fit")
        options = {"shape": shape, "metric": metric, "robust": robust, "units": units}
        try:
            selection = select(cloud.points, robust=robust) if shape == "auto" else None
            chosen = shape if selection is None else _decided(selection)
            if selection is not None and metric == "euclidean":
                fitted = selection.fits[chosen]
            else:
                fitted = fit(cloud.points, chosen, metric=metric, robust=robust)
            held = fit_record(fitted, cloud, options, selection)
        except FitError as error:
            raise FitError(f"{points}: {error}") from error
        if shared.out is not None:
            write_json(run.out, held)
            run.outputs.append(run.out)
            run.keep([points], options)
        if shared.as_json or not shared.quiet:
            typer.echo(json_text(held).rstrip())


def _decided(selection: Selection) -> Shape:
    """The shape that the evidence is for; raises FitError, with the ratios, where it is for none."""
    if selection.shape is None:
        raise FitError(f"{selection.summary()}; name the shape with --shape")
    return cast("Shape", selection.shape)


def fit_record(
    fitted: SurfaceFit, cloud: PointCloud, options: dict[str, Any], selection: Selection | None = None
) -> dict[str, Any]:
    """Return a fit ready for JSON: first what scripts rely on, in this order, then more.

    Lengths in metres; deviations of directions in radians, what ends in `_deg` in degrees. The deviations
    hold for independent residuals; `standard_deviation_correlated` allows for neighbours that err alike.
    `evidence` says how many times more probable the chosen shape is than each other, null where the shape
    was asked for.
    """
    used = cloud.points if fitted.inliers is None else cloud.points[fitted.inliers]
    correlated = _correlated(fitted, used)
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
        "evidence": None if selection is None else selection.evidence,
        "not_fitted": {} if selection is None else selection.failures,
        "options": options,
        "warnings": list(cloud.warnings),
    }


def _correlated(fitted: SurfaceFit, points: FloatArray) -> SurfaceFit:
    """The fit inflated for residuals that are alike in blocks of about sqrt(n) points."""
    extent = np.ptp(fitted.surface.to_uv(points), axis=0)
    block = float(np.sqrt(extent[0] * extent[1] / np.sqrt(len(points))))
    return inflated(fitted, points, block) if block > 0 else fitted
