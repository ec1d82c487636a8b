# SPDX-License-Identifier: MIT
"""`unseen complete`: completion of one scan, or of several registered ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np

from completion.backs.options import BackOptions
from completion.edits.file import read_edits
from completion.export.building.limits import LEAST_EXISTENCE, LEAST_MEASURED
from completion.export.decisions import DecisionSheet
from completion.features.engine.options import FITTED, FeatureOptions
from completion.features.stated import read_features
from completion.flattening.flat import FlatteningOptions
from completion.observe.tiles import solve_plane
from completion.observe.tolerance import EvidenceOptions
from completion.observe.user_options import UserOptions
from completion.options import CompletionOptions
from completion.pipeline import complete, verify_first
from completion.registration.facets import count_agreement
from completion.relations.options import BUILT
from completion.relations.relation import RelationStatus, read_scan_relations
from completion.result.completion import Completion, write_model
from completion.result.flat_scans import whole_flattening
from completion.result.labelled_points import mesh_area
from completion.result.record import completion_record
from completion.result.verification import Finding, Verification
from completion.segmentation.regions import SegmentationOptions
from completion.texturing.pipeline import TexturingOptions
from nbv.commands.options.scans import CompleteOptions
from nbv.commands.options.shared import Shared
from nbv.commands.process import Run, start_run
from nbv.run.wording import count, square_metres
from nbv.scans.registering import placed_of, register_request
from nbv.scans.remote_completion import complete_by_workers
from scenes.inclination import Up
from scenes.io.scan_request import GivenScans, ScanRequest, read_request
from scenes.run.journal import FileJournal
from scenes.scan.range_image import RangeImage

_WIDEST_M = 0.1  # half an interval beyond which nobody relies on a length
_MOST_SURFACES = 8  # that a line of the summary lists


def completion_options(asked: CompleteOptions) -> CompletionOptions:
    """Return the options of `complete`; edits, relations and features are read from their files."""
    features: FeatureOptions | None = None
    if asked.features == "auto":
        features = FITTED
    elif asked.features != "off":
        features = FeatureOptions(stated=tuple(read_features(asked.features)))
    return CompletionOptions(
        **{
            entry.name: getattr(asked, entry.name) for entry in fields(UserOptions) if entry.name != "texture"
        },
        texture=asked.has_texture,
        segmentation=SegmentationOptions(flatness_m=asked.flatness_m),
        evidence=EvidenceOptions(cell_m=asked.cell_m),
        texturing=TexturingOptions(search="auto" if asked.search == "off" else asked.search),
        edits=() if asked.edits is None else read_edits(asked.edits),
        relations=None if asked.relations == "off" else BUILT,
        stated_relations=tuple(entry for file in asked.stated for entry in read_scan_relations(file)),
        features=features,
        flattening=FlatteningOptions() if asked.flatten else None,
        backs=BackOptions(least=asked.least) if asked.backs else None,
        up=Up.along(asked.up),
    )


def run_complete(shared: Shared, how: CompleteOptions) -> None:
    """Complete scans and write model, record and report."""
    request = how.request()
    with start_run("complete", shared, default="out/complete", is_folder=True) as run:
        # Read the scans, placed to each other where that is asked for
        run.watch.enter("load")
        run.read([*request.inputs, *how.files])
        journal = run.journal({**request.options(), **how.record()})
        given, options, placement = load_scans(run, shared, how, request, journal)
        run.warn(given.doubts)
        asked = {**request.options(), "instruments": given.instruments, **how.record()}
        # Complete them
        completion = _complete_scans(
            run, shared, given.scans, options, journal, scheduler=how.scheduler, request=request
        )
        in_force = options.in_force(completion.flatness_m, completion.registration.left_m)
        resolved = {**asked, "resolved": asdict(in_force)}
        texts = [text for text in completion.warnings if text not in given.doubts]
        texts += coarser_cells(completion, how.cell_m)
        run.warn(texts)
        warnings = [*given.doubts, *texts]
        # Verify what the first scan alone infers by the others
        verification = None
        if len(given.scans) > 1:
            run.watch.enter("verify")
            verification = verify_first(
                completion, options, n_threads=shared.threads, journal=journal.part("first")
            )
        # Write the model and its record
        run.watch.enter("save")
        entry = completion_record(completion, verification, observed=how.observed)
        record = {**entry, "warnings": warnings}
        building = completion.building()
        decisions = completion.decisions(how.tolerance_m, of=building)
        lines = placement + lines_of(completion, verification) + lines_of_detail(entry["observed_step"])
        lines += lines_of_decisions(decisions)
        del verification  # a completion of its own: it is gone before the files are made
        write_model(
            completion, run.stage.folder, record, building=building, decisions=decisions,
            exports=how.exports, units=how.export_units,
        )  # fmt: skip
        del building
        # Report
        run.watch.enter("report")
        from nbv.report.completion_report import completion_page

        first_scan = record.get("first_scan")
        page = completion_page(
            completion, request.title, decisions, n_threads=shared.threads, first_scan=first_scan
        )
        run.report(replace(page, warnings=tuple(warnings)), asked)
        summary = {**summary_of(completion), "decisions": decisions.counts()}
        summary |= {"warnings": warnings, **placed_of(placement)}
        run.finish(resolved, summary, lines)


def load_scans(
    run: Run, shared: Shared, how: CompleteOptions, request: ScanRequest, journal: FileJournal
) -> tuple[GivenScans, CompletionOptions, list[str]]:
    """Return the scans, the options with what registration knows of their poses, and a line on it."""
    options = completion_options(how)
    if not how.register:
        return read_request(request), options, []
    run.will_call(count_agreement, 20)
    part = journal.part("register")
    placed = register_request(request, n_threads=shared.threads, progress=run.progress, journal=part)
    return placed.given, replace(options, pose_deviations_m=placed.deviations_m), [placed.summary]


def _complete_scans(
    run: Run,
    shared: Shared,
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    journal: FileJournal,
    *,
    scheduler: str | None,
    request: ScanRequest,
) -> Completion:
    """Complete scans here; where there is a scheduler its workers fill the journal first."""
    run.will_call(solve_plane, 40)
    if scheduler is not None:
        complete_by_workers(
            scheduler,
            request,
            options,
            journal,
            seed=shared.seed,
            n_threads=shared.threads,
            progress=run.progress,
        )
    return complete(
        scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress, journal=journal
    )


def coarser_cells(completion: Completion, cell_m: float | None) -> list[str]:
    """Say which surfaces have larger cells than of the side that was asked for, metres."""
    if cell_m is None:
        return []
    sides = [float(np.sqrt(patch.grid.cell_area)) for patch in completion.patches]
    larger = [f"{number} ({side:.3g} m)" for number, side in enumerate(sides, 1) if side > 1.01 * cell_m]
    if not larger:
        return []
    return [f"too many cells of {cell_m:g} m; these surfaces have larger ones: {', '.join(larger)}"]


def summary_of(completion: Completion) -> dict[str, Any]:
    """Return the headline numbers."""
    return {
        "mode": completion.mode,
        "scans": len(completion.observations),
        "surfaces": len(completion.patches),
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "unknown_m2": _unknown_m2(completion),
        "free_space_violation_m2": completion.free_space_violation_m2,
        "flatness_m": completion.flatness_m,
        "left_out": completion.choice.n_left_out,
        "edits": len(completion.edits),
        **_relations_of(completion),
        **({"flattening": whole_flattening(completion.flattened)} if completion.flattened else {}),
        **_things_of(completion),
        **_poses_of(completion),
    }


def _things_of(completion: Completion) -> dict[str, Any]:
    """Return how many things there are, and how much of their back sides is inferred; nothing unasked."""
    if completion.backs is None:
        return {}
    closed = [one for one in completion.things if one.back is not None]
    inferred_m2 = sum(one.inferred_m2 for one in closed)
    return {"things": len(completion.things), "closed": len(closed), "backs_m2": inferred_m2}


def _relations_of(completion: Completion) -> dict[str, Any]:
    """Return how many relations came to which status; nothing where none were looked for."""
    if completion.relations is None:
        return {}
    graph = completion.relations.graph
    return {"relations": {status.value: graph.count_with(status) for status in RelationStatus}}


def _poses_of(completion: Completion) -> dict[str, Any]:
    """Return how far apart poses set what several scans measured, at most; nothing of a single scan."""
    pairs = completion.registration.pairs
    if not pairs:
        return {}
    return {
        "poses_apart_m": max(pair.offset_m for pair in pairs),
        "poses_left_m": max(pair.left_m for pair in pairs),
        "contradicted_m2": sum(pair.still_contradicted_m2 for pair in pairs),
    }


def _unknown_m2(completion: Completion) -> float:
    return sum(mesh_area(one.unknown.vertices, one.unknown.faces) for one in completion.surfaces)


def lines_of(completion: Completion, verification: Verification | None = None) -> list[str]:
    """Return the headline numbers for people."""
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    share = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    unknown = _unknown_m2(completion)
    lines = [
        f"measured  {square_metres(observed)} m2 on {count(len(completion.patches), 'surface')}",
        f"inferred  {square_metres(inferred)} m2{share}",
        f"unknown   {square_metres(unknown)} m2 hidden on these surfaces, and not inferred",
        f"inferred where a beam went through: {square_metres(completion.free_space_violation_m2)} m2",
    ]
    if completion.choice.n_left_out:
        lines.append(f"left as measured: {count(completion.choice.n_left_out, 'other surface')}")
    lines += [
        *_lines_of_relations(completion),
        *_lines_of_flattening(completion),
        *_lines_of_things(completion),
        *_lines_of_poses(completion),
    ]
    if verification is not None:
        confirmed, refuted, hidden = (
            square_metres(verification.area_m2(finding))
            for finding in (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)
        )
        lines.append(
            f"inferred from the first scan alone, the others confirm {confirmed} m2, refute {refuted} m2 and "
            f"do not see {hidden} m2"
        )
    return lines + _lines_of_edits(completion)


def _lines_of_relations(completion: Completion) -> list[str]:
    """How many relations hold, and how many do not."""
    if completion.relations is None or not completion.relations.graph.relations:
        return []
    graph = completion.relations.graph
    holding = sum(relation.holds for relation in graph.relations)
    n_rejected, n_undecided = map(graph.count_with, (RelationStatus.REJECTED, RelationStatus.UNDECIDED))
    others = f"{n_rejected} rejected, {n_undecided} undecided"
    return [f"{count(holding, 'relation')} accepted among {count(len(graph.fits), 'surface')}; {others}"]


def _lines_of_flattening(completion: Completion) -> list[str]:
    """What flattening did."""
    if not completion.flattened:
        return []
    record = whole_flattening(completion.flattened)
    return [
        f"flattened {count(record['planes'], 'plane')}: ripple {1000 * record['ripple_before_m']:.2f} -> "
        f"{1000 * record['ripple_after_m']:.2f} mm rms, "
        f"{count(record['relief_areas'], 'area')} of relief kept; "
        f"{record['turned_over']} triangles turned over, {record['crossing_anew']} cross others anew"
    ]


def _lines_of_things(completion: Completion) -> list[str]:
    """How many things stand there, and how much of their back sides is inferred."""
    if completion.backs is None:
        return []
    told = _things_of(completion)
    if not completion.up.is_decided:
        return ["things    none: up is undecided, so that nothing stands on anything; say it by --up"]
    sure = sum(bool(one.back and one.back.sure) for one in completion.things)
    return [
        f"things    {told['things']}, {told['closed']} closed, {sure} by a symmetry: "
        f"{square_metres(told['backs_m2'])} m2 of back sides inferred (things.json)"
    ]


def lines_of_detail(step: int) -> list[str]:
    """What observed.ply leaves out, where it is not all."""
    if step == 1:
        return []
    return [
        f"observed.ply holds one of {step} rows and columns of the scans; --observed full writes them all"
    ]


def lines_of_decisions(decisions: DecisionSheet) -> list[str]:
    """How many dimensions may be relied on, and how many not."""
    if not decisions.dimensions:
        return []
    sentence = ", ".join(f"{word} {n}" for word, n in decisions.counts().items())
    doubt = f"; {decisions.told_doubt}" if decisions.told_doubt else ""
    first = f"decisions {count(len(decisions.dimensions), 'dimension')} in decisions.csv: {sentence}{doubt}"
    return [first, *_lines_to_rely(decisions)]


def _lines_to_rely(decisions: DecisionSheet) -> list[str]:
    """What would make a dimension one to rely on: a wider tolerance, more measured surface, or a sure end."""
    pairs = zip(decisions.dimensions, decisions.advice, strict=True)
    others = [dimension for dimension, word in pairs if word != "rely"]
    absent = [one for one in others if one.existence < LEAST_EXISTENCE]
    hidden = [one for one in others if one not in absent and one.measured_share < LEAST_MEASURED]
    needed = sorted(one.half / one.across_m for one in others if one not in absent and one not in hidden)
    lines = []
    if needed and needed[0] <= _WIDEST_M:
        nearest = f"--rely {_rounded_up(needed[0]):g}"
        lines.append(f"rely on {len(needed)} more with a wider tolerance: {nearest} for the nearest")
    for held, condition in ((hidden, "half of each is measured"), (absent, "their ends are seen")):
        if held:
            labels = sorted({label for one in held for label in one.surfaces})
            if not labels:  # of things alone: they are in things.json
                continue
            listed = ", ".join(map(str, labels[:_MOST_SURFACES])) + ", ..." * (len(labels) > _MOST_SURFACES)
            lines.append(f"rely on {len(held)} more once {condition}: scan surfaces {listed}")
    return [f"{'':10}{line}" for line in lines]


def _rounded_up(metres: float) -> float:
    """Return a length at two digits that is no less, metres."""
    digit = 10.0 ** (np.floor(np.log10(max(metres, 1e-6))) - 1)
    return float(np.ceil(metres / digit) * digit)


def _lines_of_poses(completion: Completion) -> list[str]:
    """How well the poses of several scans agree, the worst pair of them."""
    pairs = completion.registration.pairs
    if not pairs:
        return []
    worst = max(pairs, key=lambda pair: pair.offset_m)
    moved = f", {1000 * max(pair.left_m for pair in pairs):.1f} mm once moved"
    return [
        f"poses     largest offset between two scans {1000 * worst.offset_m:.1f} mm (scans "
        f"{worst.first + 1} and {worst.second + 1})" + (moved if completion.registration.is_moved else "")
    ]


def _lines_of_edits(completion: Completion) -> list[str]:
    """What came of a person's edits."""
    if not completion.edits:
        return []
    effects = [surface.effect for surface in completion.surfaces]
    filled, vetoed = sum(effect.filled_m2 for effect in effects), sum(effect.vetoed_m2 for effect in effects)
    lines = [f"edits     {len(completion.edits)}, by which {square_metres(filled)} m2 are inferred"]
    if vetoed > 0:
        lines.append(f"accepted, but empty since beams went through: {square_metres(vetoed)} m2")
    return lines
