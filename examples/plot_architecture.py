# SPDX-License-Identifier: MIT
"""The house in three pictures, drawn from the imports: which folders a run of each method goes through.

    python examples/plot_architecture.py [--docs docs]

A lane is a package; a folder stands above all folders that it imports. An arrow says that one imports
another; arrows that follow from others are left out, those from package to package are pale.
`tests/laws/test_house.py` reads the same imports and holds the rules of the house.
"""

import argparse
import ast
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("nbv", "completion", "texture", "scenes")
COLOURS = {"nbv": "#c9daf2", "completion": "#f2d3c4", "texture": "#f0e6b8", "scenes": "#d3e8cf"}
_WRAPPED = 18  # letters from which on a folder's name takes two lines
FLOWS = {
    "complete": "completion/pipeline.py",
    "plan": "nbv/plan/planning.py",
    "fill": "texture/pipeline.py",
}
"""The page of each method: where a flow begins."""


@dataclass(frozen=True, slots=True)
class Import:
    """One import of a file by another: paths from the root, the line, and when it is carried out."""

    source: str
    target: str
    line: int
    when: str  # "at import", "late" (inside a function), or "types" (for a type checker alone)


@cache
def modules() -> dict[str, str]:
    """Return the path of every module of the four packages by its dotted name."""
    files = sorted(file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))
    paths = [file.relative_to(ROOT).as_posix() for file in files]
    return {path[:-3].replace("/", ".").removesuffix(".__init__"): path for path in paths}


@cache
def tree_of(path: str) -> ast.Module:
    """Return the syntax tree of a file, its path from the root."""
    return ast.parse((ROOT / path).read_text("utf-8"))


@cache
def find_imports() -> list[Import]:
    """Return the imports among the four packages' files; a package's face has none of its own."""
    known = modules()
    found: list[Import] = []
    for path in known.values():
        if not path.endswith("__init__.py"):
            _visit(tree_of(path), "at import", path, known, found)
    return found


def _visit(node: ast.AST, when: str, path: str, known: dict[str, str], found: list[Import]) -> None:
    """Collect the imports below a node."""
    for child in ast.iter_child_nodes(node):
        inner = when
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            inner = "late"
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            inner = "types"
        names: list[str] = []
        if isinstance(child, ast.Import):
            names = [alias.name for alias in child.names]
        elif isinstance(child, ast.ImportFrom) and child.module:
            inside = {f"{child.module}.{alias.name}" for alias in child.names} & set(known)
            names = sorted(inside) or [child.module]
        for name in names:
            target = known.get(name, "")
            if target and target != path and not target.endswith("__init__.py"):
                found.append(Import(path, target, child.lineno, inner))
        _visit(child, inner, path, known, found)


def folder_of(path: str) -> str:
    """Return the room a file is in: its folder, or the file itself at a package's root."""
    folder = Path(path).parent.as_posix()
    return path.removesuffix(".py") if folder in PACKAGES else folder


def find_circle(arrows: dict[str, set[str]]) -> list[str]:
    """Return the nodes of a circle of arrows, in order; empty where there is none.

    Examples
    --------
    >>> find_circle({"a": {"b"}, "b": {"c"}, "c": set()}), find_circle({"a": {"b"}, "b": {"a"}})
    ([], ['a', 'b'])
    """
    state: dict[str, int] = {}
    for start in sorted(arrows):
        way, stack = [start], [iter(sorted(arrows.get(start, ())))]
        if state.setdefault(start, 1) == 2:
            continue
        while stack:
            following = next(stack[-1], None)
            if following is None:
                state[way.pop()] = 2
                stack.pop()
            elif state.get(following) == 1:
                return way[way.index(following) :]
            elif following not in state:
                state[following] = 1
                way.append(following)
                stack.append(iter(sorted(arrows.get(following, ()))))
    return []


def floors(arrows: dict[str, set[str]]) -> dict[str, int]:
    """Return the floor of each node of a graph without circles: one above the highest that it imports."""
    found: dict[str, int] = {}

    def floor(node: str) -> int:
        if node not in found:
            found[node] = 1 + max((floor(below) for below in arrows.get(node, ())), default=-1)
        return found[node]

    for node in arrows:
        floor(node)
    return found


def reached(arrows: dict[str, set[str]], start: str) -> dict[str, set[str]]:
    """Return the part of a graph that can be reached from a node."""
    part: dict[str, set[str]] = {}
    waiting = [start]
    while waiting:
        node = waiting.pop()
        if node not in part:
            part[node] = arrows.get(node, set())
            waiting.extend(part[node])
    return part


def reduced(arrows: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return the graph without the arrows that follow from others.

    Examples
    --------
    >>> reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()})
    {'a': {'b'}, 'b': {'c'}, 'c': set()}
    """
    below = {node: set(reached(arrows, node)) - {node} for node in arrows}
    return {
        node: {to for to in targets if not any(to in below[other] for other in targets if other != to)}
        for node, targets in arrows.items()
    }


def folders_of_flow(page: str) -> dict[str, set[str]]:
    """Return which folders a method's page goes through, and what each of them imports."""
    files: dict[str, set[str]] = defaultdict(set)
    for one in find_imports():
        if one.when == "at import":
            files[one.source].add(one.target)
    rooms: dict[str, set[str]] = defaultdict(set)
    for source, targets in reached(files, page).items():
        rooms[folder_of(source)] |= {folder_of(target) for target in targets} - {folder_of(source)}
    return dict(rooms)


def places(arrows: dict[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Return where each folder is drawn: a lane for each package, folders of a floor beside each other."""
    floor = floors(arrows)
    rows: dict[tuple[str, int], list[str]] = defaultdict(list)
    for node in sorted(floor):
        rows[node.split("/")[0], floor[node]].append(node)
    found: dict[str, tuple[float, float]] = {}
    left = 0.0
    for package in PACKAGES:
        lane = {height: row for (name, height), row in rows.items() if name == package}
        width = float(max((len(row) for row in lane.values()), default=0))
        for height, row in lane.items():
            for number, node in enumerate(row):
                found[node] = (left + (number + 0.5) * width / len(row), float(height))
        left += width + (0.35 if lane else 0.0)
    return found


def draw(axes: Axes, arrows: dict[str, set[str]]) -> None:
    """Draw folders on their floors, with the arrows that do not follow from others."""
    place = places(arrows)
    for node, targets in reduced(arrows).items():
        for target in sorted(targets):
            within = node.split("/")[0] == target.split("/")[0]
            look = {"color": "#3f444d" if within else "#b4b9c2", "lw": 1.1 if within else 0.7}
            look |= {"arrowstyle": "-|>", "shrinkA": 13, "shrinkB": 13}
            axes.annotate("", place[target], place[node], arrowprops=look)
    for node, (x, y) in place.items():
        package, _, name = node.partition("/")
        box = {"boxstyle": "round,pad=0.4", "facecolor": COLOURS[package], "edgecolor": "#5a5f68"}
        label = name if len(name) < _WRAPPED else name.replace("/", "/\n")
        axes.text(x, y, label, ha="center", va="center", fontsize=8.5, bbox={**box, "linewidth": 0.8})
    top = max(y for _, y in place.values()) + 0.9
    for package in {node.split("/")[0] for node in place}:
        across = [x for node, (x, _) in place.items() if node.startswith(package)]
        axes.text(sum(across) / len(across), top, package, ha="center", fontsize=11, weight="bold")
    axes.set_xlim(-0.1, max(x for x, _ in place.values()) + 0.6)
    axes.set_ylim(-0.6, top + 0.5)
    axes.axis("off")


def main() -> None:
    """Draw one picture a flow."""
    arguments = argparse.ArgumentParser(description="The house in three pictures.")
    arguments.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder of the pictures' folder")
    out = arguments.parse_args().docs / "pictures"
    out.mkdir(parents=True, exist_ok=True)
    for name, page in FLOWS.items():
        arrows = folders_of_flow(page)
        height = max(floors(arrows).values()) + 1
        figure, axes = plt.subplots(figsize=(11, 0.62 * height + 0.9), dpi=110)
        draw(axes, arrows)
        figure.savefig(out / f"architecture_{name}.png", bbox_inches="tight", metadata={"Software": None})
        plt.close(figure)
        print(f"{name}: {len(arrows)} folders on {height} floors")


if __name__ == "__main__":
    main()
