# SPDX-License-Identifier: MIT
"""Numbers agree with their nouns wherever people read them, above all when there is one of a thing."""

import pytest

from nbv.commands.plan import lines_of
from nbv.cover.instance import LowerBound
from nbv.coverage.measurement import visibility_history
from nbv.plan.planning import plan_views
from nbv.report.coverage_report import coverage_page, plan_page
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.samples import sample_surface
from scenes.world.builtin import builtin_scene


@pytest.fixture(scope="module")
def room():
    return builtin_scene("two_occluders")


@pytest.fixture(scope="module")
def one_view(room):
    samples = sample_surface(room.mesh, 0.4)
    return plan_views(room, load_sensor("panorama"), method="cover", views=1, samples=samples, rng=0)


def test_a_plan_of_one_view_speaks_of_one_view(one_view):
    first, reason, *_ = lines_of(one_view)
    assert first.startswith("1 view measures ")
    assert reason == "stopped because: the limit of 1 view is reached"


def test_reports_of_one_view_speak_of_one_view(room, one_view):
    page = plan_page(room, one_view, one_view.coverage, 1)
    assert page.summary.startswith("1 view with panorama, planned knowing the scene, measures ")
    view = one_view.views[0]
    seen = visibility_history(room.ray_caster(1), one_view.coverage.samples, one_view.requirement, [view])
    page = coverage_page(room, one_view.coverage, [view], seen, view.sensor, 1)
    assert page.summary.startswith("1 station measures ")


@pytest.mark.parametrize(("views", "said"), [(1, "at least 1 view is needed"), (2, "at least 2 views are")])
def test_bounds_agree_with_their_noun(views, said):
    assert LowerBound(views, "dual").describe().startswith(said)
