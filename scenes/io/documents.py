# SPDX-License-Identifier: MIT
"""Documents: JSON and TOML of strangers, held to a size, a depth and to numbers that can be reckoned with."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from scenes.checks import InputError
from scenes.io.guard import check_file, reading
from scenes.io.limits import check_limit

_MOST_DIGITS = 18  # of an integer: what fits into 63 bits
_HALF = re.compile(r"\\u[dD][89a-fA-F]")  # half of a pair that stands for one letter
_SUSPECT = re.compile(r"\d{19}|\d[eE]\+?\d{3}")  # may be a number that is too large: each is looked at
_WORDS = {dict: "an object {...}", list: "a list [...]"}
Kind = TypeVar("Kind", dict[str, Any], list[Any])


def read_text(path: Path, limit: str = "json_bytes") -> str:
    """Return the text of a file, UTF-8 with or without a byte order mark.

    `limit` is the field of `scenes.io.limits.Limits` that its bytes are held against. Raises
    InputError: as `check_file`, or bytes that are no UTF-8.
    """
    file = check_file(path, limit)
    try:
        return file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no UTF-8 text: its byte {error.start} begins no letter") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def read_json(path: Path, kind: type[Kind]) -> Kind:
    """Return the object (`dict`) or list (`list`) of a JSON file.

    Raises InputError: as `read_text` and `parse_json`; the message names the file.
    """
    with reading(path, "JSON"):
        return parse_json(read_text(path), kind)


def parse_json(text: str | bytes, kind: type[Kind]) -> Kind:
    """Return the object or list that a JSON text holds.

    Raises InputError: too large, no JSON, of another kind, nested too deeply, or with a number that is not
    finite, that has more than 18 digits, or with half a letter in a text.
    """
    check_limit("json_bytes", len(text), "bytes of JSON")
    try:
        known = text if isinstance(text, str) else text.decode("utf-8-sig")
        hooks = _SLOW if _SUSPECT.search(known) else {}
        value = json.loads(known, parse_constant=_refuse_constant, **hooks)
    except RecursionError as error:
        raise InputError("is no usable JSON: it is nested too deeply") from error
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"is no valid JSON: {error}") from error
    if not isinstance(value, kind):
        raise InputError(f"is JSON, but not {_WORDS[kind]}: it is {_named(value)}")
    if _HALF.search(known):
        _check_letters(value)
    return value


def _refuse_constant(word: str) -> NoReturn:
    raise InputError(f"is no valid JSON: it holds {word}; write null for what is not known")


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise InputError(f"holds the number {digits[:40]}, which is too large")
    return number


def _within_63_bits(digits: str) -> int:
    if len(digits.lstrip("-")) > _MOST_DIGITS:
        raise InputError(f"holds an integer of {len(digits.lstrip('-'))} digits; at most 18 are read")
    return int(digits)


def _named(value: object) -> str:
    if isinstance(value, dict | list):
        return _WORDS[type(value)]
    return "null" if value is None else f"the {type(value).__name__} {str(value)[:40]!r}"


def _check_letters(value: Any) -> None:
    """Raise where a text holds half of a pair, which no file can be written with."""
    try:
        json.dumps(value, ensure_ascii=False).encode("utf-8")
    except UnicodeEncodeError as error:
        raise InputError(f"holds \\u{ord(error.object[error.start]):04x}, which is half a letter") from error


_SLOW: dict[str, Any] = {"parse_float": _finite, "parse_int": _within_63_bits}


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file.

    Raises InputError: as `read_text`, no TOML, or nested too deeply; the message names the file.
    """
    text = read_text(path, "toml_bytes")
    with reading(path, "TOML"):
        return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """Return the table that a TOML text holds; raises InputError as `read_toml`."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise InputError("is no usable TOML: it is nested too deeply") from error
    except ValueError as error:  # no TOML, integers of thousands of digits, dates that are none
        raise InputError(f"is not TOML: {error}") from error
