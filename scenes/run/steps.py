# SPDX-License-Identifier: MIT
"""Steps of a method: on threads, with progress, journalled, and kept on disk where they are many."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from scenes.checks import Value
from scenes.run.journal import Journal
from scenes.run.mapping import IN_MEMORY, NoSpill, Spill, spill_of, trim
from scenes.run.memory import require, threads

Progress = Callable[[str, int, int], None]
"""Is called with a stage's name, steps done and steps in all."""
_BYTES_KEPT = 350  # of each pixel that is kept in memory, to the end: regions, surfaces, textures
_BYTES_A_PIXEL = 400  # of the largest scan, for a thread: texturing a surface that fills it
_In = TypeVar("_In")
_Out = TypeVar("_Out")


@dataclass(frozen=True, slots=True, eq=False)
class Steps(Value):
    """Runs the stages on threads; tells their progress, and the journal what they came to.

    What the steps of many or large scans come to is kept on disk, and so are their pixels: after each step
    the system may have the memory back.
    """

    pool: ThreadPoolExecutor
    tell: Progress
    journal: Journal
    spill: Spill | NoSpill

    @classmethod
    @contextmanager
    def over(
        cls, sizes: Sequence[int], n_threads: int | None, progress: Progress | None, journal: Journal
    ) -> Iterator[Steps]:
        """As many threads as the memory allows for scans of so many pixels each; refuse more than fit."""
        spill = spill_of(sum(sizes))
        require(
            _BYTES_KEPT * min(sum(sizes), IN_MEMORY),
            f"completing {len(sizes)} scans of {sum(sizes):,} pixels",
            "complete fewer of them at once, smaller ones, or give more memory",
        )
        with threads(_BYTES_A_PIXEL * max(sizes), n_threads) as pool:
            yield cls(pool, progress or (lambda _stage, _done, _total: None), journal, spill)

    def keep(self, value: _Out) -> _Out:
        """The value, on disk where that is where values are kept; the memory of what was read is free."""
        kept = self.spill.keep(value)
        trim()
        return kept

    def one(self, name: str, work: Callable[[], _Out]) -> _Out:
        """Do a step by itself."""
        return self.keep(self.journal.step(name, work))

    def each(
        self, stage: str, work: Callable[[_In], _Out], items: Iterable[_In], *, remember: bool = True
    ) -> list[_Out]:
        """Apply `work` to every item on the pool, in order; others may share the journal, and the work.

        What is made again as fast as it is read need not be remembered by the journal.
        """
        todo = [(f"{stage}-{number:04d}", item) for number, item in enumerate(items, start=1)]

        def step(name: str, item: _In) -> _Out:
            return self.one(name, lambda: work(item)) if remember else self.keep(work(item))

        def offer(index: int) -> None:
            name, item = todo[index]
            self.journal.offer(name, lambda: work(item))
            trim()

        self.tell(stage, 0, len(todo))
        if remember:
            list(self.pool.map(offer, self.journal.turn(len(todo))))
        jobs = [self.pool.submit(step, *pair) for pair in todo]
        results = []
        for done, job in enumerate(jobs, start=1):
            results.append(job.result())
            self.tell(stage, done, len(jobs))
        return results
