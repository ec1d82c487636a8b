# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features KIND`: features against their truth."""

import typer

from benchmarks.features import holes
from benchmarks.features.evolution import evolution
from benchmarks.features.openings import nulls, openings
from benchmarks.features.patches import patches

FIRST = typer.Option(10_000, "--first", help="Seed of the first; tuning seeds are below 1000.")
EACH = typer.Option(20, "-n", help="How many of each.")
app = typer.Typer(add_completion=False)
for one in (openings, nulls, patches, evolution):
    app.command()(one)


@app.command("holes")
def _holes(first: int = FIRST, n: int = EACH, null: bool = typer.Option(False, "--null")) -> None:
    """Rows, grids and bolt circles of holes, or plates without any."""
    (holes.run_null if null else holes.run)(first, n)


if __name__ == "__main__":
    app()
