# SPDX-License-Identifier: MIT
"""Table: what came of all cases, by class and reader, as docs/results/robustness.md shows it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tests.robustness.bad_files.case import CLASSES, Case, Outcome
from tests.robustness.bad_files.trial import ROOT, Tried

PAGE = ROOT / "docs" / "results" / "robustness.md"
BEGIN, END = (
    "<!-- counted: python -m tests.robustness.bad_files --write -->",
    "<!-- end of what is counted -->",
)
_GROUPS = {
    "Scenes": ("GLB", "glTF", "OBJ", "PLY", "STL", "OFF"),
    "Scans": ("npz", "ply", "pcd", "ptx", "e57", "las", "laz", "text", "RGB-D"),
    "Points": tuple(f"{one} points" for one in ("text", "PLY", "PCD", "LAS", "E57", "npz", "PTX")),
    "Images and poses": ("image", "poses .txt", "poses .log", "poses .json", "COLMAP", "TUM"),
    "Sensors, studies and what unseen writes": ("sensor", "study", "plan", "edits", "candidates"),
}
_SAID: dict[Outcome, str] = {"refused": "refused", "warned": "warned of", "read": "read"}
_NEVER: tuple[Outcome, ...] = ("crashed", "hung", "silent")


def counted(cases: Sequence[Case], tried: Sequence[Tried]) -> str:
    """The counts as Markdown: all of them, and a table for each group of readers."""
    outcome = {one.title: one.outcome for one in tried}
    all_of = Counter(outcome.values())
    sums = ", ".join(f"{name} {all_of[name]}" for name in ("refused", "warned", "read", *_NEVER))
    parts = [f"{len(cases)} files tried: {sums}.\n"]
    for title, readers in _GROUPS.items():
        parts.append(f"### {title}\n")
        parts.append("| class | " + " | ".join(readers) + " |\n|---|" + "---|" * len(readers))
        for kind, words in CLASSES.items():
            cells = [_cell(cases, outcome, kind, reader) for reader in readers]
            if set(cells) != {"-"}:
                parts.append(f"| {kind} {words} | " + " | ".join(cells) + " |")
        parts.append("")
    return "\n".join(parts)


def _cell(cases: Sequence[Case], outcome: dict[str, Outcome], kind: int, reader: str) -> str:
    here = Counter(outcome[case.title] for case in cases if (case.kind, case.reader) == (kind, reader))
    return ", ".join(f"{_SAID.get(name, name)} {n}" for name, n in sorted(here.items())) or "-"


def shown() -> str:
    """The counts as they stand in the page."""
    return PAGE.read_text("utf-8").partition(BEGIN)[2].partition(END)[0].strip()


def write(text: str) -> None:
    """Put new counts into the page."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    Path(PAGE).write_text(f"{before}{BEGIN}\n\n{text.strip()}\n\n{END}{rest.partition(END)[2]}", "utf-8")
