# SPDX-License-Identifier: MIT
"""Random streams: one for each stage of a measurement, and many numbers from one of them on all cores."""

from __future__ import annotations

import numpy as np

from scenes.checks import FloatArray
from scenes.run.blocks import in_blocks

_BLOCK = 1 << 16  # numbers from one generator; not to be changed, or seeds give other numbers


def stage_streams(
    rng: np.random.Generator | int | None, stages: tuple[str, ...]
) -> dict[str, np.random.Generator]:
    """Return a random stream for each stage, which depends on `rng` and the stage's own name alone."""
    entropy = np.random.default_rng(rng).integers(0, 2**63, size=2).tolist()
    return {
        stage: np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=tuple(stage.encode())))
        for stage in stages
    }


def normal_numbers(rng: np.random.Generator, n: int, n_threads: int | None = None) -> FloatArray:
    """Return `n` standard normal numbers, the same for any number of threads.

    Each block of them comes from a child of `rng`.
    """
    numbers = np.empty(n)
    children = rng.spawn(-(-n // _BLOCK))

    def draw(blocks: slice) -> None:
        for k in range(blocks.start, blocks.stop):
            children[k].standard_normal(out=numbers[k * _BLOCK : (k + 1) * _BLOCK])

    in_blocks(len(children), draw, n_threads, block=1)
    return numbers
