# SPDX-License-Identifier: MIT
"""Figures of one kind of features: `python -m benchmarks.features KIND [--first SEED] [-n TRIALS]`."""

import argparse
import importlib

RUNS = {
    "junctions": "benchmarks.features.junctions:run",
    "elbows": "benchmarks.features.junctions:run_elbows",
    "solids": "benchmarks.features.solids:run",
}
"""Module and function (first seed, trials), by kind."""


def main(arguments: list[str] | None = None) -> None:
    """Run the kind that is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=RUNS)
    parser.add_argument("--first", type=int, default=9_000, help="seed of the first trial")
    parser.add_argument("-n", type=int, default=16, help="trials a row")
    asked = parser.parse_args(arguments)
    module, name = RUNS[asked.kind].split(":")
    getattr(importlib.import_module(module), name)(asked.first, asked.n)


if __name__ == "__main__":
    main()
