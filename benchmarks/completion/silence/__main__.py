# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.silence`: moats, dark and clear things before a simulated Kinect.

Prints a table and writes a picture: of pixels without return those that are filled are green in the
projector's shadow and blue where things are dark or clear, those that are not are red and black. With `--fit`
it prints the most likely constants of `completion.extension.silence.TRUST` beside those in use.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import Image

from benchmarks.completion.silence.calibration import most_likely, parts_of
from benchmarks.completion.silence.desks import desk_case
from benchmarks.completion.silence.moats import Moats, moats
from completion import CompletionOptions
from completion.extension.silence import TRUST

HELD_OUT = 2000  # first seed of the desks that nothing is tuned on; constants come from 1000 on


def silence(
    first: Annotated[int, typer.Option("--first", help="Seed of the first desk.")] = HELD_OUT,
    desks: Annotated[int, typer.Option("--desks", min=1)] = 24,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder.")] = Path("out/silence"),
    fit: Annotated[bool, typer.Option("--fit", help="Print the most likely constants instead.")] = False,
) -> None:
    """Complete simulated desks, and count what brought nothing back."""
    if fit:
        parts = [one for seed in range(first, first + desks) for one in parts_of(seed)]
        print(
            f"in use\n{TRUST}\nmost likely on {desks} desks from seed {first}\n{most_likely(parts).round(3)}"
        )
        return
    out.mkdir(parents=True, exist_ok=True)
    found = []
    for seed in range(first, first + desks):
        one = moats(desk_case(seed), seed, CompletionOptions(texture=False))
        found.append(one)
        Image.fromarray(one.picture).save(out / f"{one.case.replace(' ', '-')}.png")
        print(_line(one.case, [one]), flush=True)
    print(_line("all", found))
    area, right = (sum(getattr(one, name) for one in found) for name in ("silent_m2", "right_m2"))
    for tenth in np.flatnonzero(area):
        print(f"confidence {tenth / 10:.1f}: {area[tenth]:.2f} m2, {right[tenth] / area[tenth]:.3f} right")


def _line(name: str, found: list[Moats]) -> str:
    shadow, dark = sum(one.shadow for one in found), sum(one.dark for one in found)
    area, right = (sum(float(getattr(one, key).sum()) for one in found) for key in ("silent_m2", "right_m2"))
    lit = sum(one.shadow_filled for one in found) / max(shadow, 1)
    closed = sum(one.dark_filled for one in found) / max(dark, 1)
    return (
        f"{name}: moats {shadow} pixels, {lit:.3f} filled; dark or clear {dark}, {closed:.3f} filled; "
        f"no-return {area:.2f} m2, {right / area if area else float('nan'):.3f} right"
    )


if __name__ == "__main__":
    typer.run(silence)
