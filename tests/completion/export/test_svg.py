# SPDX-License-Identifier: MIT
"""Floor plans: to scale, with widths whose intervals hold the truth, readable by any program."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from completion.export.building.cut import plan_of
from completion.export.room_dimensions import room_widths
from completion.export.svg import Lettering, Paper, svg_of, told_width
from tests.helpers.browser import Browser, needs_chromium
from tests.helpers.exchange_examples import SIZE, drawn, length, panorama, parts_of

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    path = tmp_path_factory.mktemp("svg") / "room.svg"
    assert panorama().export(path) == [path]
    return path.read_text("utf-8")


@pytest.fixture(scope="module")
def root(text):
    return ElementTree.fromstring(text.encode())


def test_widths_hold_the_truth_in_their_intervals(root):
    groups = [one for one in root.iter(f"{SVG}g") if "dimension" in one.get("class", "")]
    found = [[float(one.get(f"data-{key}-m")) for key in ("low", "value", "high")] for one in groups]
    assert len(found) == 2
    for (low, value, high), truth in zip(found, SIZE[:2], strict=True):
        assert low <= truth <= high
        assert value == pytest.approx(truth, abs=0.002)
        assert high - low < 0.02
    words = [one.find(f"{SVG}text").text for one in groups]
    assert all(re.fullmatch(r"\d\.\d{3} \u00b1 0\.00\d", word) for word in words)


def test_lines_are_to_scale(root):
    scale = int(root.get("data-scale"))
    assert (root.get("width"), root.get("viewBox").split()[2]) == ("297mm", "297")
    places = []
    for state in ("measured", "inferred"):
        paths = [one for one in root.iter(f"{SVG}path") if one.get("class") == state]
        places += [float(number) for one in paths for number in re.findall(r"-?[\d.]+", one.get("d"))]
    extent = np.ptp(np.reshape(places, (-1, 2)), axis=0) * scale / 1000
    assert extent == pytest.approx(SIZE[:2], abs=0.02)
    assert f"1 : {scale} on A4" in [one.text for one in root.iter(f"{SVG}text")]


def test_inferred_lines_are_dashed(text):
    assert ".inferred { stroke-width: 0.4; stroke: #1f5fbf; stroke-dasharray" in text
    assert 'class="inferred" d="M' in text
    assert "Plan, cut 1.1 m above the lowest floor" in text


def test_the_same_model_gives_the_same_text(text):
    assert svg_of(panorama().building()) == text


def test_areas_of_closed_rooms_are_told(root):
    (label,) = [one for one in root.iter(f"{SVG}text") if "area" in one.get("class", "")]
    value, half = map(float, label.text.removesuffix(" m\u00b2").split(" \u00b1 "))
    assert abs(value - SIZE[0] * SIZE[1]) <= half < 0.2


def test_openings_are_told():
    text = svg_of(parts_of(panorama("office")))
    assert re.search(r"window \d\.\d\d \u00d7 \d\.\d\d", text)


def inferred_all(patch):
    """A patch of which nothing was measured."""
    cells = np.ones_like(patch.provenance), np.full(patch.confidence.shape, 0.75)
    return replace(patch, provenance=cells[0], confidence=cells[1])


def test_a_wall_between_ends_a_width_and_inferred_walls_are_told():
    model = drawn(panorama())
    plan = plan_of(model)
    long, short = room_widths(model.walls, plan, model.errors)
    assert (long.measured_share, long.existence) == (1.0, 1.0)
    guessed = [replace(wall, patch=inferred_all(wall.patch)) for wall in model.walls]
    for one in room_widths(guessed, plan, model.errors):
        assert (one.measured_share, one.existence) == (0.0, 0.75)
    number = long.surfaces[0]
    (wall,) = (line for line in plan.lines if line.surface == number)
    middle = wall.points + (long.ends[1] - long.ends[0]) / 2
    between = replace(wall, points=middle, surface=99)
    found = room_widths(model.walls, replace(plan, lines=(*plan.lines, between)), model.errors)
    assert [one.surfaces for one in found] == [short.surfaces]


def test_intervals_are_rounded_up():
    for half, told in (
        (0.0021, "4.000 \u00b1 0.003"),
        (0.00012, "4.0004 \u00b1 0.0002"),
        (0.0, "4.0004 \u00b1 0.0001"),
        (np.inf, "4.000"),
    ):
        assert told_width(length(4.0004, half)) == told


def test_paper_takes_the_largest_scale_that_fits():
    lying = Paper.of(np.array([[0, 0], [9.0, 3.0]]))
    upright = Paper.of(np.array([[0, 0], [3.0, 9.0]]))
    assert (lying.width_mm, lying.scale, upright.width_mm, upright.scale) == (297, 50, 210, 50)
    assert Paper.of(np.array([[0, 0], [90_000.0, 3.0]])).scale % 1000 == 0
    np.testing.assert_allclose(lying.place(lying.centre[None]), [[297 / 2, 10 + (210 - 20 - 37) / 2]])


def test_text_is_read_from_below_or_the_right_and_keeps_apart():
    lettering = Lettering()
    for ends, turn in (((0, 0), (50, 0)), 0), (((50, 20), (0, 20)), 0), (((90, 50), (90, 0)), -90):
        assert lettering.along(np.array(ends, float), "1.000", 2.6)[1] == pytest.approx(turn)
    line = np.array([[0, 40], [50, 40.0]])
    places = [lettering.along(line, "1.000 and more", 2.6) for _ in range(8)]
    assert places[0] is not None
    assert places[-1] is None
    assert places[1] is None or abs(places[1][0][0] - places[0][0][0]) > 15


@pytest.mark.long
@needs_chromium
def test_a_browser_opens_it(tmp_path):
    path = tmp_path / "plan.svg"
    panorama().export(path)
    browser = Browser(tmp_path / "profile")
    try:
        tab = browser.open(path)
        assert tab.complaints() == []
        assert tab.run("document.querySelectorAll('.dimension').length") == 2
        assert (tab.pixels() < 100).all(axis=2).sum() > 500
    finally:
        browser.close()


def test_rooms_have_stamps_that_lie_over_no_wall(root):
    words = [one.text for one in root.iter(f"{SVG}text")]
    assert "Room 0.1" in words
    assert f"height {SIZE[2]:.2f} m" in words
    assert any(re.match(r".+: Plan, cut 1\.1 m above the lowest floor", word) for word in words)
    assert "Areas are between walls, doorways and things not taken off." in words


def test_blocks_of_text_keep_off_lines_and_each_other():
    lettering = Lettering()
    lettering.keep([np.array([[0.0, 0.0], [50.0, 0.0]])])
    foot = np.array([[10.0, 0.0], [12.0, 0.0]])
    assert lettering.block(foot, ["Room 0.1", "12.00 m2"], 2.6) is None
    put = lettering.block(foot + [0, 9.0], ["Room 0.1", "12.00 m2"], 2.6)
    assert [place[0] for place, _ in put] == [11.0, 11.0]
    assert put[0][0][1] < put[1][0][1]
    assert lettering.block(foot + [0, 9.0], ["x"], 2.6) is None
