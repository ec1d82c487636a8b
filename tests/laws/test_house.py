# SPDX-License-Identifier: MIT
"""The rules of the house: imports run down, functions take few arguments."""

import ast
import re
from collections import defaultdict

import pytest

from examples.plot_architecture import (
    FLOWS,
    PACKAGES,
    ROOT,
    find_circle,
    find_imports,
    floors,
    folder_of,
    folders_of_flow,
    modules,
    reached,
    reduced,
    tree_of,
)

MOST_ENTRIES, MOST_ARGUMENTS, MOST_POSITIONAL = 12, 8, 5
MORE_ENTRIES = {"completion": 22, "nbv": 13}  # each kind of knowledge is a room of its own
FACES = ("nbv/commands/", "nbv/cli.py")  # of the command line: a parameter is an option there


def by_file(whens=("at import", "late", "types"), without=()):
    arrows = defaultdict(set)
    for one in find_imports():
        if one.when in whens and not one.source.startswith(without):
            arrows[one.source].add(one.target)
    return dict(arrows)


def by_folder():
    arrows = defaultdict(set)
    for one in find_imports():
        source, target = folder_of(one.source), folder_of(one.target)
        if one.when == "at import" and source != target:
            arrows[source].add(target)
    return dict(arrows)


def test_files_import_in_no_circle_late_and_typing_imports_counted() -> None:
    """Commands load their work late, so that help is fast: these imports are the only ones left out."""
    assert find_circle(by_file(without=FACES)) == []
    assert find_circle(by_file(("at import",))) == []


def test_the_parts_of_a_page_load_no_completion() -> None:
    """A report of a part or a registration starts without the whole of completion and of planning."""
    page = reached(by_file(("at import",)), "nbv/report/blocks/page.py")
    assert {"completion/pipeline.py", "nbv/coverage/measurement.py"} & set(page) == set()
    assert "nbv/report/viewer/layers.py" in page


def test_folders_import_in_no_circle() -> None:
    assert find_circle(by_folder()) == []


def test_roots_hold_few_entries() -> None:
    for root in (*PACKAGES, "tests"):
        names = {path.name for path in (ROOT / root).iterdir() if path.name != "__pycache__"}
        entries = {name for name in names if not name.startswith("__init__") and name != "py.typed"}
        assert len(entries) <= MORE_ENTRIES.get(root, MOST_ENTRIES), (root, sorted(entries))


def compiled(function: ast.FunctionDef) -> bool:
    """Whether a function is compiled: the loops inside take arrays one by one."""
    words = " ".join(ast.unparse(decorator) for decorator in function.decorator_list)
    return any(word in words for word in ("jit", "compiled", "inlined", "intrinsic"))


def public_names() -> set[str]:
    """Names that the four faces offer; their signatures are a promise to users."""
    names: set[str] = set()
    for package in PACKAGES:
        stub = ROOT / package / "__init__.pyi"
        face = stub if stub.exists() else ROOT / package / "__init__.py"
        for node in ast.walk(ast.parse(face.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names |= {alias.name for alias in node.names}
    return names


@pytest.fixture(scope="module")
def nodes():
    """Functions, compiled functions, and calls with many arguments by position, of each file."""
    found = {}
    for path in modules().values():
        every = list(ast.walk(tree_of(path)))
        functions = [node for node in every if isinstance(node, ast.FunctionDef)]
        calls = [node for node in every if isinstance(node, ast.Call) and len(node.args) > MOST_POSITIONAL]
        found[path] = functions, [node for node in functions if compiled(node)], calls
    return found


def test_inner_functions_take_at_most_eight_arguments(nodes) -> None:
    public, found = public_names(), []
    for path, (functions, loops, _) in nodes.items():
        for node in functions:
            if node in loops or node.name in public:
                continue
            given = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            n_given = len([one for one in given if one.arg not in ("self", "cls")])
            if n_given > MOST_ARGUMENTS and not path.startswith(FACES):
                found.append(f"{path}: {node.name} takes {n_given}")
    assert found == []


def test_calls_give_at_most_five_arguments_by_position(nodes) -> None:
    """But calls of compiled loops, and in them, and of libraries that take no names."""
    names = {loop.name for _, loops, _ in nodes.values() for loop in loops}
    found = []
    for path, (_, loops, calls) in nodes.items():
        for node in calls:
            if any(loop.lineno <= node.lineno <= (loop.end_lineno or loop.lineno) for loop in loops):
                continue
            called = ast.unparse(node.func)
            if called.split(".")[-1] not in names and not called.startswith(OTHERS):
                found.append(f"{path}:{node.lineno}: {called}")
    assert found == []


OTHERS = (
    "int64", "void", "types.", "library.rtc", "lib.", "cv2.", "weakref.",
)  # fmt: skip  # signatures of numba, and libraries in C


def test_the_helpers_of_these_laws() -> None:
    """A circle is found, floors stand above what they import, reduction keeps what can be reached."""
    arrows = {"a": {"b", "c"}, "b": {"c", "d"}, "c": {"d"}, "d": set()}
    assert find_circle(arrows) == []
    assert find_circle({**arrows, "d": {"b"}}) in (["b", "c", "d"], ["b", "d"], ["c", "d", "b"], ["d", "b"])
    assert floors(arrows) == {"a": 3, "b": 2, "c": 1, "d": 0}
    assert set(reached(reduced(arrows), "a")) == set(reached(arrows, "a"))
    assert reduced(arrows)["a"] == {"b"}
    assert {one.when for one in find_imports()} >= {"at import", "late"}


@pytest.mark.parametrize("name", FLOWS)
def test_flows_start_at_a_page_and_reach_the_ground(name: str) -> None:
    arrows = folders_of_flow(FLOWS[name])
    assert folder_of(FLOWS[name]) in arrows
    assert min(floors(arrows).values()) == 0


def test_the_page_on_the_house_names_every_room() -> None:
    """docs/architecture.md lists the folders as they are."""
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    listed = set(re.findall(r"^\| `([a-z0-9_/]+)` \|", page, re.MULTILINE))
    rooms = {folder_of(path) for path in modules().values() if not path.endswith("__init__.py")}
    assert listed == {room for room in rooms if any((ROOT / room).glob("*.py"))}
