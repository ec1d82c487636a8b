# SPDX-License-Identifier: MIT
"""Process of a command: outputs, progress, manifest, summary, interruption, and failure in one line."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from shutil import rmtree
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

from nbv.commands.options.shared import Shared
from nbv.commands.progress import Progress, shown_progress

if TYPE_CHECKING:
    from nbv.report.blocks.page import Page
    from nbv.run.manifest import Inputs, Stopwatch
    from scenes.run.atomic import Stage
    from scenes.run.journal import FileJournal

_NOT_ENOUGH = "not enough memory for this input; use a smaller one, coarser options, or a larger limit"
_JOURNAL = ".journal"  # in the output folder, of a run that is not finished


@dataclass(slots=True, eq=False, kw_only=True)
class Run:
    """One run of a command, whose outputs wait in `stage` until all are written, and appear at its end.

    `inputs` are what `read` has hashed, `kept` outputs that are in the folder already, by their names there,
    `waiting` whole ones elsewhere on its disk, which move there with those of `stage`, `costs` times and
    memory of parts, for the manifest.
    """

    command: str
    shared: Shared
    out: Path
    is_folder: bool
    watch: Stopwatch
    progress: Progress
    stage: Stage
    inputs: Inputs
    kept: dict[str, Path] = field(default_factory=dict)
    waiting: dict[str, Path] = field(default_factory=dict)
    costs: dict[str, Any] = field(default_factory=dict)

    def path(self, name: str = "") -> Path:
        """Return where to write an output; a command with one output file need not name it."""
        return self.stage.path(name or self.out.name)

    def read(self, inputs: Iterable[str]) -> None:
        """Hash the inputs, once for journal, report and manifest: paths and names as they were given."""
        from nbv.run.manifest import read_inputs

        self.inputs = read_inputs(inputs)

    def will_call(self, loop: Any, seconds: int) -> None:
        """Say that the first run on a machine compiles its loops, `loop` among them, and for how long."""
        if not (self.shared.quiet or self.shared.as_json) and is_cold(loop):
            sentence = f"compiling the inner loops for this machine, once: about {seconds} s"
            typer.echo(f"unseen {self.command}: {sentence}", err=True)

    def journal(self, options: Mapping[str, Any]) -> FileJournal:
        """Return what remembers the steps of a run made of the same that was killed; `keep` ends it."""
        from scenes.run.journal import FileJournal

        return FileJournal(self.progress_folder, self.key(options))

    def key(self, options: Mapping[str, Any]) -> str:
        """Return what the run is made of: the SHA-256 of command, versions, inputs, options and seed."""
        return self.inputs.key({"command": self.command, **options}, self.shared.seed)

    @property
    def progress_folder(self) -> Path:
        """Folder, in that of the outputs, of what a killed run goes on from; `keep` removes it."""
        return _progress_folder(self.out, is_folder=self.is_folder)

    def report(self, page: Page, options: Mapping[str, Any]) -> None:
        """Write the report, which names options, seed, and the inputs with their SHA-256."""
        sentence = replace(page, options=options, seed=self.shared.seed, inputs=self.inputs.digests())
        sentence.write(self.path("report.html"))

    def finish(self, options: Mapping[str, Any], summary: Mapping[str, Any], lines: Sequence[str]) -> None:
        """Write the manifest; print `summary` as JSON, or `lines` for people."""
        written = self.keep(options)
        self.say({**summary, "files": [str(file) for file in written]}, [*lines, f"written to {self.out}"])

    def keep(self, options: Mapping[str, Any]) -> list[Path]:
        """Write the manifest, put all outputs in place, and return their paths, the manifest's last."""
        from nbv.run.manifest import manifest_path, write_manifest

        manifest = manifest_path(self.out, is_folder=self.is_folder).name
        staged = {file.as_posix(): self.stage.folder / file for file in self.stage.files()}
        outputs = {**self.kept, **self.waiting, **staged}
        write_manifest(
            self.stage.path(manifest),
            command=self.command,
            seed=self.shared.seed,
            inputs=self.inputs,
            options={**options, "max_memory": self.shared.max_memory, "limits": dict(self.shared.limits)},
            threads=self.shared.threads,
            outputs=outputs,
            times={**self.watch.record(), **({"costs": self.costs} if self.costs else {})},
        )
        for name, file in self.waiting.items():
            file.replace(self.path(name))
        self.stage.commit(last=manifest)
        rmtree(self.progress_folder, ignore_errors=True)
        return [self.stage.target / name for name in [*outputs, manifest]]

    def warn(self, warnings: Iterable[str]) -> None:
        """Print what is doubtful about the input, a line each on stderr; nothing when quiet."""
        if not self.shared.quiet:
            for text in warnings:
                typer.echo(f"unseen {self.command}: warning: {' '.join(text.split())}", err=True)

    def say(self, summary: Mapping[str, Any], lines: Sequence[str]) -> None:
        """Print `summary` as one JSON object, or `lines` for people, or nothing when quiet."""
        if self.shared.as_json:
            from scenes.run.atomic import json_text

            typer.echo(json_text({"command": self.command, **summary}).rstrip())
        elif not self.shared.quiet:
            for line in lines:
                typer.echo(line)


@contextmanager
def start_run(
    command: str, shared: Shared, *, default: str, is_folder: bool, writes: bool = True
) -> Iterator[Run]:
    """Run a command: make its folder, show progress, turn unusable input into one line and exit code 1.

    A command that only prints passes `writes=False`: nothing is locked or staged then.
    """
    from nbv.run.manifest import Inputs, Stopwatch
    from scenes.checks import InputError
    from scenes.io.checks.limits import limits
    from scenes.run.atomic import Stage, hold_lock
    from scenes.run.memory import memory_limit

    watch, is_new = Stopwatch(), not (shared.out or Path(default)).exists()
    try:
        out = _make_folder(shared.out or Path(default), is_folder=is_folder)
        folder, name = (out, "") if is_folder else (out.parent, out.name)
        stage = Stage(folder, name)
        with ExitStack() as held:
            held.enter_context(limits(**shared.limits))
            held.enter_context(interruptible(command))
            hidden = shared.quiet or shared.as_json
            progress = held.enter_context(shown_progress(command, watch, hidden=hidden))
            if shared.max_memory is not None:
                _take_linear_algebra_buffers()
                held.enter_context(memory_limit(shared.max_memory, enforced=True))
            if writes:
                held.enter_context(hold_lock(folder, name))
                held.enter_context(stage)
            yield Run(
                command=command,
                shared=shared,
                out=out,
                is_folder=is_folder,
                watch=watch,
                progress=progress,
                stage=stage,
                inputs=Inputs(),
            )
    except (InputError, OSError) as error:
        if writes:
            _remove_traces(shared.out or Path(default), is_folder=is_folder, is_new=is_new)
        _fail(command, str(error))
    except MemoryError:
        _fail(command, _NOT_ENOUGH)


def is_cold(loop: Any) -> bool:
    """Tell whether a loop is still to be compiled: nothing of it lies where numba keeps compiled code.

    Parameters
    ----------
    loop : numba dispatcher
        A function compiled with a cache; of anything else it is not known, and False.
    """
    folder = getattr(getattr(loop, "stats", None), "cache_path", None)
    if not folder:
        return False
    stem = Path(loop.py_func.__code__.co_filename).stem
    return not any(Path(folder).glob(f"{stem}.{loop.py_func.__qualname__}-*.nbi"))


def _take_linear_algebra_buffers() -> None:
    """Have numpy and scipy take their 32 MB each for matrix products before a limit could refuse them."""
    import numpy as np
    from scipy.linalg import inv

    inv(np.eye(64) @ np.eye(64))  # OpenBLAS keeps its buffers; scipy's waits for ever for one it does not get


def _fail(command: str, message: str) -> None:
    """Print one line on stderr and exit with 1."""
    typer.echo(f"unseen {command}: {' '.join(message.split())}", err=True)
    raise typer.Exit(1)


def _make_folder(out: Path, *, is_folder: bool) -> Path:
    """Return `out`, made where it is a folder that does not exist yet."""
    from scenes.checks import InputError
    from scenes.run.atomic import make_folder

    if not is_folder:
        if out.is_dir():
            raise InputError(f"{out}: is a folder; name a file to write")
        if not out.parent.is_dir():
            raise InputError(f"{out}: there is no folder {out.parent}; make it first")
        return out
    make_folder(out)
    if not os.access(out, os.W_OK):
        raise InputError(f"{out}: cannot write to this folder")
    return out


def _progress_folder(out: Path, *, is_folder: bool) -> Path:
    return out / _JOURNAL if is_folder else out.with_name(f".{out.name}{_JOURNAL}")


def _remove_traces(out: Path, *, is_folder: bool, is_new: bool) -> None:
    """Remove a journal without a step, and the folder that this run made if nothing is in it."""
    from scenes.run.journal import is_blank

    journal = _progress_folder(out, is_folder=is_folder)
    if is_blank(journal):
        rmtree(journal, ignore_errors=True)
    if is_folder and is_new:
        with suppress(OSError):  # not empty, or never made
            out.rmdir()


class Interruption(KeyboardInterrupt):
    """A signal, by its number, that asks the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def interruptible(command: str) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM raise in the main thread; tell it in one line, exit with 128 + their number.

    Files are written whole or not at all, so that those of the run before are still there, or those of this
    one, and nothing in between.
    """
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {number: signal.signal(number, _raise) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    except (KeyboardInterrupt, SystemError) as error:
        cause = _keyboard_interrupt(error)
        if cause is None:
            raise
        number = cause.number if isinstance(cause, Interruption) else int(signal.SIGINT)
        name = signal.Signals(number).name
        handlers.clear()  # the process ends, and what else comes must not disturb that
        typer.echo(f"unseen {command}: ended by {name}; every file is whole: run it again to go on", err=True)
        raise typer.Exit(128 + number) from None
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def _keyboard_interrupt(error: BaseException | None) -> KeyboardInterrupt | None:
    """What interrupted, though native code that called back into Python made a SystemError of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _raise(number: int, _frame: FrameType | None) -> None:
    for other in (signal.SIGINT, signal.SIGTERM):  # once is enough: what is put away meanwhile shall be whole
        signal.signal(other, signal.SIG_IGN)
    raise Interruption(number)
