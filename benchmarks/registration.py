# SPDX-License-Identifier: MIT
"""Registration from any start: how often it is right, and how often it claims what is not so.

Furnished rooms of fresh seeds are seen by a camera of 75 degrees and 320 x 240 pixels with 2 mm of noise,
from random places 1.2 to 1.8 m above the floor, towards the middle of the room give or take 60 degrees. Right
is within 3 degrees and 10 cm of the truth.

    python -m benchmarks.registration pairs [FIRST] [ROOMS]
    python -m benchmarks.registration joint [FIRST] [ROOMS] [SCANS]

`pairs` takes three pairs of scans of each room that look 30 to 120 degrees apart: by overlap, the least share
of either scan's points that the other measured, it prints how often the best hypothesis is right, how often
the right one is claimed, how often the truth is among the alternatives where it is not, and wrong claims; and
the same of pairs of scans of different rooms. `joint` registers all scans of each room at once.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from benchmarks.completion.scenes.rooms import random_case
from completion.registration.hypotheses import Hypothesis, find_hypotheses
from completion.registration.pipeline import LEVEL, register_scans
from completion.registration.station_view import StationView
from completion.registration.verdict import Verdict, judge
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensors.sensor import PinholeSensor
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

CAMERA = PinholeSensor(fov_deg=75, width=320, height=240, max_range_m=12.0)
_SAME_M = 0.03  # difference of ranges of what both measured
_NEAR_M = 0.3  # around the camera, free
_TURN, _PLACE_M = 3.0, 0.1  # degrees and metres within which a pose is right
_BINS = (0.1, 0.2, 0.4, 1.0)


class Room:
    """A furnished room by its seed, and a photographer in it."""

    def __init__(self, seed: int) -> None:
        self.scene = random_case(seed).scene
        self.rng = np.random.default_rng([77, seed])
        self.caster = RayCaster(self.scene.mesh.vertices, self.scene.mesh.faces)
        self.size = np.minimum(self.scene.mesh.bounds()[1], [5.5, 5.0, 3.0])
        around = np.random.default_rng(0).normal(size=(200, 3))
        self._around = around / np.linalg.norm(around, axis=1, keepdims=True)

    def scan(self, towards: float | None = None) -> tuple[RangeImage, float]:
        """Take a scan towards an azimuth (radians), or the middle; return it with its azimuth."""
        while True:
            eye = np.array([*self.rng.uniform(0.4, self.size[:2] - 0.4), self.rng.uniform(1.2, 1.8)])
            if self.caster.first_hit(np.tile(eye, (200, 1)), self._around).ranges.min() < _NEAR_M:
                continue
            middle = self.size / 2 - eye
            own = np.arctan2(middle[1], middle[0]) + np.radians(self.rng.uniform(-60, 60))
            azimuth = own if towards is None else towards
            down = self.rng.uniform(-0.35, 0.1)
            look = [np.cos(azimuth) * np.cos(down), np.sin(azimuth) * np.cos(down), np.sin(down)]
            scan = scan_scene(
                self.scene, Pose.looking_at(eye, eye + look), CAMERA, noise="gaussian-2mm",
                rng=self.rng.integers(2**31), truth=False, caster=self.caster,
            )  # fmt: skip
            if scan.valid.mean() > 0.3:
                return scan, azimuth

    def pair(self) -> tuple[RangeImage, RangeImage]:
        """Take two scans that look 30 to 120 degrees apart."""
        first, azimuth = self.scan()
        turn = np.radians(self.rng.uniform(30, 120)) * self.rng.choice([-1, 1])
        return first, self.scan(azimuth + turn)[0]


def overlap(a: RangeImage, b: RangeImage) -> float:
    """Return the least share of either scan's points that the other one measured."""
    return min(_share(a, b), _share(b, a))


def _share(seer: RangeImage, seen: RangeImage) -> float:
    """The share of a scan's points that another one measured, on the same side of what they lie on."""
    grid = seen.points()
    normals = np.cross(np.gradient(grid, axis=1), np.gradient(grid, axis=0))[seen.valid][::7]
    points = grid[seen.valid][::7]
    ray, own = points - seer.world_from_sensor.translation, points - seen.world_from_sensor.translation
    faces = np.einsum("ij,ij->i", normals, ray) * np.einsum("ij,ij->i", normals, own) > 0
    distance = np.linalg.norm(ray, axis=1)
    pixel = seer.projection.pixels(ray @ seer.world_from_sensor.rotation)
    inside = np.isfinite(pixel).all(axis=1) & faces
    row, column = np.rint(pixel[inside]).astype(int).T
    met = seer.ranges[row.clip(0, seer.shape[0] - 1), column.clip(0, seer.shape[1] - 1)]
    return float(np.count_nonzero(np.abs(met - distance[inside]) < _SAME_M) / len(points))


def is_right(motion: FloatArray, a: RangeImage, b: RangeImage) -> bool:
    """Tell whether a motion (3, 4) of scan b into the frame of scan a is right."""
    true = a.world_from_sensor.inverse() @ b.world_from_sensor
    cosine = (np.trace(motion[:, :3].T @ true.rotation) - 1) / 2
    turn = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return turn < _TURN and float(np.linalg.norm(motion[:, 3] - true.translation)) < _PLACE_M


def pair_table(first: int, n_rooms: int) -> Iterator[str]:
    """Yield the lines of a table: pairs by overlap, and strangers."""
    rows: list[tuple[float, list[Hypothesis], list[bool], float]] = []
    strangers: list[list[Hypothesis]] = []
    before: StationView | None = None
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        for _ in range(3):
            a, b = room.pair()
            shared = overlap(a, b)
            started = time.process_time()
            one, two = StationView.of(a), StationView.of(b)
            found = find_hypotheses(one, two)
            rows.append(
                (
                    shared,
                    found,
                    [is_right(each.motion, a, b) for each in found],
                    time.process_time() - started,
                )
            )
            if before is not None:
                strangers.append(find_hypotheses(before, two))
        before = one
    yield "| overlap | pairs | best is right | of these claimed | else truth among them | wrong claims |"
    yield "|---|---|---|---|---|---|"
    for low, high in pairwise(_BINS):
        own = [row for row in rows if low <= row[0] < high]
        claimed = [judge(row[1], LEVEL).verdict is Verdict.REGISTERED for row in own]
        best = [bool(row[2]) and row[2][0] for row in own]
        sure = sum(c and r for c, r in zip(claimed, best, strict=True))
        among = [any(row[2]) for row, c in zip(own, claimed, strict=True) if not c]
        wrong = sum(c and not r for c, r in zip(claimed, best, strict=True))
        yield (
            f"| {100 * low:.0f}-{100 * high:.0f} % | {len(own)} | {sum(best)} | {sure} "
            f"| {sum(among)} of {len(among)} | {wrong} |"
        )
    false = sum(judge(one, LEVEL).verdict is Verdict.REGISTERED for one in strangers)
    yield f"| strangers | {len(strangers)} | | | | {false} |"
    yield f"median {np.median([row[3] for row in rows]):.2f} CPU s a pair, segmentation included"


def joint_table(first: int, n_rooms: int, n_scans: int) -> Iterator[str]:
    """Yield the lines of a table: a room each, its groups, right and wrong poses in them."""
    yield "| room | groups | right | wrong | within 3 sd | by themselves | CPU s |"
    yield "|---|---|---|---|---|---|---|"
    total = np.zeros(4, np.int64)
    for seed in range(first, first + n_rooms):
        room = Room(seed)
        scans = [room.scan()[0] for _ in range(n_scans)]
        started = time.process_time()
        found = register_scans(scans, n_threads=1)
        spent = time.process_time() - started
        right = wrong = within = 0
        for network in found.groups:
            anchor, *others = network.group.poses
            for number in others:
                pose = network.group.poses[number]
                true = scans[anchor].world_from_sensor.inverse() @ scans[number].world_from_sensor
                covariance = found.covariance_of(number)
                assert covariance is not None
                off = np.abs(pose[:, 3] - true.translation) / np.sqrt(np.diag(covariance)[3:])
                right, wrong = (
                    right + is_right(pose, scans[anchor], scans[number]),
                    wrong + (not is_right(pose, scans[anchor], scans[number])),
                )
                within += int((off < 3).sum())
        alone = sum(found.group_of(k) is None for k in range(n_scans))
        sizes = " + ".join(str(len(one.group.poses)) for one in found.groups) or "none"
        told = f"{within} of {3 * (right + wrong)}"
        yield f"| {seed} | {sizes} | {right} | {wrong} | {told} | {alone} | {spent:.1f} |"
        total += [right, wrong, within, alone]
    placed = total[0] + total[1]
    yield f"| all | | {total[0]} | {total[1]} | {total[2]} of {3 * placed} | {total[3]} | |"


def main() -> None:
    """Print the table that is asked for."""
    words = sys.argv[1:] or ["pairs"]
    numbers = [int(word) for word in words[1:]]
    if words[0] == "joint":
        first, rooms, scans = (*numbers, *(9000, 20, 6)[len(numbers) :])
        lines = joint_table(first, rooms, scans)
    else:
        first, rooms = (*numbers, *(9000, 100)[len(numbers) :])
        lines = pair_table(first, rooms)
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
