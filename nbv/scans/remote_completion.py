# SPDX-License-Identifier: MIT
"""Remote completion: workers complete scans together, by a journal in a folder that all of them see.

Every worker reads the scans and runs the whole of `complete`, and in each stage does the steps that nobody
has done or claimed: it goes through the same stages at the same pace as the others, and reads what those came
to. Paths, options and a seed are sent, and nothing comes back: all results are in the journal, from which the
completion is then put together here, step by step in order, as after a run that was killed.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from completion.options import CompletionOptions
from completion.pipeline import complete, complete_first
from nbv.run.workers import Share, cluster
from scenes.checks import InputError
from scenes.io.scan_files import split_index
from scenes.io.scan_request import ScanRequest, read_request
from scenes.run.journal import FileJournal
from scenes.run.mapping import mapped_in
from scenes.run.memory import memory_limit
from scenes.run.shared_journal import Claims, SharedJournal, let_go, stage_of

Progress = Callable[[str, int, int], None]
_FIRST = "first"  # the part of the journal in which the first scan is completed alone


@dataclass(frozen=True, slots=True, kw_only=True)
class CompletionTask:
    """A completion as it is sent to workers.

    Attributes
    ----------
    scans : ScanRequest
        Which scans; absolute paths.
    sizes : tuple of (str, int)
        The files among them, and the bytes that they have here.
    options : CompletionOptions
        What to do.
    seed : int
        Of the textures.
    journal, key : str
        The journal's folder, absolute, and what it is made of.
    max_memory : int, optional
        Bytes of each worker.
    scratch : str, optional
        Where workers keep large arrays; None for their own folder of temporary files.
    """

    scans: ScanRequest
    sizes: tuple[tuple[str, int], ...]
    options: CompletionOptions
    seed: int
    journal: str
    key: str
    max_memory: int | None = None
    scratch: str | None = None

    def work(self, share: Share) -> str:
        """Do, on a worker, the steps that nobody else does; return what went wrong, or ""."""
        folder = Path(self.journal)
        claims = Claims(folder, share.number)
        journal = SharedJournal(folder, self.key, claims)
        self._check_sizes()
        with ExitStack() as held:
            held.enter_context(memory_limit(self.max_memory))
            held.enter_context(claims.beating())
            if self.scratch is not None:
                held.enter_context(mapped_in(Path(self.scratch)))
            scans = read_request(self.scans).scans
            options, n_threads = self.options, share.n_threads

            def tell(stage: str, done: int, total: int) -> None:
                if done == 0:
                    claims.tell(stage, total)

            try:
                completion = complete(
                    scans, options, rng=self.seed, n_threads=n_threads, progress=tell, journal=journal
                )
                if len(scans) > 1:
                    complete_first(completion, options, n_threads=n_threads, journal=journal.part(_FIRST))
            except MemoryError:
                return "a worker has not enough memory for this input; give it fewer threads, or more memory"
        return ""

    def _check_sizes(self) -> None:
        """Raise InputError where a worker sees other files than the client."""
        for path, size in self.sizes:
            if not Path(path).is_file() or Path(path).stat().st_size != size:
                raise InputError(
                    f"{path}: a worker does not see this file as it is here; all must see the scans under "
                    "the same path, on a disk that they share"
                )


def complete_by_workers(
    scheduler: str,
    request: ScanRequest,
    options: CompletionOptions,
    journal: FileJournal,
    *,
    seed: int = 0,
    n_threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Have workers do the steps of a completion; `complete` then finds all of them in the journal.

    Parameters
    ----------
    scheduler : str
        Address of a dask.distributed scheduler, or `local:N` for N processes here.
    request : ScanRequest
        The scans, and how to read them; workers read them under the same paths.
    options : CompletionOptions
        What to do.
    journal : FileJournal
        In a folder that all workers see under the same path.
    seed : int
        Of the textures.
    n_threads : int, optional
        Threads of each worker; those that dask gives it when not given.
    max_memory : int, optional
        Bytes that each worker plans for.
    progress : callable, optional
        Called with a stage's name, steps done by all and steps in all.

    Raises
    ------
    InputError
        No such scheduler or no worker there; one that does not see the scans or the journal, or cannot use
        them; the scheduler or all workers were lost.
    """
    folder = journal.folder.resolve()
    journal.part(_FIRST)  # is made once, here
    task = CompletionTask(
        scans=_absolute(request),
        sizes=_sizes(request),
        options=options,
        seed=seed,
        journal=str(folder),
        key=journal.key,
        max_memory=max_memory,
        scratch=str(folder) if scheduler.startswith("local:") else None,
    )

    def known() -> int:
        at = stage_of(folder)
        if at is not None and progress is not None:
            progress(*at)
        return sum(1 for _ in folder.rglob("*.npz"))

    with cluster(scheduler, n_threads) as workers, Claims.opened(folder):
        workers.together(task.work, known=known, lost=lambda number: let_go(folder, number))


def _absolute(request: ScanRequest) -> ScanRequest:
    """Return a request that means the same in any working directory."""
    poses = None if request.poses is None else str(Path(request.poses).absolute())
    return replace(request, paths=tuple(str(Path(path).absolute()) for path in request.paths), poses=poses)


def _sizes(request: ScanRequest) -> tuple[tuple[str, int], ...]:
    """Absolute paths and bytes of the files among the scans; folders are left out."""
    bases = [split_index(path)[0] for path in request.paths] + (
        [Path(request.poses)] if request.poses else []
    )
    return tuple(
        (str(base.absolute()), base.stat().st_size) for base in dict.fromkeys(bases) if base.is_file()
    )
