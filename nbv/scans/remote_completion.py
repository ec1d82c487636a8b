# SPDX-License-Identifier: MIT
"""Remote completion: workers complete scans together, by a journal in a folder that all of them see.

Every worker reads the scans and runs the whole of `complete`, and in each stage does the steps that nobody
has done or claimed: it goes through the same stages at the same pace as the others, and reads what those came
to. Paths, options and a seed are sent, and nothing comes back: all results are in the journal, from which the
completion is then put together here, step by step in order, as after a run that was killed.

Who does a step claims it first, by a file that only one process can make, and releases it once the step is
kept. Each process beats: it counts on in a file of its own. A claim whose owner has not beaten for long is
taken over. Should two do the same step all the same, both come to the same bytes.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import rmtree
from threading import Event, Lock, Thread
from typing import TypeVar
from uuid import uuid4

from completion.options import CompletionOptions
from completion.pipeline import complete, complete_first
from nbv.run.workers import WorkerShare, cluster
from scenes.checks import InputError
from scenes.io.scan_files import split_index
from scenes.io.scan_request import ScanRequest, read_request
from scenes.run.atomic import make_folder, write_json
from scenes.run.journal import FileJournal
from scenes.run.mapping import mapped_in

_CLAIMS = "claims"
_STAGE = "stage.json"  # among them
_BEAT_S = 2.0
_SILENT_S = 30.0  # without a beat: fifteen of them are missing
_POLL_S = 0.05  # between looks at a step that another does
_GOLDEN = 0.6180339887498949  # its multiples, without their whole parts, lie far from each other
_Value = TypeVar("_Value")


class Claims:
    """Who does which step of a journal, as files in a folder that all see; `number` is this process's own.

    Raises
    ------
    InputError
        There is no such folder, or (later) it is gone: who asked for the run has called it off.
    """

    def __init__(self, journal: Path, number: int) -> None:
        self.number, self._folder = number, journal / _CLAIMS
        self._owner = f"{number} {uuid4().hex}"
        self._last: dict[
            str, tuple[str, float]
        ] = {}  # of each owner: its last beat, and when it was new here
        self._lock, self._end = Lock(), Event()

    @classmethod
    @contextmanager
    def allow(cls, journal: Path) -> Iterator[None]:
        """Let claims be made, meanwhile; what was claimed before is free."""
        rmtree(journal / _CLAIMS, ignore_errors=True)
        make_folder(journal / _CLAIMS)
        try:
            yield
        finally:
            rmtree(journal / _CLAIMS, ignore_errors=True)

    @contextmanager
    def keep_alive(self) -> Iterator[None]:
        """Tell the others, meanwhile, that this process lives; what its number claimed before is free."""
        let_go(self._folder.parent, self.number)
        self._beat(0)
        beats = Thread(target=self._beats, daemon=True)
        beats.start()
        try:
            yield
        finally:
            self._end.set()
            beats.join()

    def take(self, name: str) -> bool:
        """Claim a step; False where another lives and has it."""
        for _ in range(2):
            try:
                with self._file(name).open("x") as stream:
                    stream.write(self._owner)
            except FileExistsError:
                if not self._is_free(name):
                    return False
                self._file(name).unlink(missing_ok=True)
            except OSError as error:
                raise InputError(f"{self._folder}: the run was called off, or its folder is gone") from error
            else:
                return True
        return False

    def release(self, name: str) -> None:
        """Let go of a step."""
        with suppress(OSError):
            self._file(name).unlink()

    def tell(self, stage: str, n_steps: int) -> None:
        """Say to which stage, of how many steps, this process has come; `stage_of` tells the last."""
        with suppress(InputError):
            write_json(self._folder / _STAGE, [stage, n_steps])

    def _is_free(self, name: str) -> bool:
        """Whether who claimed a step has let go of it, or was silent for long."""
        try:
            owner = self._file(name).read_text()
        except OSError:
            return True
        try:
            beat = self._beat_file(owner).read_text()
        except OSError:
            beat = ""
        now = time.monotonic()
        with self._lock:
            before, since = self._last.get(owner, (None, now))
            if beat != before:
                since = now
            self._last[owner] = (beat, since)
        return now - since > _SILENT_S

    def _beats(self) -> None:
        count = 0
        while not self._end.wait(_BEAT_S):
            count += 1
            self._beat(count)

    def _beat(self, count: int) -> None:
        with suppress(OSError):  # of a run that was called off
            self._beat_file(self._owner).write_text(str(count))

    def _beat_file(self, owner: str) -> Path:
        return self._folder / f"{owner.partition(' ')[2]}.beat"

    def _file(self, name: str) -> Path:
        return self._folder / f"{name}.claim"


def let_go(journal: Path, number: int) -> None:
    """Free all steps that the process of this number claimed: it is dead."""
    for file in (journal / _CLAIMS).glob("*.claim"):
        with suppress(OSError):
            if file.read_text().partition(" ")[0] == str(number):
                file.unlink()


def stage_of(journal: Path) -> tuple[str, int, int] | None:
    """Return the stage that the processes are at, and how many of its steps are done, of how many."""
    try:
        stage, n_steps = json.loads((journal / _CLAIMS / _STAGE).read_text())
    except (OSError, ValueError):
        return None
    return stage, len(list(journal.glob(f"{stage}-*.npz"))), n_steps


class SharedJournal(FileJournal):
    """A journal that others write, too; each step is done by one of them.

    Parameters
    ----------
    folder : Path
        That of a journal which is there already.
    key : str
        What it was made of.
    claims : Claims
        Those of this process.
    prefix : str
        Of the names of its steps among the claims.

    Raises
    ------
    InputError
        The folder does not hold a journal of this key: it is not the one that the others see.
    """

    def __init__(self, folder: Path, key: str, claims: Claims, prefix: str = "") -> None:
        self.folder, self.key = folder, key
        self._claims, self._prefix = claims, prefix
        if self._key() != key:
            raise InputError(
                f"{folder}: a worker does not find the run's journal there; all must see the output folder "
                "under the same path, on a disk that they share"
            )

    def turn(self, n_steps: int) -> Sequence[int]:
        """Return all numbers below `n_steps`, each process from a place of its own on."""
        start = int(self._claims.number * _GOLDEN % 1.0 * n_steps)
        return [*range(start, n_steps), *range(start)]

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do a step, unless it is known or another does it."""
        if not self._file(name).exists() and self._claims.take(self._prefix + name):
            self._done(name, work)

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to, once whoever does it has; it is done here where nobody does."""
        while not self._file(name).exists():
            if self._claims.take(self._prefix + name):
                return self._done(name, work)
            time.sleep(_POLL_S)
        return super().step(name, work)

    def part(self, name: str) -> SharedJournal:
        """Return the journal of a part of the run, which is there already."""
        return SharedJournal(self.folder / name, self.key, self._claims, f"{self._prefix}{name}.")

    def _done(self, name: str, work: Callable[[], _Value]) -> _Value:
        try:
            return super().step(name, work)
        finally:
            self._claims.release(self._prefix + name)


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
    scratch : str, optional
        Where workers keep large arrays; None for their own folder of temporary files.
    """

    scans: ScanRequest
    sizes: tuple[tuple[str, int], ...]
    options: CompletionOptions
    seed: int
    journal: str
    key: str
    scratch: str | None = None

    def work(self, share: WorkerShare) -> str:
        """Do, on a worker, the steps that nobody else does; return what went wrong, or ""."""
        folder = Path(self.journal)
        claims = Claims(folder, share.number)
        journal = SharedJournal(folder, self.key, claims)
        self._check_sizes()
        with ExitStack() as held:
            held.enter_context(claims.keep_alive())
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
        scratch=str(folder) if scheduler.startswith("local:") else None,
    )

    def count_steps() -> int:
        at = stage_of(folder)
        if at is not None and progress is not None:
            progress(*at)
        return sum(1 for _ in folder.rglob("*.npz"))

    with cluster(scheduler, n_threads) as workers, Claims.allow(folder):
        workers.together(task.work, known=count_steps, lost=lambda number: let_go(folder, number))


def _absolute(request: ScanRequest) -> ScanRequest:
    """Return a request that means the same in any working directory."""
    paths = tuple(str(Path(path).absolute()) for path in request.paths)
    poses, trajectory = (
        None if file is None else str(Path(file).absolute()) for file in (request.poses, request.trajectory)
    )
    return replace(request, paths=paths, poses=poses, trajectory=trajectory)


def _sizes(request: ScanRequest) -> tuple[tuple[str, int], ...]:
    """Absolute paths and bytes of the files among the scans; folders are left out."""
    bases = [split_index(path)[0] for path in request.paths]
    bases += [Path(file) for file in (request.poses, request.trajectory) if file]
    return tuple(
        (str(base.absolute()), base.stat().st_size) for base in dict.fromkeys(bases) if base.is_file()
    )
