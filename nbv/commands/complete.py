# SPDX-License-Identifier: MIT
"""`unseen complete`: completion of one scan, or of several registered ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from completion.edits.file import read_edits
from completion.extension.extent import Mode
from completion.options import CompletionOptions
from completion.pipeline import Completion, complete
from completion.result.verification import Finding, Verification, verify
from nbv.commands.process.run import Shared, running
from nbv.commands.scans import ScanRequest, doubts_of, instruments_of, read_request, title_of
from nbv.run.wording import count, square_metres
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, kw_only=True, slots=True)
class CompleteRequest:
    """How scans are to be completed.

    Attributes
    ----------
    mode : str
        How probable inferred area must be.
    sigma_m : float, optional
        Range noise, metres; when None it is read off each scan.
    max_sd_m : float
        Predicted deviation up to which surfaces are continued, metres.
    registration_m : float
        Error of the poses of several scans, metres.
    texture : bool
        Whether inferred area is textured.
    edits : str, optional
        A file of edits.
    exports : tuple of "obj" or "e57"
        Formats beside those that are always written.
    """

    mode: Mode
    sigma_m: float | None
    max_sd_m: float
    registration_m: float
    texture: bool
    edits: str | None
    exports: tuple[str, ...] = ()

    def resolved(self) -> CompletionOptions:
        """Return the options, the edits read from their file."""
        return CompletionOptions(
            mode=self.mode,
            sigma_m=self.sigma_m,
            max_sd_m=self.max_sd_m,
            registration_m=self.registration_m,
            texture=self.texture,
            edits=() if self.edits is None else read_edits(self.edits),
        )

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        return {**asdict(self), "edits": None if self.edits is None else Path(self.edits).name}


def run_complete(shared: Shared, request: ScanRequest, how: CompleteRequest) -> None:
    """Complete the scans of `request` and write model, record and report."""
    with running("complete", shared, default="out/complete", is_folder=True) as run:
        run.watch.enter("load")
        run.read([*request.inputs, *([how.edits] if how.edits else [])])
        scans = read_request(request)
        run.warn(doubts_of(scans))
        options = how.resolved()
        journal = run.journal({**request.options(), **how.options()})
        completion = complete(
            scans,
            options,
            rng=shared.seed,
            n_threads=shared.threads,
            progress=run.progress,
            journal=journal,
        )
        verification = None
        if len(scans) > 1:
            run.watch.enter("verify")
            verification = verify_first(scans, options, shared.threads, journal.part("first"))
        run.watch.enter("save")
        completion.save(run.stage.folder, verification)
        for suffix in how.exports:
            completion.export(run.path(f"completed.{suffix}"))
        run.watch.enter("report")
        from nbv.report.completion_report import completion_page

        asked = {**request.options(), "instruments": instruments_of(scans), **how.options()}
        title = title_of(request.paths)
        page = completion_page(
            completion,
            title,
            options=asked,
            seed=shared.seed,
            n_threads=shared.threads,
            verification=verification,
        )
        run.report(page)
        resolved = {**asked, "resolved": _settled(options, len(scans))}
        run.finish(resolved, summary_of(completion), lines_of(completion, verification))


def verify_first(
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
) -> Verification:
    """Complete the first scan alone and let the others confirm or refute what was inferred."""
    alone = complete(
        scans[:1], replace(options, texture=False, edits=()), n_threads=n_threads, journal=journal
    )
    return verify(
        alone,
        scans[1:],
        replace(options.evidence, flatness_m=options.tolerance(len(scans)).flatness_m),
        registration_m=options.registration_m,
        sigma_m=options.sigma_m,
    )


def _settled(options: CompletionOptions, n_scans: int) -> dict[str, Any]:
    """The options as they were in force, the edits apart."""
    tolerance = options.tolerance(n_scans)
    evidence = replace(
        options.evidence, flatness_m=tolerance.flatness_m, registration_m=tolerance.registration_m
    )
    return asdict(replace(options, edits=(), evidence=evidence))


def summary_of(completion: Completion) -> dict[str, Any]:
    """Return the headline numbers."""
    return {
        "mode": completion.mode,
        "scans": len(completion.observations),
        "surfaces": len(completion.patches),
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
        "edits": len(completion.edits),
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


def _lines_of_edits(completion: Completion) -> list[str]:
    """What came of a person's edits."""
    if not completion.edits:
        return []
    effects = [surface.effect for surface in completion.derived.surfaces]
    filled, vetoed = sum(one.filled_m2 for one in effects), sum(one.vetoed_m2 for one in effects)
    lines = [f"edits     {len(completion.edits)}, by which {square_metres(filled)} m2 are inferred"]
    if vetoed > 0:
        lines.append(f"accepted, but empty since beams went through: {square_metres(vetoed)} m2")
    return lines
