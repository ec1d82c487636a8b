# SPDX-License-Identifier: MIT
"""Processor's seconds of `complete`, stage by stage: `python benchmarks/stages.py SCAN...`.

All scans together are one completion, on one thread; of a few rounds the best is printed, so that nothing
compiles in it. Seconds of what lies within a stage are counted there too, indented. The digest is of all that
was inferred: owners of the pixels, labels and provenance of the cells, and the mesh.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import ExitStack
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

import scenes
from completion import Completion, CompletionOptions, complete
from completion.texturing.problem import TexturingOptions

STAGES = (  # where it is called, its name, how deep it lies
    ("completion.pipeline", "observe", 0),
    ("completion.pipeline", "segment", 0),
    ("completion.pipeline", "merge", 0),
    ("completion.merging.pipeline", "_agreements", 1),
    ("completion.merging.pipeline", "_hidden_between", 1),
    ("completion.pipeline", "find_boundary_pixels", 0),
    ("completion.pipeline", "find_adjacency", 0),
    ("completion.pipeline", "find_extent", 0),
    ("completion.pipeline", "extend", 0),
    ("completion.extension.pipeline", "weigh", 1),
    ("completion.extension.pipeline", "_boundary_edges", 1),
    ("completion.extension.pipeline", "divide_hidden", 1),
    ("completion.extension.pipeline", "label_regions", 1),
    ("completion.extension.pipeline", "estimate", 1),
    ("completion.extension.pipeline", "provenance_of", 1),
    ("completion.pipeline", "texture_patch", 0),
    ("completion.pipeline", "_audited", 0),
)


def timed(work: Callable[..., Any], spent: dict[str, float], name: str) -> Callable[..., Any]:
    """Return the same function, its seconds added up under a name."""

    def run(*given: Any, **named: Any) -> Any:
        start = time.process_time()
        try:
            return work(*given, **named)
        finally:
            spent[name] += time.process_time() - start

    return run


def measure(
    scans: list[scenes.RangeImage], options: CompletionOptions
) -> tuple[dict[str, float], Completion]:
    """Complete the scans once; return the seconds of each stage and of all, and what came of it."""
    spent: dict[str, float] = defaultdict(float)
    with ExitStack() as stack:
        for module, name, _ in STAGES:
            work = getattr(import_module(module), name)
            stack.enter_context(patch(f"{module}.{name}", timed(work, spent, name)))
        done = timed(complete, spent, "all")(scans, options, rng=0, n_threads=1)
    return spent, done


def digest(done: Completion) -> str:
    """Return a digest of what a completion says is where."""
    total = sha256()
    arrays = [*done.owners, done.hypothesised.vertices, done.hypothesised.faces]
    for one in done.patches:
        arrays += [one.evidence.labels, one.hypothesised, one.provenance]
    for array in arrays:
        total.update(np.ascontiguousarray(array))
    return total.hexdigest()[:12]


def main() -> None:
    """Read the scans, complete them a few times and print the best."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="+", help="files or folders of scans")
    parser.add_argument("--intrinsics", type=float, nargs=4, metavar=("FX", "FY", "CX", "CY"))
    parser.add_argument("--depth-scale", type=float, help="depth values a metre")
    parser.add_argument("--first", type=int, help="complete only so many scans")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--texture", choices=("auto", "budget", "exact"), help="with texture, by this search")
    given = parser.parse_args()
    camera = {
        "intrinsics": tuple(given.intrinsics) if given.intrinsics else None,
        "depth_scale": given.depth_scale,
    }
    scans = [scan for path in given.scans for scan in scenes.read_scans(path, **camera)][: given.first]
    search = TexturingOptions(search=given.texture or "auto")
    options = CompletionOptions(texture=given.texture is not None, texturing=search)
    rounds = [measure(scans, options) for _ in range(given.rounds)]
    spent, done = min(rounds, key=lambda one: one[0]["all"])
    n_cells = sum(one.evidence.labels.size for one in done.patches)
    print(f"{len(scans)} scans, {sum(scan.ranges.size for scan in scans) / 1e6:.2f} M pixels")
    print(f"{len(done.patches)} surfaces, {n_cells / 1e6:.2f} M cells")
    for _, name, depth in STAGES:
        if name in spent:
            print(f"{'  ' * depth + name.strip('_'):24} {spent[name]:7.2f} s")
    print(f"{'all':24} {spent['all']:7.2f} s   {digest(done)}")


if __name__ == "__main__":
    main()
