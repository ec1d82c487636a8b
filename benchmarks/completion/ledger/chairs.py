# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.ledger.chairs`: what is continued of chairs and sofas in real frames.

Outlines of them were drawn by eye on the depth and the colour of some real frames; they stand beside this
file in `chairs.json` as (column, row), pixels. Each frame is completed alone, as in the ledger. A surface
belongs to a thing where more than half of its pixels lie within the thing's outlines, and not in outlines of
holes, between slats, through which one sees what is behind. What is inferred of
such surfaces is counted: in holes that they enclose, around round limbs between the ends of what was
measured, and beyond. Sofas are listed, and left out of the verdict on chairs.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import Image, ImageDraw

from benchmarks.completion.ledger.sources import REAL
from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scores.continued import Continued, continued_area_of
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from scenes.checks import BoolArray
from scenes.scan.range_image import RangeImage

OUTLINES = Path(__file__).with_name("chairs.json")
CHAIRS = ("chair", "armchair")
HOLE = "hole"
MOST_BEYOND_M2 = 0.05  # of a frame

Outline = Sequence[Sequence[float]]  # (column, row)


def masked_frames(path: Path = OUTLINES) -> Iterator[tuple[str, int, dict[str, list[Outline]]]]:
    """Yield source, frame (from 0), and by thing the outlines drawn on it."""
    for source, frames in json.loads(path.read_text("utf-8")).items():
        for frame, parts in frames.items():
            things: dict[str, list[Outline]] = {}
            for part in parts:
                things.setdefault(part["thing"], []).append(part["outline"])
            yield source, int(frame), things


def mask_of(outlines: Sequence[Outline], shape: tuple[int, int]) -> BoolArray:
    """Return which pixels of an image of a shape (rows, columns) lie in outlines."""
    image = Image.new("1", shape[::-1])
    for outline in outlines:
        ImageDraw.Draw(image).polygon([(float(x), float(y)) for x, y in outline], fill=1)
    return np.asarray(image, dtype=np.bool_)


def surfaces_in(completed: CompletedModel, mask: BoolArray) -> BoolArray:
    """Return which surfaces (n_patches,) of one scan have more than half of their pixels in a mask."""
    owner = completed.owners[0]
    n = len(completed.patches) + 1
    inside, all_ = np.bincount(owner[mask], minlength=n), np.bincount(owner.ravel(), minlength=n)
    return np.asarray(2 * inside[1:] > all_[1:], dtype=np.bool_)


def continued_in(
    scan: RangeImage, things: dict[str, list[Outline]], options: CompletionOptions
) -> dict[str, Continued]:
    """Complete a frame alone; return what was continued of each thing outlined on it."""
    completed = complete([scan], options, rng=0)
    hypothesis = hypothesis_of(completed, [scan])
    holes = mask_of(things.get(HOLE, ()), scan.shape)
    masks = {
        thing: mask_of(outlines, scan.shape) & ~holes for thing, outlines in things.items() if thing != HOLE
    }
    return {
        thing: continued_area_of(completed, hypothesis, surfaces_in(completed, mask))
        for thing, mask in masks.items()
    }


def chairs(
    masks: Annotated[
        Path | None, typer.Option("--masks", "-o", help="Folder for pictures of the masks.")
    ] = None,
) -> None:
    """Print a row for each thing of a frame, and how many frames keep to what is allowed."""
    sources = {one.name: one for one in REAL}
    worst: list[float] = []
    print("| frame | thing | surfaces | in enclosed holes m2 | on backs m2 | beyond m2 | of which |")
    print("|---|---|---|---|---|---|---|")
    for name, frame, things in masked_frames():
        source = sources[name]
        scan = source.frames[frame]
        found = continued_in(
            scan, things, CompletionOptions(texture=False, registration_m=source.registration_m)
        )
        for thing, one in found.items():
            why = ", ".join(f"{reason} {area:.3f}" for reason, area in one.beyond_by_reason.items()) or "-"
            print(
                f"| {name} {frame} | {thing} | {one.n_surfaces} | {one.enclosed_m2:.3f} "
                f"| {one.turned_m2:.3f} | {one.beyond_m2:.3f} | {why} |",
                flush=True,
            )
        worst.append(sum(one.beyond_m2 for thing, one in found.items() if thing in CHAIRS))
        if masks is not None:
            masks.mkdir(parents=True, exist_ok=True)
            drawn = [outline for thing, own in things.items() if thing != HOLE for outline in own]
            shown = mask_of(drawn, scan.shape) & ~mask_of(things.get(HOLE, ()), scan.shape)
            Image.fromarray(np.where(shown, 255, 64 * scan.valid).astype(np.uint8)).save(
                masks / f"{name}-{frame}.png"
            )
    kept = sum(beyond <= MOST_BEYOND_M2 for beyond in worst)
    print(
        f"\n{kept} of {len(worst)} frames have at most {MOST_BEYOND_M2} m2 beyond on chairs; "
        f"{sum(worst):.3f} m2 in all, {max(worst):.3f} m2 at most"
    )


if __name__ == "__main__":
    typer.run(chairs)
