# SPDX-License-Identifier: MIT
"""The table of all formats, made by what the readers say of themselves: docs/format-table.md."""

from __future__ import annotations

from collections.abc import Iterable

from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import formats
from scenes.io.meshes.mesh_file import MESHES
from scenes.io.rgbd import phone, reconstruction
from scenes.io.rgbd.layouts import LISTED_FACTS

_HEAD = (
    "# Table of formats\n\n"
    "Made from the registry of readers by `python -m scenes.io.table`; a test compares the two. Readers "
    "convert to metres and [our conventions](../CONVENTIONS.md). [How to read and write](guides/formats.md), "
    "[defects of files](guides/bad-input.md).\n"
)


def table() -> str:
    """Return the page in Markdown: scans and points, folders of depth images, meshes."""
    scans = (known.facts for known in formats() if known.facts is not None)
    folders = (layout.facts for layout in (*phone.LAYOUTS, *reconstruction.LAYOUTS))
    return "\n".join(
        [
            _HEAD,
            _section("Scans and points", scans),
            _section("Folders of depth images", (*LISTED_FACTS, *folders)),
            _section("Meshes", (mesh.facts for mesh in MESHES)),
        ]
    )


def _section(title: str, rows: Iterable[FormatFacts]) -> str:
    return f"## {title}\n\n{FormatFacts.head()}{''.join(facts.row() for facts in rows)}"


if __name__ == "__main__":
    print(table(), end="")  # noqa: T201 - its output is the page
