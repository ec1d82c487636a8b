# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.together`: whether a scan more is ever harmful.

Real frames, and frames of simulated walks whose poses are put off, are completed alone and together. A
surface of a scan alone is held against the one that has its pixels when all scans are together: its tilt to
the truth (of real frames: to the scan alone that knows it best), the root mean square of the same pixels
about it, and how much of it is inferred. It is worse where the tilt grew by more than half and .2 degrees, or
the root mean square by more than half and 2 mm. Of real frames the last is left out and judges what was
inferred, all of them standing where they agree.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.completion.ledger.sources import REAL, WALKS, Source
from benchmarks.completion.together.surfaces import Compared
from benchmarks.completion.together.trial import Trial, run
from completion import CompletionOptions
from scenes.checks import FloatArray

OFF = ((0.0, 0.0), (0.2, 0.005), (0.5, 0.02), (1.0, 0.05))
"""By how much poses of walks are put off: degrees, metres."""

_WALKED = {WALKS[0].name: (0, 1, 2, 3, 4), WALKS[2].name: (15, 16, 17, 18)}
_COLUMNS = (
    "frames", "surfaces", "tilt alone deg", "together", "worse", "rms alone mm", "together", "worse",
    "inferred alone m2", "together", "right alone m2", "together", "kept", "wrong alone m2", "together",
    "poses apart mm", "left mm", "contradicted m2", "still",
)  # fmt: skip


def together(
    kinds: Annotated[list[str] | None, typer.Option("--of", help="real, walks, or a source's name.")] = None,
    keep_poses: Annotated[bool, typer.Option("--keep-poses", help="Move no scan.")] = False,
    registration_m: Annotated[float, typer.Option("--registration")] = 0.005,
    seed: Annotated[int, typer.Option("--seed", help="Of the poses that are put off.")] = 0,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="JSON file.")] = None,
) -> None:
    """Print a row for each set of frames; medians of surfaces, weighted alike."""
    options = CompletionOptions(texture=False, registration_m=registration_m, moves_scans=not keep_poses)
    trials = []
    print("| " + " | ".join(_COLUMNS) + " |\n" + "|---" * len(_COLUMNS) + "|")
    for source in (*REAL, *WALKS):
        kind = "real" if source in REAL else "walks"
        if not {kind, source.name} & set(kinds or ["real", "walks"]) or not _frames(source):
            continue
        for number, off in enumerate(OFF if kind == "walks" else OFF[:1]):
            trials.append(run(source, _frames(source), options, off, seed + number))
            print(row(trials[-1]), flush=True)
    if out is not None:
        out.write_text(json.dumps([asdict(one) for one in trials], indent=1), "utf-8")


def _frames(source: Source) -> tuple[int, ...]:
    """Those of a source that are completed."""
    return tuple(range(len(source.frames) - 1)) if source in REAL else _WALKED.get(source.name, ())


def row(trial: Trial) -> str:
    """Write a trial as a row of a Markdown table."""
    held = trial.compared
    tilts = np.array([(one.tilt_alone_deg, one.tilt_deg) for one in held]).reshape(-1, 2)
    rms = np.array([(one.rms_alone_m, one.rms_m) for one in held]).reshape(-1, 2)
    inferred = {one.together: one.inferred_m2 for one in held}
    best: dict[int, float] = {}
    for one in held:
        best[one.together] = max(best.get(one.together, 0.0), one.inferred_alone_m2)
    pairs = trial.pairs
    cells = (
        trial.name,
        f"{len(inferred)}",
        *(f"{value:.2f}" for value in _medians(tilts)),
        f"{sum(is_more_tilted(one) for one in held)} of {len(held)}",
        *(f"{1000 * value:.1f}" for value in _medians(rms)),
        f"{sum(is_rougher(one) for one in held)} of {len(held)}",
        f"{sum(best.values()):.2f}",
        f"{sum(inferred.values()):.2f}",
        *(f"{value:.2f}" for value in (*trial.right_m2, trial.kept, *trial.wrong_m2)),
        f"{1000 * max((one.offset_m for one in pairs), default=0.0):.1f}",
        f"{1000 * max((one.left_m for one in pairs), default=0.0):.1f}",
        f"{sum(one.contradicted_m2 for one in pairs):.2f}",
        f"{sum(one.still_contradicted_m2 for one in pairs):.2f}",
    )
    return "| " + " | ".join(cells) + " |"


def _medians(pairs: FloatArray) -> tuple[float, float]:
    return (float(np.median(pairs[:, 0])), float(np.median(pairs[:, 1]))) if len(pairs) else (np.nan, np.nan)


def is_more_tilted(one: Compared) -> bool:
    """Whether a surface is tilted more together than alone, by more than half and .2 degrees."""
    return one.tilt_deg > 1.5 * one.tilt_alone_deg and one.tilt_deg > one.tilt_alone_deg + 0.2


def is_rougher(one: Compared) -> bool:
    """Whether the same pixels lie farther off a surface together than alone, by more than half and 2 mm."""
    return one.rms_m > 1.5 * one.rms_alone_m and one.rms_m > one.rms_alone_m + 0.002


if __name__ == "__main__":
    typer.run(together)
