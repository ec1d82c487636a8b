# SPDX-License-Identifier: MIT
"""Public functions that take or return arrays say their shapes; public functions that raise say what."""

import ast
import re

import pytest

from examples.plot_architecture import modules, tree_of

ARRAY = re.compile(r"\b(NDArray|ArrayLike|FloatArray|BoolArray|IntArray|Pixels)\b")
SHAPE = re.compile(
    r"\(\s*(?:\w+|\d+|\.\.\.)(?:\s*[*+-]\s*\w+)*\s*,\s*[^)]*\)"  # (n, 3), (n,), (rows * columns,)
    r"|\bshape\b|\bscalar\b|\d+ x \d+|\bh x w\b"
)


ERRORS = {"InputError", "FitError", "ValueError"}
"""What users meet; other errors are for programmers."""


def is_compiled(function: ast.FunctionDef) -> bool:
    return any(
        word in ast.unparse(d)
        for d in function.decorator_list
        for word in ("jit", "compiled", "inlined", "intrinsic")
    )


def functions(tree: ast.Module):
    """Public functions and methods, with the docstring of the class around them."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node, ""
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and not inner.name.startswith("_"):
                    yield inner, ast.get_docstring(node) or ""


def public_functions(package: str):
    """Public functions of a package: path, node, docstring of the class around."""
    for path in modules().values():
        if path.startswith(f"{package}/"):
            for function, around in functions(tree_of(path)):
                yield path, function, around


def has_arrays(function: ast.FunctionDef) -> bool:
    given = function.args.posonlyargs + function.args.args + function.args.kwonlyargs
    notes = [ast.unparse(one.annotation) for one in given if one.annotation]
    notes += [ast.unparse(function.returns)] if function.returns else []
    return any(ARRAY.search(note) for note in notes)


def raised(function: ast.FunctionDef) -> set[str]:
    """Names of the errors that a function raises itself."""
    found = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            found.add(ast.unparse(node.exc.func).split(".")[-1])
    return found


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_arrays_have_shapes(package: str) -> None:
    missing = []
    for path, function, _around in public_functions(package):
        text = ast.get_docstring(function) or ""
        if has_arrays(function) and not is_compiled(function) and not SHAPE.search(text):
            missing.append(f"{path}:{function.lineno} {function.name}")
    assert missing == []


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_errors_are_told(package: str) -> None:
    missing = []
    for path, function, around in public_functions(package):
        text = (ast.get_docstring(function) or "") + around
        untold = {error for error in raised(function) if error in ERRORS and error not in text}
        if untold and has_arrays(function):
            missing.append(f"{path}:{function.lineno} {function.name}: {untold}")
    assert missing == []
