# SPDX-License-Identifier: MIT
"""The review page in a real browser: clicks, trials, two pages at once, by keyboard, narrow and dark."""

import os
import threading
from pathlib import Path

import pytest

from nbv.report.review.server import ReviewServer
from nbv.scanning.sensor import PinholeSensor
from tests.helpers.browser import LOOPBACK, Browser, needs_chromium
from tests.nbv.report.review.test_session import wall_of

pytestmark = [needs_chromium, pytest.mark.long]
SCREENSHOTS = os.environ.get("UNSEEN_SCREENSHOTS")
VIEW = "document.querySelector('#view').view"
IS_LIVE = f"{VIEW}?.placed && !document.body.classList.contains('is-busy')"
IDLE = "!document.body.classList.contains('is-busy')"
PRESS = "[...document.querySelectorAll('button')].find(b => b.textContent.startsWith('{}')).click()"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    running = Browser(tmp_path_factory.mktemp("chromium"), LOOPBACK)
    yield running
    running.close()


@pytest.fixture
def address(session):
    server = ReviewServer(session, "a wall and a <chair>", PinholeSensor(fov_deg=60), lambda: ["all"])
    http = server.listen()
    thread = threading.Thread(target=http.serve_forever, daemon=True)
    thread.start()
    yield server.address(http.port)
    http.shutdown()
    http.server_close()


@pytest.fixture
def tab(browser, address):
    opened = browser.open(address, 1300, 900)
    opened.wait_for(IS_LIVE, 60)
    yield opened
    assert opened.complaints() == []
    opened.close()


def press(tab, name, seconds=30):
    tab.run(PRESS.format(name))
    tab.wait_for(IDLE, seconds)


def picture(tab, name):
    if SCREENSHOTS:
        tab.whole(Path(SCREENSHOTS) / f"review_{name}.png")


def ask_wall(tab, session):
    """Press the row of the wall; its facts are shown then."""
    number = wall_of(session.completion)
    tab.run(f"document.querySelectorAll('#surfaces button')[{number - 1}].click()")
    tab.wait_for(f"document.querySelector('#place h2')?.textContent.startsWith('Surface {number},')", 30)
    tab.wait_for(IDLE)


def test_a_rejection_is_seen_before_it_is_taken_and_undone(tab, session):
    assert tab.run("document.querySelector('h1').textContent") == "a wall and a <chair>"
    ask_wall(tab, session)
    inferred = session.completion.hypothesised_m2
    press(tab, "Reject what is inferred")
    told = tab.run("document.querySelector('#consequence').textContent")
    assert f"{inferred:.2f} m\u00b2 \u2192" in told
    assert session.said == []
    assert tab.run("document.querySelectorAll('#view canvas').length") == 2
    picture(tab, "trial")
    whole = tab.pixels("#view .view-stage")
    tab.run(
        "{ const s = document.querySelector('#slide'); s.value = 0; s.dispatchEvent(new Event('input')); }"
    )
    after = tab.pixels("#view .view-stage")
    assert (whole != after).any(axis=2).mean() > 0.002
    tab.press("t")
    tab.wait_for(f"{IDLE} && document.querySelector('#history li')", 30)
    assert len(session.said) == 1
    assert session.completion.hypothesised_m2 < inferred
    tab.press("u")
    tab.wait_for(f"{IDLE} && !document.querySelector('#history li')", 30)
    assert session.completion.hypothesised_m2 == inferred
    tab.press("r")
    tab.wait_for(f"{IDLE} && document.querySelector('#history li')", 30)
    press(tab, "Save")
    assert tab.run("document.querySelector('#told').textContent") == "Written: all"


def test_a_click_in_the_picture_is_a_question(tab, session):
    number = wall_of(session.completion)
    place = session.completion.up.drawing_from_world.apply(session.completion.anchor(number)[None])[0]
    x, y = tab.run(f"{VIEW}.where({', '.join(map(str, place.tolist()))})")
    left, top, _, _ = tab.box("#view canvas")
    tab.click(left + x, top + y)
    tab.wait_for("document.querySelector('#place h2')", 30)
    tab.wait_for(IDLE)
    assert "measured" in tab.run("document.querySelector('#place').textContent")
    picture(tab, "asked")
    press(tab, "End or split here")
    assert "at this height" in tab.run("document.querySelector('#place').textContent")
    tab.run(PRESS.format("Measure from here"))
    tab.click(left + x, top + y + 30)
    tab.wait_for("document.querySelector('#told').textContent.includes('(95 %)')", 30)


def test_a_relation_that_is_refused_says_why(tab, session):
    normals = [patch.grid.surface.normal_direction for patch in session.completion.patches]
    pair = next((k, m) for k in range(len(normals)) for m in range(k) if abs(normals[k] @ normals[m]) < 0.2)
    for k in pair:
        tab.run(f"document.querySelectorAll('#surfaces button')[{k}].click()")
        tab.wait_for(f"document.querySelector('#place h2')?.textContent.startsWith('Surface {k + 1},')", 30)
        press(tab, "Add to relation")
    press(tab, "Test it")
    told = tab.run("document.querySelector('#consequence').textContent")
    assert "refused by the scans" in told
    assert "standard deviations off" in told
    picture(tab, "refused")
    press(tab, "Discard")
    assert tab.run("document.querySelector('#consequence').hidden")


def test_two_pages_at_once_show_the_same(browser, address, tab, session):
    other = browser.open(address, 1000, 800)
    other.wait_for(IS_LIVE, 60)
    ask_wall(tab, session)
    press(tab, "Reject what is inferred")
    press(tab, "Take it")
    other.wait_for("document.querySelectorAll('#history li').length === 1", 30)
    assert other.complaints() == []
    other.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_narrow_window(browser, address, scheme):
    tab = browser.open(address, 390, 844, prefers_color_scheme=scheme)
    tab.wait_for(IS_LIVE, 60)
    assert tab.run("document.documentElement.scrollWidth") <= 390
    picture(tab, f"narrow_{scheme}")
    assert tab.complaints() == []
    tab.close()


def test_a_server_that_has_gone_is_told(browser, session):
    server = ReviewServer(session, "gone", PinholeSensor(fov_deg=60), list)
    http = server.listen()
    thread = threading.Thread(target=http.serve_forever, daemon=True)
    thread.start()
    tab = browser.open(server.address(http.port), 800, 600)
    tab.wait_for(IS_LIVE, 60)
    http.shutdown()
    http.server_close()
    tab.wait_for("document.querySelector('#told').textContent.includes('What was taken is kept')", 20)
    tab.close()
