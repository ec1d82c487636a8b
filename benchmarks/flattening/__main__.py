# SPDX-License-Identifier: MIT
"""Flatten generated walls and print the table of docs/results/flattening.md.

Run it with `python -m benchmarks.flattening [--held-out] [--seeds FIRST:END] [--null N]`: walls of the
layouts and ripples on which the method was tuned, or of others; with `--null N` instead the p values of N
walls without relief of each kind of ripple, and whether they are uniform (Kolmogorov-Smirnov).
"""

import argparse

import numpy as np
from scipy.stats import kstest

from benchmarks.flattening.ripples import HELD_OUT_RIPPLES, STATIONARY, TUNING_RIPPLES
from benchmarks.flattening.study import HEAD, score_walls, smallest_p, summary


def main(arguments: list[str] | None = None) -> None:
    """Flatten the walls asked for, and print what became of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--held-out", action="store_true", help="layouts and ripples not used for tuning")
    parser.add_argument("--seeds", default="0:24", help="of the walls, FIRST:END")
    parser.add_argument(
        "--null", type=int, default=0, metavar="N", help="N walls without relief a kind of ripple"
    )
    asked = parser.parse_args(arguments)
    seeds = range(*(int(word) for word in asked.seeds.split(":")))
    if asked.null:
        kinds = HELD_OUT_RIPPLES if asked.held_out else TUNING_RIPPLES
        steady = tuple(kind for kind in kinds if kind in STATIONARY)
        p = smallest_p(range(seeds.start, seeds.start + asked.null), steady)
        shares = ", ".join(
            f"{100 * np.mean(np.array(p) <= level):.1f} % at {level}" for level in (0.01, 0.05, 0.5)
        )
        print(f"{len(p)} walls without relief: {shares}; uniform: p = {kstest(p, 'uniform').pvalue:.2f}")
        return
    print(HEAD)
    scores = []
    for one in score_walls(seeds, held_out=asked.held_out):
        scores.append(one)
        print(one, flush=True)
    print("\n" + summary(scores, STATIONARY))


if __name__ == "__main__":
    main()
