# SPDX-License-Identifier: MIT
"""What was typed: earlier names made today's, values put right or refused with what to write instead."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import typer

from scenes.run.option import Option

OLD_NAMES: Mapping[str, Mapping[str, str]] = {
    "check": {"--registration": "--registration-sd"},
    "complete": {
        "--mode": "--inference", "--only": "--kinds", "--max-sd": "--inferred-sd", "--tolerance": "--rely",
        "--registration": "--registration-sd", "--no-texture": "--texture=off",
    },
    "part": {"--noise": "--sigma"},
    "plan": {"--plan": "--before", "--stations": "--views"},
    "register": {"--start": "--poses"},
}  # fmt: skip
"""Earlier names of options by command: help does not show them, and they still work."""
_UNITS = {
    **dict.fromkeys(("millimetre", "millimeter"), "mm"), **dict.fromkeys(("centimetre", "centimeter"), "cm"),
    **dict.fromkeys(("metre", "meter"), "m"), "inch": "in", "inche": "in", '"': "in", "foot": "ft",
    "feet": "ft", "'": "ft",
}  # fmt: skip
_LIKE = {
    "M": "metres, like 0.05", "M2": "square metres, like 0.05", "DEG": "degrees, like 30",
    "MIN": "minutes, like 3", "S": "seconds, like 60", "HZ": "turns a second, like 10",
    "M/S": "metres a second, like 1",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Typed:
    """How the value of an option is typed: one of some words, a number, or a text that it reads itself."""

    declared: Option
    words: tuple[str, ...] = ()
    number: type | None = None

    @classmethod
    def of(cls, declared: Option, hint: Any) -> Typed:
        """Return how an option of a type is typed; `hint` is that of its field, None allowed beside it."""
        if declared.parse is not None or declared.is_repeated:
            return cls(declared)
        kinds = [one for kind in get_args(hint) or (hint,) for one in get_args(kind) or (kind,)]
        words = tuple(kind for kind in kinds if isinstance(kind, str))
        return cls(declared, words, next((kind for kind in (int, float) if kind in kinds), None))

    def put_right(self, name: str, value: str) -> str:
        """Return a value as it is written here; a usage error for none of the words, or no number."""
        if self.words:
            plain = value.strip().lower()
            known = {word.lower(): word for word in self.words}
            found = known.get(plain, known.get(_UNITS.get(plain.rstrip("s"), "")))
            if found is None:
                raise typer.BadParameter(f"{value!r} is none of {', '.join(self.words)}", param_hint=name)
            return found
        if self.number is not None:
            try:
                self.number(value)
            except ValueError:
                plain = "a whole number, like 3" if self.number is int else "a number, like 0.5"
                like = _LIKE.get(self.declared.metavar or "", plain)
                raise typer.BadParameter(f"{value!r} is no number; write {like}", param_hint=name) from None
        return value

    @property
    def most_numbers(self) -> float:
        """How many numbers with commas between them it takes at most; 1 for other values."""
        shape = self.declared.metavar or ""
        return math.inf if ",..." in shape else shape.count(",") + 1


def put_right(
    tokens: Sequence[str], options: Mapping[str, Typed], old: Mapping[str, str] | None = None
) -> list[str]:
    """Return what was typed after a command with today's names and with values as they are written here.

    `options` take a value, by their names; `old` has today's names by earlier ones. Raises
    `typer.BadParameter` for a value that is none of the words of its option, or no number.

    Examples
    --------
    >>> at = Typed(Option(help="Position.", flags="--at", metavar="X,Y,Z"))
    >>> put_right(["room.glb", "--place", "1", "1", "1.6"], {"--at": at}, {"--place": "--at"})
    ['room.glb', '--at', '1,1,1.6']
    """
    left, done = list(tokens), list[str]()
    while left:
        token = left.pop(0)
        if token == "--":
            return [*done, token, *left]
        name, equals, value = token.partition("=")
        name = (old or {}).get(name, name)
        option = options.get(name)
        if option is None or not (equals or left):
            done.append(name + equals + value)
            continue
        numbers = [value if equals else left.pop(0)]
        while left and len(numbers) < option.most_numbers and _is_number(numbers[0]) and _is_number(left[0]):
            numbers.append(left.pop(0))
        done += [name, option.put_right(name, ",".join(numbers))]
    return done


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
