# SPDX-License-Identifier: MIT
"""The room with two occluders, one view of it, and what that view covers."""

from functools import cache

import numpy as np

from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import measure_coverage
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")
VIEW = View(Pose.looking_at((0.5, 0.5, 1.5), (5, 4, 1)), PinholeSensor(fov_deg=70, width=64, height=48))


@cache
def covered_by_two() -> Coverage:
    """What `VIEW` covers where two places could be stood at."""
    candidates = Candidates(np.array([[0.5, 0.5, 1.5], [5, 4, 1.5]]), np.array([[1.0, 1, 0], [-1, -1, 0]]))
    return measure_coverage(ROOM, [VIEW], samples=sample_surface(ROOM.mesh, 0.3), candidates=candidates)
