# SPDX-License-Identifier: MIT
"""Progress of a command: bars on a terminal, of all stages and of each; elsewhere a line a minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from nbv.run.manifest import Stopwatch

Progress = Callable[[str, int, int], None]
_SECONDS = 60.0  # between two lines where there is no terminal
_COMPLETION = ("noise and normals", "segment", "openings", "features", "extend", "backs", "texture", "audit")
_PLANNING = ("reachability", "visibility", "views", "cover", "bound", "polish")
STAGES: Mapping[str, tuple[str, ...]] = {
    "check": ("load", "facets", "pairs", "places", "observe", "beams", "deviations", "infer", "next stations",
              "save", "report"),
    "complete": ("load", "facets", "pairs", *_COMPLETION, "verify", "save", "report"),
    "coverage": ("load", "facets", "pairs", "voxels", *_COMPLETION, "coverage", "reachability", "report"),
    "demo": (*_PLANNING, "scan", *_COMPLETION, "save", "compare", "report"),
    "feature": ("load", "openings", "features", "save", "report"),
    "part": ("load", "neighbours", "grow", "label", "fit", "relate", "flatten", "dimensions", "step", "save",
             "report"),
    "plan": ("load", "complete", "voxels", "plan", *_PLANNING, "coverage", "baselines", "report"),
    "register": ("load", "up", "facets", "pairs", "noise", "save", "report"),
}  # fmt: skip
"""Stages of a command in their order; options and input decide which of them there are."""


@dataclass(slots=True, eq=False)
class Standing:
    """Where a run stands: the stage that runs, how much of it is done, and how much of all stages.

    A stage counts as one, and those that were passed over count as done; a stage of another call within one
    (the completion of the first scan that "verify" makes) leaves the total as it is, which never falls.
    """

    stages: tuple[str, ...]
    stage: str = ""
    done: int = 0
    total: int = 0
    stages_done: float = 0.0

    def enter(self, stage: str, done: int = 0, total: int = 0) -> None:
        """Note the stage that runs, and how much of it is done."""
        self.stage, self.done, self.total = stage, done, total
        if stage in self.stages:
            within = min(done / total, 1.0) if total else 0.0
            self.stages_done = max(self.stages_done, self.stages.index(stage) + within)

    def describe(self) -> str:
        """Return it in words: the stage, how much of it is done, and which of how many it is."""
        share = f", {self.done} of {self.total}" if self.total > 1 else ""
        n = len(self.stages)
        total = f"; stage {min(int(self.stages_done) + 1, n)} of {n}" if n else ""
        return f"{self.stage or 'start'}{share}{total}"


@contextmanager
def shown_progress(
    command: str, watch: Stopwatch, *, hidden: bool, seconds: float = _SECONDS
) -> Iterator[Progress]:
    """Yield a callback that times stages and shows them on stderr, unless hidden.

    On a terminal there is a bar for all stages and one for each; elsewhere a line every `seconds`.
    """
    standing = Standing(STAGES.get(command, ()))
    if hidden:
        yield lambda stage, _done, _total: watch.enter(stage)
    elif sys.stderr.isatty():
        with _bars(standing, watch) as tell:
            yield tell
    else:
        watch.heard = standing.enter
        ended = Event()
        Thread(target=_write_lines, args=(command, standing, ended, seconds), daemon=True).start()

        def note(stage: str, done: int, total: int) -> None:
            watch.enter(stage)
            standing.enter(stage, done, total)

        try:
            yield note
        finally:
            ended.set()


def _write_lines(command: str, standing: Standing, ended: Event, seconds: float) -> None:
    """Write where a run stands from time to time until it has ended."""
    began = time.monotonic()
    while not ended.wait(seconds):
        minutes = (time.monotonic() - began) / 60
        typer.echo(f"unseen {command}: {minutes:.0f} min: {standing.describe()}", err=True)


@contextmanager
def _bars(standing: Standing, watch: Stopwatch) -> Iterator[Progress]:
    """Draw a bar for all stages and one for each."""
    import rich.progress as rich
    from rich.console import Console

    shown = (
        rich.TextColumn("{task.description:<18}"), rich.BarColumn(), rich.MofNCompleteColumn(),
        rich.TimeElapsedColumn(), rich.TextColumn("left"), rich.TimeRemainingColumn(),
    )  # fmt: skip
    with rich.Progress(*shown, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}
        if standing.stages:
            tasks[""] = bars.add_task("all stages", total=100)

        def draw(stage: str, done: int = 0, total: int = 0) -> None:
            standing.enter(stage, done, total)
            if "" in tasks:
                bars.update(tasks[""], completed=int(100 * standing.stages_done / len(standing.stages)))
            if total:
                if stage not in tasks:
                    tasks[stage] = bars.add_task(stage, total=total)
                bars.update(tasks[stage], completed=done, total=total)

        def tell(stage: str, done: int, total: int) -> None:
            watch.enter(stage)
            draw(stage, done, total)

        watch.heard = draw
        yield tell
