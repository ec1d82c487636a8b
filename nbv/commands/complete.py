# SPDX-License-Identifier: MIT
"""`unseen complete`: completion of one scan, or of several registered ones."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from completion.limits import Mode
from completion.pipeline import Completion, CompletionOptions, complete
from nbv.commands.run import Run, Shared, running
from nbv.commands.scans import ScanRequest, instruments_of, read_request
from nbv.report.completion_report import completion_page
from nbv.report.page import square_metres

FILES = ("completed.glb", "observed.ply", "hypothesised.ply", "completion.json")


def run_complete(
    shared: Shared, request: ScanRequest, *, mode: Mode, sigma_m: float | None, texture: bool
) -> None:
    """Complete the scans of `request` and write model, record and report."""
    with running("complete", shared, default="out/complete", is_folder=True) as run:
        run.watch.enter("load")
        scans = read_request(request)
        options = CompletionOptions(mode=mode, sigma_m=sigma_m, texture=texture)
        completion = complete(
            scans, options, rng=shared.seed, n_threads=shared.threads, progress=run.progress
        )
        run.watch.enter("save")
        save(run, completion)
        run.watch.enter("report")
        asked = {
            **request.options(), "instruments": instruments_of(scans),
            "mode": mode, "sigma_m": sigma_m, "texture": texture,
        }  # fmt: skip
        page = completion_page(completion, _title(request.paths), asked, shared.seed, shared.threads)
        page.write(run.path("report.html"))
        resolved = {**asked, "resolved": asdict(options)}
        run.finish(request.inputs, resolved, summary_of(completion), lines_of(completion))


def save(run: Run, completion: Completion) -> None:
    """Write the completion's files and note them for the manifest."""
    completion.save(run.out)
    for name in FILES:
        run.path(name)


def summary_of(completion: Completion) -> dict[str, Any]:
    """Return the headline numbers."""
    return {
        "mode": completion.mode,
        "scans": len(completion.observations),
        "surfaces": len(completion.patches),
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
    }


def lines_of(completion: Completion) -> list[str]:
    """Return the headline numbers for people."""
    observed, inferred = completion.observed_m2, completion.hypothesised_m2
    share = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
    return [
        f"measured  {square_metres(observed)} m2 on {len(completion.patches)} surfaces",
        f"inferred  {square_metres(inferred)} m2{share}",
        f"inferred where a beam went through: {square_metres(completion.free_space_violation_m2)} m2",
    ]


def _title(paths: tuple[str, ...]) -> str:
    names = [Path(path).name for path in paths]
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
