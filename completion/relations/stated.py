# SPDX-License-Identifier: MIT
"""Stated relations: what a person says that surfaces are to each other, in a file or in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from completion.edits.edit import Anchor
from completion.edits.file import anchors_of, named_anchor
from completion.relations.engine.relation import KINDS, VALUED, Relation, RelationKind
from scenes.checks import InputError
from scenes.io.documents import parse_json, read_text
from scenes.io.guard import reading

FORMAT = "unseen-relations/1"
_ANGLES = ("angle", "half_angle")
_FIELDS = ("type", "surfaces", "value", "forbidden", "note")
_Named = TypeVar("_Named")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StatedRelation(Generic[_Named]):
    """What a person says that surfaces are, or are not, to each other.

    Attributes
    ----------
    kind : str
        See `Relation`.
    surfaces : tuple
        Which: anchors of scans, labels (int) of a part.
    value : float, optional
        Metres or radians; see `Relation`.
    is_forbidden : bool
        Whether it does not hold.
    source : str
        Where it was said, for messages.
    """

    kind: RelationKind
    surfaces: tuple[_Named, ...]
    value: float | None = None
    is_forbidden: bool = False
    source: str = "a stated relation"

    def of(self, numbers: Sequence[int]) -> Relation:
        """Return it as a relation of surfaces by their numbers from 0.

        Raises InputError, with where it was said: a kind or number of surfaces that does not go with it.
        """
        try:
            return Relation(
                kind=self.kind,
                surfaces=tuple(numbers),
                value=self.value,
                is_given=True,
                is_forbidden=self.is_forbidden,
            )
        except InputError as error:
            raise InputError(f"{self.source}: {error}") from error


def read_scan_relations(path: str | PathLike[str]) -> tuple[StatedRelation[Anchor], ...]:
    """Return the relations of a JSON file whose surfaces are places of scans, as `read_edits` takes them.

    Raises InputError: not such a file; the message names the file, the relation and the cure.
    """

    def named(held: Mapping[str, Any]) -> Callable[[object, str], Anchor]:
        anchors = anchors_of(held.get("surfaces", []))
        return lambda name, source: named_anchor(name, anchors, source)

    return _read(path, named)


def read_part_relations(path: str | PathLike[str]) -> tuple[StatedRelation[int], ...]:
    """Return the relations of a JSON file whose surfaces are labels of a part.

    Raises InputError: not such a file; the message names the file, the relation and the cure.
    """

    def label(name: object, source: str) -> int:
        if not isinstance(name, int) or isinstance(name, bool) or name < 1:
            raise InputError(f"{source}: surfaces are labels, whole numbers from 1; got {name!r}")
        return name

    return _read(path, lambda _: label)


def _read(
    path: str | PathLike[str], naming: Callable[[Mapping[str, Any]], Callable[[object, str], _Named]]
) -> tuple[StatedRelation[_Named], ...]:
    file = Path(path)
    with reading(file, "a file of relations (JSON)"):
        text = read_text(file)
        is_list = text.lstrip().startswith("[")
        document = {"relations": parse_json(text, list)} if is_list else parse_json(text, dict)
        if document.get("format", FORMAT) != FORMAT:
            raise InputError(f'its format is {document["format"]!r}; write "format": "{FORMAT}"')
        if document.get("units", "m") != "m":
            raise InputError(f'its units are {document["units"]!r}; values are in metres: write "units": "m"')
        relations = document.get("relations")
        if not isinstance(relations, list):
            raise InputError('holds no list "relations"; write [{"type": "parallel", "surfaces": [1, 2]}]')
        name = naming(document)
        every = [
            _stated(one, name, f"{file}: relation {number}") for number, one in enumerate(relations, start=1)
        ]
        return tuple(one for one in every if one is not None)


def _stated(one: object, name: Callable[[object, str], _Named], source: str) -> StatedRelation[_Named] | None:
    """A relation of a file; None where it was written by `unseen`, which found that it does not hold."""
    if not isinstance(one, dict) or one.get("type") not in KINDS:
        said = f", not {one['type']!r}" if isinstance(one, dict) and "type" in one else ""
        raise InputError(f'{source}: needs a "type" of {", ".join(KINDS)}{said}')
    strange = [field for field in one if field not in _KNOWN]
    if strange:
        raise InputError(f"{source}: a relation knows no {strange[0]!r}, only {', '.join(_FIELDS)}")
    if one.get("status") in ("rejected", "undecided") and not one.get("given"):
        return None
    kind, surfaces, value = one["type"], one.get("surfaces"), one.get("value")
    if not isinstance(surfaces, list):
        raise InputError(f'{source}: "surfaces" are a list, got {surfaces!r}')
    if value is not None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f'{source}: "value" is a number, got {value!r}')
        value = None if kind not in VALUED else float(np.radians(value)) if kind in _ANGLES else float(value)
    forbidden = one.get("forbidden", False)
    if not isinstance(forbidden, bool):
        raise InputError(f'{source}: "forbidden" is true or false, got {forbidden!r}')
    return StatedRelation(
        kind=kind,
        surfaces=tuple(name(some, source) for some in surfaces),
        value=value,
        is_forbidden=forbidden,
        source=source,
    )


_WRITTEN = ("status", "p", "log_evidence", "given", "reason", "conflicts", "before", "after",
            "spacing_m", "mirror")  # fmt: skip
_KNOWN = (*_FIELDS, *_WRITTEN)
