# SPDX-License-Identifier: MIT
"""Options that most commands share, with their names and help, and how each command takes them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from nbv.commands.process.run import Shared

if TYPE_CHECKING:
    from scenes.io.format import Units
    from scenes.io.scan_request import ScanRequest
    from scenes.scan.upright import SignedAxis


def parse_bytes(text: str, option: str) -> int:
    """Return the bytes that a text such as 2GB means.

    Examples
    --------
    >>> parse_bytes("2GB", "--max-memory"), parse_bytes("1.5 GiB", "--max-memory")
    (2000000000, 1610612736)
    """
    size = _amount(text)
    if size < 1:
        raise typer.BadParameter(f"{text!r} is no amount of memory; write it like 2GB", param_hint=option)
    return size


def _amount(text: str) -> int:
    """Return the number that digits with a suffix such as K, M, GB or GiB mean, 0 where they mean none."""
    match = re.fullmatch(r"\s*(\d{1,18}(?:\.\d{1,18})?)\s*([kMGT]?)(i?)B?\s*", text, re.IGNORECASE)
    if not match:
        return 0
    return int(float(match[1]) * (1024 if match[3] else 1000) ** " kmgt".index(match[2].lower() or " "))


def parse_limits(given: Iterable[str], option: str) -> Mapping[str, int]:
    """Return limits by name, of texts such as faces=100M; K, M, G and T stand for thousands and more.

    Examples
    --------
    >>> parse_limits(["faces=200M", "file_bytes=8GiB"], "--limit")
    {'faces': 200000000, 'file_bytes': 8589934592}
    """
    from scenes.io.limits import LIMIT_NAMES  # numpy comes with it, and is not needed to show help

    found: dict[str, int] = {}
    for text in given:
        name, _, number = text.partition("=")
        if name not in LIMIT_NAMES:
            raise typer.BadParameter(
                f"{name!r} is no limit; write NAME=NUMBER, NAME one of {', '.join(LIMIT_NAMES)}",
                param_hint=option,
            )
        found[name] = _amount(number)
        if found[name] < 1:
            raise typer.BadParameter(
                f"{number!r} is no number of 1 or more; write {name}=100M", param_hint=option
            )
    return found


def parse_numbers(text: str, n: int, option: str) -> tuple[float, ...]:
    """Return `n` finite numbers that are written with commas between them.

    Examples
    --------
    >>> parse_numbers("1,-2.5,3e1", 3, "--at")
    (1.0, -2.5, 30.0)
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != n or not all(math.isfinite(number) for number in numbers):
        raise typer.BadParameter(
            f"{text!r} is not {n} finite numbers with commas between them", param_hint=option
        )
    return numbers


def parse_choices(given: Iterable[str], known: Sequence[str], option: str) -> tuple[str, ...]:
    """Return what was given, each once, when all of it is known.

    Examples
    --------
    >>> parse_choices(["obj", "e57", "obj"], ("obj", "e57"), "--export")
    ('obj', 'e57')
    """
    for text in given:
        if text not in known:
            raise typer.BadParameter(f"{text!r} is none of {', '.join(known)}", param_hint=option)
    return tuple(dict.fromkeys(given))


def parse_shape(text: str, option: str) -> tuple[int, int]:
    """Return the rows and columns of a text such as 120x160.

    Examples
    --------
    >>> parse_shape("120x160", "--grow")
    (120, 160)
    """
    match = re.fullmatch(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})", text.strip())
    if not match:
        raise typer.BadParameter(f"{text!r} is no size; write HxW, like 120x160", param_hint=option)
    return int(match[1]), int(match[2])


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
        show_default="see docs/guides/bad-input.md",
    ),
]
SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A mesh file, or builtin:NAME.")]
SensorOption = Annotated[str, typer.Option("--sensor", help="A profile by name, or a TOML file.")]
NoiseOption = Annotated[
    str, typer.Option("--noise", help="none, gaussian-2mm, nguyen2012, ..., profile: the sensor's own.")
]
UpOption = Annotated[Literal["x", "y", "z"], typer.Option("--up", help="Axis of the file that is up.")]
ScanUpOption = Annotated[
    Literal["auto", "x", "y", "z", "-x", "-y", "-z"],
    typer.Option("--up", help="Axis of the files that is up; auto: estimated, and told."),
]
UnitsOption = Annotated[Literal["mm", "cm", "m", "in"], typer.Option("--units", help="Unit of the file.")]
Intrinsics = Annotated[
    str | None,
    typer.Option("--intrinsics", metavar="FX,FY,CX,CY", help="Of depth images, pixels.", show_default=False),
]
DepthScale = Annotated[
    float | None, typer.Option("--depth-scale", metavar="N", help="Depth values a unit.", show_default=False)
]
RegisterFlag = Annotated[
    bool, typer.Option("--register", help="Find the scans' poses first; what has none is left out.")
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

    These are `--out`, `--seed`, `--json`, `--quiet`, `--threads`, `--max-memory` and `--limit`.
    """
    return with_value(command, "shared", _SHARED, _shared)


def with_value(
    command: Given,
    name: str,
    options: Mapping[str, tuple[Any, Any]],
    make: Callable[..., object],
    *,
    after: str = "",
) -> Given:
    """Return a command that has some options, of which `command` takes one value under a name.

    Typer reads options off a function's signature; this writes one with the options, each a type hint and a
    default, `after` another parameter, or at the end. `make` returns the value that they mean.
    """
    hints = get_type_hints(command, include_extras=True)
    del hints["return"], hints[name]
    added = [
        Parameter(option, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=hint)
        for option, (hint, default) in options.items()
    ]
    own = signature(command).parameters

    def run(**given: Any) -> None:
        value = make(**{option: given.pop(option) for option in options})
        command(**{name: value}, **given)

    parameters = [own[one].replace(annotation=hint) for one, hint in hints.items()]
    place = list(hints).index(after) + 1 if after else len(parameters)
    parameters[place:place] = added
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__annotations__["return"] = None
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # functions may have one: PEP 362
    return run


def _shared(max_memory: str | None, limit: list[str] | None, **rest: Any) -> Shared:
    memory = None if max_memory is None else parse_bytes(max_memory, "--max-memory")
    return Shared(**rest, max_memory=memory, limits=parse_limits(limit or (), "--limit"))


_SHARED: dict[str, tuple[Any, Any]] = {
    "out": (Out, None),
    "seed": (Seed, 0),
    "as_json": (AsJson, False),
    "quiet": (Quiet, False),
    "threads": (Threads, None),
    "max_memory": (MaxMemory, None),
    "limit": (Limit, None),
}


def asked_scans(
    paths: Sequence[str] | None,
    intrinsics: str | None,
    depth_scale: float | None,
    poses: str | None,
    origin: Sequence[str] | None,
    units: Units,
    up: SignedAxis = "z",
) -> ScanRequest:
    """Return the scans that a command is given; what cannot be read is a usage error."""
    from scenes.io.scan_request import ScanRequest

    camera = None if intrinsics is None else parse_numbers(intrinsics, 4, "--intrinsics")
    stood = tuple(parse_numbers(text, 3, "--origin") for text in origin or ())
    return ScanRequest(tuple(paths or ()), camera, depth_scale, poses, units=units, origins=stood, up=up)
