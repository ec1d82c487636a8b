# SPDX-License-Identifier: MIT
"""Run: what all commands share: output, progress, manifest, summary, and failure in one line."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nbv.commands.headroom import reserve
from nbv.commands.interruption import interruptible
from nbv.commands.starvation import NOT_ENOUGH, is_starved

if TYPE_CHECKING:
    from nbv.manifest import Stopwatch

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True, slots=True)
class Shared:
    """Options that every command has.

    Attributes
    ----------
    out : Path, optional
        Folder or file to write; the command's default when not given.
    seed : int
        Of everything random.
    as_json : bool
        Print one JSON object on stdout and nothing else there.
    quiet : bool
        Print nothing.
    threads : int, optional
        Threads; one for each core when not given. Results do not depend on it.
    max_memory : int, optional
        Bytes.
    """

    out: Path | None
    seed: int
    as_json: bool
    quiet: bool
    threads: int | None
    max_memory: int | None


@dataclass(slots=True, eq=False)
class Run:
    """One run of a command; `costs` are times and memory of its parts, for the manifest."""

    command: str
    shared: Shared
    out: Path
    is_folder: bool
    watch: Stopwatch
    progress: Progress
    outputs: list[Path] = field(default_factory=list)
    costs: dict[str, Any] = field(default_factory=dict)

    def path(self, name: str) -> Path:
        """Return the path of an output in the folder, and remember it for the manifest."""
        self.outputs.append(self.out / name)
        return self.outputs[-1]

    def finish(
        self,
        inputs: Sequence[str],
        options: Mapping[str, Any],
        summary: Mapping[str, Any],
        lines: Sequence[str],
    ) -> None:
        """Write the manifest; print `summary` as JSON, or `lines` for people."""
        where = self.keep(inputs, options)
        written = [str(file) for file in [*self.outputs, where]]
        self.say({**summary, "files": written}, [*lines, f"written to {self.out}"])

    def keep(self, inputs: Sequence[str], options: Mapping[str, Any]) -> Path:
        """Write the manifest and return its path."""
        from nbv.manifest import manifest_path, write_manifest

        where = manifest_path(self.out, is_folder=self.is_folder)
        write_manifest(
            where,
            command=self.command,
            seed=self.shared.seed,
            inputs=inputs,
            options={**options, "max_memory": self.shared.max_memory},
            threads=self.shared.threads,
            outputs=self.outputs,
            times={**self.watch.record(), **({"costs": self.costs} if self.costs else {})},
        )
        return where

    def warn(self, warnings: Iterable[str]) -> None:
        """Print what is doubtful about the input, a line each on stderr; nothing when quiet."""
        if not self.shared.quiet:
            for text in warnings:
                typer.echo(f"unseen {self.command}: warning: {' '.join(text.split())}", err=True)

    def say(self, summary: Mapping[str, Any], lines: Sequence[str]) -> None:
        """Print `summary` as one JSON object, or `lines` for people, or nothing when quiet."""
        if self.shared.as_json:
            from scenes.atomic import json_text

            typer.echo(json_text({"command": self.command, **summary}).rstrip())
        elif not self.shared.quiet:
            for line in lines:
                typer.echo(line)


@contextmanager
def running(command: str, shared: Shared, *, default: str, is_folder: bool) -> Iterator[Run]:
    """Run a command: make its folder, show progress, turn unusable input into one line and exit code 1."""
    from completion.fitting.result import FitError
    from nbv.manifest import Stopwatch
    from scenes.checks import InputError
    from scenes.lock import locked
    from scenes.memory import memory_limit

    watch = Stopwatch()
    try:
        out = _prepared(shared.out or Path(default), is_folder=is_folder)
        guard = locked(out) if is_folder else nullcontext()
        if shared.max_memory is not None:
            reserve(shared.threads or os.cpu_count() or 1)
        memory = memory_limit(shared.max_memory, enforced=True)
        with interruptible(command), guard, memory, _progress(shared, watch) as progress:
            yield Run(command, shared, out, is_folder, watch, progress)
    except (InputError, FitError, OSError) as error:
        _fail(command, str(error))
    except Exception as error:
        if not is_starved(error):
            raise
        _fail(command, NOT_ENOUGH)


def _fail(command: str, message: str) -> None:
    """Print one line on stderr and exit with 1."""
    typer.echo(f"unseen {command}: {' '.join(message.split())}", err=True)
    raise typer.Exit(1)


def _prepared(out: Path, *, is_folder: bool) -> Path:
    """Return `out`, made where it is a folder that does not exist yet."""
    from scenes.checks import InputError

    if not is_folder:
        if out.is_dir():
            raise InputError(f"{out}: is a folder; name a file to write")
        if not out.parent.is_dir():
            raise InputError(f"{out}: there is no folder {out.parent}; make it first")
        return out
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot make this folder: {error.strerror}") from error
    if not os.access(out, os.W_OK):
        raise InputError(f"{out}: cannot write to this folder")
    return out


@contextmanager
def _progress(shared: Shared, watch: Stopwatch) -> Iterator[Progress]:
    """Yield a progress callback that times stages, and draws them on stderr where that is a terminal."""
    if shared.quiet or shared.as_json or not sys.stderr.isatty():
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
