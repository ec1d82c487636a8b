# SPDX-License-Identifier: MIT
<<<<<<< HEAD
"""`python -m benchmarks.features KIND`: features against their truth."""

import typer

from benchmarks.features.openings import nulls, openings
from benchmarks.features.patches import patches

app = typer.Typer(add_completion=False)
for one in (openings, nulls, patches):
    app.command()(one)

if __name__ == "__main__":
    app()
=======
"""How well features are found: python -m benchmarks.features KIND [--first SEED] [-n N] [--null]."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from benchmarks.features import holes

RUNS: dict[str, tuple[Callable[[int, int], object], Callable[[int, int], object]]] = {
    "holes": (holes.run, holes.run_null),
}
"""By name: features that are there, and places without any."""


def main() -> None:
    """Run one benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=sorted(RUNS))
    parser.add_argument("--first", type=int, default=10_000, help="first seed; tuning seeds are below 1000")
    parser.add_argument("-n", type=int, default=20, help="how many of each")
    parser.add_argument("--null", action="store_true", help="places without features")
    given = parser.parse_args()
    RUNS[given.kind][given.null](given.first, given.n)


if __name__ == "__main__":
    main()
>>>>>>> holes
