# SPDX-License-Identifier: MIT
"""Classes of the packages that the annotations of public names name, and all that these lead to."""

import ast
from collections.abc import Iterator
from functools import cache

from examples.plot_architecture import PACKAGES, ROOT, modules, tree_of

Place = tuple[str, str]
"""File and name of a class, a function or an alias."""
Definition = ast.ClassDef | ast.FunctionDef | ast.Assign | ast.AnnAssign


@cache
def _names_of(path: str) -> tuple[dict[str, Definition], dict[str, tuple[str, str]]]:
    """What a file defines, and what it imports from which module."""
    defined: dict[str, Definition] = {}
    for node in tree_of(path).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            defined[node.name] = node
        if isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            if isinstance(target, ast.Name):
                defined[target.id] = node
    imported = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    return defined, imported


def resolve(path: str, name: str) -> tuple[Place, Definition] | None:
    """Where a name that a file uses is defined; None outside of the packages."""
    defined, imported = _names_of(path)
    if name in defined:
        return (path, name), defined[name]
    module, other = imported.get(name, ("", ""))
    return resolve(modules()[module], other) if module in modules() else None


def exported() -> dict[tuple[str, str], tuple[Place, Definition]]:
    """The public names, by package and name."""
    found = {}
    for package in PACKAGES:
        for node in ast.parse((ROOT / package / "__init__.pyi").read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    held = resolve(modules()[f"{package}.{node.module}"], alias.name)
                    assert held is not None, alias.name
                    found[package, alias.name] = held
    return found


def _annotations(node: Definition) -> Iterator[ast.expr | None]:
    """Annotations of a function, of a class's public fields and methods, and what an alias stands for."""
    if isinstance(node, ast.FunctionDef):
        yield from (one.annotation for one in (*node.args.args, *node.args.kwonlyargs))
        yield node.returns
    elif isinstance(node, ast.ClassDef):
        for item in node.body:
            if isinstance(item, ast.FunctionDef) and not item.name.startswith("_"):
                yield from _annotations(item)
            if isinstance(item, ast.AnnAssign) and not ast.unparse(item.target).startswith("_"):
                yield item.annotation
    else:
        yield node.value


def named_by(place: Place, node: Definition, *, bases: bool = False) -> dict[Place, Definition]:
    """Definitions of the packages that the annotations of a definition name, and perhaps its bases."""
    above = node.bases if bases and isinstance(node, ast.ClassDef) else []
    words = {
        word.id
        for note in (*_annotations(node), *above)
        if note is not None
        for word in ast.walk(note)
        if isinstance(word, ast.Name)
    }
    return dict(held for word in words if (held := resolve(place[0], word)))


def reached() -> dict[Place, Definition]:
    """All that can be reached from the public names by annotations."""
    found: dict[Place, Definition] = {}
    todo = dict(exported().values())
    while todo:
        place, node = todo.popitem()
        found[place] = node
        todo |= {held: of for held, of in named_by(place, node, bases=True).items() if held not in found}
    return found
