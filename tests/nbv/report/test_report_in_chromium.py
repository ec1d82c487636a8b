# SPDX-License-Identifier: MIT
"""Reports in a real browser: the 3-D view draws, its controls work, nothing is loaded, nothing breaks."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nbv.inspection.checking import CheckedDesign
from nbv.report.blocks.page import Cell, Page, PageSection, Table
from nbv.report.check_report import check_page
from nbv.report.viewer.layers import Classes, Layer
from scenes.mesh.labelled_mesh import Appearance
from tests.helpers.browser import Browser, needs_chromium
from tests.helpers.long_cases import first_in_gate
from tests.helpers.view_examples import (
    EVIL,
    FEW,
    KINDS,
    MEASURED,
    UNKNOWN,
    UTM,
    floor,
    known_page,
    known_view,
    report_page,
)
from tests.nbv.inspection.checks import example_check

pytestmark = needs_chromium
SCREENSHOTS = os.environ.get("UNSEEN_SCREENSHOTS")
LEFT, RIGHT = (1.3, 0.7, 0.0), (4.2, 1.1, 0.0)
IS_LIVE = "[...document.querySelectorAll('figure.view')].every(f => f.view?.placed)"
VIEW = "document.querySelector('figure.view').view"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    running = Browser(tmp_path_factory.mktemp("chromium"))
    yield running
    running.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    known_page().write(path)
    return path


@pytest.fixture
def tab(browser, file):
    opened = browser.open(file, 640, 520)
    opened.wait_for(IS_LIVE)
    yield opened
    assert opened.complaints() == []
    opened.close()


def place_of(tab, place):
    """Where a place is seen, relative to the canvas."""
    x, y, z = (UTM + place).tolist()
    return np.array(tab.run(f"{VIEW}.where({x}, {y}, {z})"))


def colour_at(tab, place):
    """Mean colour of 9 x 9 pixels, some stripes of a hatching, around a place."""
    column, row = np.rint(place_of(tab, place)).astype(int)
    return tab.pixels("canvas")[row - 4 : row + 5, column - 4 : column + 5].reshape(-1, 3).mean(axis=0)


def is_grey(colour):
    return np.ptp(colour) < 12 and 110 < colour.mean() < 215


def is_blue(colour):
    return colour[2] - colour[0] > 60


def is_orange(colour):
    return colour[0] - colour[2] > 60


def click_at(tab, place):
    left, top = tab.box("canvas")[:2]
    column, row = place_of(tab, place)
    tab.click(left + column, top + row)


def switch(tab, value):
    tab.run(f"document.querySelector('input[type=checkbox][value=\"{value}\"]').click()")


def values(tab):
    return dict(tab.run(f"{VIEW}.values"))


@pytest.mark.long
def test_measured_and_inferred_are_drawn_in_their_colours(tab):
    assert is_grey(colour_at(tab, LEFT))
    assert is_blue(colour_at(tab, RIGHT))


@pytest.mark.long
def test_what_is_switched_off_is_gone_and_comes_back(tab):
    ground = tab.pixels("canvas")[30, 30].astype(int)
    switch(tab, "inferred")
    assert np.abs(colour_at(tab, RIGHT) - ground).max() < 3
    assert is_grey(colour_at(tab, LEFT))
    switch(tab, "inferred")
    assert is_blue(colour_at(tab, RIGHT))
    switch(tab, "state 0")
    assert np.abs(colour_at(tab, LEFT) - ground).max() < 3


@pytest.mark.long
def test_lines_and_stations_can_be_switched_off(tab):
    before = tab.pixels("canvas").astype(int)
    for value in ("openings", "fields", "stations"):
        switch(tab, value)
        after = tab.pixels("canvas").astype(int)
        assert np.abs(after - before).max(axis=2).astype(bool).sum() > 20, value
        before = after
    assert tab.run("document.querySelectorAll('.view-labels span').length") == 0


@pytest.mark.long
def test_stepping_shows_what_is_measured_so_far(tab):
    said = "document.querySelector('.view-said').textContent"
    assert "50.0 % measured" in tab.run(said)
    tab.run("document.querySelector('button[title^=Last]').click()")
    assert "2" in tab.run(said)
    tab.run("document.querySelector('button[title^=Last]').click()")
    assert "View 1 \u00b7 0.0 % measured" in tab.run(said)
    assert is_orange(colour_at(tab, LEFT))
    tab.run("document.querySelector('button[title^=Next]').click()")
    assert is_grey(colour_at(tab, LEFT))


def test_the_best_incidence_so_far_follows_the_steps(tab):
    click_at(tab, LEFT)
    assert values(tab)["Best incidence"] == "40.0\u00b0"
    tab.run(f"{VIEW}.setStep(1)")
    assert values(tab)["Best incidence"] == "70.0\u00b0"
    assert values(tab)["State"] == "unknown"
    tab.run(f"{VIEW}.setStep(0)")
    assert values(tab)["Best incidence"] == "none"


def test_a_picked_point_is_right_to_the_millimetre_and_names_are_text(tab):
    click_at(tab, LEFT)
    found = values(tab)
    place = np.array([float(part) for part in found["x, y, z"].removesuffix(" m").split(",")])
    height = tab.run("document.querySelector('canvas').clientHeight")
    assert place[2] == pytest.approx(UTM[2], abs=0.00051)
    assert np.abs(place - UTM - LEFT).max() < 10 / height
    assert found["Surface"] == EVIL
    assert found["Standard deviation"] == "1.25 mm"
    assert found["Seen by view"] == "1 (70\u00b0), 2 (40\u00b0)"
    assert EVIL in tab.run("document.querySelector('.view-readout').textContent")
    assert tab.run("document.images.length") == 1  # the picture that stands in for the view
    click_at(tab, RIGHT)
    assert values(tab)["Why"] == "between"
    tab.press("Escape")
    assert tab.run("document.querySelector('.view-readout').hidden")


def test_keys_turn_colour_and_come_home(tab):
    tab.run("document.querySelector('canvas').focus()")
    home = tab.pixels("canvas")
    tab.press("ArrowLeft")
    tab.press("+")
    assert (tab.pixels("canvas") != home).any()
    tab.press("Home")
    assert (tab.pixels("canvas") == home).all()
    tab.press("2")
    assert tab.run("document.querySelector('.view-choices input:checked').value") == "quality"
    assert not is_grey(colour_at(tab, LEFT))
    assert "required: 60" in tab.run("document.querySelector('.view-bar i').title")
    tab.press("1")
    tab.press("Enter")
    tab.press("l")
    assert "View 1" in tab.run("document.querySelector('.view-said').textContent")
    assert (tab.pixels("canvas") != home).any()


@pytest.mark.long
def test_dragging_turns_and_the_wheel_zooms_only_what_was_clicked(tab):
    left, top, width, height = tab.box("canvas")
    x, y = left + width / 2, top + height / 2
    home = tab.run(f"{VIEW}.camera.state()")
    tab.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-40)
    assert tab.run(f"{VIEW}.camera.state()") == home
    tab.call(
        "Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, button="left", buttons=1, clickCount=1
    )
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 80, y=y + 20, button="left", buttons=1)
    tab.call(
        "Input.dispatchMouseEvent", type="mouseReleased", x=x + 80, y=y + 20, button="left", clickCount=1
    )
    turned = tab.run(f"{VIEW}.camera.state()")
    assert turned[3] < home[3]
    assert turned[5] == home[5]
    tab.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-40)
    tab.wait_for(f"{VIEW}.camera.state()[5] < {home[5]}")


@pytest.mark.long
def test_two_fingers_zoom(tab):
    left, top, width, height = tab.box("canvas")
    x, y = left + width / 2, top + height / 2
    home = tab.run(f"{VIEW}.camera.state()")
    for kind, apart in (("touchStart", 30), ("touchMove", 60), ("touchMove", 90)):
        fingers = [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
    tab.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert tab.run(f"{VIEW}.camera.state()")[5] < home[5] - 0.3


@pytest.mark.long
def test_a_cut_takes_off_what_is_higher(tab):
    tab.run(f"{VIEW}.cut = -1; {VIEW}.redraw()")
    ground = tab.pixels("canvas")[30, 30].astype(int)
    assert np.abs(colour_at(tab, LEFT) - ground).max() < 3


@pytest.mark.long
def test_faces_are_seen_from_their_front_until_it_is_asked_otherwise(tab):
    tab.run(f"{VIEW}.camera.pitch = -0.6; {VIEW}.redraw()")
    assert not is_grey(colour_at(tab, LEFT)) or np.abs(colour_at(tab, LEFT) - 247).max() < 12
    switch(tab, "backs")
    assert is_grey(colour_at(tab, LEFT))


@pytest.mark.long
def test_nothing_is_drawn_while_nothing_changes(tab):
    draws = f"{VIEW}.stage.draws"
    tab.pixels("canvas")
    before = tab.run(draws)
    tab.run("new Promise(done => setTimeout(done, 300))")
    assert tab.run(draws) == before


def test_tables_are_sorted_by_press_and_key(tab):
    column = "[...document.querySelectorAll('tbody tr')].map(row => row.cells[{}].textContent)"
    tab.run("document.querySelectorAll('th button')[1].click()")
    assert tab.run(column.format(1)) == ["<0.1", "9.5", "10", ">99.9", ""]
    assert tab.run("document.querySelectorAll('th')[1].getAttribute('aria-sort')") == "ascending"
    tab.run("document.querySelectorAll('th button')[1].focus()")
    tab.press("Enter", windowsVirtualKeyCode=13, text="\r")
    assert tab.run(column.format(1)) == [">99.9", "10", "9.5", "<0.1", ""]
    tab.run("document.querySelectorAll('th button')[0].click()")
    assert tab.run(column.format(0))[1:] == ["a", "b", "c", "d"]
    assert tab.run(column.format(0))[0] == EVIL


def long_page(columns=2):
    """A table of 63 rows, the last one called "needle", and more columns than asked for are numbers."""
    names = [*(f"row {k}" for k in range(62)), "needle"]
    rows = tuple((Cell(name), *(Cell(str(k)) for _ in range(columns - 1))) for k, name in enumerate(names))
    table = Table(("Name", *(f"#quantity {k}, m\u00b2" for k in range(columns - 1))), rows)
    return Page("Long", "Test", "", (), None, (PageSection("Table", (table,)),))


SHOWN_ROWS = (
    "[...document.querySelectorAll('tbody tr')].filter(row => row.offsetParent)"
    ".map(row => row.cells[0].textContent)"
)


def test_a_long_table_is_folded_searched_sorted_and_printed_whole(browser, tmp_path):
    long_page().write(tmp_path / "long.html")
    tab = browser.open(tmp_path / "long.html", 900, 700)
    assert tab.run(SHOWN_ROWS) == [f"row {k}" for k in range(20)]
    assert tab.run("document.querySelector('.more summary').innerText.trim()") == "and 43 more rows"
    tab.run("document.querySelectorAll('th button')[1].click()")
    tab.run("document.querySelectorAll('th button')[1].click()")
    assert tab.run(SHOWN_ROWS)[:2] == ["needle", "row 61"]
    assert len(tab.run(SHOWN_ROWS)) == 20
    tab.run(
        "(s => { s.value = 'ROW 6'; s.dispatchEvent(new Event('input', { bubbles: true })); })"
        "(document.querySelector('input[type=search]'))"
    )
    assert tab.run(SHOWN_ROWS) == ["row 61", "row 60", "row 6"]
    assert tab.run("document.querySelector('.more').hidden")
    tab.run(
        "(s => { s.value = ''; s.dispatchEvent(new Event('input', { bubbles: true })); })"
        "(document.querySelector('input[type=search]'))"
    )
    tab.call("Emulation.setEmulatedMedia", media="print")
    assert len(tab.run(SHOWN_ROWS)) == 63
    tab.call("Emulation.setEmulatedMedia", media="")
    tab.run("document.querySelector('.more summary').click()")
    assert len(tab.run(SHOWN_ROWS)) == 63
    assert tab.complaints() == []
    tab.close()


def test_without_scripts_a_long_table_still_opens(browser, tmp_path):
    long_page().write(tmp_path / "long.html")
    tab = browser.open(tmp_path / "long.html", 900, 700, scripts=False)
    assert len(tab.run(SHOWN_ROWS)) == 20
    left, top, _, height = tab.box(".more summary")
    tab.click(left + 20, top + height / 2)
    assert len(tab.run(SHOWN_ROWS)) == 63
    tab.close()


@pytest.mark.parametrize(("columns", "scrolls"), [(2, False), (9, True)])
def test_a_table_that_is_wider_than_the_page_says_so(browser, tmp_path, columns, scrolls):
    long_page(columns).write(tmp_path / "wide.html")
    tab = browser.open(tmp_path / "wide.html", 390, 700)
    note = "document.querySelector('.sideways')"
    tab.wait_for(f"{note}.hidden === {str(not scrolls).lower()}")
    assert tab.run("document.querySelector('.scroll').tabIndex") == (0 if scrolls else -1)
    tab.close()


def test_a_distance_is_measured_by_clicks_and_by_keys(tab):
    tab.run(f"{VIEW}.ruler.click()")
    assert "first point" in tab.run("document.querySelector('.view-readout').textContent")
    click_at(tab, LEFT)
    assert "second point" in tab.run("document.querySelector('.view-readout').textContent")
    click_at(tab, RIGHT)
    length = np.linalg.norm(np.subtract(RIGHT, LEFT))
    text, unit = values(tab)["Distance"].split(" ")
    assert (float(text), unit) == (pytest.approx(length, abs=0.03), "m")
    assert values(tab)["of it along x, y, z"].startswith("2.9")
    tab.press("Escape")
    assert tab.run("document.querySelector('.view-readout').hidden")
    # the middle is read out, and measured from; the second point is 0.3 m away
    tab.run(f"document.querySelector('canvas').focus(); {VIEW}.camera.shift(-0.1, 0)")
    tab.press("Enter")
    tab.press("m")
    start = tab.run(f"{VIEW}.point.point")
    tab.run(f"{VIEW}.camera.shift(0.05, 0)")
    tab.press("Enter")
    apart = np.linalg.norm(np.subtract(tab.run(f"{VIEW}.point.point"), start))
    text, unit = values(tab)["Distance"].split(" ")
    assert (float(text) / (1000 if unit == "mm" else 1), unit) == (pytest.approx(apart, abs=1e-3), "mm")
    tab.press("Enter")  # the next point begins anew
    assert "Distance" not in values(tab)


def test_what_is_unknown_is_named_in_natural_colours_too_and_can_be_switched_off(browser, tmp_path):
    corners, faces = floor(0.0)
    skin = Appearance(np.full((2, 3, 3), 0.4, np.float32))
    natural = Layer("measured", "measured", corners, faces, MEASURED, skin=skin)
    unknown = Layer("unknown", "unknown: hidden, not inferred", floor(3.0)[0], faces, UNKNOWN)
    view = replace(known_view(), layers=(natural, unknown), mode="skin", met=(), lines=())
    replace(known_page(), sections=(PageSection("View", (view,)),)).write(tmp_path / "unknown.html")
    tab = browser.open(tmp_path / "unknown.html", 640, 520)
    tab.wait_for(IS_LIVE)
    assert "unknown" in tab.run("document.querySelector('.view-key').textContent")
    assert is_orange(colour_at(tab, RIGHT))
    switch(tab, "unknown")
    assert not is_orange(colour_at(tab, RIGHT))
    assert tab.complaints() == []
    tab.close()


def test_the_first_picture_is_filled_by_what_is_shown(tab):
    """The middle of each side of the picture's filled part lies within a tenth of the picture's edge."""
    tab.run(
        "for (const key of ['openings', 'fields', 'stations'])"
        " document.querySelector(`input[type=checkbox][value=${key}]`).click();"
    )
    pixels = tab.pixels("canvas").astype(int)
    rows, columns = np.nonzero(np.abs(pixels - pixels[4, 4]).max(axis=2) > 20)
    across, along = np.ptp(columns) / pixels.shape[1], np.ptp(rows) / pixels.shape[0]
    assert 0.85 < max(across, along) <= 1


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_pages_fit_the_window_in_light_and_dark(browser, file, width, scheme):
    tab = browser.open(file, width, 800, prefers_color_scheme=scheme)
    tab.wait_for(IS_LIVE)
    assert tab.run("document.documentElement.scrollWidth") <= width
    ground = tab.pixels("canvas")[5, 5].astype(int)
    assert (ground < 60).all() if scheme == "dark" else (ground > 235).all()
    assert is_blue(colour_at(tab, RIGHT))
    assert tab.complaints() == []
    tab.close()


def test_in_print_the_pictures_stand_in(tab):
    shown = "getComputedStyle(document.querySelector('{}')).display"
    assert tab.run(shown.format(".view-still")) == "none"
    tab.call("Emulation.setEmulatedMedia", media="print")
    assert tab.run(shown.format(".view-live")) == "none"
    assert tab.run(shown.format(".view-still")) == "block"
    tab.call("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("missing", ["WebGL2RenderingContext", "DecompressionStream", "scripts", "drawing"])
def test_without_what_it_needs_the_pictures_stay(browser, file, missing):
    if missing == "scripts":
        tab = browser.open(file, scripts=False)
    elif missing == "drawing":
        tab = browser.open(file, before="HTMLCanvasElement.prototype.getContext = () => null")
        tab.wait_for("document.querySelector('figure.view.has-failed')")
        assert "cannot be drawn" in " ".join(tab.complaints())
    else:
        tab = browser.open(file, before=f"delete window.{missing}")
    assert tab.run("getComputedStyle(document.querySelector('.view-still')).display") == "block"
    assert not tab.run("!!document.querySelector('canvas')")
    assert "stand in for the 3-D view" in tab.run("document.querySelector('.view-still p').textContent")
    tab.close()


def test_the_page_may_load_nothing(browser, file):
    tab = browser.open(file)
    blocked = tab.run(
        "new Promise(done => {"
        " addEventListener('securitypolicyviolation', event => done(event.effectiveDirective));"
        " new Image().src = 'http://127.0.0.1:9/x.png'; })"
    )
    assert blocked == "img-src"
    tab.close()


@pytest.mark.long
@pytest.mark.parametrize(
    "kind", KINDS if SCREENSHOTS else [*FEW, pytest.param("study", marks=pytest.mark.long)]
)
def test_each_kind_of_report_comes_to_life(browser, tmp_path, kind):
    """With UNSEEN_SCREENSHOTS=FOLDER pictures of all kinds, light and dark, wide and narrow, go there."""
    file = tmp_path / "report.html"
    report_page(kind).write(file)
    for width, scheme in ((1280, "light"), (390, "dark")):
        tab = browser.open(file, width, 900, prefers_color_scheme=scheme)
        n_views = tab.run("document.querySelectorAll('figure.view').length")
        for k in range(n_views):
            tab.run(f"document.querySelectorAll('figure.view')[{k}].scrollIntoView()")
            tab.wait_for(f"document.querySelectorAll('figure.view')[{k}].view")
        assert (n_views > 0) == (kind != "study")
        assert np.ptp(tab.pixels("canvas" if n_views else "img").astype(int), axis=2).max() > 60
        assert tab.run("document.documentElement.scrollWidth") <= width
        assert tab.complaints() == []
        if SCREENSHOTS:
            save(tab, Path(SCREENSHOTS), f"{kind}-{width}-{scheme}")
        tab.close()


def save(tab, folder, name):
    folder.mkdir(parents=True, exist_ok=True)
    if tab.run("document.querySelector('figure.view') !== null"):
        Image.fromarray(tab.pixels("figure.view")).save(folder / f"{name}-view.png")
    tab.run("scrollTo(0, 0)")
    tab.whole(folder / f"{name}.png")


def page_with(view):
    return Page("Test", "Test", "Test", (), None, (PageSection("View", (view,)),), {}, 0)


@pytest.mark.parametrize("kind", first_in_gate(1, ["next-stations", "completion", "coverage", "check"]))
def test_no_table_is_cut_off_on_a_screen_or_on_paper(browser, tmp_path, kind):
    report_page(kind).write(tmp_path / "report.html")
    wide = (
        "[...document.querySelectorAll('.scroll')]"
        ".filter(e => e.offsetParent && e.scrollWidth > e.clientWidth + 1)"
        ".map(e => e.innerText.slice(0, 60))"
    )
    for media, width in (("screen", 1240), ("print", 680)):  # A4 within its margins
        tab = browser.open(tmp_path / "report.html", width, 900)
        tab.call("Emulation.setEmulatedMedia", media=media)
        assert tab.run("document.querySelectorAll('.scroll').length") > 0
        assert tab.run(wide) == []
        tab.close()


def test_names_of_near_stations_do_not_cover_each_other(browser, tmp_path):
    view = known_view()
    places = np.random.default_rng(0).uniform([0, 0, 1], [5, 2, 2], (60, 3))
    markers = [replace(view.markers[0], name=str(k), origin=UTM + at) for k, at in enumerate(places, start=1)]
    page_with(replace(view, markers=tuple(markers))).write(tmp_path / "dense.html")
    tab = browser.open(tmp_path / "dense.html", 640, 520)
    tab.wait_for(IS_LIVE)
    tab.pixels("canvas")
    rectangles = np.array(
        tab.run(
            "[...document.querySelectorAll('.view-labels span')].map(e => e.getBoundingClientRect())"
            ".map(b => [b.left, b.top, b.right, b.bottom])"
        )
    )
    assert len(rectangles) > 15
    low = np.maximum(rectangles[:, None, :2], rectangles[None, :, :2])
    high = np.minimum(rectangles[:, None, 2:], rectangles[None, :, 2:])
    common = np.maximum(high - low, 0).prod(axis=2)
    np.fill_diagonal(common, 0)
    assert common.max() == 0
    assert tab.complaints() == []
    tab.close()


def test_what_is_unknown_is_shown_in_its_colour_and_hidden(browser, tmp_path):
    view = known_view()
    corners, faces = floor(6.0)
    state = Classes("state", "State", (MEASURED, UNKNOWN), np.ones(2, np.uint16))
    unknown = Layer("unknown", "unknown: hidden, not inferred", corners, faces, UNKNOWN, channels=(state,))
    page_with(replace(view, layers=(*view.layers, unknown))).write(tmp_path / "unknown.html")
    tab = browser.open(tmp_path / "unknown.html", 640, 520)
    tab.wait_for(IS_LIVE)
    middle = (7.0, 1.0, 0.0)
    assert is_orange(colour_at(tab, middle))
    switch(tab, "unknown")
    assert not is_orange(colour_at(tab, middle))
    switch(tab, "unknown")
    tab.run("document.querySelector('input[type=radio][value=quality]')?.click()")
    assert is_orange(colour_at(tab, middle))  # also where another channel says nothing of it
    assert tab.complaints() == []
    tab.close()


def test_elements_of_a_check_are_chosen_by_verdict_storey_and_class(browser, tmp_path):
    check_page(CheckedDesign(example_check()), "room.ifc", n_threads=1).write(tmp_path / "check.html")
    tab = browser.open(tmp_path / "check.html", 900, 700)
    tab.wait_for("document.querySelector('.filters')")
    bar = "document.querySelectorAll('.filters')[0]"
    rows = f"[...{bar}.nextElementSibling.nextElementSibling.querySelectorAll('tbody tr')]"
    shown = f"{rows}.filter(r => r.offsetHeight).length"

    def chosen(number, value):
        tab.run(f"{bar}.children[{number}].value = '{value}'")
        tab.run(f"{bar}.dispatchEvent(new Event('change'))")
        return tab.run(shown), tab.run(f"{bar}.querySelector('output').textContent").strip()

    assert tab.run(f"{bar}.children.length") == 4  # three choices, and how many
    assert tab.run(shown) == 5
    assert chosen(2, "IfcWall") == (3, "3 of 5 rows")
    assert chosen(0, "deviates") == (1, "1 of 5 rows")
    assert chosen(0, "missing") == (0, "0 of 5 rows")
    assert tab.complaints() == []
    tab.close()
