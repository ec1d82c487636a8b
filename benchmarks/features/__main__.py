# SPDX-License-Identifier: MIT
"""`python -m benchmarks.features KIND`: features against their truth."""

import typer

from benchmarks.features.openings import nulls, openings

app = typer.Typer(add_completion=False)
for one in (openings, nulls):
    app.command()(one)

if __name__ == "__main__":
    app()
