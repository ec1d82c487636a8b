# SPDX-License-Identifier: MIT
"""Blocks: work on many rows split over threads; what comes out does not depend on their number."""

from __future__ import annotations

import os
from collections.abc import Callable

from scenes.run.memory import threads

_BLOCK = 1 << 16  # rows: enough that a thread is worth waking


def in_blocks(
    n_rows: int,
    work: Callable[[slice], object],
    n_threads: int | None = None,
    block: int = _BLOCK,
    *,
    bytes_a_block: float = 0.0,
) -> None:
    """Call `work` with slices that cover `n_rows`; it writes its own rows and holds no interpreter lock.

    Parameters
    ----------
    n_rows : int
        How many rows there are.
    work : callable
        Called with one slice at a time, from several threads.
    n_threads : int, optional
        All cores when not given.
    block : int
        Rows in a slice.
    bytes_a_block : float
        What `work` allocates for one: there are no more threads than fit into memory.
    """
    slices = [slice(start, min(start + block, n_rows)) for start in range(0, n_rows, block)]
    most = min(n_threads or os.cpu_count() or 1, len(slices))
    if most < 2:
        for part in slices:
            work(part)
        return
    with threads(bytes_a_block, most) as pool:
        list(pool.map(work, slices))
