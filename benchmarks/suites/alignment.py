# SPDX-License-Identifier: MIT
"""Registration beside other libraries, from turned starts, of places that look alike, and wall thickness."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.cases.pairs import CAMERA, OBJECTS, Room, Thing, is_right, is_right_of_objects, overlap
from benchmarks.run import head, suite
from completion.registration.motions import compose
from completion.registration.network import ScanGroup, settle_group
from completion.registration.pipeline import LEVEL, register_scans
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_VOXELS_M = (0.05, 0.08, 0.12)
_TUNED_ON = (9000, 7)  # first room, rooms; three pairs each
_BINS = ((0.1, 0.2), (0.2, 0.4), (0.4, 1.0))
_OFF_DEG, _OFF_M = 5.0, 0.2

Peer = Callable[[FloatArray, FloatArray, float], FloatArray]
"""From points (n, 3) that stay and (m, 3) that move, and a voxel's side, to a motion (3, 4)."""


@suite("peers", smallest="--rooms 1")
def peers(first: int = 9900, rooms: int = 20) -> Iterator[str]:
    """Registration of pairs of rooms by other libraries (Open3D, KISS-Matcher, small_gicp), and ours."""
    n_rooms = rooms
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


def _cloud(points: FloatArray, voxel_m: float) -> tuple[Any, Any]:
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


TURNS_DEG = (5, 10, 20, 40, 60, 90, 180)
_APART_DEG = 30.0  # of the two scans
_DISTANCES_M = (0.01, 0.02, 0.05)
_TUNED_ON_OF_STARTS = 3000  # seed


@suite("starts", smallest="--pairs 1")
def starts(first: int = 60, pairs: int = 4) -> Iterator[str]:
    """Objects from starts that are turned, beside ICP of Open3D."""
    n_pairs = pairs
    tuning, given_pairs = _pairs_of_starts(_TUNED_ON_OF_STARTS, 2), _pairs_of_starts(first, n_pairs)
    rng = np.random.default_rng([first, 9])
    best = max(
        _DISTANCES_M,
        key=lambda far: sum(
            is_right_of_objects(_icp(a, b, _start(a, b, 20.0, np.random.default_rng(1)), far), a, b)
            for a, b in tuning
        ),
    )
    yield f"ICP within {best:g} m; {len(given_pairs)} pairs {_APART_DEG:.0f} degrees apart"
    yield from head("start turned by, deg", "ICP right", "best pose right", "claimed")
    for turn in TURNS_DEG:
        counts = np.zeros(3, np.int64)
        for a, b in given_pairs:
            start = _start(a, b, float(turn), rng)
            counts[0] += is_right_of_objects(_icp(a, b, start, best), a, b)
            given = [a.with_facts(world_from_sensor=Pose.identity()), b.with_facts(world_from_sensor=start)]
            found = register_scans(given, level=LEVEL, started=True, n_threads=1)
            pose, (told,) = found.pose_of(1), found.pairs
            motions = told.alternatives if pose is None else pose[None]
            counts[1] += len(motions) > 0 and is_right_of_objects(motions[0], a, b)
            counts[2] += pose is not None
        yield f"| {turn} | {counts[0]} | {counts[1]} | {counts[2]} |"


def _pairs_of_starts(first: int, n_pairs: int) -> list[tuple[RangeImage, RangeImage]]:
    rng = np.random.default_rng([first, 30])
    return [Thing(name).pair(_APART_DEG, rng) for name in OBJECTS for _ in range(n_pairs)]


def _start(a: RangeImage, b: RangeImage, turn_deg: float, rng: np.random.Generator) -> Pose:
    """The true pose of b to a, turned about the middle of what b saw."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(turn_deg) * axis / np.linalg.norm(axis)).as_matrix()
    middle = true.apply(_points_of_starts(b)).mean(axis=0)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn, middle - turn @ middle
    return Pose(motion) @ true


def _points_of_starts(scan: RangeImage) -> FloatArray:
    return scan.points_in_sensor()[scan.valid]


def _icp(a: RangeImage, b: RangeImage, start: Pose, far_m: float) -> FloatArray:
    import open3d

    clouds = []
    for scan in (a, b):
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(_points_of_starts(scan)))
        cloud = cloud.voxel_down_sample(0.002)
        cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=0.008, max_nn=30))
        clouds.append(cloud)
    registration = open3d.pipelines.registration
    found = registration.registration_icp(
        clouds[1], clouds[0], far_m, start.matrix, registration.TransformationEstimationPointToPlane(),
        registration.ICPConvergenceCriteria(max_iteration=200),
    )  # fmt: skip
    return np.asarray(found.transformation)[:3]


_LENGTH_M, _DOORS_M = 40.0, 3.0
_FREE_M = 0.4  # around the camera
_SHARED = 0.1  # overlap of two scans


@suite("alike", smallest="--places 1")
def alike(first: int = 0, places: int = 40) -> Iterator[str]:
    """Corridors that determine no shift along themselves, and rooms that are their own image under a turn."""
    n_places = places
    yield from head(
        "place | pairs | right claims | false claims | slides | axis within 5 deg | ambiguous, truth among "
        "them | ambiguous | no overlap shown"
    )
    for kind, make in (("bare corridor", _bare), ("corridor with niches", _niched)):
        yield _row(kind, [make(np.random.default_rng([first + k, 1])) for k in range(n_places)])
    for kind, turns in (("half turn", 2), ("quarter turn", 4)):
        pairs = [_symmetric(np.random.default_rng([first + k, turns]), turns) for k in range(n_places)]
        shared = [overlap(a, b) >= _SHARED for a, b, _ in pairs]
        yield _row(kind, [one for one, met in zip(pairs, shared, strict=True) if met])
        yield _row(f"{kind}, less shared", [one for one, met in zip(pairs, shared, strict=True) if not met])


def _row(kind: str, pairs: list[tuple[RangeImage, RangeImage, FloatArray | None]]) -> str:
    counts = dict.fromkeys(("right", "false", "slides", "axis", "among", "ambiguous", "none"), 0)
    for a, b, axis in pairs:
        found = register_scans([a, b], level=LEVEL, n_threads=1)
        (told,) = found.pairs
        pose = found.pose_of(1)
        if pose is not None:
            counts["right" if is_right(pose, a, b) else "false"] += 1
        elif told.verdict is Verdict.SLIDES and told.direction is not None:
            counts["slides"] += 1
            along = a.world_from_sensor.rotation @ told.direction
            counts["axis"] += axis is not None and abs(float(along @ axis)) > np.cos(np.radians(5.0))
        elif told.verdict is Verdict.AMBIGUOUS:
            counts["ambiguous"] += 1
            counts["among"] += any(is_right(one, a, b) for one in told.alternatives)
        else:
            counts["none"] += 1
    return f"| {kind} | {len(pairs)} | " + " | ".join(str(one) for one in counts.values()) + " |"


def _bare(rng: np.random.Generator) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    return _corridor(rng, [])


def _niched(rng: np.random.Generator) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    at = np.arange(-_LENGTH_M / 2 + 1.0, _LENGTH_M / 2 - 1.0, _DOORS_M)
    return _corridor(rng, at.tolist())


def _corridor(
    rng: np.random.Generator, doors: list[float]
) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    """Two scans of a corridor along x."""
    width, height = rng.uniform(1.4, 2.6), rng.uniform(2.3, 3.0)
    parts = [_room(_LENGTH_M, width, height)]
    for x in doors:  # frames that stand out by 8 cm, on both sides
        parts += [
            _box([0.1, 0.08, 2.1], [x + shift, side * (width / 2 - 0.04), 1.05])
            for side in (-1, 1)
            for shift in (-0.5, 0.5)
        ]
    caster = _Caster(parts)
    scans: list[RangeImage] = []
    x = rng.uniform(-4, 4)
    for number in range(2):
        eye = [x + number * rng.uniform(0.5, 4.0), rng.uniform(-0.3, 0.3) * width, rng.uniform(1.2, 1.8)]
        way = np.array([1.0, rng.uniform(-0.35, 0.35), rng.uniform(-0.3, 0.1)])
        scans.append(caster.scan(eye, way, rng))
    return scans[0], scans[1], np.array([1.0, 0.0, 0.0])


def _symmetric(rng: np.random.Generator, turns: int) -> tuple[RangeImage, RangeImage, FloatArray | None]:
    """Two scans of a room that is its own image under a turn about its middle."""
    length, width = rng.uniform(3.5, 7.0), rng.uniform(3.0, 6.0)
    if turns == 4:
        width = length
    parts = [_room(length, width, rng.uniform(2.3, 3.0))]
    for _ in range(int(rng.integers(2, 6))):
        size = rng.uniform([0.2, 0.2, 0.3], [0.9, 0.9, 2.0])
        place = np.array([*(rng.uniform(-0.5, 0.5, 2) * [length - 1, width - 1]), size[2] / 2])
        turned = trimesh.transformations.rotation_matrix(rng.uniform(0, np.pi), [0, 0, 1])
        for k in range(turns):
            box = trimesh.creation.box(size)
            box.apply_transform(turned)
            box.apply_translation(place)
            box.apply_transform(trimesh.transformations.rotation_matrix(2 * np.pi * k / turns, [0, 0, 1]))
            parts.append(box)
    caster, scans = _Caster(parts), list[RangeImage]()
    azimuth = rng.uniform(0, 2 * np.pi)
    while len(scans) < 2:
        eye = np.array([*(rng.uniform(-0.5, 0.5, 2) * [length - 0.8, width - 0.8]), rng.uniform(1.2, 1.8)])
        if caster.is_tight(eye):
            continue
        turn = azimuth + len(scans) * np.radians(rng.uniform(30, 90))
        scans.append(caster.scan(eye, np.array([np.cos(turn), np.sin(turn), rng.uniform(-0.3, 0.1)]), rng))
    return scans[0], scans[1], None


class _Caster:
    """A place, and the camera in it."""

    def __init__(self, parts: list[trimesh.Trimesh]) -> None:
        self.scene = Scene.from_mesh(trimesh.util.concatenate(parts), mode="room")
        self.caster = RayCaster(self.scene.mesh.vertices, self.scene.mesh.faces)

    def is_tight(self, eye: FloatArray) -> bool:
        """Tell whether something stands close to a place (3,)."""
        around = np.random.default_rng(0).normal(size=(200, 3))
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        return bool(self.caster.first_hit(np.tile(eye, (200, 1)), around).ranges.min() < _FREE_M)

    def scan(self, eye: FloatArray | list[float], way: FloatArray, rng: np.random.Generator) -> RangeImage:
        """Take a scan from a place (3,) along a direction (3,)."""
        pose = Pose.looking_at(np.asarray(eye), np.asarray(eye) + way)
        return scan_scene(
            self.scene, pose, CAMERA, noise="gaussian-2mm", rng=int(rng.integers(2**31)), truth=False,
            caster=self.caster,
        )  # fmt: skip


def _room(length: float, width: float, height: float) -> trimesh.Trimesh:
    """A box seen from within, its floor at z = 0, x and y about its middle, metres."""
    box = _box([length, width, height], [0.0, 0.0, height / 2])
    box.invert()
    return box


def _box(size: list[float], place: list[float]) -> trimesh.Trimesh:
    box = trimesh.creation.box(size)
    box.apply_translation(place)
    return box


_SCANNER = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=480, height=160
)
NOISES = ("gaussian-2mm", "gaussian-10mm")
_SAME_M, _SIDE_M = 1e-3, 0.15  # of true places on a side; points nearer than that to its border do not count
_OFF_DEG, _OFF_M = 1.0, 0.03


class TwoRooms:
    """Two furnished rooms with a wall between them, by their seed; x leads from one to the other.

    `thickness_m`: of the wall, whose sides face along x, its middle at x = 0. `scans`: of six stations, with
    their true poses.
    """

    def __init__(self, seed: int, noise: str) -> None:
        rng = np.random.default_rng([242, seed])
        self.thickness_m = float(rng.uniform(0.08, 0.3))
        self.left, self.right = rng.uniform(3.5, 6.0, 2)
        self.width, self.height = rng.uniform(3.0, 4.5), rng.uniform(2.4, 2.9)
        self.door = float(rng.uniform(1.0, self.width - 1.0))
        parts = [*self._walls(), *self._furniture(rng)]
        scene = Scene.from_mesh(trimesh.util.concatenate(parts), mode="room")
        caster = RayCaster(scene.mesh.vertices, scene.mesh.faces)
        half = self.thickness_m / 2
        places = [-half - 0.8 * self.left, -half - 0.5 * self.left, -half - 0.5]
        places += [half + 0.5, half + 0.5 * self.right, half + 0.8 * self.right]
        self.scans: list[RangeImage] = []
        for x in places:
            aside = rng.uniform(-0.15, 0.15) if abs(x) < 1 else rng.uniform(-0.5, 0.5)
            eye = np.array([x, self.door + aside, rng.uniform(1.4, 1.7)])
            turn = rng.uniform(0, 2 * np.pi)
            pose = Pose.looking_at(eye, eye + [np.cos(turn), np.sin(turn), 0.0])
            self.scans.append(
                scan_scene(scene, pose, _SCANNER, noise=noise, rng=int(rng.integers(2**31)), caster=caster)
            )

    def _walls(self) -> list[trimesh.Trimesh]:
        """What encloses both rooms, and the wall between them around its doorway."""
        half, w, h = self.thickness_m / 2, self.width, self.height
        low, high = -half - self.left, half + self.right
        return [
            _block([low, -0.1, -0.1], [high, w + 0.1, 0.0]),
            _block([low, -0.1, h], [high, w + 0.1, h + 0.1]),
            _block([low, -0.1, 0.0], [high, 0.0, h]),
            _block([low, w, 0.0], [high, w + 0.1, h]),
            _block([low - 0.1, 0.0, 0.0], [low, w, h]),
            _block([high, 0.0, 0.0], [high + 0.1, w, h]),
            _block([-half, 0.0, 0.0], [half, self.door - 0.45, h]),
            _block([-half, self.door + 0.45, 0.0], [half, w, h]),
            _block([-half, self.door - 0.45, 2.05], [half, self.door + 0.45, h]),
        ]

    def _furniture(self, rng: np.random.Generator) -> Iterator[trimesh.Trimesh]:
        """Four boxes a room along its long walls."""
        half = self.thickness_m / 2
        for low, high in ((-half - self.left, -half), (half, half + self.right)):
            for k in range(4):
                size = rng.uniform([0.3, 0.2, 0.4], [0.8, 0.45, 1.6])
                x = rng.uniform(low + 0.2, high - 0.2 - size[0])
                y = 0.0 if k % 2 else self.width - size[1]
                yield _block([x, y, 0.0], [x + size[0], y + size[1], size[2]])

    def thickness_of(self, poses: Sequence[FloatArray]) -> float:
        """Return how thick the wall is where the scans stand at poses (3, 4) to the first, metres."""
        first = self.scans[0].world_from_sensor.matrix[:3]
        found = []
        for sign in (-1.0, 1.0):
            points = []
            for scan, pose in zip(self.scans, poses, strict=True):
                if sign * scan.world_from_sensor.translation[0] < 0:
                    continue
                true = scan.true_points()
                with np.errstate(invalid="ignore"):
                    own = scan.valid & (np.abs(true[..., 0] - sign * self.thickness_m / 2) < _SAME_M)
                    own &= (np.abs(true[..., 1] - self.door) > 0.45 + _SIDE_M) | (
                        true[..., 2] > 2.05 + _SIDE_M
                    )
                place = compose(first, pose)
                points.append(scan.points_in_sensor()[own] @ place[:, :3].T + place[:, 3])
            found.append(_plane(np.concatenate(points)))
        (normal_a, middle_a), (normal_b, middle_b) = found
        normal = normal_a + np.sign(normal_a @ normal_b) * normal_b
        normal /= np.linalg.norm(normal)
        at = np.array([0.0, self.width / 2, self.height / 2])
        near, far = (
            ((middle - at) @ own) / (own @ normal)
            for own, middle in ((normal_a, middle_a), (normal_b, middle_b))
        )
        return float(abs(far - near))


@suite("thickness", smallest="--places 1")
def thickness(first: int = 0, places: int = 20) -> Iterator[str]:
    """A wall seen from the rooms on its two sides: its thickness by scans placed in sequence and jointly."""
    n_places = places
    yield from head(
        "noise", "placed", "thickness off, rms mm", "median mm", "worst mm", "last pose off, median mm"
    )
    for noise in NOISES:
        errors: dict[str, list[tuple[float, float]]] = {}
        for seed in range(first, first + n_places):
            place = TwoRooms(seed, noise)
            true = [
                (place.scans[0].world_from_sensor.inverse() @ one.world_from_sensor).matrix[:3]
                for one in place.scans
            ]
            for name, poses in placements(place, np.random.default_rng([seed, 3])).items():
                off = abs(place.thickness_of(poses) - place.thickness_m)
                errors.setdefault(name, []).append((off, float(np.linalg.norm((poses[-1] - true[-1])[:, 3]))))
        for name, several in errors.items():
            off, last = 1000 * np.array(several).T
            yield (
                f"| {noise} | {name} | {np.sqrt(np.square(off).mean()):.2f} | {np.median(off):.2f} "
                f"| {off.max():.2f} | {np.median(last):.2f} |"
            )


def placements(place: TwoRooms, rng: np.random.Generator) -> Mapping[str, list[FloatArray]]:
    """Return poses (3, 4) of the stations to the first by each way of placing them."""
    views = [StationView.of(one) for one in place.scans]
    n = len(views)
    starts = [
        (one.world_from_sensor.inverse() @ two.world_from_sensor @ _off(rng)).matrix[:3]
        for one, two in zip(place.scans, place.scans[1:], strict=False)
    ]
    chain = [np.eye(4)[:3]]
    for k, start in enumerate(starts):
        pair = settle_group(ScanGroup({0: chain[0], 1: start}), views[k : k + 2])
        chain.append(compose(chain[-1], pair.group.poses[1]))
    joint = settle_group(ScanGroup(dict(enumerate(chain))), views)
    by_planes = settle_group(ScanGroup(dict(enumerate(chain))), views, by_planes=True)
    return {
        "true poses": [
            (place.scans[0].world_from_sensor.inverse() @ one.world_from_sensor).matrix[:3]
            for one in place.scans
        ],
        "one after another": chain,
        "jointly": [joint.group.poses[k] for k in range(n)],
        "jointly, with planes": [by_planes.group.poses[k] for k in range(n)],
    }


def _off(rng: np.random.Generator) -> Pose:
    """A motion by a degree and 3 cm."""
    axis, way = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(_OFF_DEG) * axis).as_matrix()
    matrix[:3, 3] = _OFF_M * way
    return Pose(matrix)


def _plane(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal (3,) and middle (3,) of the plane of points (n, 3)."""
    middle = points.mean(axis=0)
    return np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0], middle


def _block(low: Sequence[float] | FloatArray, high: Sequence[float] | FloatArray) -> trimesh.Trimesh:
    """A box from corner to corner, metres."""
    low, high = np.asarray(low), np.asarray(high)
    box = trimesh.creation.box(high - low)
    box.apply_translation((low + high) / 2)
    return box
