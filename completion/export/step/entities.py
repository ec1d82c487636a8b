# SPDX-License-Identifier: MIT
"""Entities: the lines of a STEP file, in an order that follows from their content.

The kernel orders the colours of products by addresses in memory and numbers occurrences on from file to file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import count

_STRING = r"'(?:[^']|'')*'"
_ENTITY = re.compile(rf"#(\d+) = ((?:{_STRING}|[^';])*);\n")
_TOKEN = re.compile(rf"({_STRING})|\s+")
_REFERENCE = re.compile(rf"({_STRING})|#(\d+)")
_OCCURRENCE = re.compile(r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\()'\d+'")
_STYLES = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION("


def in_order(text: str) -> str:
    """Return a STEP file as the kernel writes it with its styles in the order of what they are of.

    Occurrences of products are counted from 1, and an entity is a line.
    """
    begin = text.index("DATA;\n") + len("DATA;\n")
    end = text.rindex("ENDSEC;")
    numbered = count(1)
    entities = dict[int, str]()
    for found in _ENTITY.finditer(text, begin, end):
        line = _TOKEN.sub(
            lambda token: (token[1] or "").replace("\n", ""), found[2]
        )  # strings are broken, too
        entities[int(found[1])] = _OCCURRENCE.sub(lambda part: f"{part[1]}'{next(numbered)}'", line)
    first = min((number for number, entity in entities.items() if entity.startswith(_STYLES)), default=0)
    late = {number: entity for number, entity in entities.items() if first and number >= first}
    referred = {other for entity in late.values() for other in _references(entity)}
    walks = [list(_walk(number, late)) for number in late if number not in referred]
    walks.sort(key=lambda walk: _key(walk, late))
    order = dict.fromkeys(number for walk in walks for number in walk)
    new = {number: first + place for place, number in enumerate(order)}
    lines = [f"#{number} = {entity};\n" for number, entity in entities.items() if number not in late]
    lines += [f"#{new[number]} = {_renumbered(late[number], new)};\n" for number in order]
    return f"{text[:begin]}{''.join(lines)}{text[end:]}"


def _references(entity: str) -> list[int]:
    """Numbers of the entities that one refers to, in their order."""
    return [int(found[2]) for found in _REFERENCE.finditer(entity) if found[2]]


def _walk(number: int, late: Mapping[int, str]) -> Iterator[int]:
    """An entity, and all late ones that it refers to, each after the first that does."""
    todo, done = [number], set[int]()
    while todo:
        at = todo.pop()
        if at in late and at not in done:
            done.add(at)
            yield at
            todo += reversed(_references(late[at]))


def _key(walk: list[int], late: Mapping[int, str]) -> tuple[str, list[int]]:
    """What orders what is reached from one late entity: its kind, and the earlier entities that it is of."""
    kind = late[walk[0]].partition("(")[0]
    return kind, [other for number in walk for other in _references(late[number]) if other not in late]


def _renumbered(entity: str, new: Mapping[int, int]) -> str:
    return _REFERENCE.sub(lambda found: found[1] or f"#{new.get(int(found[2]), int(found[2]))}", entity)
