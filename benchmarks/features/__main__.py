# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features KIND`: features against their truth."""

import typer

from benchmarks.features.openings import nulls, openings
from benchmarks.features.patches import patches

app = typer.Typer(add_completion=False)
for one in (openings, nulls, patches):
    app.command()(one)

if __name__ == "__main__":
    app()
