# SPDX-License-Identifier: MIT
"""`unseen part`: a part's points or mesh as surfaces, and what these are to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from completion.export.step.kernel import kernel
from completion.export.step.pipeline import StepModel
from completion.flattening.flat import RegionKind
from completion.parts.backs.pipeline import PartBack, find_back
from completion.parts.closing import close_holes
from completion.parts.dimensions.dimension import PartDimensions
from completion.parts.dimensions.pipeline import dimensions_of
from completion.parts.dimensions.preferred import IMPOSED
from completion.parts.dimensions.table import dimension_records, value_text
from completion.parts.division.growing import reachable
from completion.parts.files import closing_record, status_counts, whole_record, write_part
from completion.parts.flat_part import FlatPart, flatten_part
from completion.parts.part import Part, kinds_text
from completion.parts.part_features import PartFeature, features_of, features_text
from completion.parts.pipeline import MACHINED, divide_part, relate_part
from completion.parts.profiles.pipeline import profiles_of
from completion.parts.profiles.profile import Profile
from completion.parts.step_export import outcome_lines, step_model
from completion.relations.relation import RelationStatus, StatedRelation, read_part_relations
from nbv.commands.options.shapes import PartOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import start_run
from nbv.run.wording import count
from scenes.checks import InputError
from scenes.io.point_files import PartFile, read_part_file


def run_part(shared: Shared, request: PartOptions) -> None:
    """Divide a part into surfaces, relate them, flatten its planes on request, and write files and report."""
    with start_run("part", shared, default="out/part", is_folder=True) as run:
        run.watch.enter("load")
        run.read(request.files)
        stated = tuple(relation for file in request.files[1:] for relation in read_part_relations(file))
        held = read_part_file(request.shape, request.units)
        run.warn(held.warnings)
        if "step" in request.exports:
            kernel()  # what is missing is said before the work
        run.will_call(reachable, 10)
        part = _model_file(held, request, stated, run)
        flat = _flatten_part(part, request, run) if request.flatten else None
        profiles = () if part.relations is None else profiles_of(part)
        closed = close_holes(part)
        doubts = [] if closed is None or not closed.n_closed else [closed.told]
        found = [text for text in part.warnings if text not in held.warnings]
        run.warn([*found, *(() if flat is None else flat.doubts), *doubts])
        run.watch.enter("dimensions")
        dimensions = dimensions_of(part, preferred=request.preferred != "off")
        run.warn(dimensions.doubts)
        features = features_of(part, dimensions, profiles)
        back = _find_back(part, held, request, run) if request.backs else None
        step = _as_step(part, features, back, request, run) if "step" in request.exports else None
        run.watch.enter("save")
        write_part(
            part,
            run.stage.folder,
            rows=held.rows,
            n_rows=held.n_rows,
            flat=flat,
            step=step,
            closed=closed,
            back=back,
            dimensions=dimensions,
            profiles=profiles,
            title=Path(request.shape).stem,
        )
        run.watch.enter("report")
        from nbv.report.part_report import part_page

        page = part_page(
            part,
            Path(request.shape).name,
            flat,
            back=back,
            dimensions=dimensions,
            profiles=profiles,
            features=features,
        )
        run.report(page, request.record())
        record = {} if step is None else {"step": step.record()}
        record |= {} if closed is None else {"closing": closing_record(closed)}
        record |= {} if back is None else {"backs": back.record()}
        lines = lines_of(part, flat) + lines_of_dimensions(dimensions, request.preferred)
        lines += [*profile_lines(profiles), f"features   {features_text(features)}"]
        lines += [] if back is None else [f"unseen     {back.told}"]
        lines += [] if step is None else list(outcome_lines(step))
        told = {**summary_of(part, flat), "dimensions": dimension_records(dimensions), **record}
        told["features"] = [one.record() for one in features]
        told["warnings"] = [*told["warnings"], *dimensions.doubts]
        run.finish({**request.record(), **record}, told, lines)


def _model_file(
    held: PartFile, request: PartOptions, stated: tuple[StatedRelation[int], ...], run: Any
) -> Part:
    """The part, with what is doubtful of the file among its warnings."""
    shape = held.points if held.mesh is None else held.mesh
    segmentation = divide_part(
        shape,
        None if request.ignores_labels else held.label,
        normals=held.normals,
        noise_m=request.noise_m,
        step_m=held.step_m,
        has_ripple=request.flatten,
        progress=run.progress,
        journal=run.journal(request.record()),
    )
    segmentation = segmentation.allow_for_rounding(held.points, held.step_m)
    wanted = None if request.relations == "off" else MACHINED
    imposes = request.preferred == "impose"
    if imposes and wanted is None:
        raise InputError("--preferred impose states relations: leave --relations off out")
    part = relate_part(
        shape,
        segmentation,
        relations=wanted,
        stated=stated,
        imposes_preferred=imposes,
        progress=run.progress,
    )
    return replace(part, warnings=(*held.warnings, *part.warnings))


def _flatten_part(part: Part, request: PartOptions, run: Any) -> FlatPart:
    """The part with its planes flattened."""
    run.watch.enter("flatten")
    try:
        return flatten_part(part, rng=run.shared.seed)
    except InputError as error:
        doubts = "".join(f"; {text}" for text in part.warnings)
        raise InputError(f"{Path(request.shape).name}: {error}{doubts}") from None


def _find_back(part: Part, held: PartFile, request: PartOptions, run: Any) -> PartBack:
    """The unseen sides of the part, as far as its symmetries imply them."""
    run.watch.enter("backs")
    return find_back(part, origins=held.origins, normals=held.normals, least=request.least)


def _as_step(
    part: Part, features: Sequence[PartFeature], back: PartBack | None, request: PartOptions, run: Any
) -> StepModel:
    """The part as STEP, with its features and unseen sides."""
    run.watch.enter("step")
    try:
        return step_model(part, Path(request.shape).stem, features, back)
    except InputError as error:
        raise InputError(f"{Path(request.shape).name}: {error}") from None


def summary_of(part: Part, flat: FlatPart | None = None) -> dict[str, Any]:
    """Return the headline numbers."""
    kinds = [fit.surface.kind for fit in part.fits]
    flattening = {} if flat is None else {"flattening": whole_record(flat)}
    doubts = () if flat is None else flat.doubts
    return {
        "points": len(part.points),
        "triangles": None if part.faces is None else len(part.faces),
        "surfaces": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "without_surface": int((part.surface == 0).sum()),
        "noise_m": part.noise_m,
        "relations": None if part.relations is None else status_counts(part),
        "free": None if part.relations is None else part.relations.free,
        **flattening,
        "warnings": [*part.warnings, *doubts],
    }


def lines_of(part: Part, flat: FlatPart | None = None) -> list[str]:
    """Return the headline numbers for people."""
    what = "vertices" if part.faces is not None else "points"
    share = float((part.surface > 0).mean())
    lines = [
        f"surfaces   {kinds_text(part.fits)}, with {100 * share:.1f} % of {len(part.points)} {what}",
        f"noise      {1000 * part.noise_m:.3g} mm, points {1000 * part.spacing_m:.3g} mm apart",
    ]
    lines += [] if flat is None else _lines_of_flattening(flat, what)
    graph = part.relations
    if graph is None:
        return lines
    holding = sum(relation.holds for relation in graph.relations)
    counts = {
        status: part.count_relations(status) for status in (RelationStatus.REJECTED, RelationStatus.UNDECIDED)
    }
    others = f"{counts[RelationStatus.REJECTED]} rejected, {counts[RelationStatus.UNDECIDED]} undecided"
    lines.append(f"relations  {count(holding, 'holds', 'hold')}; {others}")
    lines.append(f"free       {graph.free} of {graph.unknowns} surface parameters, after the relations")
    return lines


def lines_of_dimensions(dimensions: PartDimensions, preferred: str) -> list[str]:
    """Return overall sizes, how many dimensions there are and how many mean preferred values, for people."""
    rows = dimensions.rows
    overall = " x ".join(value_text(row, has_interval=False) for row in dimensions.of_kind("overall size"))
    lines = [f"size       {overall or 'unknown'}; {count(len(rows), 'dimension')} in dimensions.csv"]
    lines += [f"{row.kind:11}{value_text(row)}" for row in rows if row.kind == "volume"]
    lines += _lines_of_kinds(dimensions)
    probable = [row for row in rows if row.preferred is not None and row.preferred.probability >= IMPOSED]
    if preferred == "impose":
        imposed = sum(row.is_determined for row in probable)
        lines.append(f"preferred  {count(imposed, 'dimension')} imposed at preferred values")
    elif preferred == "tell" and probable:
        least = f"each with a probability of {100 * IMPOSED:g} % or more"
        lines.append(f"preferred  {count(len(probable), 'dimension')} at preferred values, {least}")
    return lines


def _lines_of_kinds(dimensions: PartDimensions) -> list[str]:
    """How many dimensions of which kind there are, and the least certain length."""
    kinds = [row.kind for row in dimensions.rows if row.kind not in ("overall size", "volume", "area")]
    if not kinds:
        return []
    words = {kind: _plural(kind) for kind in dict.fromkeys(kinds)}
    text = ", ".join(count(kinds.count(kind), kind, many) for kind, many in words.items())
    lengths = [row for row in dimensions.rows if row.unit == "m" and row.kind in kinds]
    least = max(lengths, key=lambda row: row.high - row.low, default=None)
    doubt = "" if least is None else f"; least certain: {least.kind} {value_text(least)}"
    return [f"dimensions {text}{doubt}"]


def _plural(kind: str) -> str:
    """Several dimensions of a kind: fillet radii, thicknesses, distances axis to plane."""
    if " to " in kind:
        return f"distances {kind}"
    changed = kind.replace("radius", "radii").replace("thickness", "thicknesses")
    return changed if changed != kind else f"{kind}s"


_PLURAL = {"boss": "bosses", "outer": "outer", "turned": "turned", "open": "open"}


def profile_lines(profiles: Sequence[Profile]) -> list[str]:
    """What is swept, a line each."""
    lines = []
    for number, profile in enumerate(profiles):
        kinds = [("through " if loop.is_through else "") + loop.kind for loop in profile.loops]
        what = ", ".join(
            count(kinds.count(kind), kind, _PLURAL.get(kind, f"{kind}s")) for kind in dict.fromkeys(kinds)
        )
        alike = f", {profile.alike} alike" if profile.alike > 1 else ""
        n = sum(1 for _ in profile.relations())
        text = f"{profile.sweep.kind}: {what}{alike}; {count(n, 'relation')}"
        lines.append(f"{'profiles' if number == 0 else '':10} {text}")
    return lines


def _lines_of_flattening(flat: FlatPart, what: str) -> list[str]:
    """What flattening did."""
    done = [surface for surface in flat.surfaces if surface.is_flattened]
    kept = sum(region.kind is RegionKind.RELIEF for surface in done for region in surface.regions)
    n = np.array([surface.n - surface.n_relief for surface in done])
    square = np.array([(surface.ripple_before_m, surface.ripple_after_m) for surface in done]) ** 2
    before, after = 1000 * np.sqrt(n @ square / max(int(n.sum()), 1))
    return [
        f"flattened  {count(len(done), 'plane')}: ripple {before:.2f} -> {after:.2f} mm rms, "
        f"{count(kept, 'area')} of relief kept",
        f"           {flat.n_turned} triangles turned over, {flat.n_crossing} cross others anew; "
        f"{flat.n_held} {what} held back for that",
    ]
