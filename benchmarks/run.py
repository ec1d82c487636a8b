# SPDX-License-Identifier: MIT
"""The runner: suites by name, their tables on the screen and in pages, results kept so that it resumes.

A suite is a function that yields the lines of its tables; its arguments are the options of the command line.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextvars import ContextVar
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.store import STORE, Store
from scenes.checks import InputError
from scenes.run.atomic import write_bytes

SUITES: dict[str, Callable[..., Iterator[str]]] = {}
SMALLEST: dict[str, list[str]] = {}  # options with which a suite is as small as it can be
_PAGE: ContextVar[Path | None] = ContextVar("page", default=None)
_MODULES = (
    "completion", "ledger", "together", "silence", "dimensions", "buildings", "relations", "panels",
    "room_surfaces", "registration", "alignment", "openings", "holes", "junctions", "evolution",
    "flattening", "segmentation", "parts", "part_dimensions", "blends", "textures", "views", "speed",
    "free_space", "confidence", "hidden_by_other_scans", "online", "bunny", "survey", "paper_study",
    "walks", "asbuilt", "asbuilt_real", "next_stations", "placement", "profiles", "model_meshes",
    "bulk_scans", "object_views", "aware_views", "backs", "things", "covered_things", "review",
    "part_backs",
)  # fmt: skip
app = typer.Typer(add_completion=False, no_args_is_help=True, help="Benchmarks of unseen; see docs/guides.")
_suites = typer.Typer(add_completion=False, no_args_is_help=True)
app.add_typer(_suites, name="run", help="Run one suite and print its tables.")


def suite(
    name: str, smallest: str = ""
) -> Callable[[Callable[..., Iterator[str]]], Callable[..., Iterator[str]]]:
    """Make a function that yields lines a suite with this name; `smallest`: options of its smallest run."""

    def register(function: Callable[..., Iterator[str]]) -> Callable[..., Iterator[str]]:
        SUITES[name] = function
        SMALLEST[name] = shlex.split(smallest)

        @wraps(function)
        def command(*given: Any, **options: Any) -> None:
            _run(name, function(*given, **options))

        _suites.command(name)(command)
        return function

    return register


@_suites.callback()
def options(
    context: typer.Context,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of kept results.")] = Path(
        "out/benchmarks"
    ),
    page: Annotated[Path | None, typer.Option(help="Also write the tables to this Markdown page.")] = None,
    fresh: Annotated[bool, typer.Option(help="Neither read nor keep results.")] = False,
) -> None:
    """Run one suite; results that are in the folder are not measured again."""
    _PAGE.set(page)
    STORE.set(Store(None if fresh else out / str(context.invoked_subcommand)))


@app.command("list")
def listed() -> None:
    """List the suites."""
    for name, function in SUITES.items():
        print(f"{name:21} {str(function.__doc__).splitlines()[0]}")


@app.command()
def smallest(names: Annotated[list[str] | None, typer.Argument(help="Suites; all if none.")] = None) -> None:
    """Run suites as small as they can be, without keeping results: whether they work, not what they show.

    Raises InputError: no suite of that name.
    """
    for name in names or SUITES:
        if name not in SUITES:
            raise InputError(f"there is no suite {name}; there are {', '.join(SUITES)}")
        print(f"\n{shlex.join([name, *SMALLEST[name]])}")
        try:
            app(["run", "--fresh", name, *SMALLEST[name]], standalone_mode=False)
        except ModuleNotFoundError as lack:
            print(f"not run to its end: {lack.name} is not installed (python -m pip install -e '.[bench]')")


def _run(name: str, lines: Iterable[str]) -> None:
    """Print the lines as they come; put them into the page where there is one."""
    printed = []
    for line in lines:
        print(line, flush=True)
        printed.append(line)
    for line in STORE.get().lines():
        print(line, file=sys.stderr)
    page = _PAGE.get()
    if page is not None:
        title = str(SUITES[name].__doc__).splitlines()[0].rstrip(".")
        command = "python -m benchmarks run " + shlex.join(_without_page(sys.argv[2:]))
        write_section(page, name, f"## {title}\n\n`{command}`\n\n" + "\n".join(printed))


def _without_page(words: Sequence[str]) -> list[str]:
    """The words of a command line without `--page FILE` and `--out FOLDER`."""
    kept = list(words)
    for option in ("--page", "--out", "-o"):
        if option in kept:
            del kept[kept.index(option) : kept.index(option) + 2]
    return kept


def write_section(page: Path, name: str, text: str) -> None:
    """Put `text` between the marks of `name` on a Markdown page; at its end where there are none yet."""
    begin, end = f"<!-- {name}: written by the benchmark, do not edit -->", f"<!-- end of {name} -->"
    held = page.read_text("utf-8") if page.exists() else f"# Results: {page.stem}\n"
    block = f"{begin}\n\n{text.strip()}\n\n{end}"
    if begin in held:
        before, rest = held.split(begin, 1)
        held = before + block + rest.split(end, 1)[1]
    else:
        held = f"{held.rstrip()}\n\n{block}\n"
    page.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(page, held.encode())


def head(*cells: str) -> Iterator[str]:
    """Yield the two lines of a table's head, from its cells or from all of them with " | " between.

    Examples
    --------
    >>> list(head("", "n"))
    ['|  | n |', '|---|---|']
    >>> list(head(" | n"))
    ['|  | n |', '|---|---|']
    """
    if len(cells) == 1:
        cells = tuple(cells[0].split(" | "))
    yield row(*cells)
    yield "|" + "---|" * len(cells)


def row(*cells: object) -> str:
    """Return a line of a table; None and NaN are "-".

    Examples
    --------
    >>> row("office", 3, None, 0.25)
    '| office | 3 | - | 0.25 |'
    """
    texts = ("-" if cell is None or cell != cell else str(cell) for cell in cells)
    return f"| {' | '.join(texts)} |"


def load_suites() -> None:
    """Import all suites."""
    for name in _MODULES:
        import_module(f"benchmarks.suites.{name}")


def main(words: Sequence[str] | None = None) -> None:
    """Run the command line."""
    load_suites()
    app(list(words) if words is not None else None, prog_name="python -m benchmarks")
