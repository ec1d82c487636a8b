# SPDX-License-Identifier: MIT
"""STEP text: entities with numbers and values as ISO 10303-21 writes them, clear text encoding."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_DIGITS = 9  # behind the point of lengths in metres
_GUID = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$"


@dataclass(frozen=True, slots=True)
class Ref:
    """An entity that was written, by its number."""

    number: int


@dataclass(frozen=True, slots=True)
class Word:
    """A value of an enumeration; * is derived from others."""

    name: str


@dataclass(frozen=True, slots=True)
class Typed:
    """A value with its type, where several are allowed."""

    name: str
    value: Value


Value = Ref | Word | Typed | str | float | int | bool | None | Sequence["Value"]


class StepText:
    """Entities as they are added; equal ones without an identifier of their own are written once.

    Parameters
    ----------
    content : bytes
        What identifiers derive from: the same content gives the same ones.
    """

    def __init__(self, content: bytes) -> None:
        self._content = hashlib.sha256(content).digest()
        self._lines: list[str] = []
        self._known: dict[str, Ref] = {}
        self._keys: set[str] = set()

    def add(self, name: str, values: Sequence[Value], *, alone: bool = False) -> Ref:
        """Return an entity of a type with the values of its attributes, in the order of the schema.

        One that is `alone` is shared with no other of the same values.
        """
        line = f"{name.upper()}({','.join(map(_encoded, values))})"
        if alone or line not in self._known:
            self._lines.append(line)
            self._known[line] = Ref(len(self._lines))
        return self._known[line]

    def guid(self, key: str) -> str:
        """Return the GlobalId (22 characters) that belongs to a key, which may be used once.

        Raises
        ------
        ValueError
            A key that was used already.
        """
        if key in self._keys:
            raise ValueError(f"{key!r} has an identifier already")
        self._keys.add(key)
        number = int.from_bytes(hashlib.sha256(self._content + key.encode()).digest()[:16])
        return "".join(_GUID[(number >> shift) & 63] for shift in range(126, -1, -6))

    def text(self, name: str, schema: str) -> str:
        """Return the whole file, which has a name but no date and no author."""
        head = [
            "ISO-10303-21;",
            "HEADER;",
            "FILE_DESCRIPTION(('ViewDefinition [NotYetAssigned]'),'2;1');",
            f"FILE_NAME({_encoded(name)},'',(''),(''),'unseen','unseen','');",
            f"FILE_SCHEMA(({_encoded(schema)}));",
            "ENDSEC;",
            "DATA;",
        ]
        body = [f"#{number}={line};" for number, line in enumerate(self._lines, start=1)]
        return "\n".join([*head, *body, "ENDSEC;", "END-ISO-10303-21;", ""])


def _encoded(value: Value) -> str:
    """A value as text."""
    match value:
        case None:
            return "$"
        case Ref():
            return f"#{value.number}"
        case Word():
            return value.name if value.name == "*" else f".{value.name}."
        case Typed():
            return f"{value.name.upper()}({_encoded(value.value)})"
        case bool():
            return ".T." if value else ".F."
        case int() | np.integer():
            return str(int(value))
        case float() | np.floating():
            return _real(float(value))
        case str():
            return f"'{_characters(value)}'"
        case _:
            return f"({','.join(map(_encoded, value))})"


def _real(value: float) -> str:
    """A number with a point, which must be finite."""
    if not np.isfinite(value):
        raise ValueError(f"STEP files hold finite numbers, got {value}")
    text = repr(round(value, _DIGITS) + 0.0)
    if "e" in text:
        mantissa, power = text.split("e")
        return f"{mantissa if '.' in mantissa else mantissa + '.'}E{power}"
    return text.removesuffix("0") if text.endswith(".0") else text


def _characters(text: str) -> str:
    """Characters beyond ASCII by their codes; apostrophes and backslashes twice."""
    found = []
    for character in text:
        if character in "'\\":
            found.append(2 * character)
        elif 32 <= ord(character) < 127:
            found.append(character)
        else:
            found.append(f"\\X2\\{character.encode('utf-16-be').hex().upper()}\\X0\\")
    return "".join(found)
