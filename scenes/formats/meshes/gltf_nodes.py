# SPDX-License-Identifier: MIT
"""Nodes of glTF: which meshes are placed how often, if the nodes make a tree; entries of its JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scenes.checks import InputError
from scenes.run.file_limits import check_limit

Content = Mapping[str, Any]
_DEEPEST = 256  # nodes within each other: a drawing program's own limit lies below
_PARTS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


def placed_meshes(content: Content, n_meshes: int) -> dict[int, int]:
    """Return how often each of `n_meshes` meshes is placed in the scene that is shown.

    Raises
    ------
    InputError
        A node that hangs on two others or in a circle, too deep, moved by what are no numbers, or with a
        mesh that is not there.
    """
    nodes, scenes = entry_list(content, "nodes"), entry_list(content, "scenes")
    if not scenes:
        return {}
    shown = scenes[entry_number(content, "scene", "it", 0, most=len(scenes))]
    times: dict[int, int] = {}
    seen: set[int] = set()
    level, depth = _numbers(shown, "nodes", "its scene", len(nodes)), 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise InputError(f"its nodes lie within each other more than {_DEEPEST} deep")
        below: list[int] = []
        for number in level:
            if number in seen:
                raise InputError(f"node {number} hangs on two others, or in a circle")
            seen.add(number)
            _check_node(nodes[number], number)
            below += _numbers(nodes[number], "children", f"node {number}", len(nodes))
            if "mesh" in nodes[number]:
                mesh = entry_number(nodes[number], "mesh", f"node {number}", most=n_meshes)
                times[mesh] = times.get(mesh, 0) + 1
        level = below
    return times


def _numbers(entry: Any, name: str, what: str, most: int) -> list[int]:
    held = entry.get(name, []) if isinstance(entry, dict) else None
    if not isinstance(held, list):
        raise InputError(f"{what} has no list of {name}")
    return [entry_number({name: one}, name, what, most=most) for one in held]


def _check_node(node: Any, number: int) -> None:
    """Raise where what moves a node is no list of numbers of the right length."""
    if not isinstance(node, dict):
        raise InputError(f"node {number} is no object")
    for name, length in _PARTS.items():
        values = node.get(name, [0.0] * length)
        if not isinstance(values, list) or len(values) != length or not all(map(_is_number, values)):
            raise InputError(f"node {number} has a {name} that is not {length} numbers")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def entry_list(content: Content, name: str) -> list[Any]:
    """Return a list of the JSON, empty where it has none; InputError for other things and long lists."""
    held = content.get(name, [])
    if not isinstance(held, list):
        raise InputError(f"its {name} are no list")
    check_limit("entries", len(held), f"its {name}")
    return held


def entry_number(
    entry: Any, name: str, what: str, default: int | None = None, most: int | None = None
) -> int:
    """Return an integer entry of 0 or more, and below `most` where that is given."""
    if not isinstance(entry, dict):
        raise InputError(f"{what} is no object")
    value = entry.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InputError(f"{what} has the {name} {value!r}; an integer of 0 or more is needed")
    if most is not None and value >= most:
        raise InputError(f"{what} names {name} {value}, but there are {most}")
    return value
