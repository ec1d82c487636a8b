# SPDX-License-Identifier: MIT
"""`unseen complete`: completion of one scan, or of several registered ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from completion.edits.file import read_edits
from completion.export.decisions import DecisionSheet
from completion.export.dimension import TOLERANCE_M
from completion.extension.extent import Mode
from completion.features.engine.options import FITTED, FeatureOptions
from completion.features.stated import read_features
from completion.flattening.flat import FlatteningOptions
from completion.observe.tiles import solve_plane
from completion.observe.tolerance import EvidenceOptions
from completion.options import CompletionOptions
from completion.pipeline import complete, verify_first
from completion.registration.facets import count_agreement
from completion.relations.options import BUILT
from completion.relations.relation import Status, read_scan_relations
from completion.result.completion import Completion, write_model
from completion.result.flat_scans import whole_flattening
from completion.result.record import completion_record
from completion.result.verification import Finding, Verification
from completion.segmentation.regions import SegmentationOptions
from completion.texturing.pipeline import TexturingOptions
from nbv.commands.process.run import Shared, running
from nbv.run.wording import count, square_metres
from nbv.scans.registering import placed_of, register_request
from nbv.scans.remote_completion import complete_by_workers
from scenes.io.scan_request import ScanRequest, read_request


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteRequest:
    """How scans are to be completed, metres; what is None is read off the scans: noise, projector, flatness.

    `search` is that of textures, `edits` a file, `relations` and `features` "auto", "off" or a file,
    `exports` the formats ("obj", "e57", "dxf", "svg", "ifc") beside those that are always written, `observed`
    how many points observed.ply holds, `scheduler` who works; results do not depend on it.
    """

    mode: Mode
    sigma_m: float | None
    max_sd_m: float
    registration_m: float
    moves_scans: bool = True
    register: bool = False
    texture: bool
    edits: str | None
    relations: str = "auto"
    features: str = "auto"
    flatten: bool = False
    exports: tuple[str, ...] = ()
    tolerance_m: float = TOLERANCE_M
    search: Literal["auto", "exact", "budget"] = "auto"
    cell_m: float | None = None
    projector_m: float | None = None
    flatness_m: float | None = None
    min_area_m2: float = 0.0
    only: tuple[str, ...] = ()
    observed: Literal["auto", "full"] = "auto"
    scheduler: str | None = None

    def resolved(self) -> CompletionOptions:
        """Return the options, the edits read from their file."""
        return CompletionOptions(
            mode=self.mode,
            sigma_m=self.sigma_m,
            projector_m=self.projector_m,
            max_sd_m=self.max_sd_m,
            registration_m=self.registration_m,
            moves_scans=self.moves_scans,
            min_area_m2=self.min_area_m2,
            only=self.only,
            texture=self.texture,
            segmentation=SegmentationOptions(flatness_m=self.flatness_m),
            evidence=EvidenceOptions(cell_m=self.cell_m),
            texturing=TexturingOptions(search=self.search),
            edits=() if self.edits is None else read_edits(self.edits),
            relations=None if self.relations == "off" else BUILT,
            stated_relations=tuple(one for file in self.stated for one in read_scan_relations(file)),
            features=self._features(),
            flattening=FlatteningOptions() if self.flatten else None,
        )

    def _features(self) -> FeatureOptions | None:
        if self.features == "off":
            return None
        return (
            FITTED if self.features == "auto" else FeatureOptions(stated=tuple(read_features(self.features)))
        )

    @property
    def stated(self) -> tuple[str, ...]:
        """The file of relations that a person states, if there is one."""
        return () if self.relations in ("auto", "off") else (self.relations,)

    @property
    def files(self) -> tuple[str, ...]:
        """The files with a person's say."""
        said = () if self.features in ("auto", "off") else (self.features,)
        return (*((self.edits,) if self.edits else ()), *self.stated, *said)

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        own = {name: value for name, value in asdict(self).items() if name != "scheduler"}
        edits = None if self.edits is None else Path(self.edits).name
        names = {"relations": Path(self.relations).name, "features": Path(self.features).name}
        return {**own, "edits": edits, **names}


def run_complete(shared: Shared, request: ScanRequest, how: CompleteRequest) -> None:
    """Complete the scans of `request` and write model, record and report."""
    with running("complete", shared, default="out/complete", is_folder=True) as run:
        run.watch.enter("load")
        run.read([*request.inputs, *how.files])
        journal = run.journal({**request.options(), **how.options()})
        options, placement = how.resolved(), []
        if how.register:
            run.will_call(count_agreement, 20)
            placed = register_request(
                request,
                request.up,
                n_threads=shared.threads,
                progress=run.progress,
                journal=journal.part("register"),
            )
            given, options = placed.given, replace(options, pose_deviations_m=placed.deviations_m)
            placement = [placed.told]
        else:
            given = read_request(request)
        scans = given.scans
        run.warn(given.doubts)
        asked = {**request.options(), "instruments": given.instruments, **how.options()}
        resolved = {**asked, "resolved": asdict(options.in_force(len(scans)))}
        run.will_call(solve_plane, 40)
        if how.scheduler is not None:
            complete_by_workers(
                how.scheduler,
                request,
                options,
                journal,
                seed=shared.seed,
                n_threads=shared.threads,
                max_memory=shared.max_memory,
                progress=run.progress,
            )
        completion = complete(
            scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress, journal=journal
        )
        found = [text for text in completion.warnings if text not in given.doubts]
        found += coarser_cells(completion, how.cell_m)
        run.warn(found)
        warnings = [*given.doubts, *found]
        verification = None
        if len(scans) > 1:
            run.watch.enter("verify")
            verification = verify_first(
                completion,
                options,
                n_threads=shared.threads,
                journal=journal.part("first"),
            )
        run.watch.enter("save")
        said = completion_record(completion, verification, observed=how.observed)
        record = {**said, "warnings": warnings}
        building = completion.building()
        decisions = completion.decisions(how.tolerance_m, of=building)
        lines = placement + lines_of(completion, verification) + lines_of_detail(said["observed_step"])
        lines += lines_of_decisions(decisions)
        del verification  # a completion of its own: it is gone before the files are made
        write_model(
            completion,
            run.stage.folder,
            record,
            building=building,
            decisions=decisions,
            exports=how.exports,
        )
        del building
        run.watch.enter("report")
        from nbv.report.completion_report import completion_page

        page = completion_page(
            completion,
            request.title,
            decisions,
            n_threads=shared.threads,
            first_scan=record.get("first_scan"),
        )
        run.report(replace(page, warnings=tuple(warnings)), asked)
        summary = {**summary_of(completion), "decisions": decisions.counts()}
        summary |= {"warnings": warnings, **placed_of(placement)}
        run.finish(resolved, summary, lines)


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
        "free_space_violation_m2": completion.free_space_violation_m2,
        "flatness_m": completion.flatness_m,
        "left_out": completion.choice.n_left_out,
        "edits": len(completion.edits),
        **_relations_of(completion),
        **({"flattening": whole_flattening(completion.flattened)} if completion.flattened else {}),
        **_poses_of(completion),
    }


def _relations_of(completion: Completion) -> dict[str, Any]:
    """Return how many relations came to which status; nothing where none were looked for."""
    if completion.relations is None:
        return {}
    graph = completion.relations.graph
    return {"relations": {status.value: graph.numbered(status) for status in Status}}


def _poses_of(completion: Completion) -> dict[str, Any]:
    """Return how far apart poses set what several scans measured, at most; nothing of a single scan."""
    pairs = completion.registration.pairs
    if not pairs:
        return {}
    return {
        "poses_apart_m": max(one.offset_m for one in pairs),
        "poses_left_m": max(one.left_m for one in pairs),
        "contradicted_m2": sum(one.still_contradicted_m2 for one in pairs),
    }


def lines_of(completion: Completion, verification: Verification | None = None) -> list[str]:
    """Return the headline numbers for people."""
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    share = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    lines = [
        f"measured  {square_metres(observed)} m2 on {count(len(completion.patches), 'surface')}",
        f"inferred  {square_metres(inferred)} m2{share}",
        f"inferred where a beam went through: {square_metres(completion.free_space_violation_m2)} m2",
    ]
    if completion.choice.n_left_out:
        lines.append(f"left as measured: {count(completion.choice.n_left_out, 'other surface')}")
    lines += [
        *_lines_of_relations(completion),
        *_lines_of_flattening(completion),
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
    holding = sum(one.holds for one in graph.relations)
    others = f"{graph.numbered(Status.REJECTED)} rejected, {graph.numbered(Status.UNDECIDED)} undecided"
    return [f"{count(holding, 'relation holds', 'relations hold')} of {len(graph.fits)} surfaces; {others}"]


def _lines_of_flattening(completion: Completion) -> list[str]:
    """What flattening did."""
    if not completion.flattened:
        return []
    told = whole_flattening(completion.flattened)
    return [
        f"flattened {count(told['planes'], 'plane')}: ripple {1000 * told['ripple_before_m']:.2f} -> "
        f"{1000 * told['ripple_after_m']:.2f} mm rms, {count(told['relief_areas'], 'area')} of relief kept; "
        f"{told['turned_over']} triangles turned over, {told['crossing_anew']} cross others anew"
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
    said = ", ".join(f"{word} {n}" for word, n in decisions.counts().items())
    doubt = f"; {decisions.told_doubt}" if decisions.told_doubt else ""
    return [f"decisions {count(len(decisions.dimensions), 'dimension')} in decisions.csv: {said}{doubt}"]


def _lines_of_poses(completion: Completion) -> list[str]:
    """How well the poses of several scans agree, the worst pair of them."""
    pairs = completion.registration.pairs
    if not pairs:
        return []
    worst = max(pairs, key=lambda one: one.offset_m)
    moved = f", {1000 * max(one.left_m for one in pairs):.1f} mm once moved"
    return [
        f"poses     set what two scans measured {1000 * worst.offset_m:.1f} mm apart at most (scans "
        f"{worst.first + 1} and {worst.second + 1})" + (moved if completion.registration.is_moved else "")
    ]


def _lines_of_edits(completion: Completion) -> list[str]:
    """What came of a person's edits."""
    if not completion.edits:
        return []
    effects = [surface.effect for surface in completion.surfaces]
    filled, vetoed = sum(one.filled_m2 for one in effects), sum(one.vetoed_m2 for one in effects)
    lines = [f"edits     {len(completion.edits)}, by which {square_metres(filled)} m2 are inferred"]
    if vetoed > 0:
        lines.append(f"accepted, but empty since beams went through: {square_metres(vetoed)} m2")
    return lines
