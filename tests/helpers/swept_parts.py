# SPDX-License-Identifier: MIT
"""Parts that are swept: an extruded plate and a turned shaft, and the part of their points by face."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.cases.profiles import SweptCase, TrueLoop, TrueSegment, ring_of, sampled
from completion.parts.part import Part
from completion.parts.pipeline import model_part
from scenes.pose import Pose

POSE = Pose.from_parts(Rotation.from_euler("xyz", (0.4, -0.7, 1.1)).as_matrix(), np.array([0.1, -0.2, 0.3]))
SIGMA_MM = 0.02


def plate() -> SweptCase:
    """60 x 40 x 15 mm with two round corners, a hole and a blind slot."""
    corners = np.array([(0, 0), (60, 0), (60, 40), (0, 40)], dtype=float)
    ring = ring_of(corners, [("sharp", 0), ("round", 8), ("round", 8), ("sharp", 0)])
    hole = TrueSegment(np.array([24.0, 28]), np.array([24.0, 28]), np.array([20.0, 28]), 4.0, 2 * np.pi)
    slot = [
        TrueSegment(np.array([20.0, 7]), np.array([40.0, 7])),
        TrueSegment(np.array([40.0, 7]), np.array([40.0, 17]), np.array([40.0, 12]), 5.0, np.pi),
        TrueSegment(np.array([40.0, 17]), np.array([20.0, 17])),
        TrueSegment(np.array([20.0, 17]), np.array([20.0, 7]), np.array([20.0, 12]), 5.0, np.pi),
    ]
    loops = (
        TrueLoop(tuple(ring), "outer", 0, 15),
        TrueLoop((hole,), "hole", 0, 15),
        TrueLoop(tuple(slot), "slot", 6, 15),
    )
    return SweptCase("extruded", loops, (), POSE)


def shaft() -> SweptCase:
    """Two steps with a fillet and a taper, solid."""
    corners = np.array([(0, 0), (0, 12), (20, 12), (20, 24), (45, 18), (45, 0)], dtype=float)[::-1]
    ring = ring_of(
        corners, [("sharp", 0), ("sharp", 0), ("sharp", 0), ("round", 5), ("sharp", 0), ("sharp", 0)]
    )
    faces = tuple(one for one in ring if max(one.start[1], one.end[1]) > 0)
    return SweptCase("revolved", (TrueLoop(faces, "turned"),), (), POSE)


def part_of(case: SweptCase, heights: tuple[float, ...] = ()) -> Part:
    """The part of a case, its points labelled by the face they are nearest to."""
    points = sampled(case, SIGMA_MM, 1)[::3]
    local = case.world.inverse().apply(points) * 1e3
    flat = local[:, :2] if case.kind == "extruded" else np.column_stack([local[:, 0], np.hypot(*local.T[1:])])
    off = [cKDTree(one.places(np.linspace(0, 1, 300))).query(flat)[0] for one in case.segments]
    off += [np.where(np.abs(local[:, 2] - height) < 0.1, 0.0, 9.0) for height in heights]
    return model_part(points, np.argmin(off, axis=0) + 1, relations=None)
