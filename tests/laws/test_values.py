# SPDX-License-Identifier: MIT
"""Frozen values that the packages' faces offer: no array in them can be written."""

import ast
from pathlib import Path

from examples.plot_architecture import PACKAGES, ROOT, modules, tree_of

MAKERS = ("ArrayValue", "frozen_copy", "freeze_arrays", "frozen_pixels", "setflags", "flags.writeable")
"""What a value is, or does while it is made, so that its arrays are read-only."""


ALSO = {"Extent", "PartFile", "RawPoints", "PointTable", "InferredPoints"}
"""Values inside the packages that the law holds for besides those on the faces."""


def frozen_classes() -> dict[str, tuple[str, ast.ClassDef]]:
    """Frozen dataclasses of the packages by name, with their files."""
    held: dict[str, tuple[str, ast.ClassDef]] = {}
    for path in modules().values():
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                how = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
                if "dataclass" in how and "frozen=True" in how:
                    held[node.name] = (path, node)
    return held


def words(text: str) -> set[str]:
    """Names in an annotation."""
    return {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}


def fields(node: ast.ClassDef) -> list[tuple[str, str]]:
    """Names and annotations of a class."""
    return [
        (item.target.id, ast.unparse(item.annotation))
        for item in node.body
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
    ]


def is_array(annotation: str) -> bool:
    """Whether a field is an array, or None."""
    parts = [part.strip() for part in annotation.split("|")]
    return any(part.endswith("Array") or part.startswith("NDArray") for part in parts)


def offered() -> set[str]:
    """Names that the faces offer."""
    names: set[str] = set()
    for package in PACKAGES:
        stub = Path(ROOT / package / "__init__.pyi")
        face = stub if stub.exists() else ROOT / package / "__init__.py"
        for node in ast.walk(ast.parse(face.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names |= {alias.name for alias in node.names}
    return names


def writable(node: ast.ClassDef) -> list[str]:
    """Array fields of a class that makes no array read-only."""
    made = " ".join(ast.unparse(item) for item in node.body if isinstance(item, ast.FunctionDef))
    made += " ".join(ast.unparse(base) for base in node.bases)
    if any(maker in made for maker in MAKERS):
        return []
    return [name for name, annotation in fields(node) if is_array(annotation)]


def test_arrays_of_offered_values_are_read_only() -> None:
    known = frozen_classes()
    looked_at = {name for name in offered() if name in known} | ALSO
    assert len(looked_at) > 20
    found = [f"{known[name][0]}: {name}.{field}" for name in looked_at for field in writable(known[name][1])]
    assert sorted(found) == []


def test_a_writable_array_is_found() -> None:
    text = "@dataclass(frozen=True)\nclass A:\n    one: FloatArray | None\n    other: int\n"
    node = ast.parse(text).body[0]
    assert isinstance(node, ast.ClassDef)
    assert writable(node) == ["one"]
