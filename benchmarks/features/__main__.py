# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features KIND`: features against their truth."""

import typer

from benchmarks.features import holes, junctions, solids
from benchmarks.features.duplex import duplex
from benchmarks.features.evolution import evolution
from benchmarks.features.openings import nulls, openings
from benchmarks.features.patches import patches
from benchmarks.features.reveals import reveals

FIRST = typer.Option(10_000, "--first", help="Seed of the first; tuning seeds are below 1000.")
EACH = typer.Option(20, "-n", help="How many of each.")
PARTS = typer.Option(False, "--parts", help="The parts in UNSEEN_DATA, with so much time for each.")
app = typer.Typer(add_completion=False)
for one in (openings, nulls, reveals, duplex, patches, evolution):
    app.command()(one)


@app.command("holes")
def _holes(
    first: int = FIRST, n: int = EACH, null: bool = typer.Option(False, "--null"), on_parts: bool = PARTS
) -> None:
    """Rows, grids and bolt circles of holes, or plates without any; or the parts of the data set."""
    if on_parts:
        holes.run_parts()
    else:
        (holes.run_null if null else holes.run)(first, n)


@app.command("junctions")
def _junctions(first: int = FIRST, n: int = EACH, on_parts: bool = PARTS) -> None:
    """Tangent joints and fillets, by noise and outliers, and what has none; or the parts of the data set."""
    if on_parts:
        junctions.run_parts()
    else:
        junctions.run(first, n)


@app.command("elbows")
def _elbows(first: int = FIRST, n: int = EACH) -> None:
    """Elbows of pipes, and what has none."""
    junctions.run_elbows(first, n)


@app.command("growth")
def _growth() -> None:
    """CPU time and peak memory of holes and of junctions, by the number of points."""
    holes.run_growth()
    junctions.run_growth()


@app.command("solids")
def _solids(first: int = FIRST, n: int = EACH, rooms: bool = typer.Option(False, "--rooms")) -> None:
    """Flights of stairs and columns, among points or in scanned rooms."""
    (solids.run_rooms if rooms else solids.run)(first, n)


if __name__ == "__main__":
    app()
