# SPDX-License-Identifier: MIT
"""Cards in notebooks: well-formed, escaped, the same again, with the figures of what they show."""

import base64
import io
import re
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

import nbv.report.figures.picture as report_picture
from completion.fitting.pipeline import fit
from nbv.cover.instance import LowerBound
from nbv.plan.plan import Plan, Resumption
from nbv.plan.tour import Leg, Stations, Tour
from scenes import card
from scenes.card import Card, CardPicture, CardShare
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.scan.thumbnail import turn_upright
from scenes.world.builtin import builtin_scene
from tests.helpers.completion_examples import completed, example
from tests.helpers.room_examples import ROOM, VIEW, covered_by_two
from texture import fill, fill_surface

EVIL = "<script>alert('x')</script> & \"more\""


def tree_of(html):
    """The card as XML: well-formed, or this raises."""
    assert "<script" not in html
    assert "http" not in html.replace("http://www.w3.org/2000/svg", "")
    return ElementTree.fromstring(html)


def text_of(html):
    return " ".join("".join(tree_of(html).itertext()).split())


def pixels_of(html, number=0):
    data = re.findall(r"data:image/png;base64,([^\"]*)", html)[number]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))


@pytest.fixture(scope="module")
def scene():
    return ROOM


@pytest.fixture(scope="module")
def view():
    return VIEW


@pytest.fixture(scope="module")
def coverage():
    return covered_by_two()


@pytest.fixture(scope="module")
def plan(view, coverage):
    views = (replace(view, met_fraction=0.5 * coverage.met), replace(view, met_fraction=coverage.met))
    return Plan("nbv", view.sensor, coverage.requirement, 0.99, 0, 2, views, coverage, None, "no more")


def test_a_card_is_well_formed_whatever_it_is_told():
    picture = CardPicture(b"png", EVIL, 100)
    html = Card(EVIL, EVIL, ((EVIL, EVIL),), (CardShare(EVIL, 0.5, "#fff"),), (picture,), EVIL).to_html()
    assert text_of(html).count("<script>") == 7  # as text
    assert tree_of(html).find(".//img").get("alt") == EVIL


def test_a_bar_leaves_out_what_is_nothing():
    html = Card("a", "b", (), (CardShare("some", 1.0, "#111"), CardShare("none", 0.0, "#222"))).to_html()
    assert "some" in html
    assert "none" not in text_of(html)


def test_cards_use_the_colours_of_reports():
    for name in ("MEASURED", "INFERRED", "UNKNOWN"):
        rgb = [round(255 * part) for part in getattr(report_picture, name)]
        assert getattr(card, name) == "#" + "".join(f"{part:02x}" for part in rgb)


def test_a_scan_shows_its_figures_and_itself():
    scan = replace(example("two_occluders", pixels=100), name=EVIL, sigma_m=0.0012, sensor=EVIL, noise=EVIL)
    html = scan._repr_html_()
    text = text_of(html)
    assert EVIL in text
    assert "100 rows, 100 columns; pinhole, 65 x 65 deg" in text
    assert f"{scan.ranges.min():.3f} to {scan.ranges.max():.3f} m" in text
    assert "sd 1.2 mm" in text
    assert "0.400, 0.400, 1.700 m" in text
    assert np.array_equal(pixels_of(html, 1)[..., :3], np.rint(255 * scan.colour).astype(np.uint8))
    assert html == scan._repr_html_()
    assert len(html) < 60_000


def test_an_empty_scan_and_one_without_noise_have_cards():
    camera = PinholeProjection(3, 2, 10, 10, 1, 0.5)
    empty = RangeImage(np.full((2, 3), np.inf), camera, Pose.identity(), sigma_m=0.0)
    assert "nothing came back" in text_of(empty._repr_html_())
    assert "range noise none" in re.sub(r"noise", "noise ", text_of(empty._repr_html_()))
    assert (pixels_of(empty._repr_html_())[..., 3] == 0).all()


@pytest.mark.parametrize(("upwards", "leftwards"), [(False, False), (True, False), (False, True)])
def test_panoramas_stand_upright(upwards, leftwards):
    up, around = np.radians(np.linspace(40, -40, 9)), np.radians(np.linspace(-80, 80, 17))
    ranges = np.full((9, 17), 5.0)
    ranges[:2, -2:] = 1.0  # above, on the right: near, so yellow
    rows, columns = slice(None, None, -1 if upwards else 1), slice(None, None, -1 if leftwards else 1)
    scan = RangeImage(ranges[rows, columns], SphericalProjection(around[columns], up[rows]), Pose.identity())
    picture = pixels_of(scan._repr_html_())
    assert picture.shape[:2] == (110, 220)
    assert picture[0, -1, 0] > 200 > picture[-1, 0, 0]


@pytest.mark.parametrize(("roll", "corner"), [(0, (0, -1)), (90, (0, 0)), (-90, (-1, -1)), (180, (0, -1))])
def test_panoramas_swept_about_a_level_axis_stand_too(roll, corner):
    """What is above and on the right of the image is where the world has it."""
    up, around = np.radians(np.linspace(40, -40, 9)), np.radians(np.linspace(-80, 80, 17))
    heights = np.zeros((9, 17))
    heights[0, -1] = 1.0
    turn = np.radians(roll)  # of the scanner about its forward axis, against the clock
    pose = Pose.looking_at((0, 0, 0), (1, 0, 0)).matrix @ np.array([
        [np.cos(turn), np.sin(turn), 0, 0], [-np.sin(turn), np.cos(turn), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]
    ])  # fmt: skip
    drawn = turn_upright(heights, SphericalProjection(around, up), Pose(pose), most=17)
    assert drawn[corner] == 1.0


def test_a_scene_shows_size_area_and_warnings(scene):
    named = replace(scene, name=EVIL, warnings=(EVIL,))
    text = text_of(named._repr_html_())
    assert text.count(EVIL) == 2
    assert "6.00 x 5.00 x 2.70 m" in text
    assert f"{scene.mesh.face_areas().sum():.2f} m\u00b2 in 36 faces" in text
    assert "18 plane" in text
    office = text_of(builtin_scene("office")._repr_html_())
    assert "openings2" in office


def test_a_coverage_shows_its_shares_and_reasons(coverage):
    text = text_of(coverage._repr_html_())
    assert f"{100 * coverage.met:.1f} %" in text
    assert f"{coverage.total_m2:.2f} m\u00b2" in text
    reasons = {name: share for name, share in coverage.reasons().items() if share >= 0.0005}
    assert reasons
    assert all(f"{name.replace('_', ' ')}{100 * share:.1f} %" in text for name, share in reasons.items())
    evil = replace(coverage, surface_names=(EVIL,) * len(coverage.surface_names))
    assert EVIL in text_of(evil._repr_html_())


def test_a_plan_shows_its_curve_to_scale(plan, coverage):
    html = plan._repr_html_()
    heights = [float(y) for y in re.findall(r"V(\d+\.\d)", html.split("<path")[2])]
    rise = [118 - y for y in heights]
    assert rise[1] == pytest.approx(114 * coverage.met, abs=0.1)
    assert rise[0] == pytest.approx(rise[1] / 2, abs=0.1)
    assert "2 of 2 candidates" in text_of(html)
    assert "stopped because: no more" in text_of(html)
    assert html == plan._repr_html_()


def test_plans_without_coverage_or_views_have_cards(plan):
    assert "0 of 2 candidates" in text_of(replace(plan, views=())._repr_html_())
    unknown = replace(plan, coverage=None, resumed_from=Resumption((Pose.identity(),), None))
    assert "<svg" not in unknown._repr_html_()
    read = replace(plan, coverage=plan.coverage.summary(), resumed_from=Resumption((), 0.25))
    assert f"M0,{118 - 114 * 0.25:.1f}" in read._repr_html_()


def test_a_completion_shows_measured_and_inferred_area():
    completion = completed("chair_before_wall", pixels=120)
    text = text_of(completion._repr_html_())
    assert f"{completion.observed_m2:.2f} m\u00b2 on {len(completion.patches)} surfaces" in text
    assert f"{completion.hypothesised_m2:.2f} m\u00b2" in text
    assert "surface 1plane" in text


def test_a_fit_shows_parameters_with_deviations():
    angle, height = np.meshgrid(np.linspace(0, 3, 30), np.linspace(0, 2, 20))
    radius = 0.5 + np.random.default_rng(0).normal(0, 1e-3, angle.shape)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1).reshape(-1, 3)
    found = fit(points, "cylinder")
    text = text_of(found._repr_html_())
    assert f"radius{found.surface.radius:.6g} m" in text
    assert f"sd of radius{found.parameter_deviations()['radius']:.6g} m" in text
    assert f"{1000 * found.rms:.3g} mm" in text
    assert "sd of direction" in text
    assert "care" in text_of(replace(found, converged=False)._repr_html_())


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_a_fill_shows_the_image_and_its_sources(channels):
    image = np.random.default_rng(0).integers(0, 255, (40, 30, *channels), dtype=np.uint8)
    mask = np.zeros((40, 30), bool)
    mask[10:14, 10:15] = True
    made = fill(image, mask, window=5, rng=0)
    html = made._repr_html_()
    assert "20 pixels copied, window 5 px" in text_of(html)
    assert np.array_equal(pixels_of(html), made.image.reshape(40, 30, *[c for c in channels if c > 1]))
    assert np.array_equal(pixels_of(html, 1)[..., 3] > 0, mask)
    assert "the time was up" in text_of(replace(made, is_complete=False)._repr_html_())
    assert tree_of(fill_surface(image / 255, mask, window=5, rng=0)._repr_html_()) is not None


@pytest.mark.long
def test_cards_cost_nothing_until_they_are_shown():
    code = (
        "import sys, nbv.plan.plan; "
        "print([m for m in ('jinja2', 'matplotlib', 'nbv.report.display', 'scenes.scan.thumbnail') if m in "
        "sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_tour_and_a_bound_are_told(plan):
    tour = Tour((0, 1), (Leg(np.array([[0.5, 0.5, 1.5], [5, 4, 1.5]]), 12.34),))
    more = replace(plan, lower_bound=LowerBound(1, "counting"), stations=Stations(tour, (), 1))
    text = text_of(more._repr_html_())
    assert "lower bound1 view" in text
    assert "tour12.3 m" in text
