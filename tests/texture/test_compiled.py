# SPDX-License-Identifier: MIT
"""Compiled functions: stored code is read again, and made anew when a part of it changes."""

import ast
import importlib
import linecache
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("scenes", "texture", "completion", "nbv")
IMPORT = "from texture.engine.compiled import compiled\n"
FILES = {
    "lowest.py": f"{IMPORT}\n\n@compiled\ndef third(x):\n    return 3 * x\n",
    "sizes.py": "STEP = 10\n",
    "callee.py": (
        f"{IMPORT}from lowest import third\n\n\n@compiled\ndef double(x):\n    return 2 * x + third(x)\n"
    ),
    "caller.py": (
        f"{IMPORT}from callee import double\nfrom sizes import STEP\n\n\n"
        "@compiled\ndef outer(x):\n    return inner(x)\n\n\n"
        "@compiled\ndef inner(x):\n    return double(x) + STEP\n\n\n"
        "print(outer(1), sum(outer.stats.cache_hits.values()))\n"
    ),
}


def run(folder):
    """What `outer(1)` is in a fresh process, and how many stored compilations were read for it."""
    command = [sys.executable, "caller.py"]
    done = subprocess.run(
        command, cwd=folder, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True
    )
    return tuple(int(word) for word in done.stdout.split())


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "old", "new", "result"),
    [
        pytest.param("callee.py", "2 * x", "5 * x", 18, marks=pytest.mark.long),
        ("lowest.py", "3 * x", "9 * x", 21),
        pytest.param("sizes.py", "STEP = 10", "STEP = 20", 25, marks=pytest.mark.long),
    ],
)
def test_an_edit_anywhere_below_compiles_anew(tmp_path, name, old, new, result):
    for file, text in FILES.items():
        (tmp_path / file).write_text(text)
    assert run(tmp_path) == (15, 0)
    assert run(tmp_path) == (15, 1)
    (tmp_path / name).write_text(FILES[name].replace(old, new))
    assert run(tmp_path) == (result, 0)
    assert run(tmp_path) == (result, 1)


TUPLES = {
    "kinds.py": "from typing import NamedTuple\n\n\nclass Pair(NamedTuple):\n    x: int\n",
    "caller.py": (
        f"{IMPORT}from kinds import Pair\n\n\n@compiled\ndef outer(pair):\n    return pair.x + 14\n\n\n"
        "print(outer(Pair(1)), sum(outer.stats.cache_hits.values()))\n"
    ),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "renamed_to", "kind"),
    [("kinds.py", "Couple", "Couple"), ("sorts.py", "Pair", "Pair")],
)
def test_stored_code_for_a_type_that_is_no_more_is_made_anew(tmp_path, file, renamed_to, kind):
    for name, text in TUPLES.items():
        (tmp_path / name).write_text(text)
    assert run(tmp_path) == (15, 0)
    assert run(tmp_path) == (15, 1)
    (tmp_path / "kinds.py").unlink()
    (tmp_path / file).write_text(TUPLES["kinds.py"].replace("Pair", renamed_to))
    caller = TUPLES["caller.py"].replace("Pair", kind).replace("kinds", file.removesuffix(".py"))
    (tmp_path / "caller.py").write_text(caller)
    assert run(tmp_path) == (15, 0)
    assert run(tmp_path) == (15, 1)


@pytest.mark.long
@pytest.mark.parametrize("left", [pytest.param(0, marks=pytest.mark.long), 30])
def test_a_list_of_stored_code_that_was_cut_short_is_made_anew(tmp_path, left):
    for name, text in TUPLES.items():
        (tmp_path / name).write_text(text)
    assert run(tmp_path) == (15, 0)
    (index,) = tmp_path.glob("__pycache__/caller.outer*.nbi")
    index.write_bytes(index.read_bytes()[:left])
    assert run(tmp_path) == (15, 0)
    assert run(tmp_path) == (15, 1)


def test_without_a_folder_to_store_in_it_is_compiled_all_the_same(tmp_path):
    for file, text in FILES.items():
        (tmp_path / file).write_text(text)
    nowhere = "import numba.core.caching as c\nc.CacheImpl._locator_classes = []\n"
    (tmp_path / "caller.py").write_text(nowhere + FILES["caller.py"])
    assert run(tmp_path) == (15, 0)
    assert not list(tmp_path.glob("__pycache__/*.nbi"))


def borrowed_names(path):
    """Names from our other files in functions that numba stores by their own file alone."""
    tree = ast.parse(path.read_text())
    imported = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES
        for alias in node.names
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(d) for d in node.decorator_list):
            names = {part.id for line in node.body for part in ast.walk(line) if isinstance(part, ast.Name)}
            yield from ((path.name, node.name, name) for name in sorted(names & imported))


@pytest.mark.long
def test_functions_stored_by_their_own_file_use_nothing_of_others():
    files = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    assert [name for path in files for name in borrowed_names(path)] == []


def test_stored_entries_of_inlined_functions_go_stale_with_these(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    for step in (9, 20):  # of other lengths: Python tells files of one second by these
        (tmp_path / "raising.py").write_text(
            f"from texture.engine.compiled import inlined\n\nSTEP = {step}\n\n\n"
            "@inlined\ndef raised(x):\n    return x + STEP\n"
        )
        sys.modules.pop("raising", None)
        importlib.invalidate_caches()
        linecache.clearcache()
        assert importlib.import_module("raising").raised(1) == 1 + step
        assert importlib.import_module("raising").raised(2) == 2 + step
