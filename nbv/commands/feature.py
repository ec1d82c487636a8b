# SPDX-License-Identifier: MIT
"""`unseen feature`: objects found by what is known of them, in scans, points or a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.features.engine.options import OPENINGS, read_given
from completion.features.engine.template import Features, FeatureStatus, Measurements
from completion.features.openings.recess import log_likelihoods
from completion.features.pipeline import find_features, of_points
from nbv.commands.options.shapes import FeatureCommandOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from scenes.checks import FloatArray, InputError, IntArray
from scenes.inclination import Up
from scenes.io.meshes.mesh_file import is_mesh
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.point_files import read_part_file
from scenes.io.scan_request import ScanRequest, read_request
from scenes.run.atomic import write_json
from scenes.scan.colour import surface_bytes
from scenes.scan.range_image import RangeImage

_LEGEND = ("unseen: feature and face number what features.json lists, from 1; 0 for none",)


@dataclass(frozen=True, slots=True, eq=False)
class _Input:
    """What was read: scans, or points, perhaps a mesh's, with their places in the file."""

    points: FloatArray
    material: tuple[RangeImage, ...] | Measurements
    rows: IntArray | None = None
    n_rows: int = 0
    warnings: tuple[str, ...] = field(default=())
    up: tuple[float, ...] | None = None

    @property
    def scans(self) -> tuple[RangeImage, ...]:
        """The scans; none where it is points."""
        return () if isinstance(self.material, Measurements) else self.material

    @property
    def faces(self) -> IntArray | None:
        """The triangles of a mesh."""
        return self.material.faces if isinstance(self.material, Measurements) else None


def run_feature(shared: Shared, how: FeatureCommandOptions) -> None:
    """Find features and write features.json, features.ply and the report."""
    request = how.request()
    with start_run("feature", shared, default="out/feature", is_folder=True) as run:
        run.watch.enter("load")
        run.read([*request.inputs, *([how.given] if how.given else [])])
        given = {} if how.given is None else read_given(how.given, how.kinds)
        options = {**request.options(), **how.record()}
        held = _read(request, how.kinds)
        run.warn(held.warnings)
        if set(how.kinds) & set(OPENINGS):
            run.will_call(log_likelihoods, 20)
        features = find_features(
            held.material,
            how.kinds,
            given=given,
            evaluations=how.evaluations,
            up=held.up,
            rng=shared.seed,
            n_threads=shared.threads,
            progress=run.progress,
            journal=run.journal(options),
        )
        run.warn(features.doubts)
        _write(run, features, held, how)
        run.watch.enter("report")
        from nbv.report.feature_report import feature_page

        page = feature_page(
            features,
            " ".join(Path(text).name for text in request.inputs),
            how.kinds,
            points=held.points,
            scans=held.scans,
            warnings=held.warnings,
        )
        run.report(page, options)
        run.finish(options, summary_of(features), lines_of(features))


def _read(request: ScanRequest, kinds: Sequence[str]) -> _Input:
    """Scans where the files hold some, or places were told that points were measured from; else points."""
    paths, openings = request.paths, [kind for kind in kinds if kind in OPENINGS]
    has_mesh = len(paths) == 1 and is_mesh(paths[0])
    if has_mesh and openings and not request.origins:
        raise InputError(
            f"{paths[0]}: a {openings[0]} is found by the beams through it, and a mesh has no beams: give "
            "the position of a scanner (--origin X,Y,Z)"
        )
    if not has_mesh or request.origins:
        try:
            given = read_request(request)
        except InputError:
            if openings or len(paths) > 1 or request.origins:
                raise
        else:
            points = np.concatenate([scan.points()[scan.valid] for scan in given.scans])
            scans = tuple(given.scans)
            return _Input(points, scans, n_rows=len(points), warnings=tuple(given.doubts), up=_up(request))
    file = read_part_file(paths[0], request.units)
    faces = None if file.mesh is None else file.mesh.faces
    try:
        measured = of_points(file.points, faces=faces)
    except InputError as error:
        raise InputError(f"{paths[0]}: {error}") from None
    return _Input(
        file.points, measured, file.rows, n_rows=file.n_rows, warnings=file.warnings, up=_up(request)
    )


def _up(request: ScanRequest) -> tuple[float, ...] | None:
    """The direction that was said to be up; None where it is to be estimated."""
    up = Up.along(request.up)
    return None if up is None else tuple(up.direction.tolist())


def _write(run: Run, features: Features, held: _Input, how: FeatureCommandOptions) -> None:
    run.watch.enter("save")
    write_json(run.path("features.json"), {**features.record(), "asked": list(how.kinds)})
    feature, face = features.of_points()
    colour = surface_bytes(feature)
    record: dict[str, NDArray[Any]] = {
        "feature": _in_file_order(feature, held, 0),
        "face": _in_file_order(face, held, 0),
        "red": _in_file_order(colour[:, 0], held, 0),
        "green": _in_file_order(colour[:, 1], held, 0),
        "blue": _in_file_order(colour[:, 2], held, 0),
    }
    write_mesh_ply(
        run.path("features.ply"), _in_file_order(held.points, held, np.nan), held.faces, record, _LEGEND
    )


def _in_file_order(values: NDArray[Any], held: _Input, without: float) -> NDArray[Any]:
    """Values (n, ...) in the places of their points in the file, where some were left out."""
    if held.rows is None:
        return values
    out = np.full((held.n_rows, *values.shape[1:]), without, dtype=values.dtype)
    out[held.rows] = values
    return out


def summary_of(features: Features) -> dict[str, Any]:
    """Return the headline numbers."""
    numbers = {str(status): sum(fit.status is status for fit in features.fits) for status in FeatureStatus}
    return {
        **features.record(),
        "found": numbers["found"],
        "ambiguous": numbers["ambiguous"],
        "refused": numbers["none"],
    }


def lines_of(features: Features) -> list[str]:
    """Return a line for each feature: kind, size, sides seen, evidence; refused ones counted."""
    from nbv.report.feature_report import chance_of, size_of
    from nbv.run.plain_words import odds_text

    lines = []
    for number, fit in enumerate(features.fits, start=1):
        if fit.status is FeatureStatus.NONE:
            continue
        seen = sum(side.is_seen for side in fit.sides)
        doubt = f" ({fit.reason})" if fit.reason else ""
        sentence = f"{seen} of {len(fit.sides)} sides seen, {odds_text(fit.evidence)} times likelier with it"
        if np.isfinite(fit.false_fit_probability):
            sentence += f", false {chance_of(fit)}"
        lines.append(f"{number:3d} {fit.kind} {fit.status}: {size_of(fit)}; {sentence}{doubt}")
    refused = [fit for fit in features.fits if fit.status is FeatureStatus.NONE]
    if refused:
        lines.append(f"{len(refused)} proposed and refused, the best: {refused[0].kind}, {refused[0].reason}")
    if not features.is_complete:
        lines.append("the search was ended before it was done: these are the best so far")
    return lines
