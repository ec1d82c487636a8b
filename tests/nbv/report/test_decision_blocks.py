# SPDX-License-Identifier: MIT
"""Decisions in reports: a row a dimension, the rule, and what is left out."""

from dataclasses import replace

import numpy as np

from completion.export.decisions import DecisionSheet
from nbv.report.completion_report import completion_page, decision_sections
from tests.helpers.exchange_examples import panorama


def test_each_dimension_has_a_row_with_its_word_and_the_rule_stands_above():
    (section,) = decision_sections(panorama().decisions())
    text, table, note = section.blocks
    assert text.text.startswith("5 dimensions: 5 \u00d7 rely. Rely: half the 95 % interval is at most 10 mm")
    first = table.rows[0]
    assert [cell.text for cell in first[:2]] == ["room width", "4 6"]
    low, high = (cell.text.removesuffix(" m") for cell in first[3:5])
    assert float(low) <= 6.0 <= float(high)
    assert (first[-1].text, first[-1].state) == ("rely", "measured")
    assert note.is_note


def test_no_dimensions_no_section_and_many_are_cut_short():
    assert decision_sections(DecisionSheet((), 0.01)) == ()
    sheet = panorama().decisions()
    many = replace(sheet, dimensions=sheet.dimensions * 20)
    (section,) = decision_sections(many)
    assert len(section.blocks[1].rows) == 60
    assert "40 more are in decisions.csv." in section.blocks[2].text


def test_of_a_mesh_none_may_be_relied_on():
    one = replace(panorama().decisions().dimensions[0], low=0.0, high=np.inf)
    sheet = DecisionSheet((one,), 0.01)
    (section,) = decision_sections(sheet)
    assert "a mesh never does" in section.blocks[0].text
    (row,) = section.blocks[1].rows
    assert [cell.text for cell in row[2:5]] == ["6.00 m", "not known", "not known"]
    assert row[-1].text == "check"


def test_the_report_of_a_completion_has_it():
    page = completion_page(panorama(), "room", n_threads=1)
    assert "What to rely on" in [section.title for section in page.sections]
