# SPDX-License-Identifier: MIT
"""The report of a check: verdicts, plans, cards with evidence, and sentences that an inspector can defend."""

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from completion.asbuilt.findings import VERDICTS, Interval
from nbv.inspection.changes import changes_since
from nbv.inspection.checking import CheckedDesign
from nbv.inspection.record import check_record
from nbv.inspection.verdict_colours import VERDICT_COLOURS, rgb_of
from nbv.report.blocks.check_tables import (
    WORST_FIRST,
    alignment_sentence,
    cards,
    counts_table,
    elements_table,
    loa_blocks,
    millimetres,
    numbered,
    verdict_bar,
)
from nbv.report.blocks.coverage_tables import cut_by_surface
from nbv.report.blocks.page import Card, Histogram
from nbv.report.blocks.verdict_plans import _area, _paths, design_storeys, verdict_plans
from nbv.report.check_report import check_page, summary
from nbv.report.figures.check_snapshots import check_snapshots
from nbv.report.viewer.check_view import check_view, worst_deviation
from tests.nbv.inspection.checks import BOXES, example_check

CHECK = example_check()


@pytest.fixture(scope="module")
def html():
    earlier = check_record(replace(CHECK, elements=tuple(
        replace(one, verdict="within") if one.verdict == "missing" else one for one in CHECK.elements
    )))  # fmt: skip
    return check_page(CheckedDesign(CHECK, changes=changes_since(earlier, CHECK)), "room.ifc").to_html()


def test_the_head_says_all_in_numbers():
    text = summary(CHECK)
    assert "6 elements at a tolerance of 5 to 10 mm: 1 within, 1 deviates, 1 undecided, 1 missing" in text
    assert "247 faces were tested; 0.05 wrong \u201cdeviates\u201d are expected" in text
    assert "3.71 standard deviations" in text
    assert "moved by (1.00 ± 0.78, 0.00 ± 0.78, -9.80 ± 0.78) mm" in text
    assert "a slab 10 mm high everywhere is the alignment's" in text
    held = replace(CHECK, alignment=replace(CHECK.alignment, is_free=False))
    assert "control network" in summary(held)
    assert "moved by" not in summary(held)
    assert "alignment's" not in alignment_sentence(held)


def test_the_page_holds_evidence_and_what_is_no_element(html):
    for text in (
        "19.9 mm behind its place", "640 beams went through", "extra-1", "ended before it", "went through it",
        "Changes since the earlier check", "within before, missing now", "LOA40", "no part of the verdict",
    ):  # fmt: skip
        assert text in html, text
    assert "http://" not in html.replace("http://www.w3.org", "")


def test_elements_are_numbered_the_gravest_first():
    numbers = numbered(CHECK)
    by_surface = {one.surface: one.verdict for one in CHECK.elements}
    order = [WORST_FIRST.index(by_surface[surface]) for surface in numbers]
    assert order == sorted(order)
    assert list(numbers.values()) == [1, 2, 3, 4, 5]
    assert set(by_surface) - set(numbers) == {0}  # the floor is within
    assert set(WORST_FIRST) == set(VERDICTS) == set(VERDICT_COLOURS)


def test_each_verdict_is_counted_once():
    assert sum(share.amount for share in verdict_bar(CHECK).shares) == pytest.approx(1)
    table = counts_table(CHECK)
    assert sum(int(row[2].text) for row in table.rows) == 6
    assert sum(int(cell.text or 0) for row in table.rows for cell in row[3:]) == 6
    bands = loa_blocks(CHECK)[0]
    assert [sum(int(row[k].text) for row in bands.rows) for k in (2, 3)] == [6, 6]


def test_the_list_of_the_others_is_folded_away():
    numbers = numbered(CHECK)
    (open_,), (folded,) = (elements_table(CHECK, numbers, within=within) for within in (False, True))
    assert (len(open_.rows), open_.is_folded) == (5, False)
    assert (len(folded.rows), folded.is_folded) == (1, True)
    assert open_.rows[0][6].text == "-19.9 [-21.2, -18.6]"
    everything = replace(CHECK, elements=CHECK.elements[:1])
    assert elements_table(everything, numbered(everything), within=False) == ()


def test_cards_show_what_speaks_for_the_verdict():
    held = {card.title.split()[0]: card for card in cards(CHECK, numbered(CHECK)) if isinstance(card, Card)}
    off, gone = held["1"], held["2"]
    (histogram,) = (block for block in off.blocks if isinstance(block, Histogram))
    assert histogram.limit == 10
    assert histogram.interval == pytest.approx((-21.2, -18.6))
    assert sum(histogram.counts) == 900
    assert not any(isinstance(block, Histogram) for block in gone.blocks)
    assert (off.state, gone.state) == ("deviates", "missing")


def test_a_histogram_has_its_limits_where_they_are():
    shown = Histogram("", (0, 2, 4, 1), -50.0, 50.0, "mm", 10.0, (-60.0, 0.0))
    assert [shown.at(value) for value in (-50, 0, 10, 50, 90)] == [0, 50, 60, 100, 100]
    assert shown.heights == (0, 50, 100, 25)
    assert shown.ticks == (-50, -10, 0, 10, 50)
    assert replace(shown, limit=1.0).ticks == (-50, 0, 50)  # texts would cover each other


def test_an_interval_is_in_millimetres():
    assert millimetres(Interval(0.0099, 0.0079, 0.0119)) == "9.9 [7.9, 11.9]"
    assert millimetres(None) == ""


@pytest.mark.parametrize(
    ("value", "half", "text"),
    [
        (3e-4, 2e-5, "0.300 [0.280, 0.320]"),
        (-0.02, 1.3e-3, "-20.0 [-21.3, -18.7]"),
        (0.2, 0.05, "200 [150, 250]"),
    ],
)
def test_an_interval_is_told_from_its_value(value, half, text):
    assert millimetres(Interval(value, value - half, value + half)) == text


def test_a_displaced_element_shows_its_shift_and_where_it_went():
    """Not what a beam near its empty place is off by."""
    south = CHECK.elements[1]
    shift = Interval(-0.2811, -0.2822, -0.2800, south.offset.along)
    moved = replace(CHECK, elements=(replace(south, kind="displaced", offset=shift),))
    (table,) = elements_table(moved, numbered(moved), within=False)
    assert table.rows[0][6].text == f"281.1 [280.0, 282.2] along {'-' if south.offset.along[1] > 0 else '+'}y"
    assert worst_deviation(moved.elements[0]) is shift
    (card,) = cards(moved, numbered(moved))
    assert not any(isinstance(block, Histogram) for block in card.blocks)


def test_a_plan_fills_what_the_cut_meets():
    (storey,) = design_storeys(CHECK.design)
    assert (storey.name, storey.floor_m, storey.cut_m) == ("Ground", 0.0, pytest.approx(1.2))
    segments, surface = cut_by_surface(CHECK.design.mesh, 1.2)
    assert set(surface.tolist()) == {1, 2, 3, 4, 5}  # all but the floor
    for number, (_, size) in enumerate(BOXES.values()):
        if number:
            area = _area(segments[surface == number], 1e-9)
            assert area.area == pytest.approx(size[0] * size[1], rel=1e-4)
            assert len(_paths(area)) == 1
    (picture,) = verdict_plans(CHECK, numbered(CHECK))
    assert picture.title == "Ground"
    assert "1.20 m above the floor at z = 0.00 m" in picture.caption


def test_holes_stay_open():
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    ring = np.concatenate([np.stack([s, np.roll(s, -1, axis=0)], axis=1) for s in (square, 1 + square / 2)])
    area = _area(ring, 1e-9)
    assert area.area == pytest.approx(16 - 4)
    (path,) = _paths(area)
    assert path.contains_point((0.5, 0.5))
    around = [np.asarray(polygon) for polygon in path.to_polygons()]
    signed = [np.sum(p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]) for p in around]
    assert signed[0] * signed[1] < 0  # filled by winding, the hole is none of it


def test_storeys_stand_one_on_the_other():
    elements = tuple(
        replace(one, storey="Roof" if k == 5 else one.storey) for k, one in enumerate(CHECK.design.elements)
    )
    low = CHECK.design.mesh.vertices.copy()
    low[40:48, 2] += 3.0  # the column is upstairs
    design = replace(CHECK.design, mesh=CHECK.design.mesh.at(low), elements=elements)
    assert [storey.floor_m for storey in design_storeys(design)] == [0.0, 3.0]
    nameless = replace(design, elements=tuple(replace(one, storey="") for one in elements))
    found = [(storey.name, storey.floor_m) for storey in design_storeys(nameless)]
    assert found == [("Level 0.00 m", 0.0), ("Level 3.00 m", 3.0)]


def test_the_view_colours_each_element_by_its_verdict():
    view = check_view(CHECK, 1.5, n_threads=1)
    layer = view.layers[0]
    (verdict,) = (one for one in layer.channels if one.key == "verdict")
    told = [VERDICTS[k] for k in verdict.values]
    assert told == [one.verdict for one in CHECK.elements]
    assert [one.key for one in view.layers] == ["design", "extra", "points"]
    assert len(view.markers) == 2
    assert len(view.pictures) == 2
    bare = replace(CHECK, extra=(), cloud=replace(CHECK.cloud, element=np.full_like(CHECK.cloud.element, -1)))
    assert [one.key for one in check_view(bare, None, n_threads=1).layers] == ["design"]


def test_a_check_of_nothing_has_a_page():
    empty = replace(CHECK, elements=(), extra=(), scans=(), alignment=replace(
        CHECK.alignment, poses=(), station_shift_m=np.zeros((0, 3))
    ))  # fmt: skip
    text = check_page(CheckedDesign(empty), "none", n_threads=1).to_html()
    assert "0 elements" in text


def test_issues_have_a_snapshot_of_their_element():
    found = check_snapshots(CHECK, 1)
    assert set(found) == {1, 4}  # what deviates, and what is missing
    for surface, verdict in ((1, "deviates"), (4, "missing")):
        pixels = np.asarray(Image.open(io.BytesIO(found[surface])).convert("RGB"), float)
        red, green, blue = rgb_of(VERDICT_COLOURS[verdict])
        tint = (red - green) / (red + green + blue)  # of greys it is 0
        found_tint = (pixels[..., 0] - pixels[..., 1]) / np.maximum(pixels.sum(axis=2), 1)
        assert 0.03 < float((found_tint > 0.3 * tint).mean()) < 0.95, verdict
    nowhere = replace(CHECK, alignment=replace(CHECK.alignment, poses=()))
    assert check_snapshots(nowhere, 1) == {}


@pytest.mark.parametrize(
    ("along", "way"), [((0, 0, 1), "-z"), ((-1, 0, 0), "+x"), ((0.6, -0.8, 0), "(-0.60, 0.80, 0.00)")]
)
def test_a_shift_has_a_length_and_a_direction(along, way):
    shift, told = Interval(-0.3, -0.31, -0.29, along).as_shift()
    assert (shift.value, shift.low, shift.high, told) == (0.3, 0.29, 0.31, way)
    assert shift.value * np.array(shift.along) == pytest.approx(-0.3 * np.array(along))
