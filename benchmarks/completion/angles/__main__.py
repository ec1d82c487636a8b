# SPDX-License-Identifier: MIT
"""`python -m benchmarks.completion.angles`: walls and floors that should be square, by what was stated.

Real frames (the dining room is the one that the size of distortions was taken from), and frames of held-out
flats before a camera that bends what it sees, each with a bend of its own. A table is printed: how far angles
between planes that enclose a frame are off, and by how many of the deviations that are stated, without and
with the sensor's systematic errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import typer

from benchmarks.completion.angles.distorted import distorted
from benchmarks.completion.angles.pairs import names_of, pairs_of, summary
from benchmarks.completion.ledger.sources import DATA, HELD_OUT_HOUSES, REAL
from completion import CompletionOptions, complete
from scenes import RangeImage, read_scan

_REAL = ("nyu_dining", "open3d_redwood", "align3d_sample1")
_OFFICE = "range/pcl/office1.pcd"


def angles(
    flats: Annotated[int, typer.Option("--flats", min=0, help="Held-out flats, two frames each.")] = 20,
    units: Annotated[float, typer.Option("--units", min=0.0, help="Bend, units of disparity.")] = 2.0,
    real: Annotated[bool, typer.Option(help="Real frames as well.")] = True,
) -> None:
    """Print the table."""
    options = CompletionOptions(texture=False)
    print("| | pairs | off, deg | stated before | times | within 2 sd | stated | times | within 2 sd |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, scans in sources(flats, units, real=real):
        found = [pair for one, scan in scans for pair in pairs_of(one, complete(scan, options, rng=0))]
        if found:
            print(summary(name, found), flush=True)


def sources(flats: int, units: float, *, real: bool) -> Iterator[tuple[str, list[tuple[str, RangeImage]]]]:
    """Yield what is scanned by name, with its frames."""
    if real:
        for source in REAL:
            if source.name in _REAL:
                yield source.name, names_of(source.frames, source.name)
        yield "office1", names_of([read_scan(DATA / _OFFICE)], "office1")
    scans = [
        distorted(flat.frames[k], 10 * flat.seed + k, units)
        for flat in HELD_OUT_HOUSES[:flats]
        for k in (0, 2)
    ]
    yield f"flats, bent by {units:g} units", names_of(scans, "flat")


if __name__ == "__main__":
    typer.run(angles)
