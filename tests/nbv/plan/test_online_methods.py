# SPDX-License-Identifier: MIT
"""Planners of the literature in plans, studies and the command: labelled, and refused where none fits."""

import csv

import pytest
import trimesh
from typer.testing import CliRunner

from nbv import PinholeSensor, PlannerOptions, plan_views, sphere_candidates
from nbv.cli import app
from nbv.cover.overlap import OverlapOptions
from nbv.plan.plan import Plan
from nbv.plan.problem import RemoteVisibility
from nbv.report.blocks.inference import measured_sentence
from nbv.run.plan_options import ONLINE_METHODS, Method
from nbv.run.workers import ThisProcess
from nbv.visibility.samples import sample_surface
from scenes import Scene
from scenes.checks import InputError
from tests.helpers.study_examples import SMALL, write_study

WORLD = Scene.from_mesh(trimesh.creation.box((0.4, 0.3, 0.2)), mode="object")
CAMERA = PinholeSensor(fov_deg=50, width=64, height=64, max_range_m=6)
PLACES = sphere_candidates(WORLD, CAMERA, 40)
SAMPLES = sample_surface(WORLD.mesh, 0.02)


def planned(method: Method, **given) -> Plan:
    return plan_views(
        WORLD, CAMERA, method=method, candidates=PLACES, samples=SAMPLES, **{"rng": 0, "target": 0.9, **given}
    )


@pytest.mark.parametrize("method", ONLINE_METHODS)
def test_online_methods_plan_from_the_same_start_until_the_target(method: Method) -> None:
    plan = planned(method, views=30)
    assert plan.method == method
    assert (
        plan.views[0].world_from_sensor.matrix.tobytes()
        == planned("nbv", views=1).views[0].world_from_sensor.matrix.tobytes()
    )
    assert "planned without knowing the scene" in measured_sentence(plan, plan.coverage)
    assert plan.stopped_because.startswith("target met")
    assert planned(method, views=30).to_json() == plan.to_json()


def test_a_criterion_in_the_options_is_the_method_of_the_plan() -> None:
    by_options = planned("nbv", views=3, options=PlannerOptions(criterion="proximity"))
    assert by_options.to_json() == planned("online:proximity", views=3).to_json()
    other = planned("online:frontier", views=3, options=PlannerOptions(criterion="proximity"))
    assert other.method == "online:frontier"


def test_online_methods_refuse_what_they_do_not_use(tmp_path) -> None:
    with pytest.raises(InputError, match="nbv or cover, not of online:entropy"):
        planned("online:entropy", infer=True)
    with pytest.raises(InputError, match="method cover, not online:entropy"):
        planned("online:entropy", overlap=OverlapOptions())
    with pytest.raises(InputError, match="they do not serve method online:entropy"):
        planned("online:entropy", remote=RemoteVisibility(ThisProcess(1), tmp_path))
    result = CliRunner().invoke(app, ["plan", "--scans", "scan.npz", "--method", "online:entropy"])
    assert result.exit_code == 2
    assert "needs a scene" in result.stderr


def test_a_study_compares_them(tmp_path) -> None:
    planners = "".join(f'[[planners]]\nmethod = "{name}"\nviews = 2\n\n' for name in ONLINE_METHODS)
    text = SMALL.split("[[planners]]")[0].replace("seeds = 2", "seeds = 1") + planners
    result = CliRunner().invoke(app, ["study", str(write_study(tmp_path, text)), "-o", str(tmp_path / "out")])
    assert result.exit_code == 0, result.stderr
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text("utf-8").splitlines()))
    assert {row["planner"] for row in rows} == set(ONLINE_METHODS)
    assert all(row["views"] == "2" and not row["error"] for row in rows)
