# SPDX-License-Identifier: MIT
"""Arguments as text: numbers with commas, sizes, amounts of memory; what cannot be read is a usage error."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

import typer


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
    from scenes.run.file_limits import LIMIT_NAMES  # numpy comes with it, and is not needed to show help

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
