# SPDX-License-Identifier: MIT
"""A lidar of 16 beams carried through a box: its walls are found, and no beam crosses what is inferred."""

import numpy as np
import pytest

from benchmarks.metrics.free_space import violation_of_beams
from completion import CompletionOptions, complete
from scenes.io.point_files import PointCloud
from scenes.io.track import Trajectory
from scenes.io.walk import walk_of
from scenes.surfaces.catalogue import Plane
from tests.helpers.walks import SIZE, walk_through_box

SIGMA_M = 0.02


@pytest.mark.parametrize("times", [1.0, 4.0])
def test_walls_of_a_box_are_found_by_stretches(times: float) -> None:
    walked = walk_through_box(seconds=0.3, sigma_m=SIGMA_M)
    cloud = PointCloud(walked.points, times=walked.times, name="walk")
    track = Trajectory(walked.track_times, walked.track_places)
    chosen, _ = walk_of(cloud, track)
    walk, _ = walk_of(cloud, track, times * chosen.reach_m)
    options = CompletionOptions(texture=False)
    completed = complete([walk.scan(k) for k in range(len(walk.cuts))], options, rng=0)
    world, n_walls = completed.world_from_reference, 0
    for patch in completed.patches:
        plane = patch.source.fit.surface
        if isinstance(plane, Plane) and patch.observed_m2 > 1:
            normal = world.rotate(plane.normal(np.zeros((1, 3)))[0])
            height = abs(normal @ world.apply(plane.point[None])[0])
            axis = int(np.argmax(np.abs(normal)))
            assert np.abs(normal[axis]) > np.cos(np.radians(1))
            assert min(abs(height), abs(height - SIZE[axis])) < SIGMA_M / 2
            n_walls += 1
    assert n_walls == 4
    found = violation_of_beams(completed, walked.origins, walked.points, SIGMA_M, options)
    assert found.area_m2 == 0
