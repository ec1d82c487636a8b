# SPDX-License-Identifier: MIT
"""The table of formats is what the readers say of themselves."""

from scenes.io.formats.format import formats
from scenes.io.meshes.mesh_file import MESH_SUFFIXES
from scenes.io.table import table
from tests.helpers.data_paths import ROOT


def test_the_page_is_made_by_the_registry():
    assert (ROOT / "docs" / "format-table.md").read_text("utf-8") == table(), (
        "python -m scenes.io.table > docs/format-table.md"
    )


def test_every_suffix_has_a_row():
    page = table()
    read = [suffix for known in formats() if known.points or known.scans for suffix in known.suffixes]
    missing = [suffix for suffix in {*read, *MESH_SUFFIXES} if f"`{suffix}`" not in page]
    assert missing in ([], [".ds"])
