# SPDX-License-Identifier: MIT
"""What costs most is done once a run: the scene's tree is built once, each view is cast once."""

import pickle

import numpy as np
import pytest

import nbv.coverage.measurement as measurement
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.measurement import measure_coverage
from nbv.plan.baselines import compare_with_baselines
from nbv.plan.planning import plan_views
from nbv.report.coverage_report import coverage_page, plan_page
from nbv.report.figures.surface_values import below
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.samples import sample_surface
from scenes.rays.raycast import RayCaster
from scenes.world.builtin import builtin_scene

SENSOR = PinholeSensor(fov_deg=80, width=40, height=40, name="small")


@pytest.fixture
def built(monkeypatch):
    """Numbers of faces of the trees that are built."""
    faces, build = [], RayCaster.__init__

    def counted(self, *arguments, **more):
        build(self, *arguments, **more)
        faces.append(self.n_faces)

    monkeypatch.setattr(RayCaster, "__init__", counted)
    return faces


@pytest.fixture
def cast(monkeypatch):
    """Views that are cast."""
    views, look = [], measurement.visible_from_view

    def counted(caster, view, samples, limits):
        views.append(view)
        return look(caster, view, samples, limits)

    monkeypatch.setattr(measurement, "visible_from_view", counted)
    return views


@pytest.mark.long
def test_a_plan_with_its_baselines_and_reports_builds_one_tree_and_casts_each_view_once(built, cast):
    scene = builtin_scene("two_occluders")
    samples = sample_surface(scene.mesh, 0.4)
    fixed = {"budgets": CoverOptions(polish_steps=0), "samples": samples, "n_threads": 1}
    plan = plan_views(scene, SENSOR, method="cover", views=3, **fixed)
    baselines = compare_with_baselines(scene.ray_caster(1), plan, rng=0, n_threads=1)
    assert "Beside other planners" in plan_page(scene, plan, plan.coverage, 1, baselines).to_html()
    assert len(cast) == len(plan.views) == 3
    coverage = measure_coverage(scene, plan.views, samples=samples, n_threads=1)
    page = coverage_page(scene, coverage, plan.views, coverage.history, SENSOR, 1)
    assert "Coverage report" in page.to_html()
    assert len(cast) == 6
    # and one of what the plan's pictures show, cut below the ceiling
    assert built == [len(scene.mesh.faces), len(below(scene.mesh, plan.site.cut_m)[0].faces)]


def test_the_tree_of_a_scene_serves_any_number_of_threads_and_is_not_pickled():
    scene = builtin_scene("two_occluders")
    down = np.array([[3.0, 2.5, 2.0]]), np.array([[0.0, 0.0, -1.0]])
    one, two = (scene.ray_caster(n).first_hit(*down) for n in (1, 2))
    assert one.ranges.tobytes() == two.ranges.tobytes()
    again = pickle.loads(pickle.dumps(scene))
    assert again.ray_caster(1).first_hit(*down).ranges.tobytes() == one.ranges.tobytes()
