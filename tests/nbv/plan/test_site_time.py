# SPDX-License-Identifier: MIT
"""Time on site: budgets that are kept, steps that are as coarse as they may be, stations that are blocked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from nbv import measure_coverage, plan_views
from nbv.plan.plan import Plan, read_plan
from nbv.plan.site_time import SitePace, coarser, knees
from nbv.scanning.sensor import SphericalSensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.site_options import SiteOptions
from scenes.checks import InputError
from scenes.world.builtin import builtin_scene

SENSOR = SphericalSensor(points_per_s=20_000.0, name="tripod")
SITE = SiteOptions(heights_m=(1.6,), spacing_m=1.0)
ROOM = builtin_scene("two_occluders")


def planned(**options: object) -> Plan:
    given = {"method": "cover", "site": SITE, "rng": 0, **options}
    return plan_views(ROOM, given.pop("sensor", SENSOR), **given)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole() -> Plan:
    return planned()


def test_a_plan_tells_its_time_and_reads_back(whole, tmp_path) -> None:
    time = whole.time
    scan_s = 1080 * 451 / 20_000
    assert time.scans_s == pytest.approx([scan_s] * len(whole.views))
    assert time.total_s == pytest.approx(len(whole.views) * (scan_s + 180) + time.walked_m)
    whole.save(tmp_path)
    again = read_plan(tmp_path / "plan.json")
    assert again.time == time
    assert again.lost_if_blocked == pytest.approx(whole.lost_if_blocked)


def test_a_station_that_is_blocked_costs_what_it_alone_met(whole) -> None:
    met = whole.coverage.met
    for number, lost in enumerate(whole.lost_if_blocked):
        others = [view for k, view in enumerate(whole.views) if k != number]
        left = measure_coverage(
            ROOM, others, whole.requirement, samples=whole.coverage.samples,
            candidates=whole.candidates,
        )  # fmt: skip
        assert met - left.met == pytest.approx(lost, abs=1e-9)


def test_a_budget_is_kept_and_the_bound_holds(whole) -> None:
    half = whole.time.total_s / 120
    within = planned(pace=SitePace(budget_min=half))
    assert within.time.total_s <= 60 * half
    assert 0 < within.coverage.met < whole.coverage.met
    assert within.coverage.met <= within.most_in_time <= 1.1 * within.coverage.met
    with pytest.raises(InputError, match="less than one station takes"):
        planned(pace=SitePace(budget_min=1, set_up_min=3))
    with pytest.raises(InputError, match="not both"):
        planned(pace=SitePace(budget_min=30.0), views=3)
    with pytest.raises(InputError, match="points_per_s: give --scan-time"):
        planned(sensor=replace(SENSOR, points_per_s=None), pace=SitePace(budget_min=30.0))


def test_steps_are_coarser_where_points_lie_densely_enough() -> None:
    """Coarser scans meet the density on the same samples; one more step would lose some."""
    requirement = Requirement(max_incidence_deg=60, min_density_per_m2=400.0)
    plan = planned(requirement=requirement)
    columns = [view.sensor.width for view in plan.views]
    assert min(columns) < SENSOR.width
    assert plan.time.total_s < len(columns) * (1080 * 451 / 20_000 + 180) + plan.time.walked_m
    fine = [replace(view, sensor=SENSOR) for view in plan.views]
    met = measure_coverage(
        ROOM, fine, requirement, samples=plan.coverage.samples, candidates=plan.candidates
    ).met
    assert met == pytest.approx(plan.coverage.met)
    assert coarser(SENSOR, 2).width == 540


def test_curves_without_a_bend_have_no_knees() -> None:
    assert knees(np.linspace(0, 1, 9).tolist()) == ()
    assert knees([0.0, 0.4, 0.5]) == ()


def test_a_storey_without_stairs_is_told() -> None:
    """Two storeys, one over the other, without any way between them."""
    low = trimesh.Trimesh(ROOM.mesh.vertices, ROOM.mesh.faces, process=False)
    high = low.copy().apply_translation([0.0, 0.0, float(low.extents[2]) + 0.3])
    both = trimesh.util.concatenate([low, high])
    plan = plan_views(both, SENSOR, method="cover", mode="room", site=SITE, views=2, rng=0)
    assert any("no stairs lead to storey 2 (the top one)" in text for text in plan.site.warnings)
