# SPDX-License-Identifier: MIT
"""Starts: how often pairs of objects come together from starts that are turned, beside ICP.

The start is the truth turned by so many degrees about the middle of what was seen, about any axis.
Registration is given the start and tries it beside its own candidates. ICP is point-to-plane (Open3D), at the
best of three distances on other pairs; open3d is to be installed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.registration.objects import OBJECTS, Thing, is_right
from completion.registration.pipeline import LEVEL, register_scans
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

TURNS_DEG = (5, 10, 20, 40, 60, 90, 180)
_APART_DEG = 30.0  # of the two scans
_DISTANCES_M = (0.01, 0.02, 0.05)
_TUNED_ON = 3000  # seed


def start_table(first: int, n_pairs: int) -> Iterator[str]:
    """Yield the lines of a table: for each turn of the start, right ones of ICP and of registration."""
    tuning, pairs = _pairs(_TUNED_ON, 2), _pairs(first, n_pairs)
    rng = np.random.default_rng([first, 9])
    best = max(
        _DISTANCES_M,
        key=lambda far: sum(
            is_right(_icp(a, b, _start(a, b, 20.0, np.random.default_rng(1)), far), a, b) for a, b in tuning
        ),
    )
    yield f"ICP within {best:g} m; {len(pairs)} pairs {_APART_DEG:.0f} degrees apart"
    yield "| start turned by, deg | ICP right | best pose right | claimed |"
    yield "|---|---|---|---|"
    for turn in TURNS_DEG:
        counts = np.zeros(3, np.int64)
        for a, b in pairs:
            start = _start(a, b, float(turn), rng)
            counts[0] += is_right(_icp(a, b, start, best), a, b)
            given = [a.restated(world_from_sensor=Pose.identity()), b.restated(world_from_sensor=start)]
            found = register_scans(given, level=LEVEL, started=True, n_threads=1)
            pose, (told,) = found.pose_of(1), found.pairs
            motions = told.alternatives if pose is None else pose[None]
            counts[1] += len(motions) > 0 and is_right(motions[0], a, b)
            counts[2] += pose is not None
        yield f"| {turn} | {counts[0]} | {counts[1]} | {counts[2]} |"


def _pairs(first: int, n_pairs: int) -> list[tuple[RangeImage, RangeImage]]:
    rng = np.random.default_rng([first, 30])
    return [Thing(name).pair(_APART_DEG, rng) for name in OBJECTS for _ in range(n_pairs)]


def _start(a: RangeImage, b: RangeImage, turn_deg: float, rng: np.random.Generator) -> Pose:
    """The true pose of b to a, turned about the middle of what b saw."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(turn_deg) * axis / np.linalg.norm(axis)).as_matrix()
    middle = true.apply(_points(b)).mean(axis=0)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn, middle - turn @ middle
    return Pose(motion) @ true


def _points(scan: RangeImage) -> FloatArray:
    return scan.points_in_sensor()[scan.valid]


def _icp(a: RangeImage, b: RangeImage, start: Pose, far_m: float) -> FloatArray:
    import open3d

    clouds = []
    for scan in (a, b):
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(_points(scan)))
        cloud = cloud.voxel_down_sample(0.002)
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=0.008, max_nn=30))
        clouds.append(cloud)
    registration = open3d.pipelines.registration
    found = registration.registration_icp(
        clouds[1], clouds[0], far_m, start.matrix, registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(max_iteration=200),
    )  # fmt: skip
    return np.asarray(found.transformation)[:3]
