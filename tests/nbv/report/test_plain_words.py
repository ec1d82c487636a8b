# SPDX-License-Identifier: MIT
"""Titles of tables name their units, and texts of reports have no jargon."""

import ast
import re
from pathlib import Path

import pytest

import nbv.report
from completion.boundary.continuation import Cue
from completion.result.labelled_points import PROVENANCE_NAMES
from nbv.report.blocks.page import Page, Table
from nbv.run.plain_words import HOW_ITS_END_IS_KNOWN, WHY_INFERRED

FOLDER = Path(nbv.report.__file__).parent
UNITS = re.compile(
    r"(?:, | or )(?:m|mm|m\u00b2|cm\u00b2|m\u00b3|\u00b0|deg|%|unit|views|standard deviations)"
    r"(?: \[95 %\])?$| to 1$|^% of |^views to .* %$|^minutes$"
)
COUNTS = {
    "all", "No.", "Station", "Scan", "Seed", "views", "views planned", "scans", "Scans placed", "stations",
    "stations to the target", "storey", "points", "measured pixels", "poses possible", "legs without a way",
    "elements settled", "elements, measured", "elements, represented", "times likelier",
    "...",  # a verdict's elements
}  # fmt: skip
JARGON = re.compile(
    r"\bnats?\b|\bholds? of\b|log.evidence|shadow-limit|architectural|\bp-?value|\bleast p\b|\bsd\b(?!_)"
)


def texts():
    """Strings of the report's modules but docstrings, with their files; what is put into them is "..."."""
    for path in sorted(FOLDER.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        nodes = list(ast.walk(tree))
        apart = {node.value for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            if isinstance(node, ast.JoinedStr):
                apart |= set(node.values)
                parts = [part.value if isinstance(part, ast.Constant) else "..." for part in node.values]
                yield path.name, "".join(parts)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in apart:
                yield path.name, node.value


def test_each_column_of_numbers_names_its_unit_or_is_a_count():
    titles = {text[1:] for _, text in texts() if re.match(r"#(?![0-9a-f]{6}$).", text)}
    assert len(titles) > 60
    assert {title for title in titles if not UNITS.search(title)} - COUNTS == set()


def test_no_jargon_is_in_what_people_read():
    words = [(file, text) for file, text in texts() if " " in text and JARGON.search(text)]
    assert words == []


def test_every_provenance_has_plain_words():
    assert set(PROVENANCE_NAMES.values()) <= set(WHY_INFERRED)
    ends = {str(cue) for cue in Cue} | {"measured", "shadow-limit", "feature", "user"}
    assert ends == set(HOW_ITS_END_IS_KNOWN)


@pytest.mark.parametrize(("n_rows", "left"), [(20, None), (63, "43")])
def test_rows_after_the_twentieth_are_folded_but_in_the_page(n_rows, left):
    from nbv.report.blocks.page import Cell, PageSection

    table = Table(("Name", "#area, m\u00b2"), tuple((Cell(f"row {k}"), Cell(str(k))) for k in range(n_rows)))
    html = Page("t", "k", "s", (), None, (PageSection("T", (table,)),)).to_html()
    assert html.count("<td>row ") == n_rows
    assert re.findall(r"and <b>(\d+)</b> more rows", html) == ([left] if left else [])


def test_the_style_folds_after_as_many_rows_as_the_page_counts():
    style = (FOLDER / "templates" / "style.css").read_text(encoding="utf-8")
    assert f"nth-child(n + {Table.first + 1} of" in style


def test_the_same_warning_of_several_stands_once():
    texts = ("north: no pose is known", "south: no pose is known", "the clock is off", "the clock is off")
    html = Page("t", "k", "s", (), None, (), warnings=texts).to_html()
    assert re.findall(r'class="warning">([^<]*)', html) == [
        "north and south: no pose is known",
        "the clock is off",
    ]
