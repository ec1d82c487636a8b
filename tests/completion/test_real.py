# SPDX-License-Identifier: MIT
"""Real scans: what a person sees in them must come out."""

from functools import cache

import numpy as np
import pytest

from completion import Completion, CompletionOptions, complete
from completion.evidence.evidence import Label
from scenes.io.scan_files import read_scan
from scenes.surfaces.catalogue import Cylinder, Plane
from tests.helpers.data_paths import data_path, requires_data

pytestmark = requires_data


@cache
def completed(name: str) -> Completion:
    options = {"range/icl_nuim#1": {"intrinsics": (481.2, -480.0, 319.5, 239.5), "depth_scale": 5000.0}}
    scan = read_scan(data_path(name), **options.get(name, {}))
    return complete(scan, CompletionOptions(texture=False), rng=0)


LONG = [pytest.param(name, marks=pytest.mark.long) for name in ("range/icl_nuim#1", "range/e57/pumpA.e57")]


@pytest.mark.parametrize("name", ["range/pcl/office1.pcd", *LONG])
def test_nothing_is_inferred_in_observed_free_space(name):
    found = completed(name)
    assert found.hypothesised_m2 > 0.5
    assert found.free_space_violation_m2 <= 50e-6 * found.hypothesised_m2


@pytest.mark.long
def test_pump_room_vertical_pipe_has_its_radius():
    """Check value 87.7 +- 0.8 mm for columns 227-239, rows 721-999 (robust fits with a free axis)."""
    found = completed("range/e57/pumpA.e57")
    window = found.owners[0][721:1000, 227:240]
    number = int(np.bincount(window[window > 0]).argmax())
    pipe = found.patches[number - 1]
    assert isinstance(pipe.grid.surface, Cylinder)
    assert pipe.grid.surface.radius == pytest.approx(0.0877, abs=0.0008)
    axis = found.world_from_reference.rotate(pipe.grid.surface.direction)
    assert abs(axis[2]) > 0.999
    assert pipe.source.fit.parameter_deviations()["radius"] < 0.0008


@pytest.mark.long
def test_pump_room_pipes_end_where_beams_passed():
    """The two risers end at the flanges of the pumps, below which the scanner looked past them."""
    found = completed("range/e57/pumpA.e57")
    pipes = [p for p in found.patches if p.limits.full_turn]
    assert sum(p.hypothesised_m2 for p in pipes) > 1.0
    for pipe in pipes:
        passed = np.count_nonzero(pipe.evidence.labels == Label.FREE, axis=1)
        through = passed > np.count_nonzero(pipe.evidence.is_own, axis=1)
        assert not pipe.hypothesised[through].any()


@pytest.mark.long
def test_pump_room_floor_runs_on_under_the_pumps():
    found = completed("range/e57/pumpA.e57")
    floors = [p for p in found.patches if p.limits.encloses and _up(found, p) > 0.99]
    assert sum(p.hypothesised_m2 for p in floors) > 1.0


def _up(found: Completion, patch) -> float:
    if not isinstance(patch.grid.surface, Plane):
        return 0.0
    return float(found.world_from_reference.rotate(patch.grid.surface.normal_direction)[2])


def test_office_has_two_walls_across_each_other_and_a_floor_that_runs_on():
    found = completed("range/pcl/office1.pcd")
    planes = [p for p in found.patches if isinstance(p.grid.surface, Plane)]
    large = sorted(planes, key=lambda p: -p.observed_m2)[:4]
    normals = np.array([p.grid.surface.normal_direction for p in large])
    level = np.abs(normals[:, 1]) > 0.95  # the camera was held level
    upright = np.abs(normals[:, 1]) < 0.1
    assert level.sum() == 1
    assert np.abs(normals[upright] @ normals[upright].T).min() < np.sin(np.radians(20))
    assert large[int(np.argmax(level))].hypothesised_m2 > 0.3


@pytest.mark.long
def test_living_room_walls_are_square_and_go_on_behind_the_lamp():
    found = completed("range/icl_nuim#1")
    walls = [p for p in found.patches if p.limits.encloses][:3]
    assert len(walls) == 3
    normals = np.array([p.grid.surface.normal_direction for p in walls])
    np.testing.assert_allclose(np.abs(normals @ normals.T), np.eye(3), atol=0.01)
    assert sum(p.hypothesised_m2 for p in walls) > 1.0
