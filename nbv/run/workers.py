# SPDX-License-Identifier: MIT
"""Workers: who does independent pieces of work; results do not depend on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
Item_contra = TypeVar("Item_contra", contravariant=True)
Result_co = TypeVar("Result_co", covariant=True)


class Work(Protocol[Item_contra, Result_co]):
    """A piece of work: a pure function of an item, on so many threads (None: all cores)."""

    def __call__(self, item: Item_contra, n_threads: int | None, /) -> Result_co:
        """Do it."""


class Workers(Protocol):
    """Who does the work."""

    def each(
        self, work: Work[Item, Result], items: Sequence[Item], keys: Sequence[str]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each item and its result, as they come; equal `keys` mean equal work."""


@dataclass(frozen=True, slots=True)
class ThisProcess:
    """One piece after the other, on as many threads as asked for."""

    n_threads: int | None = None

    def each(
        self, work: Work[Item, Result], items: Sequence[Item], keys: Sequence[str]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each item and its result, in order."""
        del keys
        for number, item in enumerate(items):
            yield number, work(item, self.n_threads)
