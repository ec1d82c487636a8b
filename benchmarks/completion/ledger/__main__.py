# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.ledger`: inferred area of real and simulated frames, and what came true.

Each frame is completed alone, or with others (`--together`), and held against the frames that were not
given, or against the truth where there is one. The ledger is a JSON file with an entry a surface, reason and
tenth of confidence; the tables are printed, and pictures are written beside it: blue is right, orange wrong,
yellow unknown, grey beside what was measured.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import Image

from benchmarks.completion.ledger.entries import Entry, Outcome, outcome
from benchmarks.completion.ledger.sources import (
    FURNISHED,
    HELD_OUT_HOUSES,
    HOUSES,
    REAL,
    WALKS,
    Source,
    groups,
)
from benchmarks.completion.ledger.table import bin_of, row, rows_by, table
from completion import CompletionOptions
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage

_SHOWN = {2: (150, 150, 150), 0: (240, 228, 66), 1: (0, 114, 178), -1: (213, 94, 0)}


def ledger(
    kinds: Annotated[
        list[str] | None,
        typer.Option("--of", help="real, walks, furnished, houses, held-out-houses, or a source's name."),
    ] = None,
    together: Annotated[int, typer.Option("--together", min=1, help="Frames completed together.")] = 1,
    every: Annotated[int, typer.Option("--every", min=1, help="Of the groups of frames.")] = 1,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder.")] = Path("out/ledger"),
    sigma_m: Annotated[float | None, typer.Option("--sigma")] = None,
    by_truth: Annotated[
        bool, typer.Option("--by-truth/--by-others", help="What walks and houses are held against.")
    ] = True,
) -> None:
    """Write the ledger, its pictures, and print its tables."""
    out.mkdir(parents=True, exist_ok=True)
    entries: list[Entry] = []
    found = np.zeros(2, np.int64)
    for source in chosen(kinds or ["real", "walks"]):
        options = CompletionOptions(texture=False, registration_m=source.registration_m, sigma_m=sigma_m)
        for frames in list(groups(len(source.frames), together))[::every]:
            one = outcome(source, frames, options, by_truth=by_truth)
            entries.extend(one.entries)
            found += one.found
            name = f"{source.name.replace(', ', '-').replace(' ', '-')}-{'-'.join(str(k) for k in frames)}"
            _picture(one, source.frames[frames[0]]).save(out / f"{name}.png")
            print(table([row(name, one.entries)]).splitlines()[-1], flush=True)
    (out / "ledger.json").write_text(json.dumps([asdict(one) for one in entries], indent=1), "utf-8")
    for key in (
        lambda one: one.source,
        lambda one: one.reason,
        bin_of,
        lambda one: f"{one.reason} {bin_of(one)}",
    ):
        print("\n" + table(rows_by(entries, key)))
    print("\n" + table([row("all", entries)]))
    print(f"recall {found[1] / max(found[0], 1):.3f} of {found[0]} reference points")


def chosen(kinds: Sequence[str]) -> list[Source]:
    """Return the sources of some kinds, or with some names, in their order."""
    kept: dict[str, Sequence[Source]] = {
        "real": REAL,
        "walks": WALKS,
        "furnished": FURNISHED,
        "houses": HOUSES,
        "held-out-houses": HELD_OUT_HOUSES,
    }
    return [one for kind, held in kept.items() for one in held if {kind, one.name} & set(kinds)]


def _picture(one: Outcome, scan: RangeImage) -> Image.Image:
    """The frame, with what was inferred of it."""
    shown = np.full((*scan.shape, 3), 255, np.uint8)
    if scan.colour is not None:
        shown = (unit_colour(scan.colour) * 127 + 128).astype(np.uint8)
    pixels = scan.pixels(one.samples.points)
    inside = np.isfinite(pixels).all(axis=1)
    row_, column = np.rint(pixels[inside]).astype(np.int64).T
    for state, colour in _SHOWN.items():
        here = one.state[inside] == state
        shown[row_[here], column[here]] = colour
    return Image.fromarray(shown)


if __name__ == "__main__":
    typer.run(ledger)
