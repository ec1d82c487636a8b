# SPDX-License-Identifier: MIT
"""Options that most commands share, with their names and help, and how each command takes them."""

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import typer

from nbv.commands.options.arguments import parse_bytes, parse_limits
from nbv.commands.process.run import Shared

Out = Annotated[Path | None, typer.Option("--out", "-o", help="Folder or file to write.", show_default=False)]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, nothing else there.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")]
Threads = Annotated[
    int | None,
    typer.Option("--threads", min=1, help="Threads; results do not depend on it.", show_default="all cores"),
]
MaxMemory = Annotated[
    str | None,
    typer.Option(
        "--max-memory", metavar="SIZE", help="Like 2GB; results do not depend on it.", show_default="no limit"
    ),
]
Limit = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=NUMBER",
        help="How large what a file holds may be, like faces=200M; repeat it.",
        show_default="see docs/bad-input.md",
    ),
]
SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A mesh file, or builtin:NAME.")]
SensorOption = Annotated[str, typer.Option("--sensor", help="A profile by name, or a TOML file.")]
NoiseOption = Annotated[
    str, typer.Option("--noise", help="none, gaussian-2mm, nguyen2012, ..., profile: the sensor's own.")
]
UpOption = Annotated[Literal["x", "y", "z"], typer.Option("--up", help="Axis of the file that is up.")]
UnitsOption = Annotated[Literal["mm", "cm", "m", "in"], typer.Option("--units", help="Unit of the file.")]
Intrinsics = Annotated[
    str | None,
    typer.Option("--intrinsics", metavar="FX,FY,CX,CY", help="Of depth images, pixels.", show_default=False),
]
DepthScale = Annotated[
    float | None, typer.Option("--depth-scale", metavar="N", help="Depth values a unit.", show_default=False)
]
Poses = Annotated[
    str | None,
    typer.Option("--poses", metavar="FILE", help="World from sensor, one a scan.", show_default=False),
]
Origins = Annotated[
    list[str] | None,
    typer.Option(
        "--origin",
        metavar="X,Y,Z",
        help="Where the scanner stood, for files of mere points; repeat it for each.",
        show_default="from the files",
    ),
]

Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Of a dask.distributed scheduler, or local:N for N processes here.",
        show_default="this process",
    ),
]

Given = Callable[..., None]


def with_shared(command: Given) -> Given:
    """Return a command that also has the options which all have; `command` takes them as `shared`.

    Typer reads options off a function's signature; this writes one with `--out`, `--seed`, `--json`,
    `--quiet`, `--threads`, `--max-memory` and `--limit` in the place of `shared`.
    """
    hints = get_type_hints(command, include_extras=True)
    del hints["shared"], hints["return"]
    own = signature(command).parameters

    def run(**given: Any) -> None:
        command(_shared(**{name: given.pop(name) for name in _SHARED}), **given)

    kept = [own[name].replace(annotation=hint) for name, hint in hints.items()]
    added = [
        Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=hint)
        for name, (hint, default) in _SHARED.items()
    ]
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {**hints, **{name: hint for name, (hint, _) in _SHARED.items()}}
    run.__signature__ = Signature([*kept, *added])  # type: ignore[attr-defined]  # functions may have one: PEP 362
    return run


def _shared(
    out: Path | None,
    seed: int,
    as_json: bool,
    quiet: bool,
    threads: int | None,
    max_memory: str | None,
    limit: list[str] | None,
) -> Shared:
    return Shared(
        out=out,
        seed=seed,
        as_json=as_json,
        quiet=quiet,
        threads=threads,
        max_memory=None if max_memory is None else parse_bytes(max_memory, "--max-memory"),
        limits=parse_limits(limit or (), "--limit"),
    )


_SHARED: dict[str, tuple[Any, Any]] = {
    "out": (Out, None),
    "seed": (Seed, 0),
    "as_json": (AsJson, False),
    "quiet": (Quiet, False),
    "threads": (Threads, None),
    "max_memory": (MaxMemory, None),
    "limit": (Limit, None),
}
