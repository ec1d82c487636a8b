# SPDX-License-Identifier: MIT
"""Parsing of what is typed for an option: memory, limits, tolerances, sizes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from scenes.run.option import numbers

POSE_SD_DEG = 0.006
"""Standard deviation of a pose's angle where a person states only that of its position."""
_MOST_TOLERANCE_M = 1.0


def parse_bytes(text: str) -> int:
    """Return the bytes that a text such as 2GB means.

    Examples
    --------
    >>> parse_bytes("2GB"), parse_bytes("1.5 GiB")
    (2000000000, 1610612736)
    """
    size = _amount(text)
    if size < 1:
        raise ValueError(f"{text!r} is no amount of memory; write it like 2GB")
    return size


def _amount(text: str) -> int:
    """Return the number that digits with a suffix such as K, M, GB or GiB mean, 0 where they mean none."""
    match = re.fullmatch(r"\s*(\d{1,18}(?:\.\d{1,18})?)\s*([kMGT]?)(i?)B?\s*", text, re.IGNORECASE)
    if not match:
        return 0
    return int(float(match[1]) * (1024 if match[3] else 1000) ** " kmgt".index(match[2].lower() or " "))


def parse_limits(texts: Iterable[str]) -> Mapping[str, int]:
    """Return limits by name, of texts such as faces=100M; K, M, G and T stand for thousands and more.

    Examples
    --------
    >>> parse_limits(["faces=200M", "file_bytes=8GiB"])
    {'faces': 200000000, 'file_bytes': 8589934592}
    """
    from scenes.io.checks.limits import LIMIT_NAMES  # numpy comes with it, and is not needed to show help

    limits: dict[str, int] = {}
    for text in texts:
        name, _, number = text.partition("=")
        if name not in LIMIT_NAMES:
            raise ValueError(f"{name!r} is no limit; write NAME=NUMBER, NAME one of {', '.join(LIMIT_NAMES)}")
        limits[name] = _amount(number)
        if limits[name] < 1:
            raise ValueError(f"{number!r} is no number of 1 or more; write {name}=100M")
    return limits


def parse_tolerances(texts: Iterable[str]) -> Mapping[str, float]:
    """Return tolerances in metres by pattern, "" for the one of all other elements.

    Examples
    --------
    >>> parse_tolerances(["0.01", "IfcDoor*=0.005"])
    {'': 0.01, 'IfcDoor*': 0.005}
    """
    tolerances: dict[str, float] = {}
    for text in texts:
        pattern, _, number = text.rpartition("=")
        try:
            tolerance = float(number)
        except ValueError:
            tolerance = 0.0
        if not 0 < tolerance <= _MOST_TOLERANCE_M:
            raise ValueError(
                f"{number!r} is no tolerance above 0 and up to {_MOST_TOLERANCE_M:g} m; write 0.010, or "
                "IfcDoor*=0.005"
            )
        tolerances[pattern] = tolerance
    return tolerances


def parse_shape(text: str) -> tuple[int, int]:
    """Return the rows and columns of a text such as 120x160.

    Examples
    --------
    >>> parse_shape("120x160")
    (120, 160)
    """
    match = re.fullmatch(r"([1-9]\d{0,4})[xX]([1-9]\d{0,4})", text.strip())
    if not match:
        raise ValueError(f"{text!r} is no size; write HxW, like 120x160")
    return int(match[1]), int(match[2])


def parse_registration(text: str) -> tuple[float, float]:
    """Return metres and degrees, both 0 or more, of a text such as 0.002,0.006; degrees may be left out.

    Examples
    --------
    >>> parse_registration("0.004,0.01"), parse_registration("0.004")
    ((0.004, 0.01), (0.004, 0.006))
    """
    given = numbers(0)(text)
    if len(given) > 2 or min(given) < 0:
        raise ValueError(f"{text!r} is no M,DEG, both 0 or more; write it like 0.002,0.006")
    return given[0], given[1] if len(given) == 2 else POSE_SD_DEG


def record_of(options: Any, *, files: Iterable[str] = (), without: Iterable[str] = ()) -> dict[str, Any]:
    """Return options by name for manifest and report, those of groups among them, files without folders."""
    files, without = set(files), set(without)
    record: dict[str, Any] = {}
    for entry in fields(options):
        value = getattr(options, entry.name)
        if entry.name in without:
            continue
        if "group" in entry.metadata:
            record |= record_of(value, files=files, without=without)
        else:
            record[entry.name] = Path(value).name if entry.name in files and value else value
    return record
