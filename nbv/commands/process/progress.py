# SPDX-License-Identifier: MIT
"""Progress: how far each stage of a command is, timed for the manifest and drawn where somebody looks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nbv.run.manifest import Stopwatch

Progress = Callable[[str, int, int], None]


@contextmanager
def progress_bars(watch: Stopwatch, *, hidden: bool) -> Iterator[Progress]:
    """Yield a callback that times stages and draws them on stderr, unless hidden or no terminal is there."""
    if hidden or not sys.stderr.isatty():
        yield lambda stage, _done, _total: watch.enter(stage)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description:<18}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def tell(stage: str, done: int, total: int) -> None:
            watch.enter(stage)
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield tell
