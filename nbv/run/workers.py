# SPDX-License-Identifier: MIT
"""Workers: who does independent pieces of work, here or on a cluster of dask.distributed.

Every piece of work is a pure function, named by the hash of what it is made of; a piece whose worker dies is
done again by another. So results depend neither on the scheduler nor on who lives.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Protocol, Self, TypeVar
from uuid import uuid4

from nbv.run.manifest import versions
from scenes.checks import InputError
from scenes.io.checks.limits import current_limits, limits
from scenes.run.memory import memory_limit, planned_bytes, reuse_freed

Item = TypeVar("Item")
Result = TypeVar("Result")
Item_contra = TypeVar("Item_contra", contravariant=True)
Result_co = TypeVar("Result_co", covariant=True)


class Work(Protocol[Item_contra, Result_co]):
    """A piece of work: a pure function of an item, on so many threads (None: all cores)."""

    def __call__(self, item: Item_contra, n_threads: int | None, /) -> Result_co:
        """Do it."""


@dataclass(frozen=True, slots=True)
class WorkerShare:
    """Which of the workers that do one piece of work together this one is, and on how many threads."""

    number: int
    n_threads: int


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


_WAIT_S = 30.0  # for the scheduler to answer, and for the first worker
_DEATHS = 10  # of workers under the same piece of work, before it is blamed
_TELL_S = 0.3  # between looks at how far workers are
_LOCAL = "local"


@contextmanager
def workers_of(scheduler: str | None, n_threads: int | None) -> Iterator[Workers]:
    """Yield this process, or the cluster at an address (`cluster`, which raises InputError)."""
    if scheduler is None:
        yield ThisProcess(n_threads)
        return
    with cluster(scheduler, n_threads) as workers:
        yield workers


@contextmanager
def cluster(address: str, n_threads: int | None = None) -> Iterator[DaskWorkers]:
    """Yield the workers of a scheduler.

    Parameters
    ----------
    address : str
        Like `tcp://host:8786`; `local:N` starts N processes here, and stops them at the end.
    n_threads : int, optional
        Threads of each process that is started here, and that each piece of work may use; when not given,
        the cores of a machine are shared among its worker's threads.

    Raises
    ------
    InputError
        dask.distributed is missing, no such scheduler, no worker, or workers with other versions of the
        packages on which results depend.
    """
    distributed = _import_distributed()
    with _scheduler(distributed, address) as place:
        try:
            client = distributed.Client(place, timeout=_WAIT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(
                f"--scheduler {address}: no scheduler answers there ({error}); start one with "
                "`dask scheduler`, or take local:N"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=_WAIT_S)
            except TimeoutError as error:
                raise InputError(
                    f"--scheduler {address}: has no worker; start some with `dask worker {address}`"
                ) from error
            _check_versions(client, address)
            yield DaskWorkers(client, address, n_threads)


class DaskWorkers:
    """Workers of a connected dask.distributed client; `address` is its scheduler's, for errors."""

    def __init__(self, client: Any, address: str, n_threads: int | None) -> None:
        self.client, self._address, self._n_threads = client, address, n_threads

    def each(
        self, work: Work[Item, Result], items: Sequence[Item], keys: Sequence[str]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each item and its result, as they come.

        Raises
        ------
        InputError
            The scheduler was lost, or workers die whoever does a piece of the work.
        """
        distributed = _import_distributed()
        lost = _lost(distributed)
        held = _Bounds.here()
        futures = {
            self.client.submit(
                _on_worker, work, item, self._n_threads, held, key=f"unseen-{key}", retries=_DEATHS, pure=True
            ): number
            for number, (item, key) in enumerate(zip(items, keys, strict=True))
        }
        for future in distributed.as_completed(list(futures), loop=self.client.loop):
            number = futures.pop(future)
            try:
                result = future.result()
            except lost as error:
                raise InputError(
                    f"--scheduler {self._address}: a task failed repeatedly ({type(error).__name__}: "
                    f"{error}); what is done is kept: run the same command again to go on"
                ) from error
            yield number, result

    def together(
        self, work: Callable[[WorkerShare], str], *, known: Callable[[], int], lost: Callable[[int], None]
    ) -> None:
        """Have all workers do a piece of work together, until one comes to its end.

        Workers that come later take part, and one may die.

        Parameters
        ----------
        work : callable
            Sent to each worker: does what nobody else does, to the end of it all; returns what went wrong,
            or "".
        known : callable
            Tells how many steps of it are done; called again and again.
        lost : callable
            Called with the number of a worker that has died.

        Raises
        ------
        InputError
            What went wrong on a worker. The scheduler was lost, or all workers for long, or they die and no
            step is done meanwhile.
        """
        try:
            with _WorkerTasks(self.client, work, known, lost, self._n_threads) as shares:
                while not shares.are_done():
                    shares.renew()
        except _lost(_import_distributed()) as error:
            raise InputError(
                f"--scheduler {self._address}: a task failed repeatedly ({type(error).__name__}: {error}); "
                "what is done is kept: run the same command again to go on"
            ) from error


class _WorkerTasks:
    """The tasks of workers that do one piece of work together, one a worker."""

    def __init__(
        self,
        client: Any,
        work: Callable[[WorkerShare], str],
        known: Callable[[], int],
        lost: Callable[[int], None],
        n_threads: int | None,
    ) -> None:
        self._client, self._n_threads = client, n_threads
        self._work, self._known, self._lost = work, known, lost
        self._name, self._tasks = uuid4().hex, dict[str, tuple[int, Any]]()
        self._n_given = self._n_steps = self._n_dead = 0
        self._seen = time.monotonic()
        self.renew()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.cancel([task for _, task in self._tasks.values()], force=True)

    def renew(self) -> None:
        """Give workers that have come a task each, and note which have gone."""
        there = self._client.nthreads()
        now, known = time.monotonic(), self._known()
        if known > self._n_steps:
            self._n_steps, self._n_dead = known, 0
        for address in [task for task in self._tasks if task not in there]:
            self._lost(self._tasks.pop(address)[0])
            self._n_dead += 1
        if there:
            self._seen = now
        if self._n_dead > _DEATHS or now - self._seen > _WAIT_S:
            raise OSError(f"{self._n_dead} workers died, and {len(there)} are there")
        for address, n_threads in there.items():
            if address not in self._tasks:
                share = WorkerShare(self._n_given, self._n_threads or n_threads)
                held = _Bounds.here()
                key = f"unseen-{self._name}-{share.number}"
                task = self._client.submit(
                    _share_on_worker, self._work, share, held, key=key, workers=[address], pure=False
                )
                self._tasks[address] = share.number, task
                self._n_given += 1

    def are_done(self) -> bool:
        """Tell whether one has come to its end, after a moment where none has; raise what went wrong."""
        ended = [task for _, task in self._tasks.values() if task.status in ("finished", "error")]
        for task in ended:
            if message := task.result():
                raise InputError(message)
        if not ended:
            time.sleep(_TELL_S)
        return bool(ended)


@dataclass(frozen=True, slots=True)
class _Bounds:
    """Limits in force where work is given out, which hold for each worker that does it."""

    reading: Mapping[str, int]
    memory: int | None

    @classmethod
    def here(cls) -> _Bounds:
        return cls(current_limits().non_defaults(), planned_bytes())


def _share_on_worker(work: Callable[[WorkerShare], str], share: WorkerShare, held: _Bounds) -> str:
    """Do a worker's share under the limits in force here; errors of the input are told, not raised."""
    reuse_freed()
    with limits(**held.reading), memory_limit(held.memory):
        try:
            return work(share)
        except InputError as error:
            return str(error)


def _on_worker(work: Work[Item, Result], item: Item, n_threads: int | None, held: _Bounds) -> Result:
    """Do a piece of work on a worker, with its share of the machine's cores and the limits in force here."""
    if n_threads is None:
        n_threads = max(1, (os.cpu_count() or 1) // _worker_threads())
    reuse_freed()
    with limits(**held.reading), memory_limit(held.memory):
        return work(item, n_threads)


def _worker_threads() -> int:
    threads: int = _import_distributed().get_worker().state.nthreads
    return threads


@contextmanager
def _scheduler(distributed: ModuleType, address: str) -> Iterator[Any]:
    """Yield what a client connects to."""
    kind, _, number = address.partition(":")
    if kind != _LOCAL:
        yield address
        return
    if not (number.isascii() and number.isdigit() and int(number) > 0):
        raise InputError(f"--scheduler {address}: after local: comes the number of processes, like local:4")
    with distributed.LocalCluster(
        n_workers=int(number),
        threads_per_worker=1,
        processes=True,
        dashboard_address="127.0.0.1:0",
        host="127.0.0.1",
        silence_logs=logging.CRITICAL,
        memory_limit=0,
    ) as here:
        yield here


def _lost(distributed: ModuleType) -> tuple[type[BaseException], ...]:
    """What is raised where workers or their scheduler are gone."""
    return distributed.KilledWorker, distributed.CancelledError, OSError


def _check_versions(client: Any, address: str) -> None:
    """Raise where a worker has other versions than we."""
    versions_here = versions()
    for worker, remote_versions in client.run(versions).items():
        differ = [
            f"{name} {remote_versions.get(name)} for {mine}"
            for name, mine in versions_here.items()
            if remote_versions.get(name) != mine
        ]
        if differ:
            raise InputError(
                f"--scheduler {address}: worker {worker} has {', '.join(differ)}; results would depend "
                "on who works: install the same versions everywhere"
            )


def _import_distributed() -> ModuleType:
    try:
        import distributed
    except ImportError as error:
        raise InputError('--scheduler needs dask.distributed: pip install "unseen[cluster]"') from error
    module: ModuleType = distributed
    return module
