# SPDX-License-Identifier: MIT
"""Thickness: a wall seen from the rooms on its two sides, by scans placed one after another and jointly.

Two rooms share a wall of 8 to 30 cm with a doorway. Six stations lead from one end through the doorway to the
other. Each is placed to its predecessor, or all together by what all share, from 1 degree and 3 cm off. Each
side of the wall is the plane of all points on it from its own room; the thickness is their distance at the
wall's middle. What these points are of is known from the truth, so that poses alone are compared.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from completion.registration.motions import composed
from completion.registration.network import Group, settle_group
from completion.registration.station_view import StationView
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import SphericalSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

CAMERA = SphericalSensor(
    azimuth_span_deg=360, elevation_min_deg=-60, elevation_max_deg=60, width=480, height=160
)
NOISES = ("gaussian-2mm", "gaussian-10mm")
_SAME_M, _SIDE_M = 1e-3, 0.15  # of true places on a side; points nearer than that to its border do not count
_OFF_DEG, _OFF_M = 1.0, 0.03


class TwoRooms:
    """Two furnished rooms with a wall between them, by their seed; x leads from one to the other.

    Attributes
    ----------
    thickness_m : float
        Of the wall, whose sides face along x, its middle at x = 0.
    scans : list of RangeImage
        Of six stations, with their true poses.
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
                scan_scene(scene, pose, CAMERA, noise=noise, rng=rng.integers(2**31), caster=caster)
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
                place = composed(first, pose)
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


def thickness_table(first: int, n_places: int) -> Iterator[str]:
    """Yield the lines of a table: for each noise and way of placing how far off thickness and poses are."""
    yield "| noise | placed | thickness off, rms mm | median mm | worst mm | last pose off, median mm |"
    yield "|---|---|---|---|---|---|"
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
        pair = settle_group(Group({0: chain[0], 1: start}), views[k : k + 2])
        chain.append(composed(chain[-1], pair.group.poses[1]))
    joint = settle_group(Group(dict(enumerate(chain))), views)
    by_planes = settle_group(Group(dict(enumerate(chain))), views, by_planes=True)
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
