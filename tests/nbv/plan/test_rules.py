# SPDX-License-Identifier: MIT
"""Rules of thumb: where they put stations, what these measure, and how a plan is told beside them."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.measurement import measure_coverage
from nbv.plan.planning import plan_views
from nbv.plan.rules import RULES, compare_with_rules, grid_places, room_and_doorway_places, rule_poses
from nbv.report.blocks.room_tables import rule_sentences, rules_section
from nbv.scanning.sensor import View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.samples import sample_surface
from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene
from tests.helpers.buildings import Building, house

PANORAMA = load_sensor("panorama")


def hall(width, depth):
    made = Building()
    made.box("slab", (0, 0, -0.2), (width, depth, 0))
    made.box("roof", (0, 0, 3), (width, depth, 3.2))
    for axis, at, end in ((1, 0.1, depth), (1, width - 0.1, depth), (0, 0.1, width), (0, depth - 0.1, width)):
        made.wall(axis, at, 0, end, 0, 3, 0.2)
    return made.scene("hall")


@pytest.mark.parametrize(("size", "n"), [((15.4, 10.4), 6), ((4.0, 3.0), 1), ((23.0, 4.0), 5)])
def test_a_hall_gets_a_grid_of_five_metres_in_its_middle(size, n):
    places = grid_places(find_site(hall(*size)))
    assert len(places) == n
    assert places[:, :2].mean(axis=0) == pytest.approx(np.array(size) / 2, abs=0.1)
    assert places[:, 2] == pytest.approx(0.0)
    if n > 1:
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        assert apart[apart > 0].min() == pytest.approx(5.0)


def test_a_finer_grid_has_its_own_step():
    places = grid_places(find_site(hall(15.4, 10.4)), 2.5)
    assert len(places) == 6 * 4
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    assert apart[apart > 0].min() == pytest.approx(2.5)


def test_rooms_and_doorways_are_each_one_station():
    made = house(3)
    site = find_site(made.scene(), SiteOptions(heights_m=(1.6,)))
    places = room_and_doorway_places(site)
    inner = [way for way in made.doorways if min(way[0], way[1]) > 0.3]
    assert len(places) == len(made.rooms) + len(inner)
    for x0, y0, x1, y1, z in inner:
        middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, z])
        assert np.linalg.norm(places - middle, axis=1).min() < 0.45
    for x0, y0, x1, y1, _ in made.rooms:
        inside = (places[:, 0] > x0) & (places[:, 0] < x1) & (places[:, 1] > y0) & (places[:, 1] < y1)
        assert inside.any()


def test_poses_are_candidates_near_the_places_and_at_the_instruments_height():
    site = find_site(house(33, storeys=2).scene())
    candidates = site.candidates(PANORAMA)
    for name in RULES:
        numbers = rule_poses(name, site, candidates)
        assert len(set(numbers)) == len(numbers)
        positions = candidates.positions[numbers]
        heights = site.rooms.height_above_floor(positions)
        assert np.median(heights) == pytest.approx(1.6)
        assert set(site.rooms.room_of(positions).tolist()) == set(site.chosen)


@pytest.fixture(scope="module")
def planned():
    scene = house(3).scene()
    plan = plan_views(
        scene, PANORAMA, method="cover", target=0.9, site=SiteOptions(heights_m=(1.6,)),
        samples=sample_surface(scene.mesh, 0.3), budgets=CoverOptions(polish_steps=100), rng=0, n_threads=1,
    )  # fmt: skip
    return scene, plan


@pytest.mark.long
def test_outcomes_are_what_measuring_says_and_the_bound_holds_for_them(planned):
    scene, plan = planned
    outcomes = compare_with_rules(scene.ray_caster(1), plan)
    assert [one.name for one in outcomes] == list(RULES)
    for one in outcomes:
        numbers = rule_poses(one.name, plan.site, plan.candidates)
        views = [View(plan.candidates.pose(number), PANORAMA) for number in numbers]
        found = measure_coverage(
            scene, views, plan.requirement, samples=plan.coverage.samples, candidates=plan.candidates,
            sensor=PANORAMA, n_threads=1,
        )  # fmt: skip
        assert one.stations == len(views)
        assert one.met == pytest.approx(found.met)
        assert one.met_of_reachable == pytest.approx(found.met_of_reachable)
        if one.stations_to_target is not None:
            assert plan.lower_bound.views <= one.stations_to_target <= one.stations
        else:
            assert one.met_of_reachable < 0.9
    sentences = rule_sentences(plan, outcomes)
    assert f"(rule:grid5m) takes {outcomes[0].stations} station" in sentences[0]
    assert sentences[0].endswith(
        f"this plan {len(plan.views)} stations and {100 * plan.coverage.met_of_reachable:.1f} %"
    )
    (section,) = rules_section(plan, outcomes)
    assert section.title == "Beside rules of thumb"
    assert rules_section(plan, ()) == ()


@pytest.mark.long
def test_a_rule_is_a_method(planned):
    scene, plan = planned
    ruled = plan_views(
        scene, PANORAMA, method="rule:grid5m", target=1.0, site=SiteOptions(heights_m=(1.6,)),
        samples=sample_surface(scene.mesh, 0.3), rng=0, n_threads=1,
    )  # fmt: skip
    outcome = compare_with_rules(scene.ray_caster(1), plan)[0]
    assert len(ruled.views) == outcome.stations
    assert ruled.coverage.met == pytest.approx(outcome.met)
    assert ruled.stopped_because == "all stations of the rule are taken"


def test_rules_are_refused_where_they_say_nothing():
    room, own = builtin_scene("two_occluders"), Candidates(np.array([[3.0, 1.0, 1.6]]), np.eye(3))
    with pytest.raises(InputError, match=r"give a scene of rooms.*panorama, not generic60"):
        plan_views(
            room, load_sensor("generic60"), method="rule:grid5m", samples=sample_surface(room.mesh, 0.5)
        )
    with pytest.raises(InputError, match="no candidates of your own"):
        plan_views(room, PANORAMA, method="rule:grid5m", candidates=own)


@pytest.mark.long
def test_the_command_tells_the_rules_beside_a_plan(tmp_path):
    line = ["plan", "builtin:two_occluders", "--method", "cover", "--sensor", "panorama", "--target", "0.9"]
    line += ["--heights", "1.6", "--spacing", "1", "--polish-steps", "0", "--start", "1.2,4.1"]
    result = CliRunner().invoke(app, [*line, "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.stderr
    written = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert set(written["rules"]) == set(RULES)
    assert written["views"][0]["world_from_sensor"][0][3] == pytest.approx(1.2)
    assert (
        f"a station every 5 m (rule:grid5m) takes {written['rules']['rule:grid5m']['stations']} station"
        in result.stdout
    )
    assert "Beside rules of thumb" in (tmp_path / "out" / "report.html").read_text()
