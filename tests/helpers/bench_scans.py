# SPDX-License-Identifier: MIT
"""Frames of the benchmark instances, and what a built-in scene gives for the same rays."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.world.scene import Scene
from tests.helpers.data_paths import bench_path

SIGMA_M = 0.002


@dataclass(frozen=True)
class BenchFrames:
    """All frames of one instance: ranges in metres (NaN for none), surface ids and poses."""

    projection: PinholeProjection
    ranges: FloatArray
    surface: NDArray[np.int8]
    poses: tuple[Pose, ...]


@cache
def bench_frames(name: str) -> BenchFrames:
    data = np.load(bench_path(f"{name}.npz"))
    fx, fy, cx, cy = (float(value) for value in data["intrinsics"])
    ranges = np.where(data["range_tenth_mm"] > 0, data["range_tenth_mm"] / 1e4, np.nan)
    height, width = ranges.shape[1:]
    projection = PinholeProjection(width, height, fx, fy, cx, cy)
    return BenchFrames(projection, ranges, data["surface"], tuple(map(Pose, data["world_from_sensor"])))


def cast(scene: Scene, pose: Pose, projection: PinholeProjection) -> tuple[FloatArray, NDArray[np.int32]]:
    """Noise-free ranges and surface ids (-1 for none) of the built-in scene."""
    rays = pose.rotate(projection.directions()).reshape(-1, 3)
    hits = scene.ray_caster().first_hit(pose.translation[None], rays)
    surface = np.where(hits.hit, scene.mesh.face_surface[hits.face], -1)
    return hits.ranges.reshape(projection.shape), surface.reshape(projection.shape).astype(np.int32)
