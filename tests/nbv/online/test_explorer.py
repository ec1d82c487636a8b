# SPDX-License-Identifier: MIT
"""Exploration step by step: the same as at once, what each step tells, files, and the report."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from nbv import Exploration, Explorer, PinholeSensor, PlannerOptions, explore, scan_scene, sphere_candidates
from nbv.report.display import _page_of
from scenes import Scene, read_scan
from scenes.checks import InputError

WORLD = Scene.from_mesh(trimesh.creation.capsule(height=0.5, radius=0.2), mode="object")
CAMERA = PinholeSensor(fov_deg=50, width=64, height=64, max_range_m=6)
PLACES = sphere_candidates(WORLD, CAMERA, 40)


def explorer(max_views: int = 3) -> Explorer:
    return Explorer(
        scan=lambda pose: scan_scene(WORLD, pose, CAMERA, rng=0),
        volume=WORLD.mesh.bounds(),
        start=PLACES.pose(0),
        candidates=PLACES,
        sensor=CAMERA,
        options=PlannerOptions(max_views=max_views),
        from_outside=True,
    )


@pytest.fixture(scope="module")
def found() -> Exploration:
    steps = explorer()
    for _ in steps:
        pass
    return steps.exploration


def test_steps_are_those_of_exploring_at_once(found) -> None:
    whole = explore(
        lambda pose: scan_scene(WORLD, pose, CAMERA, rng=0), WORLD.mesh.bounds(), PLACES.pose(0), PLACES,
        CAMERA, options=PlannerOptions(max_views=3), from_outside=True,
    )  # fmt: skip
    assert len(found.steps) == 3
    assert found.stopped_because == whole.stopped_because == "the limit of 3 views is reached"
    for one, other in zip(found.steps, whole.steps, strict=True):
        assert one.world_from_sensor.matrix.tobytes() == other.world_from_sensor.matrix.tobytes()
    assert (found.voxels.labels == whole.voxels.labels).all()


def test_each_step_tells_what_is_known_after_it(found) -> None:
    """Surface grows, and the boundary of the unknown shrinks in the end."""
    measured = [row["measured_m2"] for row in found.curve()]
    assert measured == sorted(measured)
    assert measured[0] > 0
    assert found.steps[-1].unknown_m2 < found.steps[0].unknown_m2
    assert all(step.met_m2 <= step.measured_m2 for step in found.steps)
    assert [step.expected_gain_m2 is None for step in found.steps] == [True, False, False]


def test_a_loop_that_is_left_keeps_what_was_found() -> None:
    steps = explorer()
    for number, _ in enumerate(steps, start=1):
        if number == 2:
            break
    assert len(steps.exploration.scans) == 2
    assert steps.exploration.stopped_because == "the loop was left"
    with pytest.raises(InputError, match="can run only once"):
        next(iter(steps))


def test_an_exploration_is_saved_and_shown(found, tmp_path) -> None:
    found.save(tmp_path / "seen")
    content = json.loads((tmp_path / "seen" / "exploration.json").read_text())
    assert [step["views"] for step in content["steps"]] == [1, 2, 3]
    scan = read_scan(tmp_path / "seen" / "scans" / "0002.npz")
    assert np.array_equal(scan.ranges, found.scans[1].ranges)
    assert len((tmp_path / "seen" / "curve.csv").read_text().splitlines()) == 4
    page = _page_of(found, None, (), None, 1)
    assert "measured as required" in str(page.headlines)
    assert len(repr(found)) < 400
