# SPDX-License-Identifier: MIT
"""Options of features: which kinds are sought, and values that a person gives, which are held exactly."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from completion.features.engine.template import Given, TemplateFit
from scenes.checks import InputError, Value, check_number
from scenes.io.checks.documents import read_json

OPENINGS = ("doorway", "window", "niche")
KNOWN_OF_OPENINGS = ("width", "height", "depth")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FeatureOptions(Value):
    """Which features completion makes use of.

    Attributes
    ----------
    kinds : tuple of str
        Some of "doorway", "window", "niche".
    given : mapping
        Known values of all of them: "width", "height", "depth", metres, each above 0; held exactly.
    stated : tuple of TemplateFit, optional
        Features that are known (`applied.file.read_features`): these are used, and none are sought.

    Raises
    ------
    InputError
        An unknown kind or name of a value; a value that is not above 0.
    """

    kinds: tuple[str, ...] = OPENINGS
    given: Mapping[str, float] = field(default_factory=dict)
    stated: tuple[TemplateFit, ...] | None = None

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in OPENINGS:
                raise InputError(f"completion uses features of kind {', '.join(OPENINGS)}, got {kind!r}")
        for name, value in self.given.items():
            if name not in KNOWN_OF_OPENINGS:
                names = ", ".join(KNOWN_OF_OPENINGS)
                raise InputError(f"{name} is no value of {', '.join(OPENINGS)}: {names}")
            if check_number(name, value, -np.inf) <= 0:
                raise InputError(f"{name} must be above 0, got {value}")


FITTED = FeatureOptions()
"""What `complete` makes use of when nobody says otherwise."""


KNOWN: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(OPENINGS, KNOWN_OF_OPENINGS),
    "stairs": ("going", "rise", "width", "count"),
    "column": ("width", "top", "radius"),
    "hole-row": ("count", "pitch", "radius"),
    "hole-grid": ("count", "count_2", "pitch", "pitch_2", "radius"),
    "bolt-circle": ("count", "circle_radius", "radius"),
    "junction": ("radius_1", "radius_2"),
    "elbow": ("bend_radius", "tube_radius", "angle"),
}
"""What may be given of each kind of feature; lengths in the unit of the input."""

_COUNTS, _MOST = ("count", "count_2"), 1000  # of holes, of steps


def read_given(path: str | os.PathLike[str], kinds: Sequence[str]) -> dict[str, Given]:
    """Return what a file says of each of some kinds.

    It is an object of numbers, which hold for all kinds that have them, or of such objects by kind:
    ``{"radius": 3.0}``, ``{"hole-row": {"count": 6, "pitch": 12.0}}``.

    Raises InputError: no such file, no JSON, a name or value that cannot be; the message names all three.
    """
    source = os.fspath(path)
    held = read_json(Path(source), dict)
    general = {name: value for name, value in held.items() if name not in KNOWN}
    allowed = {name for kind in kinds for name in KNOWN[kind]}
    for name in general:
        if name not in allowed:
            raise InputError(f"{source}: {name}: no option has this name; {_may_be(kinds)}")
    out: dict[str, Given] = {}
    for kind in kinds:
        given_values = held.get(kind, {})
        if not isinstance(given_values, Mapping):
            raise InputError(f"{source}: {kind}: must be an object of numbers; {_may_be([kind])}")
        for name in given_values:
            if name not in KNOWN[kind]:
                raise InputError(f"{source}: {kind}: {name} cannot be given; {_may_be([kind])}")
        merged = {**{n: v for n, v in general.items() if n in KNOWN[kind]}, **given_values}
        out[kind] = {name: _number(source, name, value) for name, value in merged.items()}
        for name in set(_COUNTS) & set(out[kind]):
            if not out[kind][name].is_integer() or not 2 <= out[kind][name] <= _MOST:
                sentence = f"must be a whole number from 2 to {_MOST}, got {merged[name]!r}"
                raise InputError(f"{source}: {name} {sentence}")
    return out


def _may_be(kinds: Sequence[str]) -> str:
    return "; ".join(f"of {kind} {', '.join(KNOWN[kind])}" for kind in kinds)


def _number(source: str, name: str, value: Any) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not np.isfinite(value) or value <= 0:
        raise InputError(f"{source}: {name} must be a number above 0, got {value!r}")
    return float(value)
