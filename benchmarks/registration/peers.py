# SPDX-License-Identifier: MIT
"""Peers on the same pairs: FPFH with fast global registration and with RANSAC (Open3D), KISS-Matcher, GICP.

Each has one length, a voxel's side; of three the one is taken that is right most often on twenty pairs of
other rooms. GICP (small_gicp) starts from the truth turned by 5 degrees and shifted by 20 cm, and from none.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.registration.rooms import Room, is_right, overlap
from completion.registration.pipeline import register_scans
from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

_VOXELS_M = (0.05, 0.08, 0.12)
_TUNED_ON = (9000, 7)  # first room, rooms; three pairs each
_BINS = ((0.1, 0.2), (0.2, 0.4), (0.4, 1.0))
_OFF_DEG, _OFF_M = 5.0, 0.2

Peer = Callable[[FloatArray, FloatArray, float], FloatArray]
"""From points (n, 3) that stay and (m, 3) that move, and a voxel's side, to a motion (3, 4)."""


def peer_table(first: int, n_rooms: int) -> Iterator[str]:
    """Yield the lines of a table: for each peer how often it is right, by overlap, and its time."""
    tuning, pairs = _pairs(*_TUNED_ON), _pairs(first, n_rooms)
    own = [overlap(a, b) for a, b in pairs]
    bins = [[k for k, share in enumerate(own) if low <= share < high] for low, high in _BINS]
    yield (
        "| | voxel, m | right: "
        + " | ".join(
            f"{100 * low:.0f}-{100 * high:.0f} % ({len(some)} pairs)"
            for (low, high), some in zip(_BINS, bins, strict=True)
        )
        + " | median s a pair |"
    )
    yield "|---|---|" + "---|" * (len(_BINS) + 1)
    for name, peer in _PEERS.items():
        best = max(_VOXELS_M, key=lambda voxel: sum(_rights(peer, tuning, voxel)[0]))
        right, spent = _rights(peer, pairs, best)
        yield _line(name, f"{best:g}", right, bins, spent)
    right, spent = _rights(_gicp_from_near(pairs), pairs, 0.05)
    yield _line("small_gicp, from near the truth", "0.05", right, bins, spent)
    right, claimed, spent = _ours(pairs)
    yield _line("unseen, best hypothesis", "", right, bins, spent)
    yield _line("unseen, claimed", "", claimed, bins, spent)


def _line(name: str, voxel: str, right: list[bool], bins: list[list[int]], spent: list[float]) -> str:
    told = " | ".join(str(sum(right[k] for k in some)) for some in bins)
    return f"| {name} | {voxel} | {told} | {np.median(spent):.2f} |"


def _pairs(first: int, n_rooms: int) -> list[tuple[RangeImage, RangeImage]]:
    return [room.pair() for room in map(Room, range(first, first + n_rooms)) for _ in range(3)]


def _rights(
    peer: Peer, pairs: list[tuple[RangeImage, RangeImage]], voxel_m: float
) -> tuple[list[bool], list[float]]:
    right, spent = [], []
    for a, b in pairs:
        own, other = _points(a), _points(b)
        started = time.process_time()
        motion = peer(own, other, voxel_m)
        spent.append(time.process_time() - started)
        right.append(is_right(motion, a, b))
    return right, spent


def _points(scan: RangeImage) -> FloatArray:
    """The points (n, 3) of a scan in the sensor's frame, metres."""
    return np.asarray(scan.world_from_sensor.inverse().apply(scan.points()[scan.valid]))


def _ours(pairs: list[tuple[RangeImage, RangeImage]]) -> tuple[list[bool], list[bool], list[float]]:
    best, claimed, spent = [], [], []
    for a, b in pairs:
        started = time.process_time()
        found = register_scans([a, b], n_threads=1)
        spent.append(time.process_time() - started)
        pose, (told,) = found.pose_of(1), found.pairs
        first = pose if pose is not None else (told.alternatives[0] if len(told.alternatives) else None)
        best.append(first is not None and is_right(first, a, b))
        claimed.append(pose is not None and is_right(pose, a, b))
    return best, claimed, spent


def _cloud(points: FloatArray, voxel_m: float):
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)).voxel_down_sample(voxel_m)
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel_m, max_nn=30))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    near = open3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel_m, max_nn=100)
    return cloud, open3d.pipelines.registration.compute_fpfh_feature(cloud, near)


def _fast_global(stay: FloatArray, move: FloatArray, voxel_m: float) -> FloatArray:
    import open3d

    (one, features), (two, others) = _cloud(stay, voxel_m), _cloud(move, voxel_m)
    open3d.utility.random.seed(0)
    options = open3d.pipelines.registration.FastGlobalRegistrationOption(
        maximum_correspondence_distance=voxel_m
    )
    found = open3d.pipelines.registration.registration_fgr_based_on_feature_matching(
        two, one, others, features, options
    )
    return np.asarray(found.transformation)[:3]


def _ransac(stay: FloatArray, move: FloatArray, voxel_m: float) -> FloatArray:
    import open3d

    registration = open3d.pipelines.registration
    open3d.utility.random.seed(0)
    (one, features), (two, others) = _cloud(stay, voxel_m), _cloud(move, voxel_m)
    checkers = [
        registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
        registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel_m),
    ]
    found = registration.registration_ransac_based_on_feature_matching(
        two, one, others, features, mutual_filter=True, max_correspondence_distance=1.5 * voxel_m,
        estimation_method=registration.TransformationEstimationPointToPoint(False), ransac_n=3,
        checkers=checkers, criteria=registration.RANSACConvergenceCriteria(100_000, 0.999),
    )  # fmt: skip
    refined = registration.registration_icp(
        two, one, 1.5 * voxel_m, found.transformation, registration.TransformationEstimationPointToPlane()
    )
    return np.asarray(refined.transformation)[:3]


def _kiss(stay: FloatArray, move: FloatArray, voxel_m: float) -> FloatArray:
    import kiss_matcher

    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_m))
    found = matcher.estimate(move.astype(np.float32), stay.astype(np.float32))
    return np.concatenate(
        [np.asarray(found.rotation), np.asarray(found.translation).reshape(3, 1)], axis=1
    ).astype(np.float64)


def _gicp(stay: FloatArray, move: FloatArray, voxel_m: float, start: FloatArray | None = None) -> FloatArray:
    import small_gicp

    found = small_gicp.align(
        stay, move, np.eye(4) if start is None else start, registration_type="GICP",
        downsampling_resolution=voxel_m, max_correspondence_distance=10 * voxel_m, num_threads=1,
    )  # fmt: skip
    return np.asarray(found.T_target_source)[:3]


def _gicp_from_near(pairs: list[tuple[RangeImage, RangeImage]]) -> Peer:
    """GICP of the pairs in their order, each from near the truth."""
    rng, left = np.random.default_rng(5), iter(pairs)

    def aligned(stay: FloatArray, move: FloatArray, voxel_m: float) -> FloatArray:
        a, b = next(left)
        axis, way = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
        start = (a.world_from_sensor.inverse() @ b.world_from_sensor).matrix.copy()
        start[:3, :3] = Rotation.from_rotvec(np.radians(_OFF_DEG) * axis).as_matrix() @ start[:3, :3]
        start[:3, 3] += _OFF_M * way
        return _gicp(stay, move, voxel_m, start)

    return aligned


_PEERS: dict[str, Peer] = {
    "Open3D, FPFH and FGR": _fast_global,
    "Open3D, FPFH and RANSAC, ICP": _ransac,
    "KISS-Matcher": _kiss,
    "small_gicp, from none": _gicp,
}
