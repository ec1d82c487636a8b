# SPDX-License-Identifier: MIT
"""Option: a field of a dataclass that a person can set, declared once with its help text, default and limits.

The command line (`nbv.cli`), the fields of study files (`nbv.study.spec`) and the checks of
calls from Python (`check_limits`) are made from these declarations. Nothing slow is imported here: commands
show their help before they import their work.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

Parse = Callable[[Any], Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberRange:
    """Range of a number, both ends included, `above` apart: a least value that is itself excluded."""

    least: float | None = None
    most: float | None = None
    above: float | None = None


NOT_NEGATIVE = NumberRange(least=0)
POSITIVE = NumberRange(above=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """How the command line shows and reads a field.

    Attributes
    ----------
    help : str
        One phrase, unit included.
    flags : str
        Its name on the command line, several with spaces between; "" for an argument without a name.
    metavar : str, optional
        What stands for its value in help; typer's choice when not given.
    shown : str or bool
        The default in help: as it is (True), not at all (False), or a text in its place.
    limits : Limits
        Range of a number.
    parse : callable, optional
        Makes the value from the text, or from the list of texts of a repeated option; raises ValueError.
    is_repeated : bool
        Whether it may be given more than once.
    is_negated : bool
        Whether the flag sets the field to False.
    section : str
        Where help shows it: input, method, output or run.
    """

    help: str
    flags: str
    metavar: str | None = None
    shown: str | bool = True
    limits: NumberRange = NumberRange()
    parse: Parse | None = None
    is_repeated: bool = False
    is_negated: bool = False
    section: str = "method"


def option(flags: str, help: str, default: Any, **more: Any) -> Any:  # noqa: A002  # as typer calls it
    """Return a dataclass field that is an option; `more` are further fields of `Option`."""
    return field(default=default, metadata={"option": Option(flags=flags, help=help, **more)})


def argument(metavar: str, help: str, **more: Any) -> Any:  # noqa: A002
    """Return a dataclass field that is an argument without a name, required unless `default` is given."""
    default = {"default": more.pop("default")} if "default" in more else {}
    return field(**default, metadata={"option": Option(flags="", metavar=metavar, help=help, **more)})


def group(kind: type, without: Sequence[str] = ()) -> Any:
    """Return a dataclass field that holds the options of another dataclass, some left at their defaults."""
    return field(default_factory=kind, metadata={"group": kind, "without": tuple(without)})


def declared_options(kind: type) -> dict[str, Option]:
    """Return the options that a dataclass declares itself, by the names of its fields."""
    if not is_dataclass(kind):
        raise TypeError(f"expected a dataclass, got {kind}")
    return {entry.name: entry.metadata["option"] for entry in fields(kind) if "option" in entry.metadata}


def check_limits(options: Any) -> None:
    """Raise InputError for a number of `options` outside the limits that are declared for it.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Steps:
    ...     step_m: float = option("--step", "Length of a step.", 1.0, limits=NOT_NEGATIVE)
    >>> check_limits(Steps(-1.0))
    Traceback (most recent call last):
    scenes.checks.InputError: step_m must be 0 or more, got -1.0
    """
    from scenes.checks import InputError, check_number  # numpy comes with it, which help does without

    for name, declared in declared_options(type(options)).items():
        value, limits = getattr(options, name), declared.limits
        if value is None or limits == NumberRange():
            continue
        bounds = [end for end in (limits.least, limits.above) if end is not None]
        most = math.inf if limits.most is None else limits.most
        check_number(name, value, max(bounds, default=-math.inf), most)
        if limits.above is not None and value <= limits.above:
            raise InputError(f"{name} must be above {limits.above:g}, got {value}")


def numbers(n: int, *, above: float | None = None) -> Parse:
    """Return a parser of `n` finite numbers with commas or spaces between, of as many as there are for n = 0.

    Examples
    --------
    >>> numbers(3)("1,-2.5,3e1"), numbers(3)("1 1 1.6")
    ((1.0, -2.5, 30.0), (1.0, 1.0, 1.6))
    """

    def parse(text: str) -> tuple[float, ...]:
        parts = re.split(r"\s*[,;]\s*|\s+", text.strip(" ()[]"))
        wanted = n or len(parts)
        try:
            values = tuple(float(part) for part in parts)
        except ValueError:
            values = ()
        if len(values) != wanted or not all(math.isfinite(value) for value in values):
            example = ",".join(f"{1 + k / 2:g}" for k in range(wanted))
            raise ValueError(
                f"{text!r} is not {wanted} finite numbers with commas between them; write it like {example}"
            )
        if above is not None and min(values) <= above:
            raise ValueError(f"every value must be above {above:g}, got {min(values):g}")
        return values

    return parse


def minutes(text: str) -> float:
    """Return the minutes of a text; plain numbers are minutes.

    Examples
    --------
    >>> [minutes(text) for text in ("2h", "90 min", "1h30", "1:30", "45")]
    [120.0, 90.0, 90.0, 90.0, 45.0]
    """
    plain = text.replace(" ", "").lower()
    clock = re.fullmatch(r"(\d+)(?::|h)([0-5]?\d)(?:min|m)?", plain)
    single = re.fullmatch(r"(\d+(?:\.\d+)?)(h|min|m|s)?", plain)
    value = 0.0
    if clock is not None:
        value = 60.0 * int(clock[1]) + int(clock[2])
    elif single is not None:
        value = float(single[1]) * {"h": 60.0, "s": 1 / 60}.get(single[2] or "min", 1.0)
    if not value > 0:
        raise ValueError(f"{text!r} is no time; write 2h, 90min, 1h30 or 1:30")
    return value


def each(parse: Parse) -> Parse:
    """Return a parser of a repeated option's texts, one value for each."""
    return lambda texts: tuple(parse(text) for text in texts)


def choices(known: Sequence[str], separator: str = "") -> Parse:
    """Return a parser of names that are all known, each kept once; a separator may stand between several.

    Examples
    --------
    >>> choices(("obj", "e57"))(["obj", "e57", "obj"])
    ('obj', 'e57')
    """

    def parse(texts: Sequence[str]) -> tuple[str, ...]:
        parts = [part.strip() for text in texts for part in text.split(separator)] if separator else texts
        for part in parts:
            if part not in known:
                raise ValueError(f"{part!r} is none of {', '.join(known)}")
        return tuple(dict.fromkeys(parts))

    return parse
