# SPDX-License-Identifier: MIT
"""A spinning lidar carried through a box, and the files that such walks are kept in."""

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np

from benchmarks.cases.spinning import SpinningLidar, carry
from scenes.checks import FloatArray

SIZE = np.array([6.0, 4.0, 2.6])
_PATH = np.array([[1.0, 1.0, 1.4], [5.0, 1.0, 1.4], [5.0, 3.0, 1.4], [1.0, 3.0, 1.4], [1.0, 1.0, 1.4]])
_LIDAR = SpinningLidar(n_firings=450)


@dataclass(frozen=True)
class Walked:
    """Points in the order of their times, where each was measured from, and the trajectory at 100 Hz."""

    times: FloatArray
    points: FloatArray
    origins: FloatArray
    track_times: FloatArray
    track_places: FloatArray

    def some(self, seconds: float) -> "Walked":
        """The points of the first seconds."""
        n = int(np.searchsorted(self.times, seconds))
        return Walked(self.times[:n], self.points[:n], self.origins[:n], self.track_times, self.track_places)

    def box_distance(self, points: FloatArray) -> FloatArray:
        """How far points (n, 3) are from the nearest wall, metres."""
        return np.asarray(np.minimum(np.abs(points), np.abs(SIZE - points)).min(axis=1))


def cast_at_box(origins: FloatArray, rays: FloatArray) -> FloatArray:
    """Ranges (n,) of the inside of the box."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum(-origins / rays, (SIZE - origins) / rays).min(axis=1))


def walk_through_box(
    *, seconds: float, speed_m_s: float = 1.2, sigma_m: float = 0.02, rng: int = 0
) -> Walked:
    """Carry a lidar of 16 beams along the walls."""
    lidar = SpinningLidar(n_firings=_LIDAR.n_firings, sigma_m=sigma_m)
    held = carry(
        lidar, cast_at_box, _PATH, speed_m_s=speed_m_s, seconds=seconds, rng=np.random.default_rng(rng)
    )
    times = np.arange(0.0, seconds + 0.01, 0.01)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(_PATH, axis=0), axis=1)))
    places = np.stack([np.interp(times * speed_m_s, length, axis) for axis in _PATH.T], axis=-1)
    return Walked(*held, times, places)


def write_timed_las(path: Path, points: FloatArray, times: FloatArray) -> Path:
    """Write points with GPS times."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 1e-4)
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.gps_time = times
    data.write(str(path))
    return path


def write_tum(path: Path, times: FloatArray, places: FloatArray) -> None:
    """Write a TUM trajectory without turns."""
    rows = np.column_stack([times, places, np.tile([0, 0, 0, 1.0], (len(times), 1))])
    np.savetxt(path, rows, fmt="%.9f")
